"""Qualities as costs that add up exactly.

Equal products tie in whatever order they are multiplied.
"""
from functools import lru_cache
from math import log

UNIT = 2**40
DECIMALS = 10**4


@lru_cache(maxsize=None)
def cost(quality: float) -> int:
    """Return the cost of a quality in (0, 1]: -ln(quality) in whole numbers of 1/UNIT.

    It is 0 for the quality 1.

    Sums of whole numbers are exact. Qualities of up to four decimals are split into prime factors
    first, so that 0.9 * 0.9 costs exactly what 0.81 costs. Any quality below 1 costs at least 1.
    """
    numerator = round(quality * DECIMALS)
    if numerator > 0 and numerator / DECIMALS == quality:
        return _log(DECIMALS) - _log(numerator)
    return max(1, round(-log(quality) * UNIT))


def _log(number: int) -> int:
    """Return ln(number) * UNIT, rounded by prime factors: _log(a * b) == _log(a) + _log(b)."""
    total = 0
    factor = 2
    while factor * factor <= number:
        while number % factor == 0:
            total += _log_prime(factor)
            number //= factor
        factor += 1
    return total + (_log_prime(number) if number > 1 else 0)


@lru_cache(maxsize=None)
def _log_prime(prime: int) -> int:
    return round(log(prime) * UNIT)
