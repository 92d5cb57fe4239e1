"""A publisher that fails on command: its silences."""
from itertools import groupby

from shsa_testing.faulty_publisher import BETWEEN, Silences


def test_no_silence_unless_commanded() -> None:
    silences = Silences()
    assert not any(silences.skip() for _ in range(100))


def test_silences_are_as_long_as_commanded_with_messages_between_them() -> None:
    silences = Silences(3, 10)
    skipped = [silences.skip() for _ in range(5000)]
    runs = [(silent, len(list(group))) for silent, group in groupby(skipped)][:-1]
    assert {length for silent, length in runs if not silent} == {BETWEEN}
    # Who leaves out n - 1 messages is silent for n periods.
    assert {length + 1 for silent, length in runs if silent} == {*range(3, 11)}
