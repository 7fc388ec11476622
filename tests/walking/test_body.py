"""Kinematics of a walking robot: inverse kinematics against their law, and slopes through feet."""

from collections.abc import Iterator

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from simrob_drake import load_station
from simrob_drake.parts.controllers.walk import WalkingLoop
from simrob_drake.stations.station import add_station
from simrob_drake.walking.body import Body, height_on_slope, slope_through, slope_weights_of
from simrob_drake.walking.engine import rotation_matrix
from simrob_drake.walking.knees import Knee

DAMPING = 1e-5  # m², rad²
LARGEST_STEP = 0.3  # rad
ROOT = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]  # pose x y z qw qx qy qz of a root that is not turned


# Components of the pose error [roll, pitch, yaw, ahead, left, up] that legs correct, by their count of joints.
CONTROLLED = {4: [0, 1, 3, 5], 6: [0, 1, 2, 3, 4, 5]}


@pytest.fixture(scope="module", params=["humanoid_walking", "zjudancer_walking"])
def robot(request: pytest.FixtureRequest) -> Iterator[tuple[Body, np.ndarray]]:
    """Kinematics of a robot with four or six joints in each leg, and its posture as it stands, shape (n,) [rad]."""
    builder = DiagramBuilder()  # keeps the plant alive
    add_station(builder, load_station(request.param))
    loop = next(block for block in builder.GetSystems() if isinstance(block, WalkingLoop))
    yield loop.engine.body, loop.engine.stand(loop.start)[1]
    assert builder is not None


def sole_poses(body: Body, posture: np.ndarray) -> list[RigidTransform]:
    """Poses of the soles' middles from the root, in a root that looks along x."""
    still = np.zeros_like(posture)
    state = body.observe(np.concatenate([posture, still, ROOT, np.zeros(6)]))
    root = RigidTransform(ROOT[:3])
    poses = []
    for rows in state.feet:
        in_root = root.inverse() @ RigidTransform(np.array([*rows, [0, 0, 0, 1]]))
        # The rotation of a sole is already that from one that looks along the x axis of the world.
        poses.append(RigidTransform(body.facing) @ in_root)
    return poses


def pose_error(pose: RigidTransform, target: RigidTransform) -> np.ndarray:
    """Rotation vector and distance from a pose to a target, shape (6,) [rad, m]."""
    rotation = target.rotation().matrix() @ pose.rotation().matrix().T
    distance = target.translation() - pose.translation()
    return np.concatenate([Rotation.from_matrix(rotation).as_rotvec(), distance])


def numeric_jacobian(body: Body, posture: np.ndarray, foot: int, axes: np.ndarray) -> np.ndarray:
    """Jacobian of a sole's pose by axes of its leg, by central differences, shape (6, k)."""
    change = 1e-6  # rad
    columns = []
    for axis in axes:
        offset = np.zeros_like(posture)
        offset[axis] = change
        before = sole_poses(body, posture - offset)[foot]
        after = sole_poses(body, posture + offset)[foot]
        columns.append(pose_error(before, after) / (2 * change))
    return np.array(columns).T


def displace(
    poses: list[RigidTransform], rotation: RotationMatrix, translation: list[float]
) -> list[RigidTransform]:
    """Poses that are turned about their own points and moved."""
    return [
        RigidTransform(rotation @ pose.rotation(), pose.translation() + translation)
        for pose in poses
    ]


def matrices(poses: list[RigidTransform]) -> np.ndarray:
    """Poses as an array of shape (feet, 3, 4)."""
    return np.array([pose.GetAsMatrix34() for pose in poses])


def test_one_round_is_a_damped_least_squares_step(robot: tuple[Body, np.ndarray]) -> None:
    """The change of the legs is J' (J J' + lambda I)^-1 e, here with a Jacobian by differences."""
    body, posture = robot
    poses = sole_poses(body, posture)
    turn = RotationMatrix(Rotation.from_rotvec([0.002, -0.001, 0.003]).as_matrix())
    targets = displace(poses, turn, [0.003, -0.002, 0.004])

    body.set_posture(posture)
    change = body.solve_posture(np.eye(3), matrices(targets)) - posture

    for foot, axes in enumerate(body._legs):
        components = CONTROLLED[len(axes)]
        jacobian = numeric_jacobian(body, posture, foot, axes)[components]
        error = pose_error(poses[foot], targets[foot])[components]
        square = jacobian @ jacobian.T + DAMPING * np.eye(len(components))
        expected = jacobian.T @ np.linalg.solve(square, error)
        assert np.abs(expected).max() > 0.01
        assert change[axes] == pytest.approx(expected, abs=2e-5)


def test_axes_in_no_leg_stay(robot: tuple[Body, np.ndarray]) -> None:
    body, posture = robot
    targets = displace(sole_poses(body, posture), RotationMatrix(), [0.01, 0.0, 0.01])

    body.set_posture(posture)
    solved = body.solve_posture(np.eye(3), matrices(targets), 3)

    others = np.setdiff1d(np.arange(len(posture)), body._legs)
    assert others.size > 0
    assert (solved[others] == posture[others]).all()


def test_no_joint_changes_by_more_than_the_largest_step(robot: tuple[Body, np.ndarray]) -> None:
    body, posture = robot
    far = displace(sole_poses(body, posture), RotationMatrix(), [0.3, 0.0, 0.3])

    body.set_posture(posture)
    change = body.solve_posture(np.eye(3), matrices(far)) - posture

    assert np.abs(change).max() == pytest.approx(LARGEST_STEP)


@pytest.mark.parametrize(("move", "end"), [([0.3, 0.0, 0.3], "upper"), ([-0.3, 0.0, 0.3], "lower")])
def test_legs_stay_within_their_limits_if_a_target_is_out_of_reach(
    robot: tuple[Body, np.ndarray], move: list[float], end: str
) -> None:
    body, posture = robot
    far = displace(sole_poses(body, posture), RotationMatrix.MakeZRotation(1.5), move)

    body.set_posture(posture)
    solved = body.solve_posture(np.eye(3), matrices(far), 30)

    limits = body._upper if end == "upper" else body._lower
    is_at_limit = solved[body._legs] == limits[body._legs]
    assert is_at_limit.any()  # without a limit, these axes would go on
    assert (solved >= body._lower).all()
    assert (solved <= body._upper).all()


def test_further_rounds_reach_the_target(robot: tuple[Body, np.ndarray]) -> None:
    body, posture = robot
    targets = displace(sole_poses(body, posture), RotationMatrix(), [0.02, 0.0, 0.02])

    body.set_posture(posture)
    solved = body.solve_posture(np.eye(3), matrices(targets), 20)

    for pose, target in zip(sole_poses(body, solved), targets, strict=True):
        assert pose_error(pose, target) == pytest.approx(np.zeros(6), abs=1e-5)


@pytest.mark.parametrize("angles", [(0.3, -0.2, 0.7), (-1.0, 0.4, -2.5), (0.0, 0.0, 0.0)])
def test_a_rotation_matrix_is_that_of_its_angles(angles: tuple[float, float, float]) -> None:
    expected = Rotation.from_euler("xyz", angles).as_matrix()  # about fixed axes

    assert np.array(rotation_matrix(*angles)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("slope", [0.1 - 0.05j, -0.2j])
def test_a_slope_is_found_from_the_heights_of_feet(slope: complex) -> None:
    feet = [0.3 + 0.1j, -0.2 + 0.2j, -0.1 - 0.3j]
    heights = [height_on_slope(slope, foot) for foot in feet]

    assert heights[0] == pytest.approx(slope.real * 0.3 + slope.imag * 0.1)
    assert slope_through(slope_weights_of(feet), heights) == pytest.approx(slope)


def test_two_feet_determine_the_slope_along_their_line_only() -> None:
    pair = [0.2 - 0.1j, -0.2 + 0.1j]
    heights = [0.01, -0.01]

    slope = slope_through(slope_weights_of(pair), heights)

    across = 1j * (pair[0] - pair[1])
    assert height_on_slope(slope, pair[0]) == pytest.approx(0.01)
    assert height_on_slope(slope, across) == pytest.approx(0.0, abs=1e-15)


class TestKnees:
    """Limits that keep a knee on the side to which it is bent."""

    knee = Knee(place=3, straight=0.2, fold=1.0)

    @pytest.mark.parametrize(
        ("angle", "bend"), [(1.0, 0.8), (-0.5, -0.7), (0.2, 0.0), (0.2 + 2 * np.pi, 0.0)]
    )
    def test_the_bend_is_measured_from_the_straight_leg(self, angle: float, bend: float) -> None:
        assert self.knee.bend_at(angle) == pytest.approx(bend)

    def test_a_knee_with_a_positive_bend_has_a_higher_lower_limit(self) -> None:
        assert self.knee.limits_on_side_of(1.0, -2.0, 2.0) == pytest.approx((0.25, 2.0))

    def test_a_knee_with_a_negative_bend_has_a_lower_upper_limit(self) -> None:
        assert self.knee.limits_on_side_of(-0.5, -2.0, 2.0) == pytest.approx((-2.0, 0.15))

    def test_limits_that_are_narrower_stay(self) -> None:
        assert self.knee.limits_on_side_of(1.0, 0.5, 2.0) == pytest.approx((0.5, 2.0))
