"""Connections to publishers, read by one thread as bytes: `subscriptions` is where to begin.

What happens is told as the monitor's events. Of messages `ros/reader` makes those of monitor and
gate, `ros/inputs` those of a substitute.
"""
