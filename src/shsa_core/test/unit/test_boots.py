"""Other computers: who is believed to be one of ours, and how far its clock can be from ours."""
import hashlib
import json
import random
import secrets
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any, Callable, Dict, List
from unittest.mock import patch

import pytest
import rosgraph
from hypothesis import given, strategies as st

from shsa_core.errors import ShsaError
from shsa_core.ros.master.node_api import Answer, BadAnswer
from shsa_core.ros.trust import signing
from shsa_core.ros.trust.signing import NONCE_B, challenge
from shsa_core.trust import proof
from shsa_core.trust.boots import (
    Boot,
    Met,
    MOST,
    MOST_FAILED,
    PAUSE_NS,
    RENEW_NS,
    TRIES,
    Boots,
)
from shsa_core.trust.proof import Place, Proof
from shsa_core.trust.seal import (
    AHEAD_NS,
    EARLY,
    FOREIGN,
    FUTURE,
    REPEATED,
    TWICE,
    UNPROVEN,
    Verifier,
    seal,
)

SECRET = bytes(range(32))
S, MS = 10**9, 10**6
MASTER = Place("", frozenset({"10.0.0.1"}), 11311)
ASLEEP = 3600 * S


def proved(
    node: str,
    call: Callable[..., Answer],
    master: Place = MASTER,
    find: Callable[[str], str] = lambda node: "http://x:1/",
    **others: Any,
) -> Met:
    """Return what a node proves that is found and called so."""
    api = SimpleNamespace(lookupNode=find)
    there: Dict[str, Any] = {"master_api": lambda: api, "ask_timed": call, **others}
    with patch.multiple(signing, master_seen=lambda: master, **there):
        return challenge(SECRET, node)


class World:
    """The true time in ns, and a link of which each way takes a while."""

    def __init__(self) -> None:
        self.now = 0
        self.there = self.back = lambda: MS
        self.nodes: Dict[str, "Robot"] = {}


class Robot:
    """One boot of a computer, with clocks of its own and one node."""

    def __init__(self, world: World, name: str, ahead: int = 0, ppm: float = 0.0) -> None:
        self.world, self.name = world, name
        self.ahead, self.ppm, self.wall_ahead = ahead, ppm, 0
        self.boot = hashlib.sha256(name.encode()).digest()[:16]
        self.secret, self.master = SECRET, MASTER
        self.answers: Callable[["Robot", str], Any] = Robot.proves
        self.asked = 0
        world.nodes[name] = self

    def clock(self) -> int:
        return self.world.now + self.ahead + int(self.world.now * self.ppm * 1e-6)

    def wall(self) -> int:
        return self.world.now + self.wall_ahead

    def proves(self, nonce: str) -> Any:
        told = Proof(self.boot, self.name, self.master, self.clock(), self.wall())
        return proof.written(self.secret, nonce, told)

    def says(self, text: bytes = b"text") -> bytes:
        """A signed message, sent now."""
        self.world.now += 1000
        signed = text + self.boot + self.clock().to_bytes(8, "little")
        return signed + seal(self.secret, self.boot, "/topic", signed)


class Reader(Robot):
    """A computer that reads a topic."""

    def __init__(self, world: World, ahead: int = 5 * S) -> None:
        super().__init__(world, "reader", ahead)
        self.has_master = True
        self.boots = Boots(self.boot, self.ask, self.clock)
        self.begin()

    def begin(self) -> None:
        """Begin to listen: nobody can be connected before a call has gone there and back."""
        self.verifier = Verifier(SECRET, "/topic", self.boots.find, self.clock)
        self.world.now += 10 * MS

    def ask(self, node: str) -> Met:
        """Ask for a proof by the clocks, the master and the link of this world."""
        clocks = SimpleNamespace(time_ns=self.wall, monotonic_ns=self.clock)
        return proved(node, self.call, self.master, find=self.find, time=clocks)

    def find(self, node: str) -> str:
        if not self.has_master or node not in self.world.nodes:
            raise rosgraph.MasterError("it is not registered")
        return f"http://{node}:1/"

    def call(self, uri: str, method: str, nonce: str) -> Answer:
        node = self.world.nodes.get(uri[7:-3])
        if node is None:
            raise ConnectionRefusedError
        node.asked += 1
        asked = self.clock()
        self.world.now += self.world.there()
        value = node.answers(node, nonce)
        self.world.now += self.world.back()
        return Answer(value, asked, self.clock())

    def hears(self, message: bytes, sender: str = "sender") -> str:
        """Why a message is refused, as a subscriber of ours finds it."""
        why = self.verifier.refusal(message)
        if why == UNPROVEN:
            boot = message[-56:-40]
            why = self.boots.refusal(boot, sender) or self.verifier.refusal(message)
        return why


CLOCKS = [(0, 0.0), (S * 10**9, 200.0), (-S * 10**9, -200.0), (7 * S, 100.0)]


@pytest.fixture(name="world")
def _world() -> World:
    world = World()
    world.now = 2 * S * 10**9
    return world


@pytest.mark.parametrize("ahead, ppm", CLOCKS)
def test_clocks_may_be_anywhere_and_drift(world: World, ahead: int, ppm: float) -> None:
    sender = Robot(world, "sender", ahead, ppm)
    world.now += 10 * MS
    before = sender.says()
    world.now += 10 * MS
    reader = Reader(world)
    world.now += 10 * MS
    first, *rest = (sender.says() for _ in range(20))
    assert reader.hears(first) == "" and sender.asked == 1
    assert reader.hears(first) == TWICE
    assert {reader.hears(each) for each in reversed(rest)} == {""}, "in whatever order it comes"
    assert reader.hears(before) == EARLY
    for _ in range(50):
        world.now += 600 * S
        message = sender.says()
        assert reader.hears(message) == ""
        world.now += 2 * S
        assert reader.hears(message) == REPEATED
    assert sender.asked == 1, "nobody is asked once it is known"


@pytest.mark.parametrize("ahead, ppm", CLOCKS)
def test_a_clock_is_told_within_its_bound_however_slow_the_link(
    world: World, ahead: int, ppm: float
) -> None:
    chance = random.Random(1)
    world.there = lambda: int(chance.expovariate(1.0) * 30 * MS)
    world.back = lambda: int(chance.expovariate(1.0) * 30 * MS)
    sender, reader = Robot(world, "sender", ahead, ppm), Reader(world)
    sender.wall_ahead = 3 * S
    reader.hears(sender.says())
    for pause in (PAUSE_NS, *(RENEW_NS,) * 99):
        world.now += pause
        reader.boots.renew()
        (seen,) = reader.boots.seen()
        assert abs(seen.ahead - 3 * S) <= seen.round_trip / 2
        computer = reader.boots.find(sender.boot)
        assert computer is not None
        for later in (0, 30, 3600):
            world.now += later * S
            assert sender.clock() <= computer.latest(reader.clock())
        assert abs(computer.ours(sender.clock()) - reader.clock()) < 2 * S
        assert reader.hears(sender.says()) == ""


def test_the_fastest_answer_tells_the_offset(world: World) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    world.there = lambda: 400 * MS
    reader.hears(sender.says())
    ways = iter([5 * MS, 1 * MS, 90 * MS])
    world.there = lambda: next(ways)
    world.now += PAUSE_NS
    asked = sender.asked
    for _ in range(9):
        reader.boots.renew()
    assert sender.asked == asked + TRIES, "not before the next renewal"
    (seen,) = reader.boots.seen()
    assert seen.round_trip == pytest.approx(2 * MS) and (seen.host, seen.address) == ("sender",) * 2


def test_a_computer_that_was_just_met_is_not_asked_again_at_once(world: World) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    assert reader.hears(sender.says()) == ""
    reader.boots.renew()
    assert sender.asked == 1
    world.now += PAUSE_NS
    reader.boots.renew()
    assert sender.asked == 1 + TRIES


def test_of_answers_that_are_as_fast_the_newest_counts() -> None:
    boot, first = Boot(b"boot"), Met(b"boot", "host", "address", 5, 0, asked=0, answered=10)
    newer = first._replace(clock=105, asked=100, answered=110)
    slower = first._replace(clock=205, asked=200, answered=211)
    for met in (first, newer, slower):
        boot.measured(met)
    assert boot.met is newer
    assert boot.was_compared(110) and not boot.was_compared(111)


def test_what_is_ahead_of_its_computer_is_refused(world: World) -> None:
    sender, reader = Robot(world, "sender", -(10**17)), Reader(world)
    assert reader.hears(sender.says()) == ""
    sender.ahead += AHEAD_NS + 100 * MS
    early = sender.says()
    sender.ahead -= AHEAD_NS + 100 * MS
    assert reader.hears(early) == UNPROVEN and sender.asked == 2, "it was asked again, and is wrong"
    assert reader.hears(sender.says()) == ""


def test_our_own_clock_needs_no_proof(world: World) -> None:
    reader = Reader(world)
    assert reader.hears(reader.says()) == "" and reader.asked == 0
    reader.ahead += AHEAD_NS + S
    ahead = reader.says()
    reader.ahead -= AHEAD_NS + S
    assert reader.hears(ahead) == FUTURE and reader.asked == 0


@pytest.mark.parametrize("asleep", ["reader", "sender"])
def test_a_computer_that_was_suspended_is_asked_again(world: World, asleep: str) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    assert reader.hears(sender.says()) == ""
    world.nodes[asleep].ahead -= ASLEEP
    world.now += ASLEEP  # its clock stands meanwhile
    assert reader.hears(sender.says()) == ""
    reader.begin()
    assert reader.hears(sender.says()) == "", "nor is a new reader's floor where the clock was"
    world.now += S
    assert reader.hears(sender.says()) == ""


def test_an_earlier_boot_is_refused_though_its_secret_is_right(world: World) -> None:
    sender = Robot(world, "sender")
    reader = Reader(world)
    old = sender.says()
    rebooted = Robot(world, "sender")
    rebooted.boot = b"another boot ..."
    assert reader.hears(old) == "it is of another boot or computer than its sender"
    assert reader.hears(rebooted.says()) == ""
    assert reader.hears(old) == "it is of another boot or computer than its sender"


def test_who_passes_the_question_back_to_us_proves_nothing(world: World) -> None:
    reader = Reader(world)
    stolen = Robot(world, "lost").says()
    mirror = Robot(world, "mirror")
    mirror.answers = lambda node, nonce: reader.proves(nonce)
    assert reader.hears(stolen, "mirror") == "it is of another boot or computer than its sender"


PLACES = [
    (Place("", frozenset({"10.0.0.1"}), 11311), True),
    (Place("net a", frozenset({"10.0.0.1", "192.168.1.1"}), 11311), True),
    (Place("net a", frozenset({"10.0.0.1"}), 11312), False),
    (Place("", frozenset({"10.0.0.9"}), 11311), False),
    (Place("net b", frozenset({"192.168.1.7"}), 11311), False),
    (Place("net b", frozenset(), 11311), False),
]


@pytest.mark.parametrize("master, same", PLACES)
def test_another_master_is_another_robot(world: World, master: Place, same: bool) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    sender.master = master
    why = reader.hears(sender.says())
    assert (why == "") is same
    assert same or why.startswith("it is of another robot")
    assert master.is_same(reader.master) is same is reader.master.is_same(master)


def test_a_master_on_each_of_two_computers_is_not_the_same() -> None:
    both = frozenset({"172.17.0.1"})  # as Docker gives to every computer
    assert not Place("net a", both, 11311).is_same(Place("net b", both, 11311))
    assert Place("net a", both, 11311).is_same(Place("net a", frozenset(), 11311))


NONSENSE: List[Any] = [
    None,
    [],
    [[]],
    "text",
    7,
    [["a", "b"]],
    [["a"] * 3],
    [[1, 2]],
    {"a": 1},
    [None] * 99,
]


@pytest.mark.parametrize("answer", NONSENSE)
def test_nonsense_proves_nothing(world: World, answer: Any) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    sender.answers = lambda node, nonce: answer
    assert reader.hears(sender.says()) not in ("", UNPROVEN)
    assert sender.asked == 1


@given(st.recursive(st.none() | st.integers() | st.text(), st.lists, max_leaves=8))
def test_whatever_is_answered_is_no_proof(answer: Any) -> None:
    with pytest.raises(ShsaError):
        proved("/x", lambda *_: Answer(answer, 0, 0))
    with pytest.raises(ShsaError):
        proof.read(SECRET, "", answer)


def test_a_proof_of_another_version_is_none() -> None:
    for text in ("{}", "[]", "nonsense", json.dumps({"boot": 1, "master": [1, 2, 3]})):
        signed = [text, proof._signature(SECRET, "ab", text)]
        with pytest.raises(ShsaError, match="another version"):
            proof.read(SECRET, "ab", signed)


def test_a_proof_counts_for_its_nonce_alone(world: World) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    old = sender.proves(secrets.token_hex(NONCE_B))
    sender.answers = lambda node, nonce: old
    assert reader.hears(sender.says()) == "sender on sender: its secret is another than ours"


def test_who_does_not_answer_is_asked_again_but_not_all_the_time(world: World) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)

    def dead(node: Robot, nonce: str) -> Any:
        world.now += 500 * MS
        raise BadAnswer("late")

    sender.answers = dead
    why = reader.hears(sender.says())
    assert "no answer" in why and sender.asked == TRIES
    for _ in range(100):
        assert reader.hears(sender.says()) == why
    assert sender.asked == TRIES
    world.now += PAUSE_NS
    sender.answers = Robot.proves
    assert reader.hears(sender.says()) == ""
    del world.nodes["sender"]
    assert reader.hears(Robot(World(), "lost").says()) != ""


def test_who_is_known_is_believed_without_the_master(world: World) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    assert reader.hears(sender.says()) == ""
    reader.has_master = False
    for _ in range(600):
        world.now += RENEW_NS
        reader.boots.renew()
        assert reader.hears(sender.says()) == ""
    assert sender.asked == 1


def test_strangers_are_not_asked_and_leave_nothing_behind(world: World) -> None:
    reader = Reader(world)
    threads = threading.active_count()
    for number in range(2000):
        stranger = Robot(world, f"stranger{number}")
        stranger.secret = bytes(32)
        assert reader.hears(stranger.says(), stranger.name) == FOREIGN
        assert stranger.asked == 0
    assert not reader.boots._failed and not reader.verifier._senders
    recorded = [Robot(World(), f"old{number}").says() for number in range(3 * MOST_FAILED)]
    for message in recorded:
        assert "no answer" in reader.hears(message, "nobody")
    assert len(reader.boots._failed) == MOST_FAILED
    assert len(reader.boots._known) == 1 and not reader.verifier._senders
    assert threading.active_count() == threads


def test_who_cannot_prove_a_boot_does_not_keep_out_who_can(world: World) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    thief = Robot(world, "thief")
    message = sender.says()
    assert reader.hears(b"x" + message, "thief") == FOREIGN and thief.asked == 0
    assert reader.hears(message, "thief") != "" and thief.asked == 1
    assert reader.hears(message, "sender") == ""


def test_more_computers_than_are_known_at_once_are_forgotten_and_repeat_nothing(
    world: World,
) -> None:
    reader = Reader(world)
    first = Robot(world, "sender")
    world.now += S  # more than the drift can make of all that follows
    messages = [first.says() for _ in range(10)]
    assert {reader.hears(each) for each in messages} == {""}
    said: List[bytes] = []
    for number in range(MOST + 3):
        other = Robot(world, f"other{number}", number * S)
        world.now += S
        said.append(other.says())
        assert reader.hears(said[-1], other.name) == ""
    assert len(reader.boots._known) == MOST + 1 == len(reader.verifier._senders) + 1
    assert reader.hears(messages[0]) == EARLY, "it proves itself again, and that was before"
    world.now += S
    assert reader.hears(first.says()) == ""


def test_another_node_is_asked_once_the_one_that_proved_it_is_gone(world: World) -> None:
    sender, reader = Robot(world, "sender"), Reader(world)
    assert reader.hears(sender.says()) == ""
    beside = Robot(world, "beside")
    beside.boot = sender.boot
    sender.answers = lambda node, nonce: None
    message = beside.says()
    assert reader.hears(message, "beside") == ""
    reader.boots.ours(beside.boot, 0, "beside")
    world.now += PAUSE_NS
    reader.boots.renew()
    assert beside.asked > 0 and world.now - reader.boots.seen()[0].answered < S


def test_a_process_proves_the_secret_that_it_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signing, "ROSHandler", SimpleNamespace())
    monkeypatch.setattr(signing, "master_seen", lambda: MASTER)
    signing.serve(SECRET, b"b" * 16)
    prove = partial(getattr(signing.ROSHandler, signing.METHOD), None)
    call = lambda uri, method, nonce: Answer(prove("/me", nonce)[2], 0, 0)
    met = proved("/sender", call)
    assert met.boot == b"b" * 16
    for wrong in ("", "x" * 32, "a" * 31, 7, None):
        assert prove("/me", wrong)[0] == -1
