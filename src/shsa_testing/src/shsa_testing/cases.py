"""Runs the cases of a rostest."""
import unittest
from typing import Type

import rospy
import rostest
from rospy.impl import registration


def run_cases(package: str, name: str, cases: Type[unittest.TestCase]) -> None:
    """Run them as rostest does, in a node that ends at once: see shsa_core's `standing.py`."""
    registration.is_shutdown = rospy.core.is_shutdown_requested
    rostest.rosrun(package, name, cases)
