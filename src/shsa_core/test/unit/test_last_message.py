"""The last good message of an original: kept, sent along, and gone on from."""
from dataclasses import replace
from typing import Any, List, Optional

import pytest
import rospy
from core_robot import A, B, C, ONTOLOGY, Robot, last_incident, only, service
from shsa_msgs.msg import Failure
from std_msgs.msg import Header
from substitute_driver import PERIOD, Driver, row, signal

from shsa_core.codegen.program import compile_program
from shsa_core.healing import events as healing
from shsa_core.model.error import Error
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, Others, Standby
from shsa_core.model.log import Level
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import LastResort, Provision
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import HealthChanged
from shsa_core.monitoring.last_messages import LastMessages
from shsa_core.monitoring.settings import LAST_MESSAGE_B, MESSAGES_KEPT, OLDEST_MESSAGE_S
from shsa_core.ros.wire.healing import failure_seen
from shsa_core.substitution import events

# The monitor's side.


def test_the_newest_message_that_was_still_good_is_handed_out() -> None:
    kept = LastMessages()
    for time in (1.0, 1.1, 1.2):
        kept.keep(time, "/a", "/node", str(time).encode())
    kept.keep(1.15, "/a", "/other", b"other")
    assert kept.newest("/a", "/node", 1.1, 1.3) == b"1.1"
    assert kept.newest("/a", "/node", 1.19, 1.3) == b"1.1"
    assert kept.newest("/a", "/node", 9.0, 9.0) == b"1.2"
    assert kept.newest("/a", "/node", 0.9, 1.3) == b""
    assert kept.newest("/a", "/node", None, 1.3) == b""
    assert kept.newest("/a", "/nobody", 1.1, 1.3) == b""


def test_messages_are_few_small_and_young() -> None:
    kept = LastMessages()
    for number in range(MESSAGES_KEPT + 5):
        kept.keep(float(number), "/a", "/node", b"%d" % number)
    assert kept.newest("/a", "/node", 4.0, 20.0) == b""
    assert kept.newest("/a", "/node", 5.0, 20.0) == b"5"
    assert kept.newest("/a", "/node", 5.0, 5.1 + OLDEST_MESSAGE_S) == b""
    kept.keep(50.0, "/a", "/node", bytes(LAST_MESSAGE_B + 1))
    assert kept.newest("/a", "/node", 50.0, 50.0) == b"%d" % (MESSAGES_KEPT + 4)
    kept.keep(100.0 + OLDEST_MESSAGE_S, "/b", "/node", b"")
    assert kept.newest("/a", "/node", 50.0, 50.0) == b"", "nobody is remembered for ever"


FAILED = PublisherHealth("/a", A, PublisherState.FAILED, 92.0, None, 91.0, Kind.SILENT, service="a")


def substituted(kept: LastMessages, node: str, quality: float = 0.5, muted: bool = False) -> None:
    row_ = Substitution(node, "a", (), "", (), quality=quality, publishing=not muted)
    kept.substitutions([row_])
    kept.keep(99.0, "/a", node, node.encode())


def told(kept: LastMessages, *rows: PublisherHealth, gone: str = "") -> List[Any]:
    """The publishers that are told, each with its message."""
    removed = (("/a", gone),) if gone else ()
    return [
        (each.publisher, each.last_message)
        for each in kept.rows(HealthChanged(100.0, rows, removed))[0]
    ]


def test_the_row_of_a_failed_publisher_has_its_last_good_message_and_keeps_it() -> None:
    kept = LastMessages()
    kept.keep(91.0, "/a", A, b"good")
    kept.keep(91.5, "/a", A, b"bad")
    assert told(kept, FAILED) == [(A, b"good")]
    for number in range(MESSAGES_KEPT):
        kept.keep(93.0 + number, "/a", A, b"bad")
    assert told(kept, replace(FAILED, kind=Kind.NODE_GONE)) == [(A, b"good")]
    assert told(kept, replace(FAILED, state=PublisherState.HEALTHY, since=94.0)) == [(A, b"")]
    assert told(kept, gone=A) == []


def test_a_new_failure_has_the_message_also_where_its_publisher_is_forgotten() -> None:
    kept = LastMessages()
    kept.keep(91.0, "/a", A, b"good")
    for rows, removed in (((FAILED,), ()), ((), (FAILED.key,))):
        _, (new,) = kept.rows(HealthChanged(100.0, rows, removed, (FAILED,)))
        assert new.last_message == b"good"


def test_it_has_the_newest_message_of_a_substitute_that_stood_in_once_that_has_left() -> None:
    kept = LastMessages()
    kept.keep(91.0, "/a", A, b"good")
    told(kept, FAILED)
    substituted(kept, "/standing")
    # Muted ones and safe values tell nothing of where the robot is.
    substituted(kept, "/safe", quality=0.0)
    substituted(kept, "/muted", muted=True)
    for node in ("/safe", "/muted"):
        assert told(kept, gone=node) == []
    assert told(kept, gone="/standing") == [(A, b"/standing")]
    # A substitute's own failure ends with it.
    substituted(kept, "/other")
    failed = replace(FAILED, publisher="/other", last_good=99.0)
    assert told(kept, failed) == [("/other", b"/other"), (A, b"/other")]


def test_where_nobody_was_ever_seen_it_has_what_a_substitute_has_computed() -> None:
    kept = LastMessages()
    told(kept, replace(FAILED, publisher="", last_good=None))
    substituted(kept, "")  # a plan
    substituted(kept, "/standing")
    assert told(kept, gone="/standing") == [("", b"/standing")]


def test_the_row_of_a_healthy_original_has_a_message_that_a_substitutes_are_made_of() -> None:
    kept = LastMessages()
    kept.keep(91.0, "/a", A, b"good")
    substituted(kept, "/standing")
    healthy = replace(FAILED, state=PublisherState.HEALTHY)
    standing = replace(healthy, publisher="/standing", last_good=99.0)
    assert told(kept, healthy, standing) == [(A, b"good"), ("/standing", b"")]


# On the way.


def test_a_failure_carries_the_message_unless_it_is_too_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    for data, seen in ((b"\0\xff", b"\0\xff"), (bytes(LAST_MESSAGE_B + 1), b""), (b"", b"")):
        failure = Failure(header=Header(), topic="/a", kind="silent", last_message=data)
        assert failure_seen(failure).last_message == seen


def fail(robot: Robot, node: str, time: float, data: bytes, kind: str = "node_gone") -> List[Any]:
    """A publisher of /a fails; the monitor has its last good message."""
    robot.rows.pop(("/a", node), None)
    good = time - 0.02
    return robot.handle(healing.FailureSeen(time, "", "/a", node, Kind(kind), "died", good, data))


@pytest.mark.parametrize("mode", ["cold", "warm", "hot"])
def test_the_row_of_the_substitute_has_the_message_before_it_publishes(mode: str) -> None:
    first = service("a", A, needed=True, standby=Standby(mode), others=Others.LAST)
    robot = Robot(Som([first, service("b", B), service("c", C)]))
    shown = only(fail(robot, A, 10.0, b"good"), healing.ShowSubstitutions)
    (row_,) = [each for each in shown.rows if each.publishing]
    assert (row_.last_message, row_.others) == (b"good", Others.LAST)


@pytest.mark.parametrize("mode", ["cold", "warm", "hot"])
def test_a_row_without_a_last_message_has_one_of_when_the_original_was_well(mode: str) -> None:
    """As where the monitor has died before the node."""
    first = service("a", A, needed=True, standby=Standby(mode))
    robot = Robot(Som([first, service("b", B), service("c", C)]))
    well = replace(robot.rows["/a", A], last_message=b"well")
    robot.handle(healing.HealthSeen(2.0, (well,)))
    assert [each.template for each in robot.working()] == [b"well"] * (mode == "hot")
    fail(robot, A, 10.0, b"")
    assert [(each.last_message, each.template) for each in robot.working()] == [(b"", b"well")]


def test_who_takes_a_substitutes_place_goes_on_from_its_last_message() -> None:
    robot = Robot()
    substitute = only(fail(robot, A, 10.0, b"good"), healing.StartSubstitute).node
    robot.row("/a", substitute, "healthy", 10.5, first=10.5)
    robot.table(10.6)
    fail(robot, substitute, 11.0, b"newer", "silent")
    (row_,) = robot.working()
    assert (row_.node != substitute, row_.last_message) == (True, b"newer")


def test_the_row_brings_the_message_of_a_failure_that_was_told_before() -> None:
    robot = Robot()
    fail(robot, A, 10.0, b"")
    for message in (b"good", b"newer"):  # the second one after its substitute has left
        died = (PublisherState.FAILED, 10.0, 1.0, 9.98, Kind.NODE_GONE, "died")
        failed = PublisherHealth("/a", A, *died, last_message=message)
        robot.handle(healing.HealthSeen(10.01, (failed,)))
        assert [each.last_message for each in robot.working()] == [message]


def test_an_older_message_does_not_take_the_place_of_a_newer_one() -> None:
    robot = Robot()
    fail(robot, A, 10.0, b"good")
    robot.handle(healing.FailureSeen(11.0, "a", "/a", "/other", Kind.SILENT, "late", 3.0, b"older"))
    assert [each.last_message for each in robot.working()] == [b"good"]


def test_safe_values_are_nothing_to_go_on_from() -> None:
    resort = LastResort((("a", 0.0),))
    robot = Robot(Som([service("a", A, needed=True, last_resort=resort)]))
    fail(robot, A, 10.0, b"good")
    (row_,) = robot.working()
    fail(robot, row_.node, 11.0, b"safe", "silent")
    robot.handle(healing.Tick(robot.core.deadline))
    assert robot.core.services["a"].last_message == b"good"


def test_what_a_stranger_has_sent_is_not_gone_on_from() -> None:
    robot = Robot()
    robot.rows.pop(("/a", A))
    robot.table(9.0)
    fail(robot, "/stranger", 10.0, b"his", "unknown_publisher")
    assert [each.last_message for each in robot.working()] == [b""]


def test_a_hot_substitute_forgets_the_message_when_the_incident_ends() -> None:
    first = service("a", A, needed=True, standby=Standby.HOT)
    robot = Robot(Som([first, service("b", B), service("c", C)]))
    fail(robot, A, 10.0, b"good")
    robot.killed(10.01, A)
    (row_,) = robot.working()
    robot.row("/a", row_.node, "healthy", 10.1, first=10.1)
    robot.back(11.0)
    assert [each.last_message for each in robot.working()] == [b"good"]
    robot.handle(healing.Tick(14.0))
    assert [each.last_message for each in robot.working()] == [b""]


def test_somebody_who_asks_for_a_substitute_gives_the_message() -> None:
    robot = Robot()
    robot.handle(healing.SubstituteRequested(10.0, "a", b"asked"))
    (row_,) = robot.working()
    assert row_.last_message == b"asked"


def test_outputs_carry_the_error_that_is_predicted() -> None:
    functions = tuple(
        replace(each, error=Error(0.5)) if each.relation == "good" else each
        for each in ONTOLOGY.functions
    )
    ontology = Ontology(ONTOLOGY.properties, {}, functions)
    for others, expected in (((), 0.5), ((Error(0.25),), 0.25)):
        provisions = [(Provision("a", "data", error=error),) for error in others]
        extra = [replace(service("d", "/d_node"), provides=each) for each in provisions]
        som = Som([service("a", A, needed=True), service("b", B), service("c", C), *extra])
        robot = Robot(som, ontology)
        commands = fail(robot, A, 10.0, b"")
        (row_,) = robot.working()
        assert [each.error and each.error.rms for each in row_.outputs] == [expected]
        incident = last_incident(commands)
        assert [each.error for each in row_.outputs] == list(incident.errors)
    plain = Robot()
    fail(plain, A, 10.0, b"")
    assert [each.error for each in plain.working()[0].outputs] == [None]


# At the substitute.

SUM = "t0=x[0];\ndef _tf1(i1):\n  return integral(i1)\nt1=_tf1(t0)\ny=t1"
HIDDEN = "t0=x[0];\ndef _tf1(i1):\n  return 2*integral(i1)\nt1=_tf1(t0)\ny=t1"


def of_service(publishing: bool, data: bytes = b"", code: str = SUM, **more: Any) -> Substitution:
    """The row that a reconfigurator writes."""
    return replace(row(publishing, code=code, **more), last_message=data)


def known(value: float) -> events.LastMessage:
    """A last message with that value."""
    return events.LastMessage((("data", value),), 0)


def change(driver: Driver, row_: Substitution, last: Optional[events.LastMessage]) -> List[Any]:
    """The row changes, and what its last message holds is known."""
    return driver.tell(events.RowChanged, row_, (), last)


def hot(code: str = SUM) -> Driver:
    """A muted substitute that has integrated for 2 s."""
    driver = Driver(of_service(False, code=code))
    driver.ready()
    driver.stream(2.0)
    assert driver.published() == []
    return driver


def test_an_integral_goes_on_where_the_original_was_however_long_it_was_muted() -> None:
    driver = hot()
    change(driver, of_service(True, b"m"), known(9.7))
    driver.stream(3.0)
    (time, first), *_, (later, last) = driver.published()
    assert first == pytest.approx(9.7, abs=2 * PERIOD)
    assert last - first == pytest.approx(later - time, abs=1e-6)


def test_an_integral_does_not_start_again_when_numbers_change() -> None:
    driver = hot()
    change(driver, of_service(True, b"m"), known(9.7))
    driver.stream(3.0)
    slower = of_service(True, b"m", outputs=(signal("/out", period=0.1),))
    change(driver, slower, known(9.7))
    driver.stream(4.0)
    assert driver.published()[-1][1] == pytest.approx(11.7, abs=0.15)


def test_another_program_goes_on_where_the_old_one_was() -> None:
    driver = hot()
    change(driver, replace(of_service(True, b"m"), quality=0.9), known(9.7))
    driver.stream(3.0)
    other = SUM.replace("integral(i1)", "integral(0*i1)")
    change(driver, of_service(True, b"m", other), known(9.7))
    driver.stream(4.0)
    assert driver.published()[-1][1] == pytest.approx(10.7, abs=0.05)


def test_after_safe_values_an_integral_goes_on_where_the_original_was() -> None:
    safe = "def _tf1():\n  return 0\nt0=_tf1()\ny=t0"
    driver = Driver(of_service(True, b"m", safe, inputs=()))
    driver.ready()
    driver.pass_to(1.0)
    assert driver.published()[-1][1] == 0.0
    change(driver, of_service(True, b"m"), known(9.7))
    driver.stream(1.5)
    assert driver.published()[-1][1] == pytest.approx(10.2, abs=0.1)


def test_after_the_original_was_back_an_integral_starts_where_that_was_last() -> None:
    driver = hot()
    change(driver, of_service(True, b"m"), known(9.7))
    driver.stream(3.0)
    change(driver, of_service(False, b"m"), known(9.7))
    driver.stream(4.0)
    change(driver, of_service(True, b"n"), known(20.0))
    since = driver.time
    driver.stream(5.0)
    assert driver.published(since)[0][1] == pytest.approx(20.0, abs=2 * PERIOD)


@pytest.mark.parametrize("last", [None, known(float("nan"))])
def test_an_integral_from_nobody_knows_where_is_not_published_and_it_says_so_once(
    last: Optional[events.LastMessage],
) -> None:
    driver = hot()
    change(driver, of_service(True, b"m" if last else b""), last)
    driver.stream(3.0)
    assert driver.published() == []
    logs = [c for _, c in driver.said if isinstance(c, events.Log)]
    assert [each.level for each in logs] == [Level.ERROR]
    assert "data of /out" in logs[0].text
    change(driver, of_service(True, b"k"), known(1.0))
    driver.stream(3.1)
    assert driver.published()


def test_who_was_started_by_hand_integrates_from_zero() -> None:
    driver = Driver(replace(row(True, code=SUM), service=""))
    driver.ready()
    driver.stream(0.1)
    assert driver.published()[0][1] == 0.0


def test_an_integral_within_an_expression_starts_at_zero_and_that_is_said() -> None:
    driver = hot(HIDDEN)
    change(driver, of_service(True, b"m", HIDDEN), known(9.7))
    driver.stream(3.0)
    logs = [c for _, c in driver.said if isinstance(c, events.Log)]
    assert driver.published() and [each.level for each in logs] == [Level.WARN]


def test_which_outputs_are_integrals() -> None:
    code = (
        "t0=x[0];\ndef _tf1(i1):\n  return integral(i1)\nt1=_tf1(t0)\n"
        "def _tf2(i1):\n  return i1+1\nt2=_tf2(t1)\ny=(t1,t2)"
    )
    program = compile_program(code, 1, 2)
    first, second = program.integrals
    assert (first, second, program.hidden) == ([0.0], None, False)
    assert first is not None
    first[0] = 5.0
    assert program.step((1.0,), 0.0) == (5.0, 6.0)
    assert compile_program(code.replace("y=(t1,t2)", "y=t2"), 1, 1).hidden


def test_a_message_is_composed_anew_when_what_it_is_made_of_changes() -> None:
    driver = Driver(row())
    driver.ready()
    composed = lambda commands: [c for c in commands if isinstance(c, events.Compose)]
    taken = replace(row(True), others=Others.LAST, last_message=b"m")
    (first,) = composed(change(driver, taken, known(1.0)))
    assert first == events.Compose("/out", "std_msgs/Float64", (("data", None),), Others.LAST, b"m")
    assert composed(change(driver, replace(taken, quality=0.5), known(1.0))) == []
    better = replace(taken, outputs=(replace(taken.outputs[0], error=Error(0.1)),))
    assert composed(change(driver, better, known(1.0)))[0].written == (("data", 0.1),)
    certain = replace(taken, outputs=(replace(taken.outputs[0], error=Error(0.0)),))
    assert composed(change(driver, certain, known(1.0)))[0].written == (("data", None),)
    (unreadable,) = composed(change(driver, certain, None))
    assert unreadable.last_message == b""


def test_its_messages_are_made_of_the_last_one_or_else_of_one_of_when_all_was_well() -> None:
    driver = Driver(replace(of_service(False, code=SUM), template=b"well"))
    made = lambda: [
        each.last_message for _, each in driver.said if isinstance(each, events.Compose)
    ]
    assert made() == [b"well"]
    change(driver, replace(of_service(True, b"m"), template=b"well"), known(9.7))
    assert made() == [b"well", b"m"]
    change(driver, replace(of_service(True), template=b"well"), None)
    assert made() == [b"well", b"m", b"well"]
