"""What rospy does otherwise here than as it was released."""
