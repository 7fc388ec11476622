"""Candidates are measured in turn, so that a machine whose speed drifts treats them alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

ROUNDS = 15


def in_turn(
    candidates: dict[str, Callable[[], float]], rounds: int = ROUNDS
) -> dict[str, np.ndarray]:
    """Call the candidates in turn and return what each gave, after one round that does not count."""
    figures = {name: [] for name in candidates}
    for counted in [False] + [True] * rounds:
        for name, candidate in candidates.items():
            value = candidate()
            if counted:
                figures[name].append(value)
    return {name: np.array(values) for name, values in figures.items()}
