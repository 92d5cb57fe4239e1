"""Mends rospy, each fault in a file of its own; see `node.run` for those that all nodes need.

test_rospy_patches.py has a test for each that fails once rospy has mended it: then it can go.
"""
