"""Attacks on what the robot keeps: its secret, its files, what it publishes of itself."""
import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import psutil

from redteam_attacks.target import Target


def files(target: Target, end: float) -> int:
    """Read and write what is the robot's: the secret, sockets of heartbeats, logs, memory."""
    count = 0
    while time.monotonic() < end:
        homes = [Path(f"/proc/{target.innocent}/cwd"), *Path("/tmp").glob("shsa_redteam_*")]
        for home in homes:
            for path in ("shsa/secret", "shsa", "log", "shsa_incidents.jsonl"):
                with suppress(OSError):
                    if home != Path(target.folder):
                        data = (home / path).read_bytes()
                        if path.endswith("secret") and data:
                            Path(target.folder, "ran").touch()
                with suppress(OSError):
                    if home != Path(target.folder):
                        os.symlink(f"{target.folder}/log", str(home / path))
                count += 2
        for process in psutil.process_iter():
            with suppress(OSError, psutil.Error):
                if process.uids().real == 4001:
                    count += 1
                    process.environ()
                    Path(target.folder, "ran").touch()  # nobody else's is to be had
        time.sleep(0.1)
    return count


def recordings(target: Target, end: float) -> int:
    """Record every topic, and keep every parameter: the secret may be in one of them."""
    words = ["rosbag", "record", "-a", "-O", f"{target.folder}/all.bag", "__name:=recording"]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(words, stdout=quiet, stderr=quiet, start_new_session=True)
    count = 0
    while time.monotonic() < end - 2.0:
        Path(target.folder, "parameters").write_text(str(target.master.getParam("/")), "utf-8")
        count += 1
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    try:
        process.wait(20.0)
    except subprocess.TimeoutExpired:  # it was not listening yet
        os.killpg(process.pid, signal.SIGKILL)
    return count + int(any(Path(target.folder).glob("all.bag*")))
