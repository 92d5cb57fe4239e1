"""Connections to publishers, read by one thread as bytes: `subscriptions` is where to begin.

It takes each connection over from rospy and cuts it into messages (`connection`), has the master
say whose it is (`identity`), and tells a node that is gone from one that dropped a connection
(`reconnection`). What happens is told as the monitor's events. Of messages `ros/reader` makes those
of monitor and gate, `ros/inputs` those of a substitute.
"""
