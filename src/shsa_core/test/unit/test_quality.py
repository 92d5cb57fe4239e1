"""Costs of qualities: products of decimals tie exactly, and the order is that of the qualities."""
from math import exp, log
from random import Random

import pytest

from shsa_core.model.ontology import UNIT, cost


def test_the_best_quality_costs_nothing_and_any_other_something() -> None:
    assert cost(1.0) == 0
    assert cost(1.0 - 2**-53) == 1
    assert cost(0.9999) > 1


def test_equal_products_of_decimals_cost_the_same() -> None:
    assert cost(0.9) + cost(0.9) == cost(0.81)
    assert cost(0.5) + cost(0.9) == cost(0.45)
    assert cost(0.0097) + cost(0.5) == cost(0.97) + cost(0.005)
    assert cost(0.7) + cost(0.1) == cost(0.07)
    assert cost(0.1) * 4 == cost(0.0001)


def test_a_cost_is_minus_the_logarithm() -> None:
    random = Random(1)
    for quality in [random.random() for _ in range(500)] + [n / 10000 for n in range(1, 10000, 7)]:
        assert exp(-cost(quality) / UNIT) == pytest.approx(quality, rel=1e-10)
        assert cost(quality) == pytest.approx(-log(quality) * UNIT, abs=30)


def test_a_better_quality_costs_less() -> None:
    decimals = [cost(n / 10000) for n in range(1, 10001)]
    assert decimals == sorted(decimals, reverse=True) and len(set(decimals)) == 10000
    assert cost(0.90001) < cost(0.9) < cost(0.89999)


def test_the_smallest_qualities_have_a_cost() -> None:
    assert cost(5e-324) == round(744.4400719213812 * UNIT)
    assert cost(0.00001) > cost(0.0001)
