"""What rospy, the master and the operating system are made to do."""
