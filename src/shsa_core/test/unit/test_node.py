"""The run of a node."""
import gc
import sys
from typing import Any, List

import rospy

from shsa_core.ros import node


class Nothing:
    def __call__(self, *_: object) -> "Nothing":
        return self

    def close(self) -> None:
        pass


def test_what_is_loaded_before_a_node_works_is_not_looked_through_for_garbage(
    monkeypatch: Any,
) -> None:
    ours = ("say_failures_once", "keep_rospys_threads", "serve_each_by_itself", "_log_plainly")
    for name in (*ours, "ask_once_for_rosout", "LogQueue"):
        monkeypatch.setattr(node, name, Nothing())
    for name in ("init_node", "signal_shutdown"):
        monkeypatch.setattr(rospy, name, Nothing())
    interval, frozen = sys.getswitchinterval(), []  # type: float, List[int]
    try:
        node.run("node", lambda: frozen.append(gc.get_freeze_count()))
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)
    assert frozen[0] > 10_000
