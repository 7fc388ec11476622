"""The weighted numeric solver: success on random poses, limits, weights, and what it says when it fails."""

import numpy as np
import pytest
from scipy.optimize import minimize

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.kinematics import NumericSolver, Unreachable, pose_errors, require


@pytest.mark.long
def test_random_poses_from_home(irb120_chain, random_postures, home):
    targets = irb120_chain.forward(random_postures(irb120_chain, 10_000))
    solutions = NumericSolver(irb120_chain).solve(targets, np.tile(home, (len(targets), 1)))

    errors = pose_errors(targets, irb120_chain.forward(solutions.positions))

    within = (np.linalg.norm(errors[:, :3], axis=1) < 1e-5) & (
        np.linalg.norm(errors[:, 3:], axis=1) < 1e-4
    )
    assert within.mean() >= 0.995
    assert within[solutions.reached].all()
    assert (solutions.positions >= irb120_chain.lower).all()
    assert (solutions.positions <= irb120_chain.upper).all()
    assert all(
        reason or reached
        for reason, reached in zip(solutions.reasons, solutions.reached, strict=True)
    )


def test_path_in_order_does_not_jump(irb120_chain):
    path = np.linspace([-1.0, 0.2, 0.3, -0.8, 0.7, 0.5], [1.0, 0.7, -0.5, 0.8, 1.4, -1.0], 100)
    found = require(NumericSolver(irb120_chain).solve(irb120_chain.forward(path), path[0]))
    np.testing.assert_allclose(found, path, atol=1e-4)  # 1e-6 m and 1e-5 rad at the tool


@pytest.mark.parametrize("name", ["ur5", "irb120"])
def test_any_geometry(name, dh_chain, random_postures, tables, belt):
    chain = dh_chain(tables[name], slide=belt)
    targets = chain.forward(random_postures(chain, 200))

    solutions = NumericSolver(chain).solve(targets, np.full((200, 7), 0.1))

    assert solutions.reached.mean() > 0.98


def test_position_only(irb120_chain, home):
    target = irb120_chain.forward(home)
    target[0, :3, 3] += [0.05, 0.1, -0.05]
    target[0, :3, :3] = np.eye(3)  # of no account
    solutions = NumericSolver(irb120_chain, weights=[1, 1, 1, 0, 0, 0]).solve(target, home)

    found = irb120_chain.forward(require(solutions))

    np.testing.assert_allclose(found[0, :3, 3], target[0, :3, 3], atol=1e-6)
    assert solutions.rotation_error[0] == 0.0


@pytest.mark.parametrize("axis", range(3))
def test_weights_are_in_pose_order(irb120_chain, home, axis):
    """Only the rotation about one axis of the base is asked: R = exp(e)·R keeps e's other parts free."""
    target = irb120_chain.forward(home + np.array([0.3, 0.2, -0.1, 0.2, -0.3, 0.1]))
    weights = np.zeros(6)
    weights[5 - axis] = 1.0  # [x y z Rz Ry Rx]
    found = NumericSolver(irb120_chain, weights=weights).solve(target, home).positions

    errors = pose_errors(target, irb120_chain.forward(found))[0]

    assert abs(errors[3 + axis]) < 1e-5
    assert np.abs(np.delete(errors, 3 + axis)).max() > 1e-2


def test_compromise_is_the_weighted_minimum(irb120_chain, home):
    """A pose out of reach, against scipy's minimiser of the same sum."""
    target = irb120_chain.forward(home)
    target[0, :3, 3] += [0.5, 0.1, 0.0]
    weights = np.array([1.0, 2.0, 3.0, 0.3, 0.2, 0.1])

    def cost(posture):
        return (
            pose_errors(target, irb120_chain.forward(posture))[0] ** 2 @ weights[[0, 1, 2, 5, 4, 3]]
        )

    found = (
        NumericSolver(irb120_chain, weights=weights, restarts=0, iterations=200)
        .solve(target, home)
        .positions[0]
    )
    limits = list(zip(irb120_chain.lower, irb120_chain.upper, strict=True))
    best = minimize(
        cost, found + 0.01, bounds=limits, method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-9}
    )
    assert cost(found) <= best.fun * (1 + 1e-9)


def test_limits_hold_joints_back(irb120_chain, home):
    target = irb120_chain.forward(home + np.array([3.2, 0, 0, 0, 0, 0]))  # joint 1 ends at 2.88
    solutions = NumericSolver(irb120_chain, restarts=0).solve(
        target, home + np.array([2.5, 0, 0, 0, 0, 0])
    )

    assert solutions.positions[0, 0] == irb120_chain.upper[0]
    with pytest.raises(
        Unreachable,
        match=r"joint limit: joint_1 is at its upper limit of 2\.88 rad \(165 deg\)",
    ):
        require(solutions)


def test_out_of_reach(irb120_chain, home):
    with pytest.raises(Unreachable, match=r"out of reach: the target is 2\.09 m from joint_1"):
        require(NumericSolver(irb120_chain).solve([2, 0, 0.6, 0, 0, 0], home))


def test_just_out_of_reach_is_a_singular_posture(irb120_chain, home):
    target = [0.7, 0, 0.29, 0, np.pi / 2, 0]
    solutions = NumericSolver(irb120_chain, weights=[1, 1, 1, 0, 0, 0]).solve(target, home)

    # 0.270 + 0.310 + 0.072 stretched
    assert solutions.position_error[0] == pytest.approx(0.7 - 0.652, abs=1e-3)
    with pytest.raises(Unreachable, match="singular posture: the arm is stretched"):
        require(solutions)


@pytest.mark.long
def test_nothing_is_random(irb120_chain, random_postures, home):
    targets = irb120_chain.forward(random_postures(irb120_chain, 50))
    one, other = (NumericSolver(irb120_chain).solve(targets, home) for _ in range(2))
    np.testing.assert_array_equal(one.positions, other.positions)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"weights": [1, 1, 1]}, "six numbers"),
        ({"weights": [1, 1, 1, 0, 0, -1]}, "none negative"),
        ({"weights": [0] * 6}, "not all zero"),
        ({"weights": [1, 1, 1, 1, 1, np.nan]}, "six numbers"),
        ({"weights": "position"}, "six numbers"),
        ({"restarts": -1}, "restarts"),
        ({"iterations": 0}, "iterations"),
        ({"position_tolerance": 0.0}, "position_tolerance"),
        ({"rotation_tolerance": np.nan}, "rotation_tolerance"),
    ],
)
def test_bad_settings(irb120_chain, options, said):
    with pytest.raises(InvalidParameter, match=said):
        NumericSolver(irb120_chain, **options)


def test_seven_axes_keep_room_to_their_limits_where_they_begin_with_it(
    dh_chain, random_postures, tables
):
    chain = dh_chain(tables["iiwa"], limit=1.2)
    postures = random_postures(chain, 200) * 0.9
    targets = chain.forward(postures)

    solutions = NumericSolver(chain, restarts=0).solve(targets, np.zeros_like(postures))

    room = np.minimum(chain.upper - solutions.positions, solutions.positions - chain.lower).min(
        axis=1
    )
    assert solutions.reached.mean() > 0.5
    assert (room[solutions.reached] > 0.05 - 1e-9).mean() > 0.95

    near = chain.upper - 0.01
    stays = NumericSolver(chain).solve(chain.forward(near), near[np.newaxis])

    # what begins without room does not jump
    np.testing.assert_allclose(stays.positions[0], near, atol=1e-9)


def test_the_lower_limit_holds_a_joint_back_as_well(irb120_chain, home):
    target = irb120_chain.forward(home - np.array([3.2, 0, 0, 0, 0, 0]))  # joint 1 ends at -2.88
    solutions = NumericSolver(irb120_chain, restarts=0).solve(
        target, home - np.array([2.5, 0, 0, 0, 0, 0])
    )

    assert solutions.positions[0, 0] == irb120_chain.lower[0]
    with pytest.raises(
        Unreachable,
        match=r"joint limit: joint_1 is at its lower limit of -2\.88 rad \(-165 deg\)",
    ):
        require(solutions)
