"""An idle substitute's node, without a master: what it subscribes to at its start."""
import queue
from types import SimpleNamespace
from typing import Any

import pytest
import rospy
from shsa_msgs import msg

from shsa_core.model.substitution import Substitution
from shsa_core.ros import substitute
from shsa_core.ros.wire import names


def test_it_hears_of_failures_though_its_first_row_comes_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its row is there before the call that subscribes to the table is back."""
    subscribed: "queue.Queue[str]" = queue.Queue()
    row = msg.Substitution(node="/idle", service="a", code="t0=x[0];\ny=t0")
    row.inputs = [msg.Signal(topic="/in", type="std_msgs/Float64", field="data")]
    row.outputs = [msg.Signal(topic="/out", type="std_msgs/Float64", field="data")]

    def comes_at_once(topic: str, kind: Any, heard: Any, *_: object) -> None:
        heard(msg.Substitutions(substitutions=[row], whole=True))

    monkeypatch.setattr(substitute, "TableSubscriber", comes_at_once)
    monkeypatch.setattr(substitute, "SignedPublisher", lambda *_: SimpleNamespace(publish=None))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
    node: Any = substitute.SubstituteNode(Substitution("/idle", "", (), "", ()))
    node._signing = SimpleNamespace(
        checked=lambda topic, kind: kind, subscribe=lambda topic, *_: subscribed.put(topic)
    )
    node.spin()
    assert not node._idle
    assert subscribed.get(timeout=5.0) == names.FAILURES
