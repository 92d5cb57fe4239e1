from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

PARTS = ("language", "files", "model", "search", "codegen", "analysis", "monitoring", "healing", "substitution", "cli", "ros", "ros.graph")

setup(
    **generate_distutils_setup(
        packages=["shsa_core"] + ["shsa_core." + name for name in PARTS],
        package_dir={"": "src"},
    )
)
