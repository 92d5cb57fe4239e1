from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(
    **generate_distutils_setup(
        packages=["shsa_core", "shsa_core.cli", "shsa_core.ros"],
        package_dir={"": "src"},
    )
)
