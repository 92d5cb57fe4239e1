"""Evidence and kills belong to one life of a node: the next one of its name begins clean."""
import pytest
from core_robot import SOM, A, Robot, changed, has, only
from test_succession import succeed

from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Kind, Policy

FIRST, SECOND = "http://127.0.0.1:4001/", "http://127.0.0.1:4002/"


class Lives(Robot):
    """A robot that tells which life of the node of /a its monitor has heard."""

    def tell(
        self, uri: str, state: str, since: float, detail: str = "", kind: Kind = Kind.NODE_GONE
    ) -> None:
        failed = state == "failed"
        detail = "it failed." if failed else detail
        self.row("/a", A, state, since, uri=uri, detail=detail, kind=kind if failed else None)
        self.said.clear()
        self.table(since)

    @property
    def state(self) -> State:
        incident = self.core.incident("a")
        return State.WELL if incident is None else incident.state

    def healed(self) -> "Lives":
        """The first life dies; before its process is found its substitute publishes."""
        self.tell(FIRST, "healthy", 5.0)
        self.tell(FIRST, "failed", 10.0)
        node = only(self.said, events.StartSubstitute).node
        assert not has(self.said, events.NodeLeft)
        self.heard(node, 10.02)
        assert self.state is State.HEALED and A in self.core.robot.health.dying
        return self


def test_a_substitute_knows_the_original_before_the_dead_process_is_found() -> None:
    (row,) = Lives().healed().working()
    assert row.publishing and row.original == A


def test_the_next_life_is_back_while_the_process_of_the_former_is_searched_for() -> None:
    robot = Lives().healed()
    robot.tell(SECOND, "unknown", 10.04)
    assert robot.state is State.HEALED
    robot.tell(SECOND, "healthy", 10.05)
    assert robot.state is State.RETURNING
    (row,) = robot.working()
    assert not row.publishing and row.original == A
    robot.handle(events.NodeFound(10.2, A, events.Where.DEAD))
    assert robot.state is State.RETURNING
    robot.handle(events.Tick(12.06))
    assert robot.state is State.WELL and A not in robot.core.robot.health.doomed


@pytest.mark.parametrize("uri", ["", FIRST, FIRST.replace("127.0.0.1", "10.0.0.7")])
def test_the_life_that_is_being_ended_is_not_back(uri: str) -> None:
    """Nor one of which nobody can tell, nor as another computer knows it."""
    robot = Lives().healed()
    robot.tell(uri, "healthy", 10.05)
    assert robot.state is State.HEALED
    robot.handle(events.NodeFound(10.2, A, events.Where.DEAD))
    assert robot.state is State.RETURNING


def test_a_life_that_is_back_and_dies_at_once_is_substituted_again() -> None:
    robot = Lives().healed()
    robot.tell(SECOND, "healthy", 10.05)
    robot.tell(SECOND, "failed", 10.1)
    (row,) = robot.working()
    assert robot.state is State.HEALED and row.publishing and row.original == A
    robot.handle(events.NodeFound(10.2, A, events.Where.DEAD))
    assert robot.state is State.HEALED


def test_a_node_is_not_started_again_beside_its_next_life() -> None:
    robot = Lives(changed(SOM, "a", policy=Policy.RESTART_AND_SUBSTITUTE)).healed()
    robot.tell(SECOND, "healthy", 10.05)
    robot.handle(events.NodeFound(10.2, A, events.Where.DEAD))
    robot.said.clear()
    robot.handle(events.Tick(30.0))
    assert not has(robot.said, events.RestartNode)


def test_while_the_former_life_may_still_babble_the_next_one_is_not_back() -> None:
    robot = Lives()
    robot.tell(FIRST, "healthy", 5.0)
    robot.tell(FIRST, "failed", 10.0, kind=Kind.OUT_OF_RANGE)
    robot.handle(events.NodeFound(10.0, A, events.Where.HERE))
    robot.tell(SECOND, "healthy", 10.3)
    assert robot.state is State.HEALING
    robot.handle(events.NodeLeft(12.0, A))
    assert robot.state is State.RETURNING  # it was well before the former one had ended
    robot.handle(events.Tick(14.1))
    assert robot.state is State.WELL and A not in robot.core.robot.health.doomed


def test_who_is_up_and_not_well_as_its_row_says_takes_nobody_over() -> None:
    robot = Lives().healed()
    robot.tell(SECOND, "unknown", 10.1)
    assert robot.working()[0].original == A
    robot.tell(SECOND, "unknown", 10.1, "what it sends is of another type")
    (row,) = robot.working()
    assert row.publishing and row.original == ""
    assert robot.state is State.HEALED


BABBLES = Kind.OUT_OF_RANGE


@pytest.mark.parametrize("policy", [Policy.SUBSTITUTE, Policy.RESTART_AND_SUBSTITUTE])
def test_a_next_life_that_fails_while_the_former_leaves_is_ended_after_it(policy: Policy) -> None:
    robot = Lives(changed(SOM, "a", policy=policy))
    robot.tell(FIRST, "healthy", 5.0)
    robot.tell(FIRST, "failed", 10.0, kind=BABBLES)
    robot.handle(events.NodeFound(10.1, A, events.Where.HERE))
    robot.tell(SECOND, "unknown", 10.5)
    robot.tell(SECOND, "failed", 11.0, kind=BABBLES)
    assert not any(row.publishing for row in robot.working())
    robot.said.clear()
    robot.handle(events.NodeLeft(12.0, A))
    assert only(robot.said, events.FindNode).uri == SECOND
    assert not any(row.publishing for row in robot.working()), "two would publish"
    robot.handle(events.NodeFound(12.1, A, events.Where.HERE))
    assert only(robot.said, events.AskToLeave).node == A
    robot.handle(events.Tick(13.2))
    assert only(robot.said, events.EndProcess).node == A
    robot.handle(events.NodeLeft(13.3, A))
    assert [row.publishing for row in robot.working()] == [True]
    robot.handle(events.Tick(14.0))
    assert has(robot.said, events.RestartNode) == policy.restarts


@pytest.mark.parametrize("where", [events.Where.DEAD, events.Where.HERE])
def test_the_former_life_is_not_ended_for_the_failure_of_the_next_one(where: events.Where) -> None:
    robot = Lives().healed()
    robot.tell(SECOND, "healthy", 10.05)
    robot.tell(SECOND, "failed", 10.5, kind=BABBLES)
    robot.said.clear()
    robot.handle(events.NodeFound(10.6, A, where))
    assert not has(robot.said, events.AskToLeave)
    assert only(robot.said, events.FindNode).uri == SECOND
    robot.handle(events.NodeFound(10.7, A, events.Where.HERE))
    assert has(robot.said, events.AskToLeave)


def test_a_next_life_that_has_recovered_as_the_former_ends_is_left_alone() -> None:
    robot = Lives()
    robot.tell(FIRST, "healthy", 5.0)
    robot.tell(FIRST, "failed", 10.0, kind=BABBLES)
    robot.handle(events.NodeFound(10.1, A, events.Where.HERE))
    robot.tell(SECOND, "failed", 11.0, kind=BABBLES)
    robot.tell(SECOND, "healthy", 11.5)
    robot.handle(events.NodeLeft(12.0, A))
    assert not has(robot.said, events.FindNode) and robot.state is State.RETURNING


def test_a_next_life_that_dies_as_the_former_does_is_gone_as_well() -> None:
    robot = Lives().healed()
    robot.tell(SECOND, "unknown", 10.05)
    robot.tell(SECOND, "failed", 10.1)
    robot.handle(events.NodeFound(10.2, A, events.Where.DEAD))
    assert only(robot.said, events.FindNode).uri == SECOND
    robot.handle(events.NodeFound(10.3, A, events.Where.DEAD))
    incident = robot.core.incident("a")
    assert incident is not None and incident.killed is not None and robot.state is State.HEALED


@pytest.mark.parametrize(
    "late",
    [
        events.NodeFound(12.1, A, events.Where.DEAD, uri=FIRST),
        events.NodeFound(12.1, A, events.Where.HERE, uri=FIRST),
        events.NodeAnswered(12.1, A, FIRST),
        events.NodeLeft(12.1, A, FIRST),
        events.ProcessUntouchable(12.1, A, FIRST),
    ],
    ids=lambda event: type(event).__name__,
)
def test_an_answer_about_the_former_life_says_nothing_of_the_next_one(late: events.Event) -> None:
    """As the process of one that was forced ends: both who asked it and who forced it tell."""
    robot = Lives()
    robot.tell(FIRST, "healthy", 5.0)
    robot.tell(FIRST, "failed", 10.0, kind=BABBLES)
    robot.handle(events.NodeFound(10.1, A, events.Where.HERE))
    robot.tell(SECOND, "failed", 11.0, kind=BABBLES)
    robot.handle(events.NodeLeft(12.0, A))
    assert only(robot.said, events.FindNode).uri == SECOND
    robot.said.clear()
    robot.handle(late)
    assert not robot.said and not any(row.publishing for row in robot.working())
    robot.handle(events.NodeFound(12.2, A, events.Where.HERE))
    assert only(robot.said, events.AskToLeave).uri == SECOND
    robot.handle(events.Tick(13.3))
    assert only(robot.said, events.EndProcess) == events.EndProcess(A, SECOND, gently=False)


def test_what_a_user_s_monitor_tells_is_told_of_the_life_that_was_heard() -> None:
    """Its next one, which nobody has heard yet, is not ended for that."""
    robot = Lives()
    robot.tell(FIRST, "healthy", 5.0)
    robot.failure("/a", A, 10.0, "out_of_range", "a is 99.", 9.9)
    assert only(robot.said, events.FindNode).uri == FIRST
    robot.tell(SECOND, "healthy", 10.1)
    robot.handle(events.NodeFound(10.2, A, events.Where.ANOTHER, "it is not at its address"))
    assert not has(robot.said, events.AskToLeave)
    assert robot.state is State.RETURNING


def test_a_life_that_did_well_is_known_after_a_restart_of_healing() -> None:
    robot = Lives()
    robot.tell(FIRST, "healthy", 5.0)
    succeed(robot, 20.0)
    robot.failure("/a", A, 21.0, "out_of_range", "a is 99.", 20.9)
    assert only(robot.said, events.FindNode).uri == FIRST
