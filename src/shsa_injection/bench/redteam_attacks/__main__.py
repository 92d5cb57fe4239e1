"""Attacks a robot in one way, and prints how often it was tried."""
import os
import sys
import time

from redteam_attacks import ATTACKS
from redteam_attacks.target import Target

if __name__ == "__main__":
    name, seconds, folder, innocent = sys.argv[1:]
    target = Target(folder, int(innocent))
    print(ATTACKS[name](target, time.monotonic() + float(seconds)), flush=True)
    os._exit(0)
