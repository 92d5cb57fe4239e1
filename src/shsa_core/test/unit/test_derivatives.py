"""The derivative of what a substitute reads: by the times of its inputs, whenever it computes."""
from typing import Any, List, Tuple

import pytest
from shsa_core.codegen.program import compile_periodic, compile_program
from shsa_core.substitution import events
from shsa_core.substitution.readings import Readings
from substitute_driver import PERIOD, Driver, row, signal, values

SLOPE = 0.5


def code(text: str) -> str:
    """A program of one relation over one input."""
    return f"t0=x[0];\ndef _tf1(i1):\n  return {text}\nt1=_tf1(t0)\ny=t1"


def computed(text: str, every: float, **of: Any) -> List[float]:
    """What is published of a ramp that comes `every` so many s."""
    start = row(True, code=code(text), inputs=(signal("/in", every, 1.0),), **of)
    driver = Driver(start)
    driver.ready()
    for number in range(int(4.0 / every)):
        driver.pass_to(round(number * every, 9))
        driver.arrive(SLOPE * driver.time)
    return [value for _, value in driver.published(1.0)]


@pytest.mark.parametrize("every", [0.1, 1 / 30, 0.0201, 0.0199, 0.02, 0.001])
def test_a_held_input_has_the_slope_of_its_samples(every: float) -> None:
    found = computed("derivative(i1)", every)
    assert len(found) > 100
    assert found == pytest.approx([SLOPE] * len(found), abs=1e-6)


def test_a_slope_of_slopes_is_by_the_same_samples() -> None:
    found = computed("derivative(derivative(i1))", 0.1)
    assert found == pytest.approx([0.0] * len(found), abs=1e-6)


def test_what_is_filtered_is_of_the_time_of_the_evaluation() -> None:
    """As it goes on to change while its input is held."""
    for value in computed("derivative(integral(i1))", 0.1)[1:]:
        assert 0.4 < value < 2.0


def test_an_integral_goes_on_while_its_input_is_held() -> None:
    found = computed("integral(1 + 0*i1)*1", 0.1)
    apart = [later - sooner for sooner, later in zip(found, found[1:])]
    assert apart == pytest.approx([PERIOD] * len(apart))


def test_stamps_count_rather_than_when_a_message_came() -> None:
    driver = Driver(row(True, code=code("derivative(i1)")))
    driver.ready()
    for number in range(1, 100):
        driver.pass_to(round(number * PERIOD + 0.003 * (number % 3 == 0), 9))
        stamp = 10**9 + number * int(PERIOD * 1e9)
        told = ("data", SLOPE * number * PERIOD), stamp, stamp + 5 * 10**6
        driver.tell(events.InputArrived, "/in", "/sensor", told[:1], *told[1:])
    found = [value for _, value in driver.published(0.5)]
    assert found == pytest.approx([SLOPE] * len(found))


def test_samples_that_come_at_once_give_no_wild_slope() -> None:
    step = compile_periodic(code("derivative(i1)"), [("data", 0.02)], 1, 0.02).step
    moments = [(0.0, 0.0), (0.0399, 0.02), (0.0401, 0.04), (0.06, 0.06)]
    found = [step((x,), now, (at,)) for now, (at, x) in zip((0.0, 0.02, 0.04, 0.06), moments)]
    assert [each and each[0] for each in found[:3]] == [None, *[pytest.approx(0.02 / 0.0399)] * 2]


def test_the_newest_of_several_inputs_counts() -> None:
    both = "t0=x[0]; t1=x[1];\ndef _tf1(i1,i2):\n  return derivative(i1 + i2)\nt2=_tf1(t0,t1)\ny=t2"
    program = compile_program(both, 2, 1)
    assert program.timed and not compile_program(code("previous(i1)"), 1, 1).timed
    samples: List[Tuple[Tuple[float, float], float, Tuple[float, float]]] = [
        ((0.0, 0.0), 0.1, (0.0, 0.05)),
        ((1.0, 0.0), 0.2, (0.15, 0.05)),
        ((1.0, 0.0), 0.3, (0.15, 0.05)),
    ]
    found = [program.step(*each) for each in samples]
    assert found[1:] == [(pytest.approx(10.0),)] * 2


def test_a_value_that_holds_until_the_next_one_makes_no_other_one_newer() -> None:
    readings = Readings()
    held, periodic = signal("/held", None, None), signal("/in")
    readings.listen([held, periodic])
    for each in (held, periodic):
        readings.take(events.InputArrived(1.0, each.topic, "/s", (("data", 1.0),)))
    assert readings.times([held, periodic], 1.1) == (1.0, 1.0)
    assert readings.times([held], 1.1) == (1.1,)


def test_a_slow_input_has_a_slope_too() -> None:
    inputs = (signal("/in", 2.0, 10.0),)
    driver = Driver(row(True, code=code("derivative(i1)"), inputs=inputs))
    driver.ready()
    for number in range(5):
        driver.pass_to(2.0 * number)
        driver.arrive(SLOPE * driver.time)
    assert {value for _, value in driver.published(3.0)} == {SLOPE}
    assert values(driver.pass_to(driver.time + PERIOD))


def test_a_law_that_awaits_its_second_sample_has_not_failed() -> None:
    inputs = (signal("/in", 0.5, 2.5),)
    driver = Driver(row(True, code=code("derivative(i1)"), inputs=inputs))
    driver.ready()
    driver.arrive(0.0)
    driver.pass_to(0.5)
    driver.arrive(SLOPE * 0.5)
    driver.pass_to(0.52)
    assert not [each for _, each in driver.said if isinstance(each, events.TellNoValue)]
    assert [value for _, value in driver.published()] == [SLOPE]
