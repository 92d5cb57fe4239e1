"""Schedulability of substitutes: CPU and link of each host."""
from dataclasses import replace
from typing import List

import pytest
from shsa_testing.models import law, ontology, source

from shsa_core.model.cost import Host, cost, idle_cost, traffic
from shsa_core.model.service import Placement, Service
from shsa_core.model.kinds import Policy, Standby
from shsa_core.model.som import Som
from shsa_learning.check import check_model
from shsa_learning.schedulability import check_placements

ROBOT = ontology(law("rolling", "speed", "left"), law("turning", "turn", "left"))
SPEED = replace(source("speed", "/speed", "/drive", needed=True).service, host="board", period=0.02)
TURN = replace(source("turn", "/turn", "/drive", needed=True).service, host="board", period=0.02)
LEFT = replace(source("left", "/left", "/wheel").service, host="pi", period=0.02)
ONE = cost([LEFT], SPEED, ()).cores


def unfit(pi: Host, *services: Service, board: Host = Host("board")) -> List[str]:
    """Return what does not fit: substitutes of speed and turn run on `pi`, beside their inputs."""
    som = Som([*(services or (SPEED, TURN)), LEFT], [pi, board])
    return [each.what for each in check_placements(ROBOT, som)]


def test_the_substitutes_of_all_that_a_node_provides_must_fit_together() -> None:
    assert unfit(Host("pi", cores=2 * ONE)) == []
    (said,) = unfit(Host("pi", cores=1.9 * ONE))
    assert said.startswith("the substitute of ") and f"= {2 * ONE:.4g} cores of" in said
    assert f"0 busy + {ONE:.4g} placed lately + {ONE:.4g} for it" in said
    assert said.endswith("it would run on the reconfigurator's computer")
    alone = replace(TURN, node="/gyro")  # another node: not at the same time
    assert unfit(Host("pi", cores=1.9 * ONE), SPEED, alone) == []


def test_a_link_must_carry_what_goes_out_and_what_comes_in() -> None:
    assert unfit(Host("pi", link=2 * traffic(SPEED)), SPEED) == []
    (said,) = unfit(Host("pi", link=0.9 * traffic(SPEED)), SPEED)
    assert f"{traffic(SPEED):.4g} for it = {traffic(SPEED):.4g} bytes/s of" in said
    away = replace(SPEED, placement=Placement(prefer=("board",)))
    both = traffic(SPEED) + traffic(LEFT)
    assert unfit(Host("pi"), away, board=Host("board", link=both)) == []
    (said,) = unfit(Host("pi"), away, board=Host("board", link=0.9 * both))
    assert "board has no room" in said and f"= {both:.4g} bytes/s" in said
    assert said.endswith("it would run on pi")


@pytest.mark.parametrize("standby, own", [(Standby.HOT, ONE), (Standby.WARM, 0.0)])
def test_what_stands_by_takes_room_while_nothing_has_failed(standby: Standby, own: float) -> None:
    waiting = replace(SPEED, standby=standby)
    other = replace(TURN, node="/gyro")
    pool = 2 * idle_cost([LEFT], {"pi"}).cores if standby is Standby.WARM else 0.0
    enough = pool + own + ONE
    assert unfit(Host("pi", cores=1.001 * enough), waiting, other) == []
    said = unfit(Host("pi", cores=0.999 * enough), waiting, other)
    assert any(each.startswith("the substitute of turn") for each in said)


def test_a_hot_substitute_that_does_not_fit_is_told_once() -> None:
    hot = replace(SPEED, standby=Standby.HOT, placement=Placement(forbid=("board",)))
    (said,) = unfit(Host("pi", cores=0.5 * ONE), hot)
    assert "of 0" in said and said.endswith("it would run on the reconfigurator's computer")


def test_nothing_is_said_without_hosts_or_of_what_is_not_substituted() -> None:
    hostless = Som(replace(each, host="") for each in (SPEED, LEFT))
    assert list(check_placements(ROBOT, hostless)) == []
    assert unfit(Host("pi", cores=0.01), replace(SPEED, policy=Policy.ADVISE)) == []
    lost = replace(SPEED, needed=False)
    assert unfit(Host("pi", cores=0.01), lost) == []


def test_check_says_it_with_the_place() -> None:
    som = Som([replace(SPEED, where="som.yaml:3"), LEFT], [Host("pi", cores=0.001), Host("board")])
    (found,) = [each for each in check_model(ROBOT, som) if "does not fit" in each.what]
    assert (found.level, found.where) == ("warning", "som.yaml:3")
    assert "colder standby" in found.todo
