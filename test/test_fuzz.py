"""Whatever comes in is read or refused: the stored inputs, and many made of them."""
from typing import List

import fuzz_targets
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from shsa_testing.thorough import many

EXAMPLES = {name: many(1500) for name in fuzz_targets.TARGETS}


def inputs(name: str) -> "st.SearchStrategy[bytes]":
    """Random bytes, and stored inputs with some places cut out, and put in."""
    stored = fuzz_targets.corpus(name)
    part = st.one_of(
        st.sampled_from(fuzz_targets.words(name)),
        st.binary(max_size=8),
        st.sampled_from([b"\0", b"\x1b", b"9" * 400, b"1e308", b"5e-324", b"\xff\xff\xff\xff"]),
    )
    edits = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 20), part), max_size=5)
    return st.one_of(st.binary(max_size=200), st.builds(edited, st.sampled_from(stored), edits))


def edited(data: bytes, edits: List[tuple]) -> bytes:
    """Return the data with a part put in the stead of some bytes, at each place."""
    for place, cut, part in edits:
        begin = int(place * len(data))
        data = data[:begin] + part + data[begin + cut :]
    return data


@pytest.mark.parametrize("name", fuzz_targets.TARGETS)
def test_stored_inputs_are_read_or_refused(name: str) -> None:
    stored = fuzz_targets.corpus(name)
    assert stored
    for data in stored:
        fuzz_targets.TARGETS[name](data)


@pytest.mark.parametrize("name", fuzz_targets.TARGETS)
def test_made_inputs_are_read_or_refused(name: str) -> None:
    @settings(
        derandomize=True,
        database=None,
        deadline=None,
        max_examples=EXAMPLES[name],
        suppress_health_check=list(HealthCheck),
    )
    @given(inputs(name))
    def run(data: bytes) -> None:
        fuzz_targets.TARGETS[name](data)

    run()
