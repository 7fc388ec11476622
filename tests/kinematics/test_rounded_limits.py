"""Limits that are published with rounding, such as pi - 1e-5 rad, cost no pose that the arm reaches."""

from dataclasses import replace

import numpy as np
import pytest

from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.every_branch import goal_postures
from simrob_drake.kinematics.registry import make_solver
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.limits import ANGLE_TOLERANCE, ClampedPosition

POSES = 12
HALF_TURN = np.pi - 1e-5
COARSE_HALF_TURN = np.pi - 5e-5  # further from half a turn than a solver's tolerance of 1e-5 rad


def rounded_chain(name: str, most: float = HALF_TURN) -> Chain:
    """An arm of the package whose axes turn by a largest angle [rad] either way."""
    chain = Chain.of_robot(load_robot(name))
    return replace(chain, lower=np.maximum(chain.lower, -most), upper=np.minimum(chain.upper, most))


def posture_beyond(chain: Chain, random: np.random.Generator, over: float) -> np.ndarray:
    """A random posture with one axis beyond one of its limits by ``over`` [rad]."""
    posture = random.uniform(np.maximum(chain.lower, -3.0), np.minimum(chain.upper, 3.0))
    axis, is_upper = random.integers(chain.size), random.integers(2)
    posture[axis] = chain.upper[axis] + over if is_upper else chain.lower[axis] - over
    return posture


@pytest.mark.filterwarnings("ignore::simrob_drake.robots.limits.ClampedPosition")
@pytest.mark.parametrize("solver", ["analytic", "numeric"])
@pytest.mark.parametrize("name", ["irb120", "ur5", "puma560"])
def test_poses_at_half_a_turn_are_reached(name: str, solver: str) -> None:
    """The error is at most what the clamped part of the axis moves the tool: tolerance times reach."""
    chain, random = rounded_chain(name), np.random.default_rng(4)
    for over in np.linspace(1e-5, 0.95 * ANGLE_TOLERANCE, POSES):
        posture = posture_beyond(chain, random, over)
        start = np.clip(posture + 0.05 * random.normal(size=6), chain.lower, chain.upper)
        found = make_solver(solver, chain).solve(chain.forward(posture), start[np.newaxis])
        assert found.reached[0], found.reasons[0]
        assert ((chain.lower <= found.positions) & (found.positions <= chain.upper)).all()
        assert found.position_error[0] <= ANGLE_TOLERANCE * chain.reach
        assert found.rotation_error[0] <= ANGLE_TOLERANCE


def test_a_tool_that_looks_straight_down_is_found_and_the_clamp_is_said() -> None:
    """ur5 with its tool down: axis 6 at half a turn, where the published limit is 5e-5 rad less."""
    chain = rounded_chain("ur5", COARSE_HALF_TURN)
    posture = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 180.0])

    pose = chain.forward(posture)

    np.testing.assert_allclose(pose[0, :3, 2], [0.0, 0.0, -1.0], atol=1e-9)
    start = np.clip(posture + 0.01, chain.lower, chain.upper)
    with pytest.warns(ClampedPosition, match=chain.names[5]):
        found = make_solver("analytic", chain).solve(pose, start[np.newaxis])
    assert found.reached[0]
    np.testing.assert_allclose(
        found.positions[0], np.clip(posture, chain.lower, chain.upper), atol=1e-4
    )


@pytest.mark.parametrize("solver", ["analytic", "numeric"])
def test_poses_further_beyond_are_refused(solver: str) -> None:
    chain = rounded_chain("irb120")
    cut = replace(chain, lower=np.full(6, -0.5), upper=np.full(6, 0.5))
    posture = np.array([0.3, 0.3, -0.3, 0.3, 0.4, 0.5 + 3 * ANGLE_TOLERANCE])

    found = make_solver(solver, cut).solve(
        chain.forward(posture), np.clip(posture, cut.lower, cut.upper)[np.newaxis]
    )

    assert not found.reached[0]
    assert "joint limit" in found.reasons[0]


@pytest.mark.filterwarnings("ignore::simrob_drake.robots.limits.ClampedPosition")
def test_goals_of_planners_are_within_the_limits() -> None:
    chain = rounded_chain("ur5")
    posture = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 180.0])

    goals = goal_postures(chain, chain.forward(posture), np.zeros(6))

    assert len(goals) > 0
    assert ((chain.lower <= goals) & (goals <= chain.upper)).all()
