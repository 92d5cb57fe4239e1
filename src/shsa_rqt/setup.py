from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(
    **generate_distutils_setup(
        packages=["shsa_rqt"],
        package_dir={"": "src"},
        package_data={"shsa_rqt": ["py.typed"]},
    )
)
