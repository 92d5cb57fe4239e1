"""A node without ROS, in a process of its own: `plain_node.py TOPICS KIND PORT`.

It says that it publishes TOPICS (comma-separated), and leaves when it is asked. KIND: how it
answers getPid, one of strange_nodes.NONSENSE or `pid NUMBER`; empty: rightly. The first line that
it prints is its address.
"""
import os
import signal
import socket
import subprocess
import sys
import time
from typing import List

from strange_nodes import NONSENSE, StrangeNode, value


class PlainNode:
    """A test's handle; `user`: whose process it is, empty for our own. `program`: a copy of us."""

    def __init__(
        self, topics: str, kind: str = "", port: int = 0, user: str = "", program: str = __file__
    ) -> None:
        words = ["setpriv", f"--reuid={user}", "--clear-groups"] if user else []
        words += [sys.executable, program, topics, kind, str(port)]
        path = os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")])
        variables = {**os.environ, "PYTHONPATH": path}
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, env=variables)
        assert self.process.stdout is not None
        self.uri = self.process.stdout.readline().decode().strip()

    @property
    def port(self) -> int:
        """The address at which it listens."""
        return int(self.uri.rstrip("/").rsplit(":", 1)[1])

    @property
    def runs(self) -> bool:
        """Return whether it still runs."""
        return self.process.poll() is None

    def stop(self) -> None:
        """Hang."""
        self.process.send_signal(signal.SIGSTOP)

    def end(self) -> None:
        """Kill it for certain."""
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def main(arguments: List[str]) -> None:
    """Run the node."""
    topics, kind, port = arguments
    number = int(kind[4:]) if kind.startswith("pid ") else os.getpid()
    answer = NONSENSE.get(kind) or value([1, "", number])

    def leave(caller: socket.socket) -> None:
        value([1, "", 1])(caller)
        os._exit(0)

    rows = [[topic, "std_msgs/Float64"] for topic in topics.split(",")]
    node = StrangeNode(
        value([-1, "there is no such method", 0]),
        int(port),
        getPid=answer,
        getPublications=value([1, "", rows]),
        shutdown=leave,
    )
    print(node.uri, flush=True)
    time.sleep(120.0)


if __name__ == "__main__":
    main(sys.argv[1:])
