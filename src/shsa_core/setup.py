from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

PARTS = ("model", "search", "codegen", "analysis", "health", "healing", "cli", "ros")

setup(
    **generate_distutils_setup(
        packages=["shsa_core"] + ["shsa_core." + name for name in PARTS],
        package_dir={"": "src"},
    )
)
