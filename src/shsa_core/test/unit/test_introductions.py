"""Introductions: new publishers that are looked at, and the subscribers that are told."""
from typing import Any, List, Tuple

import rosgraph

from shsa_core.ros.master import announce, node_api
from shsa_core.ros.master.announce import Introductions, Publisher
from shsa_core.ros.settings import INTRODUCTION_LOOKS, MASTER_LOOK_S

LOOKS_S = [looks * MASTER_LOOK_S for looks in INTRODUCTION_LOOKS]
OLD, NEW = Publisher("/x", "/a", "http://a:1/"), Publisher("/x", "/a", "http://a:2/")
OURS = Publisher("/shsa/health", "/monitor", "http://m:1/")


def looks(introductions: Introductions, until: float) -> list:
    """Return what is looked at when, in steps of 0.05 s."""
    steps = [step / 20 for step in range(round(until * 20) + 1)]
    return [(at, each) for at in steps for each in introductions.due(at)]


def test_who_was_there_before_is_known_to_all_but_whoever_asks_is_new() -> None:
    introductions = Introductions("/monitor")
    introductions.heed(0.0, frozenset({OLD, OURS}))
    assert looks(introductions, 10.0) == [(pause, OURS) for pause in LOOKS_S]


def test_a_node_that_is_started_again_is_new() -> None:
    introductions = Introductions("/monitor")
    introductions.heed(0.0, frozenset({OLD}))
    introductions.heed(1.0, frozenset({NEW}))
    introductions.heed(1.5, frozenset({NEW}))
    found = looks(introductions, 10.0)
    assert [each for _, each in found] == 3 * [NEW]
    assert [at for at, _ in found] == [1.0 + pause for pause in LOOKS_S]


def test_who_has_gone_is_not_looked_at() -> None:
    introductions = Introductions("/monitor")
    introductions.heed(0.0, frozenset())
    introductions.heed(1.0, frozenset({NEW}))
    introductions.heed(1.1, frozenset())
    assert not looks(introductions, 10.0)


def test_after_a_long_pause_there_is_one_look() -> None:
    introductions = Introductions("/monitor")
    introductions.heed(0.0, frozenset())
    introductions.heed(1.0, frozenset({NEW}))
    assert introductions.due(60.0) == [NEW] and not introductions.due(100.0)


class Master:
    """It has just told of nodes of which it knows some no more."""

    def getSystemState(self) -> Any:
        publishing = [["/x", ["/left", "/substitute"]], ["/y", ["/substitute"]]]
        return publishing, [["/x", ["/reader"]], ["/y", ["/left", "/reader"]]], []

    def lookupNode(self, node: str) -> str:
        if node == "/left":
            raise rosgraph.MasterError("unknown node [/left]")
        return f"http://here{node}:1/"


def test_who_has_just_left_keeps_nobody_from_being_reminded(monkeypatch: Any) -> None:
    told: List[Tuple[Any, ...]] = []
    for module in (announce, node_api):
        monkeypatch.setattr(module, "master_api", Master)
    monkeypatch.setattr(announce, "tell", lambda nodes, *what: told.append((list(nodes), *what)))
    announce.remind(["/x", "/y"], lambda topic: frozenset())
    reader, substitute = "http://here/reader:1/", "http://here/substitute:1/"
    assert told == [([reader], "/x", [substitute]), ([reader], "/y", [substitute])]
