"""Introductions: new publishers that are looked at, and the subscribers that are told."""
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
