"""The table of voices: complete, without a rule that never counts, and what it promises."""
from itertools import product
from typing import Iterator, Tuple

from shsa_core.substitution.voice import ANY, RULES, Heard, Order, Original, Voice, decide

Case = Tuple[Order, Heard, bool, Original]


def cases() -> Iterator[Case]:
    return product(Order, Heard, (False, True), Original)


def rule_of(case: Case) -> int:
    fits = (all(w in (ANY, c) for w, c in zip(rule, case)) for rule in RULES)
    return next(number for number, fit in enumerate(fits) if fit)


def test_each_case_has_a_voice_and_each_rule_a_case() -> None:
    assert {rule_of(case) for case in cases()} == set(range(len(RULES)))
    assert all(decide(*case) is RULES[rule_of(case)][-1] for case in cases())


def test_one_that_is_told_to_publish_is_still_for_nobody_but_a_rival() -> None:
    for order, others, cut_off, original in cases():
        if order is Order.PUBLISH:
            still = decide(order, others, cut_off, original) is Voice.MUTED
            assert still is (others is Heard.RIVAL)


def test_a_muted_one_speaks_for_the_late_the_silent_and_the_returning_alone() -> None:
    for order, others, cut_off, original in cases():
        voice = decide(order, others, cut_off, original)
        if order in (Order.MUTE, Order.BRIDGE) and voice is not Voice.MUTED:
            late = order is Order.BRIDGE and original.late
            alone = cut_off and others is Heard.SILENCE
            assert late or alone or original is Original.BACK
            assert voice.publishes is (alone or late)
