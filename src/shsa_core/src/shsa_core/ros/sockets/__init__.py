"""Connections to publishers, read by one thread as bytes: `subscriptions` is where to begin.

It takes each connection over from rospy (`connection`, cut into messages by `frames`), has the
master say whose it is (`identity`), tells a node that is gone from one that dropped a connection
(`reconnection`), and dates what has come (`arrival_times`). Of that `ros/reader` makes the events
of monitor and gate, `ros/inputs` those of a substitute: no core is known here.
"""
