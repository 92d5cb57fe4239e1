"""Several hot substitutes in one process: who shares one, and what each does there."""
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Dict, List, Mapping, Set

import pytest
from core_robot import Robot, function, has, only, publishing, service
from substitute_driver import CODE, PERIOD, check, signal
from test_succession import succeed

from shsa_core.healing import events as healing
from shsa_core.model.kinds import Standby
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution, row_key
from shsa_core.monitoring.events import SubstitutionsChanged
from shsa_core.monitoring.board import Substitutes
from shsa_core.substitution import events
from shsa_core.substitution.sharing import Sharing

NAMES = "abcdef"
HOST = "/substitute_host_3"


def robot(
    nodes: str = NAMES,
    most: int = 2,
    period: Any = 0.02,
    topics: Mapping[str, str] = MappingProxyType({}),
) -> Robot:
    """Hot services a to f of some nodes; each can be computed from z. What starts comes up."""
    services = [
        service(
            name,
            f"/{node}",
            needed=True,
            standby=Standby.HOT,
            **({"topic": topics[name]} if name in topics else {}),
        )
        for name, node in zip(NAMES, nodes)
    ]
    laws = [function(f"of_{name}", name, "2 * z", 0.9) for name in NAMES]
    ontology = Ontology({name: Property(name) for name in NAMES + "z"}, {}, laws)
    source = replace(service("z", "/z"), period=period)
    found = Robot(Som([*services, source]), ontology, hot_hosts=most)
    heard: Set[str] = set()
    while set(started(found)) - heard:
        for node in set(started(found)) - heard:
            heard.add(node)
            found.handle(healing.ProcessPulse(2.0, node, True))
    return found


def started(found: Robot) -> List[str]:
    """The processes that were started."""
    return [each.node for each in found.said if isinstance(each, healing.StartSubstitute)]


def processes(found: Robot) -> Dict[str, str]:
    """The services that have a substitute in each process."""
    rows: Dict[str, str] = {}
    for row in sorted(found.working(), key=lambda row: row.service):
        rows[row.node] = rows.get(row.node, "") + row.service
    return rows


def test_the_first_have_a_process_each_and_those_beyond_share_some() -> None:
    found = robot()
    assert sorted(processes(found).values()) == ["a", "b", "cd", "ef"]
    assert {row.service for row in found.working() if row.shared} == set("cdef")
    starts = [each for each in found.said if isinstance(each, healing.StartSubstitute)]
    assert [each.program is None for each in starts] == [each.shared for each in starts]
    assert len(starts) == 4


def test_none_share_one_that_a_single_fault_has_publish() -> None:
    found = robot(nodes="xxxxxx")
    assert sorted(processes(found).values()) == list(NAMES)


def test_none_share_one_with_another_of_their_topic() -> None:
    """A process composes one message a topic."""
    found = robot(topics={"c": "/joint_states", "d": "/joint_states"})
    (of_c,) = (services for services in processes(found).values() if "c" in services)
    assert "d" not in of_c


def test_without_a_number_each_has_its_own() -> None:
    assert sorted(processes(robot(most=0)).values()) == list(NAMES)


def test_what_comes_at_no_period_is_read_by_a_process_of_ones_own() -> None:
    assert sorted(processes(robot(period=None)).values()) == list(NAMES)


def test_one_takes_over_and_yields_while_the_others_stand_by() -> None:
    found = robot()
    (node,) = (node for node, services in processes(found).items() if services == "cd")
    commands = found.fail("/c", "/c", 10.0)
    assert not has(commands, healing.StartSubstitute) and not has(commands, healing.StopNode)
    found.killed(10.01, "/c")
    assert publishing(found).count(True) == 1
    found.row("/c", node, "healthy", 10.1, first=10.1)
    found.table(10.11)
    incident = found.core.incident("c")
    assert incident is not None and incident.state.value == "healed"
    assert found.core.incident("d") is None
    found.row("/c", "/c", "healthy", 20.0)
    found.table(20.0)
    said = found.handle(healing.Tick(23.0))
    assert found.core.incident("c") is None and not has(said, healing.StopNode)
    assert processes(found)[node] == "cd" and publishing(found).count(True) == 0


def test_a_process_ends_with_its_last_substitute() -> None:
    found = robot()
    (node,) = (node for node, services in processes(found).items() if services == "cd")

    def without(name: str, time: float) -> List[healing.Command]:
        other = Som([replace(each, needed=each.needed and each.name != name) for each in found.som])
        found.som = other
        return found.handle(healing.SomChanged(time, other))

    assert not has(without("c", 30.0), healing.StopNode)
    assert found.shown[f"{node} d"].service == "d" and f"{node} c" not in found.shown
    assert only(without("d", 31.0), healing.StopNode).node == node
    assert node not in processes(found)


@pytest.mark.parametrize("kind", [healing.ProcessExited, healing.ProcessPulse])
def test_the_end_of_a_process_concerns_all_that_share_it(kind: Any) -> None:
    found = robot()
    (node,) = (node for node, services in processes(found).items() if services == "cd")
    detail = "killed" if kind is healing.ProcessExited else False
    before = set(started(found))
    found.handle(kind(10.0, node, detail))
    for time in (11.0, 12.0, 15.0, 20.0):
        found.handle(healing.Tick(time))
        for new in set(started(found)) - before:
            found.handle(healing.ProcessPulse(time, new, True))
    rows = processes(found)
    assert node not in rows and sorted("".join(rows.values())) == list(NAMES)


def test_who_follows_a_reconfigurator_takes_up_what_shares_a_process() -> None:
    found = robot()
    rows = processes(found)
    (node,) = (node for node, services in rows.items() if services == "cd")
    said = succeed(found, 50.0, tuple(rows), ontology=found.core.robot.planner.ontology)
    assert not has(said, healing.StopNode) and processes(found) == rows
    assert {row.service for row in found.working() if row.shared} == set("cdef")
    assert found.core._processes.served(node) == ("c", "d")


# The monitor's side.


def rows_of(*services: str, publishing: str = "") -> SubstitutionsChanged:
    return SubstitutionsChanged(
        1.0, tuple(row(each, publishing == each) for each in services), (), False
    )


def row(name: str, publishing: bool = False, topic: str = "") -> Substitution:
    inputs, outputs = (signal("/in"),), (signal(topic or f"/{name}"),)
    return Substitution(
        HOST, name, inputs, CODE, outputs, publishing=publishing, shared=True, bridge=0.05
    )


def test_the_monitor_knows_each_of_a_process_by_its_topic() -> None:
    known = Substitutes()
    known.change(rows_of("c", "d", publishing="c"))
    rows = [known.row(topic, HOST) for topic in ("/c", "/d")]
    assert [(each.service, each.publishing) for each in rows if each] == [("c", True), ("d", False)]
    gone = SubstitutionsChanged(2.0, (), (row_key(row("c")),), False)
    assert [(node, old and old.service, new) for node, old, new in known.change(gone)] == [
        (HOST, "c", None)
    ]
    left = known.row("/d", HOST)
    assert left is not None and left.service == "d"
    known.change(SubstitutionsChanged(3.0, (), (row_key(row("d")),), False))
    assert known.row("/d", HOST) is None


# The process's side.


class Process:
    """A process that several share, and what it was told to do."""

    def __init__(self, *names: str) -> None:
        self.core = Sharing()
        self.time = 0.0
        for name in names:
            self.tell(events.RowChanged, row(name))
            self.tell(events.Advertised, f"/{name}")

    def tell(self, event: Any, *arguments: Any) -> List[Any]:
        """An event now; what it calls for."""
        said = self.core.handle(event(self.time, *arguments))
        for core in self.core._cores.values():
            published = [each for each in said if isinstance(each, events.Publish)]
            check(core, [each for each in published if each.outputs[0].topic in core.topics])
        return said

    def run(self, seconds: float) -> List[Any]:
        """Let time pass with an input once a period; what was published."""
        said: List[Any] = []
        end = self.time + seconds
        while self.time < end - 1e-9:
            arrival = self.time + PERIOD
            while self.core.next_deadline < arrival:
                self.time = max(self.time, self.core.next_deadline)
                said += self.tell(events.Tick)
                for look in looks(self):
                    said += self.tell(events.OthersStand, look, True)
            self.time = arrival
            said += self.tell(events.InputArrived, "/in", "/source", (("data", 3.0),))
        return [each for each in said if isinstance(each, events.Publish)]


def test_each_publishes_by_its_own_row() -> None:
    process = Process("c", "d")
    assert process.run(1.0) == [] and not process.core.hurries
    process.tell(events.RowChanged, row("d", publishing=True))
    assert process.core.hurries
    assert {each.outputs[0].topic for each in process.run(1.0)} == {"/d"}
    process.tell(events.RowChanged, row("d"))
    assert process.run(1.0) == []


def test_an_input_is_subscribed_for_all_and_told_to_all() -> None:
    process = Process("c", "d")
    for name in ("c", "d"):
        process.tell(events.RowChanged, row(name, publishing=True))
    published = process.run(1.0)
    assert {each.outputs[0].topic for each in published} == {"/c", "/d"}
    assert len(published) == pytest.approx(100, abs=4)


def test_who_leaves_publishes_no_more_and_the_others_go_on() -> None:
    process = Process("c", "d")
    for name in ("c", "d"):
        process.tell(events.RowChanged, row(name, publishing=True))
    said = process.tell(events.RowRemoved, "c", True)
    assert only_of(said, events.Withdraw).topic == "/c"
    assert {each.outputs[0].topic for each in process.run(1.0)} == {"/d"}
    assert process.tell(events.RowRemoved, "c", True) == []


def test_who_leaves_ends_no_topic_that_another_one_publishes() -> None:
    process = Process()
    for name in ("c", "d"):
        process.tell(events.RowChanged, row(name, topic="/joint_states"))
    process.tell(events.Advertised, "/joint_states")
    assert process.tell(events.RowRemoved, "c", True) == []
    said = process.tell(events.RowRemoved, "d", True)
    assert only_of(said, events.Withdraw).topic == "/joint_states"


def test_a_table_that_is_begun_anew_ends_nobody() -> None:
    process = Process("c")
    process.tell(events.RowChanged, row("c", publishing=True))
    process.tell(events.RowRemoved, "c", False)
    assert process.tell(events.RowRemoved, "x", False) == []
    assert process.run(1.0)


def test_a_program_that_is_refused_costs_the_others_nothing() -> None:
    process = Process("d")
    process.tell(events.RowChanged, row("d", publishing=True))
    said = process.tell(events.RowChanged, replace(row("c"), code="import os"))
    assert only_of(said, events.TellNoValue).service == "c"
    assert not any(isinstance(each, events.GiveUp) for each in said)
    assert {each.outputs[0].topic for each in process.run(1.0)} == {"/d"}


def test_left_alone_it_ends_unless_one_publishes() -> None:
    process = Process("c", "d")
    process.tell(events.RowChanged, row("c", publishing=True))
    assert process.tell(events.ReachChanged, False, True) == []
    process.tell(events.RowChanged, row("c"))
    only_of(process.tell(events.ReachChanged, False, True), events.GiveUp)


def test_one_bridges_while_the_others_are_muted() -> None:
    process = Process("c", "d")
    for _ in range(20):
        process.run(PERIOD)
        for name in ("c", "d"):
            process.tell(events.OtherHeard, f"/{name}", f"/{name}_node", 0)
    published: List[Any] = []
    for _ in range(10):
        published += process.run(PERIOD)
        process.tell(events.OtherHeard, "/d", "/d_node", 0)
    assert {each.outputs[0].topic for each in published} == {"/c"}


def looks(process: Process) -> List[events.LookAtOthers]:
    """The looks that are awaited."""
    cores = process.core._cores.values()
    return [each._others._awaited for each in cores if each._others._awaited is not None]


def only_of(said: List[Any], kind: Any) -> Any:
    found = [each for each in said if isinstance(each, kind)]
    assert len(found) == 1, said
    return found[0]
