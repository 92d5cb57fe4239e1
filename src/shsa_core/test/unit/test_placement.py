"""The placement of a substitute, and its cost there."""
from typing import Any, Dict, Iterable, List, Optional, Tuple

import pytest

from core_robot import A, B, C, ONTOLOGY, service
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.errors import ShsaError
from shsa_core.healing.settings import Settings
from shsa_core.model.cost import EVENT_RATE_HZ, Cost, Host, cost, rate, traffic
from shsa_core.model.service import Placement as Wanted, Service
from shsa_core.model.som import Som
from shsa_core.planning.placement import HERE, Computers, Place, Placement
from shsa_core.planning.settings import CERTAIN_S
from shsa_core.search.derivation import SourceTable

PI, BOARD, BOOK = "pi", "board", "book"
HOSTS = (Host(PI, 4.0, 1e6), Host(BOARD), Host(BOOK))


def placed(
    a: Optional[Service] = None,
    b: str = PI,
    hosts: Tuple[Host, ...] = HOSTS,
    seen: Iterable[Tuple[Any, ...]] = tuple((0.0, each.name, 0.5, 4.0) for each in HOSTS),
    lately: Dict[str, List[Cost]] = {},
    idle: Tuple[str, ...] = (),
    own: str = "",
    lost: str = "",
    time: float = 1.0,
) -> Place:
    """Place the substitute of a service that reads `b`, which runs on a computer."""
    a = a or service("a", A, needed=True)
    som = Som([a, service("b", B, host=b), service("c", C, host=BOARD)], hosts)
    known = Computers(own)
    for each in seen:
        known.seen(*each)
    if lost:
        known.lose(lost, 0.5, "silent")
    placement = Placement(known, lambda host, _: lately.get(host, []), lambda: som)
    return placement.place(time, a, placement.inputs(plan(som)), BOOK, idle)


def cores(inputs: Iterable[Service], output: Service) -> float:
    """The share of a core that a substitute takes."""
    return cost(inputs, output, ()).cores


def plan(som: Som) -> Plan:
    table = SourceTable(ONTOLOGY.network)
    for source in som.sources:
        table.add(source)
    return plan_service(ONTOLOGY, som.services["a"], table, [A])


def wanting(**wanted: Tuple[str, ...]) -> Service:
    return service("a", A, needed=True, placement=Wanted(**wanted))


def test_with_one_computer_there_is_nothing_to_be_said() -> None:
    assert placed(hosts=()) is HERE and HERE.words == ""


def test_a_substitute_runs_beside_its_inputs() -> None:
    assert placed().host == PI
    assert placed(b=BOARD).host == BOARD
    assert placed().words == " It runs on pi."


def test_what_has_no_inputs_on_a_known_computer_runs_on_our_own() -> None:
    assert placed(b="") == Place("")


def test_of_equally_near_computers_the_least_loaded_is_taken() -> None:
    seen = tuple((0.0, n, b, 4.0) for n, b in ((PI, 3.0), (BOARD, 1.0), (BOOK, 2.0)))
    wanted, hosts = wanting(forbid=(PI, "own")), (*HOSTS, Host("own"))
    assert placed(wanted, hosts=hosts, own="own", seen=seen).host == BOARD


def test_a_preferred_computer_comes_first_in_order() -> None:
    assert placed(wanting(prefer=(BOOK, BOARD))).host == BOOK
    assert placed(wanting(prefer=(BOOK, BOARD)), lost=BOOK).host == BOARD


@pytest.mark.parametrize("prefer", [(), (PI,)])
def test_a_forbidden_computer_is_never_used(prefer: Tuple[str, ...]) -> None:
    assert placed(wanting(forbid=(PI,), prefer=prefer)).host == ""


def test_a_computer_counts_only_while_it_is_heard() -> None:
    assert placed(lost=PI).host == ""
    assert placed(seen=[(0.0, BOARD, 0.0, 4.0)]).host == ""


def test_our_own_computer_goes_by_its_name_as_well() -> None:
    assert placed(own=PI, seen=[]).host == ""
    assert placed(wanting(prefer=(PI,)), own=PI, b=BOARD, seen=[]).host == ""
    assert placed(wanting(forbid=(PI,)), own=PI, b=BOARD).host == BOARD
    with pytest.raises(ShsaError, match="pi is forbidden; board is not heard; book is not heard"):
        placed(wanting(forbid=(PI,)), own=PI, seen=[])


def test_where_a_process_stands_by_is_taken_rather_if_it_may_be() -> None:
    assert placed().host == PI and placed(idle=(PI, BOARD, BOOK)).host == BOOK
    assert placed(wanting(forbid=(BOOK,)), idle=(BOOK,)).host == PI


def test_a_process_that_stands_by_elsewhere_is_taken_rather_than_one_that_must_start() -> None:
    assert placed(idle=(BOARD,)).host == BOARD
    assert placed(idle=(BOARD, PI)).host == PI
    assert placed(wanting(forbid=(BOARD,)), idle=(BOARD,)).host == PI


def test_who_is_busy_for_a_while_keeps_the_process_that_stands_by() -> None:
    busy = [(0.0, BOOK, 4.0, 4.0), (0.0, PI, 0.0, 4.0)]
    assert placed(seen=busy, idle=(BOOK,)) == Place(BOOK)
    limited = (Host(PI), Host(BOARD), Host(BOOK, 4.0))
    assert placed(seen=busy, idle=(BOOK,), hosts=limited).host == PI


def test_where_a_process_stands_by_does_not_go_by_the_load() -> None:
    som = Som([service("a", A, needed=True), service("b", B, host=BOARD)], HOSTS)
    known = Computers()
    placement = Placement(known, lambda *_: [], lambda: som)
    for load in (0.0, 4.0):
        known.seen(load, BOARD, load, 4.0)
        assert placement.stands_by(5.0, som.services["a"], placement.inputs(plan(som))) == BOARD
    limited = Som(list(som), (Host(BOARD, 4.0),))
    placement = Placement(known, lambda *_: [], lambda: limited)
    assert placement.stands_by(5.0, som.services["a"], placement.inputs(plan(som))) == ""


def test_who_has_no_cores_left_is_passed_over_with_the_sum() -> None:
    full = [(0.0, PI, 3.995, 4.0)]
    place = placed(seen=full)
    assert place.host == ""
    (why,) = place.passed_over
    assert "pi has no room: 3.995 busy + " in why and "cores of 4" in why
    assert place.words.startswith(" It runs on the reconfigurator's computer. pi has no room")


def test_what_was_placed_lately_counts_beside_the_load() -> None:
    seen = [(0.0, PI, 3.5, 4.0)]
    assert placed(seen=seen).host == PI
    place = placed(seen=seen, lately={PI: [Cost(0.3), Cost(0.195)]})
    assert place.host == "" and "3.5 busy + 0.495 placed lately + " in place.passed_over[0]


def test_the_som_says_how_many_cores_count_and_else_the_computer_itself() -> None:
    seen = [(0.0, BOARD, 1.995, 2.0)]
    assert placed(b=BOARD, seen=seen).host == ""
    few = (Host(BOARD, 1.0),)
    assert placed(b=BOARD, hosts=few, seen=[(0.0, BOARD, 0.995, 8.0)]).host == ""
    unknown = [(0.0, BOARD, 50.0, 0.0)]
    assert placed(b=BOARD, seen=unknown).host == BOARD


def test_who_has_no_link_left_is_passed_over_with_the_sum() -> None:
    busy = [(0.0, PI, 0.0, 4.0, 0.999e6)]
    (why,) = placed(seen=busy).passed_over
    assert "pi has no room: 9.99e+05 busy + 3900 for it" in why and "bytes/s of 1e+06" in why


def test_where_nothing_fits_is_told_with_every_sum() -> None:
    full = [(0.0, "", 4.0, 4.0), (0.0, PI, 4.0, 4.0)]
    with pytest.raises(ShsaError, match="no computer can run the substitute: pi has no room: 4 "):
        placed(seen=full, hosts=(*HOSTS, Host("own", 4.0)), own="own")


def test_where_all_are_busy_only_the_limits_of_the_som_are_kept() -> None:
    busy = [(0.0, name, 2.0, 2.0) for name in ("", PI, BOARD)]
    place = placed(seen=busy, hosts=(Host(PI, 2.0), Host(BOARD)))
    assert place.host == ""
    assert "pi has no room: 2 busy" in place.words
    assert "the reconfigurator's computer has no room: 2 busy" in place.words
    assert placed(b=BOARD, seen=busy, hosts=(Host(PI, 2.0), Host(BOARD))).host == BOARD


def test_a_computer_that_comes_back_counts_after_a_hold_off_that_doubles() -> None:
    hosts = Computers("", Settings(hold_off=2.0).held_off, Settings().stable)
    hosts.seen(0.0, PI, 0.0, 4.0)
    assert hosts.counts(PI, 0.0) and hosts.settling.pop_due(CERTAIN_S) == [PI]
    for time, hold_off in ((10.0, 2.0), (20.0, 4.0), (30.0, 8.0)):
        assert hosts.lose(PI, time - 1.0, "silent")
        assert not hosts.lose(PI, time - 1.0, "silent")
        assert hosts.lost(PI) == "silent" and not hosts.reachable(PI)
        hosts.seen(time, PI, 0.0, 4.0)
        assert hosts.reachable(PI) and hosts.of(PI).steady == time
        assert not hosts.counts(PI, time + hold_off - 0.1)
        assert hosts.counts(PI, time + hold_off)
        assert hosts.settling.next() == time + max(hold_off, CERTAIN_S)
    assert hosts.lose(PI, 200.0, "silent")
    hosts.seen(210.0, PI, 0.0, 4.0)
    assert hosts.counts(PI, 212.0)


def test_a_gap_is_noticed_though_nobody_tells_of_a_loss() -> None:
    hosts = Computers()
    for time in (0.0, 1.0):
        hosts.seen(time, PI, 0.0, 4.0)
    assert hosts.of(PI).steady == 0.0
    hosts.seen(3.5, PI, 0.0, 4.0)
    assert hosts.of(PI).steady == 3.5 and hosts.counts(PI, 3.5)


def test_a_computer_is_in_doubt_while_it_has_just_come_back() -> None:
    hosts = Computers()
    assert not hosts.doubted(PI, 0.0)
    hosts.seen(0.0, PI, 0.0, 4.0)
    assert not hosts.doubted(PI, 0.0), "it was never lost"
    hosts.lose(PI, 5.0, "silent")
    hosts.seen(10.0, PI, 0.0, 4.0)
    assert hosts.doubted(PI, 10.0 + CERTAIN_S) and not hosts.doubted(PI, 10.1 + CERTAIN_S)
    for time in (11.0, 12.0, 13.0):
        hosts.seen(time, PI, 0.0, 4.0)
    for time in (13.0, 13.2):
        hosts.doubt(PI, time)
        assert hosts.doubted(PI, time)
    hosts.seen(14.0, PI, 0.0, 4.0)
    assert not hosts.doubted(PI, 14.0)


def test_a_computer_that_was_never_heard_can_be_lost() -> None:
    hosts = Computers()
    assert hosts.lose(PI, 1.0, "") and hosts.lost(PI) == "nothing is heard of it"
    assert not hosts.lose("", 1.0, "silent") and hosts.reachable("")
    own = Computers(PI)
    assert not own.lose(PI, 1.0, "silent") and not own.lost(""), "we are there"
    assert not hosts.reachable(BOARD) and hosts.lost(BOARD) == ""


def of(
    name: str, period: Optional[float] = 0.02, type_: str = "std_msgs/Float64", **more: Any
) -> Service:
    return Service(name, "/" + name, type_, A, period, (), **more)


def test_what_a_service_is_on_a_link() -> None:
    assert traffic(of("a")) == 50.0 * 78
    assert traffic(of("a", 0.1, "nav_msgs/Odometry")) == pytest.approx(10.0 * 782)
    assert traffic(of("a", 1.0, "own_msgs/Any")) == 326.0
    assert rate(of("a", None)) == EVENT_RATE_HZ


def test_only_what_crosses_the_link_is_on_it_and_each_service_once() -> None:
    far, near = of("far", host=BOARD), of("near", host=PI)
    own = cost([far, near, far], of("a"), [PI])
    assert own == Cost(cores([far, near], of("a")), 2 * 50.0 * 78)
    assert cost([far, near], of("a"), [PI, BOARD]).link == 50.0 * 78


def test_a_substitute_costs_more_the_more_it_reads() -> None:
    assert cores([], of("a", 1.0)) < cores([], of("a")) < cores([of("b")], of("a"))
