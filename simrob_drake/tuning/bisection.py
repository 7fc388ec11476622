"""The largest number with which something still holds, by bisection."""

from collections.abc import Callable
from math import inf, sqrt

_LEAST = 1e-3  # of the first number: what is smaller is nothing


def bracket(holds: Callable[[float], bool], first: float, *, close: float, most: float = inf) -> tuple[float, float]:
    """Return the largest number that holds, and one not much larger that does not.

    That nothing holds again beyond what does not is taken for granted.

    Args:
        holds: tells whether a positive number holds.
        first: what is tried first; it grows by twos until one does not hold.
        close: the two lie at most this part of the larger one apart.
        most: what is tried at most.

    Returns:
        0 and the smallest that was tried, where none holds; ``most`` and infinity where all do.
    """
    low, high, tried = 0.0, inf, min(first, most)
    while True:
        low, high = (tried, high) if holds(tried) else (low, tried)
        if low >= most or high - low <= close * high < inf or high < _LEAST * first:
            return low, high
        tried = min(2 * low, most) if high == inf else sqrt(low * high) if low else high / 2
