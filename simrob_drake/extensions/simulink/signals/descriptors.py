r"""Linear systems :math:`E x' = A x + B u` whose E has no inverse, as networks are, made systems of states.

Where rows of E and, without E, of A do not determine x, what is stored depends on what is given, as a rotor's speed on
that of a joint: a combination of rows is then differentiated, until they do (index reduction; Hairer and Wanner,
Solving Ordinary Differential Equations II, VII). So a rotor reacts by exactly its inertia times the acceleration.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector

AT_ONCE = 1e-4  # s


class Reduced(NamedTuple):
    """States s of a network, and what it tells: s' = a s + b u, y = c s + d[0] u + d[1] u'."""

    a: Vector
    b: Vector
    c: Vector
    d: list[Vector]


@np.errstate(all="ignore")  # some processors tell of fractions what is not so
def reduced(e: Vector, a: Vector, b: Vector, c: Vector) -> Reduced | None:
    """Return the states of e x' = a x + b u and y = c x, which begin at 0; None where these do not determine y.

    It is computed in fractions, so what is nothing is exactly nothing.
    """
    size = e.shape[1]
    rows, rest = _echelon(np.hstack([e, a, b]), size)
    # held x' = moved x + b1 u
    held, moved, b1 = (
        rows[:, :size],
        rows[:, size : 2 * size],
        rows[:, 2 * size :],
    )
    kept, b2 = (
        rest[:, size : 2 * size],
        [rest[:, 2 * size :], 0 * rest[:, 2 * size :], 0 * rest[:, 2 * size :]],
    )
    while True:  # of u, u' and u'': kept x + b2 u = 0
        both = np.vstack([held, kept])
        found, lost = _echelon(np.hstack([both, _fractions(np.eye(len(both)))]), size)
        if not len(lost):
            break
        stored, other = np.split(lost[0][size:], [len(held)])
        driven = [other @ one for one in b2]
        if not stored.any() and not np.any(driven):  # it says again what others say
            kept, *b2 = (np.delete(one, np.flatnonzero(other)[0], 0) for one in (kept, *b2))
            continue
        if not stored.any() or driven[2].any():
            return None
        derived = [stored @ b1, -driven[0], -driven[1]]
        kept, b2 = (
            np.vstack([kept, stored @ moved]),
            [np.vstack(pair) for pair in zip(b2, derived, strict=True)],
        )
        held, moved, b1 = (
            np.delete(one, np.flatnonzero(stored)[0], 0) for one in (held, moved, b1)
        )
    c = _fractions(c)
    if (solution := _solution(found, size, np.vstack([moved, c]))) is None:
        return None
    states, rest = np.split(solution, [len(held)], axis=1)
    a, c, d = moved @ states, c @ states, [-(c @ rest @ one) for one in b2]
    driven = [-(moved @ rest @ one) for one in b2]
    driven[0] = driven[0] + b1
    if d[2].any():
        return None
    for place in (2, 1):  # a rate of what is given moves the states by what is given
        driven[place - 1], d[place - 1] = (
            driven[place - 1] + a @ driven[place],
            d[place - 1] + c @ driven[place],
        )
    return Reduced(
        a.astype(float), driven[0].astype(float), c.astype(float), [one.astype(float) for one in d]
    )


def _solution(found: Any, size: int, asked: Any) -> Any:
    """Return x by what determines it, and 0 where nothing does; None where what is asked of it depends on that.

    So two references share a force as they may: nothing that moves depends on it.
    """
    pivots = [int(np.flatnonzero(row[:size])[0]) for row in found]
    free = [place for place in range(size) if place not in pivots]
    undetermined, solution = (
        _fractions(np.eye(size)[:, free]),
        _fractions(np.zeros((size, found.shape[1] - size))),
    )
    undetermined[pivots], solution[pivots] = -found[:, free], found[:, size:]
    return None if (asked @ undetermined).any() else solution


def without_fast(full: Reduced) -> Reduced:
    """Return a network without what settles within ``AT_ONCE``: it is where it would come to."""
    rates, modes = np.linalg.eig(full.a)
    fast = rates.real < -1.0 / AT_ONCE
    if not fast.any():
        return full
    back = np.linalg.inv(modes)
    slow = (modes[:, ~fast] @ back[~fast]).real
    settled = (modes[:, fast] / rates[fast] @ back[fast]).real
    basis = np.linalg.svd(slow)[0][:, : int((~fast).sum())]
    at_once = [full.d[0] - full.c @ settled @ full.b, *full.d[1:]]
    return Reduced(basis.T @ full.a @ basis, basis.T @ slow @ full.b, full.c @ basis, at_once)


def _fractions(values: Any) -> Any:
    exact = np.frompyfunc(
        lambda one: one if isinstance(one, Fraction) else Fraction(repr(float(one))), 1, 1
    )
    return np.asarray(exact(values), dtype=object)


def _echelon(rows: Any, columns: int) -> tuple[Any, Any]:
    """Return rows by Gauss's elimination in their first columns: those with a pivot, by its place, and the others."""
    left: list[Any] = list(_fractions(rows))
    found: list[Any] = []
    for column in range(columns):
        place = next((place for place, row in enumerate(left) if row[column]), None)
        if place is None:
            continue
        pivot = left.pop(place)
        pivot = pivot / pivot[column]
        found = [row - row[column] * pivot if row[column] else row for row in found]
        left = [row - row[column] * pivot if row[column] else row for row in left]
        found.append(pivot)
    width = rows.shape[1]
    shaped = [np.array(one, dtype=object).reshape(len(one), width) for one in (found, left)]
    return shaped[0], shaped[1]
