"""Another computer by way of its agent: reached, cut off, started anew, and what that answers."""
import random
from typing import Any, List

import pytest

pytest.importorskip("shsa_msgs.msg")

from shsa_msgs import msg  # noqa: E402

from shsa_core.healing import events  # noqa: E402
from shsa_core.healing.events import Where  # noqa: E402
from shsa_core.hosts.conversation import COMMANDS, EVENTS, HostEvent  # noqa: E402
from shsa_core.hosts.conversation import AgentEnd, RemoteHost  # noqa: E402
from shsa_core.ros.settings import LOST_BEATS, RETURN_BEATS, TICK_S, TURN_S  # noqa: E402

PATIENCE, RETURNS = LOST_BEATS * TURN_S, RETURN_BEATS * TURN_S
SUBSTITUTE = events.StartSubstitute("/substitute_a_1", None, host="pi")


class Cable:
    """A RemoteHost and the end of an agent, on one clock, with a cable that can be cut."""

    def __init__(self) -> None:
        self.told: List[Any] = []
        self.done: List[Any] = []
        self.whole = True
        self.now = 100.0
        self.running: List[str] = []
        self.host = RemoteHost("pi", self.told.append, self.command, PATIENCE, RETURNS)
        self.agent = AgentEnd(PATIENCE)

    def command(self, **fields: Any) -> None:
        if self.whole and self.agent.hear(msg.HostCommand(**fields), self.now):
            self.done.append(COMMANDS.from_text(fields["command"], "test", "it"))

    def say(self, text: str) -> None:
        if self.whole:
            self.host.heard(
                msg.HostEvent(
                    session=self.agent.session,
                    open=self.agent.is_open(self.now),
                    number=self.agent.said,
                    heard=self.agent.heard,
                    event=text,
                    running=self.running,
                    load=0.5,
                    cores=4.0,
                ),
                self.now,
            )

    def tell(self, event: HostEvent) -> None:
        self.agent.said += 1
        self.say(EVENTS.to_text(event))

    def pass_time(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.now += TICK_S
            self.say("")
            self.host.tick(self.now, TICK_S)
            self.host.beat()

    def take(self, kind: type) -> List[Any]:
        found = [each for each in self.told if isinstance(each, kind)]
        self.told[:] = [each for each in self.told if not isinstance(each, kind)]
        return found


@pytest.fixture
def cable() -> Cable:
    cable = Cable()
    cable.pass_time(0.2)
    cable.host.take_up()
    return cable


def test_a_command_arrives_once_and_its_answer_is_of_our_clock(cable: Cable) -> None:
    assert cable.host.is_reached
    cable.host.carry_out(events.LearnNode("/a", "/x"), cable.now)
    assert cable.done == [events.WatchNodes(()), events.LearnNode("/a", "/x")]
    cable.tell(events.NodeLearned(-5.0, "/a", True))
    assert cable.take(events.NodeLearned) == [events.NodeLearned(cable.now, "/a", True)]
    cable.pass_time(1.0)
    assert len(cable.done) == 2 and not cable.take(events.NodeLearned)
    assert cable.host.is_quiet


@pytest.mark.parametrize("node", ["/substitute_a_1", "/substitute_a_2"])
def test_after_a_loss_both_begin_anew_and_what_is_not_wanted_is_stopped(
    cable: Cable, node: str
) -> None:
    for start in (SUBSTITUTE, events.StartSubstitute("/substitute_a_2", None, host="pi")):
        cable.host.carry_out(start, cable.now)
        cable.running.append(start.node)
    cable.pass_time(0.2)
    session = cable.agent.session
    cable.whole = False
    cable.host.carry_out(events.StopNode(node), cable.now)
    cable.tell(events.ProcessPulse(0.0, node, False))
    cable.host.carry_out(events.FindNode("/a"), cable.now)
    cable.whole = True
    cable.pass_time(0.5)
    assert cable.agent.session > session and cable.host.is_reached
    assert cable.done.count(events.StopNode(node)) == 1
    assert [each.where for each in cable.take(events.NodeFound)] == [Where.UNREACHABLE]
    cable.pass_time(2.0)
    assert not cable.take(events.HostLost) and cable.host.is_quiet


@pytest.mark.parametrize("seed", range(20))
def test_what_is_carried_out_is_in_order_and_each_once_on_a_cable_that_loses(seed: int) -> None:
    chance, cable = random.Random(seed), Cable()
    cable.pass_time(0.2)
    nodes = [f"/{number}" for number in range(100)]
    for node in nodes:
        cable.whole = chance.random() < 0.9
        cable.host.carry_out(events.ClearNode(node), cable.now)
        cable.tell(events.NodeLeft(0.0, node))
        cable.pass_time(0.2 * chance.random())
    cable.whole = True
    cable.pass_time(1.0)
    assert cable.host.is_reached and cable.host.is_quiet
    for heard in (cable.done, cable.take(events.NodeLeft)):
        done = [int(each.node[1:]) for each in heard if not isinstance(each, events.WatchNodes)]
        assert 10 < len(done) < 100 and done == sorted(set(done))


def test_the_load_of_a_computer_is_told_as_often_as_it_comes(cable: Cable) -> None:
    cable.told.clear()
    cable.say("")
    cable.tell(events.NodeLeft(0.0, "/a"))
    seen = cable.take(events.HostSeen)
    assert len(seen) == 1
    assert (seen[0].host, seen[0].load, seen[0].cores) == ("pi", 0.5, 4.0)


def test_a_silent_computer_is_lost_and_seen_again(cable: Cable) -> None:
    cable.whole = False
    cable.pass_time(PATIENCE - 0.2)
    assert not cable.take(events.HostLost)
    cable.pass_time(0.4)
    assert [each.host for each in cable.take(events.HostLost)] == ["pi"]
    assert not cable.host.is_reached
    cable.take(events.HostSeen)
    cable.pass_time(3.0)
    assert not cable.take(events.HostLost)  # it is said once
    cable.whole = True
    cable.pass_time(0.5)
    assert cable.take(events.HostSeen) and cable.host.is_reached


def test_time_in_which_we_did_not_run_is_no_silence(cable: Cable) -> None:
    cable.now += 5.0
    cable.host.tick(cable.now, TICK_S)
    assert not cable.take(events.HostLost)


def test_an_agent_that_has_ended_is_given_time_to_be_started_again(cable: Cable) -> None:
    cable.host.ended = lambda: True
    cable.whole = False
    cable.pass_time(PATIENCE + 0.5)
    cable.host.ended = lambda: False  # the next one has connected, and says nothing yet
    cable.pass_time(RETURNS - PATIENCE - 1.0)
    assert not cable.take(events.HostLost)
    cable.host.carry_out(events.FindNode("/a"), cable.now)
    assert cable.take(events.NodeFound)[0].where is Where.UNREACHABLE
    cable.pass_time(1.0)
    assert len(cable.take(events.HostLost)) == 1


def test_whoever_waits_when_it_is_lost_is_answered_at_once(cable: Cable) -> None:
    life = "http://pi:4001/"
    cable.whole = False
    cable.host.carry_out(events.FindNode("/a", uri=life), cable.now)
    cable.host.carry_out(SUBSTITUTE, cable.now)
    cable.pass_time(PATIENCE + 0.2)
    (found,) = cable.take(events.NodeFound)
    assert (found.where, found.uri) == (Where.UNREACHABLE, life)
    assert [each.started for each in cable.take(events.ProcessExited)] == [False]
    cable.host.carry_out(events.EndProcess("/a", life), cable.now)
    assert [each.uri for each in cable.take(events.ProcessUntouchable)] == [life]
    cable.host.carry_out(events.RestartNode("/a"), cable.now)
    assert len(cable.take(events.RestartFailed)) == 1
    cable.whole = True
    cable.pass_time(1.0)
    # None of it is carried out later.
    assert cable.done == [events.WatchNodes(()), events.WatchNodes(())]


def test_what_was_kept_back_on_a_cut_cable_is_refused(cable: Cable) -> None:
    text = COMMANDS.to_text(events.EndProcess("/a"))
    number = cable.agent.heard + 1
    late = msg.HostCommand(session=cable.agent.session, number=number, command=text)
    cable.now += PATIENCE + 0.1
    assert not cable.agent.hear(late, cable.now)
    cable.pass_time(0.3)
    assert cable.host.is_reached and cable.agent.session > late.session
    assert not cable.agent.hear(late, cable.now)


def test_what_a_stranger_repeats_changes_nothing(cable: Cable) -> None:
    text = COMMANDS.to_text(events.EndProcess("/a"))
    cable.host.carry_out(events.EndProcess("/a"), cable.now)
    cable.tell(events.NodeLeft(0.0, "/a"))
    ours = msg.HostCommand(session=cable.agent.session, number=2, command=text)
    done, session = list(cable.done), cable.agent.session
    assert ours.number == cable.agent.heard and not cable.agent.hear(ours, cable.now)
    cable.take(events.NodeLeft)
    cable.say(EVENTS.to_text(events.NodeLeft(0.0, "/a")))
    cable.pass_time(0.5)
    assert cable.done == done and not cable.take(events.NodeLeft)
    assert cable.host.is_reached and cable.agent.session == session


def test_a_later_reconfigurator_is_heard_and_the_former_no_more(cable: Cable) -> None:
    former = cable.agent.session
    told: List[Any] = []
    second = RemoteHost("pi", told.append, cable.command, PATIENCE, RETURNS)
    cable.running = ["/substitute_a_1"]
    first, cable.host = cable.host, second
    cable.pass_time(0.2)
    assert cable.agent.session > former
    assert second.take_up() == ("/substitute_a_1",)
    done = len(cable.done)
    first.carry_out(events.EndProcess("/a"), cable.now)
    assert len(cable.done) == done
    second.carry_out(events.EndProcess("/a"), cable.now)
    assert cable.done[-1] == events.EndProcess("/a")


def test_an_agent_that_was_started_anew_is_given_no_former_command(cable: Cable) -> None:
    cable.host.carry_out(SUBSTITUTE, cable.now)
    cable.tell(events.SubstituteStarted(0.0, SUBSTITUTE.node))
    cable.running = [SUBSTITUTE.node]
    cable.host.carry_out(events.LearnNode("/a", "/x"), cable.now)
    cable.told.clear()
    cable.agent = AgentEnd(PATIENCE)
    cable.pass_time(0.3)
    assert cable.done.count(SUBSTITUTE) == 1
    assert [each.known for each in cable.take(events.NodeLearned)] == [False]
    assert cable.host.is_reached and not cable.take(events.ProcessExited)  # it took that up


def test_a_new_agent_awaits_the_nodes_that_the_former_did(cable: Cable) -> None:
    watch = events.WatchNodes(("/a",))
    cable.host.carry_out(watch, cable.now)
    cable.done.clear()
    cable.agent = AgentEnd(PATIENCE)
    cable.pass_time(0.5)
    assert cable.done == [watch]


def test_an_end_that_was_told_is_not_told_again_to_a_new_agent(cable: Cable) -> None:
    cable.host.carry_out(SUBSTITUTE, cable.now)
    cable.tell(events.ProcessExited(0.0, SUBSTITUTE.node, "exit status 1"))
    cable.agent = AgentEnd(PATIENCE)
    cable.pass_time(0.5)
    assert cable.host.is_reached and len(cable.take(events.ProcessExited)) == 1


def test_the_agent_hears_at_once_that_something_was_lost(cable: Cable) -> None:
    session = cable.agent.session
    cable.agent.said += 1
    cable.say("")
    assert cable.agent.session > session


def test_what_runs_there_and_is_not_wanted_any_more_is_stopped(cable: Cable) -> None:
    cable.host.carry_out(SUBSTITUTE, cable.now)
    cable.host.carry_out(events.RestartNode("/a"), cable.now)
    kept = events.StartSubstitute("/substitute_b_2", None, host="pi")
    ended = events.StartSubstitute("/substitute_c_3", None, host="pi")
    for start in (kept, ended):
        cable.host.carry_out(start, cable.now)
    for node in (SUBSTITUTE.node, kept.node, ended.node):
        cable.tell(events.SubstituteStarted(0.0, node))
    cable.tell(events.NodeRestarted(0.0, "/a"))
    cable.whole = False
    cable.pass_time(2.0)
    cable.host.carry_out(events.StopNode(SUBSTITUTE.node), cable.now)
    cable.host.carry_out(events.StopNode("/a"), cable.now)
    cable.running = [SUBSTITUTE.node, kept.node, "/a"]
    cable.whole = True
    cable.done.clear()
    cable.pass_time(0.5)
    stops = [each for each in cable.done if not isinstance(each, events.WatchNodes)]
    assert stops == [events.StopNode("/a"), events.StopNode(SUBSTITUTE.node)]
    assert [each.node for each in cable.take(events.ProcessExited)] == [ended.node]


def test_a_restarted_node_that_is_found_late_goes_on(cable: Cable) -> None:
    """As after a restart of the reconfigurator, whose agent was not reached at first."""
    cable.running = ["/driver", "/substitute_a_1"]
    cable.host = RemoteHost("pi", cable.told.append, cable.command, PATIENCE, RETURNS)
    assert cable.host.take_up() == ()
    cable.done.clear()
    cable.pass_time(0.3)
    assert cable.host.is_reached
    assert cable.done == [events.WatchNodes(()), events.StopNode("/substitute_a_1")]
    assert [each.node for each in cable.take(events.NodeRestarted)] == ["/driver"]
    cable.running = ["/driver"]
    cable.host.carry_out(events.StopNode("/driver"), cable.now)  # its launch has ended
    assert cable.done[-1] == events.StopNode("/driver")


@pytest.mark.parametrize("runs", [True, False])
def test_what_has_become_of_a_restart_is_told_by_what_runs(cable: Cable, runs: bool) -> None:
    for command in (events.StopNode, events.RestartNode):  # it was ended once before
        cable.host.carry_out(command("/driver"), cable.now)
    cable.running = ["/driver"] if runs else []
    cable.done.clear()
    cable.whole = False
    cable.pass_time(PATIENCE + 0.2)
    assert cable.take(events.HostLost) and not cable.take(events.RestartFailed)
    cable.whole = True
    cable.pass_time(0.5)
    assert cable.host.is_reached and events.StopNode("/driver") not in cable.done
    told = cable.take(events.NodeRestarted), cable.take(events.RestartFailed)
    assert [len(each) for each in told] == [int(runs), int(not runs)]
    cable.whole = False
    cable.pass_time(PATIENCE + 0.2)
    cable.whole = True
    cable.pass_time(0.5)
    assert events.StopNode("/driver") not in cable.done and not cable.take(events.RestartFailed)


def test_nobody_is_told_twice_of_what_is_no_event(cable: Cable) -> None:
    cable.told.clear()
    cable.agent.said += 1
    cable.say("no event")
    assert cable.told == []
    cable.tell(events.NodeLeft(0.0, "/a"))
    assert cable.take(events.NodeLeft)
