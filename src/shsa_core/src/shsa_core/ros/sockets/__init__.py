"""Connections to publishers, read by one thread as bytes: `subscriptions` is where to begin.

It takes each connection over from rospy and cuts it into messages (`connection`), has the master
say whose it is (`identity`), and tells a node that is gone from one that dropped a connection
(`reconnection`). Of that `ros/reader` makes the events
of monitor and gate, `ros/inputs` those of a substitute: no core is known here.
"""
