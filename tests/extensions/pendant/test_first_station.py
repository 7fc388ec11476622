"""The station that ``simrob teach`` opens without a name: a taught move reaches its target."""

import inspect

import numpy as np
import pytest

from simrob_drake import Arm
from simrob_drake.extensions.pendant.commands import teach

TARGETS = [
    [0.3, 0.4, 0.2, 0.3, 0.5, -0.2],
    [-0.6, 0.2, 0.5, -0.5, 0.8, 1.0],
    [1.5, -0.5, 0.3, 1.0, 1.0, 1.0],
]
"""Postures in the whole workspace [rad]."""


@pytest.fixture
def first_station():
    """Name of the station that the command opens if the user gives none."""
    return inspect.signature(teach).parameters["subject"].default


def test_moves_end_within_a_tenth_of_a_millimetre(first_station):
    arm = Arm(first_station)
    for target in TARGETS:
        result = arm.move_j(arm.pose(target))
        reached = [result[f"q.joint_{number}"][-1] for number in range(1, 7)]
        distance = np.linalg.norm(np.subtract(arm.pose(reached)[:3], arm.pose(target)[:3]))
        assert distance < 1e-4  # m
        assert not result.verdict.warnings
