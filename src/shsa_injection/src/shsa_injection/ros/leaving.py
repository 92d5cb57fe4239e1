"""Ends a process that takes too long to leave: a master that is gone does not answer."""
import os
import threading

LONGEST_S = 2.0


def leave_in_time() -> None:
    """End this process after a while, whatever it waits for."""
    timer = threading.Timer(LONGEST_S, os._exit, args=(0,))
    timer.daemon = True
    timer.start()
