"""What is over leaves nothing behind in a core: no more objects are held after more failures."""
import gc
from dataclasses import replace
from random import Random
from types import FunctionType, ModuleType
from typing import Any, List, Set

import pytest
from core_robot import ONTOLOGY, SOM, A
from monitor_bench import SETTINGS, Bench
from plant import HealedPlant

from shsa_core.model.kinds import Standby
from shsa_core.model.som import Som

CYCLES = 60


def held(root: object) -> int:
    """Count the objects that can be reached from one."""
    seen: Set[int] = set()
    todo: List[Any] = [root]
    while todo:
        found = todo.pop()
        if id(found) in seen or isinstance(found, (type, ModuleType)):
            continue
        seen.add(id(found))
        if isinstance(found, FunctionType):  # its module holds everything
            todo += [cell.cell_contents for cell in found.__closure__ or ()]
        else:
            todo += gc.get_referents(found)
    return len(seen)


@pytest.mark.parametrize("standby", list(Standby))
def test_healing_holds_nothing_of_an_incident_that_is_over(standby: Standby) -> None:
    som = Som([replace(service, standby=standby) for service in SOM])
    robot = HealedPlant(ONTOLOGY, som, Random(1), switches=0, hold_off=0.5)

    def fail_and_return() -> None:
        for what, seconds in (("die", 1.0), ("start", 2.0)):
            robot.plant.fault(what, [A])
            robot.sense()
            robot.run(seconds)
            healed = [row for row in robot.plant.rows.values() if row.publishing]
            assert len(healed) == (what == "die")

    for _ in range(CYCLES):
        fail_and_return()
    before = held(robot.core)
    for _ in range(CYCLES):
        fail_and_return()
    assert held(robot.core) <= before + 5  # a number may be an object of its own


def test_the_monitor_holds_nothing_of_a_node_that_has_gone() -> None:
    bench = Bench(settings=SETTINGS)
    bench.connect()
    bench.stream(100)

    def fail_and_return(number: int) -> None:
        substitute = f"/substitute_{number}"
        bench.connect(substitute)  # it is heard before the table has it
        bench.substitutes((substitute, False))
        bench.disconnect()
        bench.substitutes((substitute, True))
        bench.stream(10, substitute)
        bench.connect()
        bench.substitutes((substitute, False))
        bench.stream(20)
        bench.substitutes()
        bench.disconnect(substitute)
        assert bench.kinds()[number:] == [("/amperemeter", "node_gone")]

    for number in range(CYCLES):
        fail_and_return(number)
    before = held(bench.core)
    for number in range(CYCLES, 2 * CYCLES):
        fail_and_return(number)
    assert held(bench.core) <= before + 5
