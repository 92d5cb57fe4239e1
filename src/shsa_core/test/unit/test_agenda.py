"""An agenda: events and when they are due."""
from math import inf
from typing import Dict, List, Optional, Tuple

from hypothesis import given, strategies as st

from shsa_core.agenda import Agenda

MOMENTS = st.one_of(st.none(), st.integers(0, 9).map(float))


@given(st.lists(st.tuples(st.integers(0, 5), MOMENTS)))
def test_the_earliest_is_at_hand_however_often_moments_change(
    changes: List[Tuple[int, Optional[float]]]
) -> None:
    agenda: Agenda[int] = Agenda()
    plain: Dict[int, float] = {}
    for key, due in changes:
        agenda.set(key, due)
        plain.pop(key, None)
        if due is not None:
            plain[key] = due
        assert agenda.next() == min(plain.values(), default=inf)
    due_now = [key for key, due in plain.items() if due <= 5.0]
    popped = agenda.pop_due(5.0)
    assert sorted(popped) == sorted(due_now)
    assert [plain[key] for key in popped] == sorted(plain[key] for key in popped)
    assert agenda.pop_due(5.0) == []
    assert agenda.next() == min((d for d in plain.values() if d > 5.0), default=inf)


def test_an_alarm_comes_once_at_the_earliest_time_that_it_was_set_to() -> None:
    agenda: Agenda[str] = Agenda()
    assert (agenda.next(), agenda.when("a")) == (inf, inf)
    for time in (5.0, 3.0, 4.0, inf):
        agenda.bring_forward("a", time)
    agenda.bring_forward("b", 4.0)
    assert (agenda.next(), agenda.when("a")) == (3.0, 3.0)
    assert agenda.pop_due(3.5) == ["a"]
    assert agenda.pop_due(10.0) == ["b"]
    assert agenda.next() == inf
    agenda.bring_forward("a", 7.0)
    assert agenda.next() == 7.0
