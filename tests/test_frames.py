"""Pose vectors and pose ports against their definition R = Rz Ry Rx."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial.transform import Rotation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import (
    as_transform,
    lean,
    point,
    pose_from_transform,
    pose_matrices,
    poses_from_matrices,
    three_point_frame,
    transform_from_pose,
    transform_from_xyz_quaternion,
    xyz_quaternion_from_transform,
)

# At the gimbal lock Ry = ±90 deg the angles are not unique, so the random ones keep away from it.
ANGLE_BOUNDS = np.array([np.pi, 1.5, np.pi])


def random_poses(count: int) -> list[np.ndarray]:
    random = np.random.default_rng(1)
    return [
        np.concatenate([random.uniform(-2, 2, 3), random.uniform(-1, 1, 3) * ANGLE_BOUNDS])
        for _ in range(count)
    ]


def test_a_pose_turns_about_z_then_the_new_y_then_the_new_x() -> None:
    x, y, z, about_z, about_y, about_x = 0.1, -0.2, 0.3, 0.7, -0.4, 1.9
    transform = transform_from_pose([x, y, z, about_z, about_y, about_x])

    expected = (
        RotationMatrix.MakeZRotation(about_z)
        @ RotationMatrix.MakeYRotation(about_y)
        @ RotationMatrix.MakeXRotation(about_x)
    )

    np.testing.assert_allclose(transform.rotation().matrix(), expected.matrix(), atol=1e-15)
    np.testing.assert_array_equal(transform.translation(), [x, y, z])


def test_the_tilted_table_has_its_published_axes() -> None:
    # facts of the inclined table: Euler ZYX [-120, 0, 15] deg
    matrix = (
        transform_from_pose([0.4, 0.133, 0, *np.deg2rad([-120.0, 0.0, 15.0])]).rotation().matrix()
    )
    published = [[-0.5, -0.8660, 0], [0.8365, -0.4830, 0.2588], [-0.2241, 0.1294, 0.9659]]
    np.testing.assert_allclose(matrix.T, published, atol=5e-5)  # printed with four decimals


@pytest.mark.parametrize("pose", random_poses(20))
def test_a_pose_survives_the_way_through_a_transform(pose: np.ndarray) -> None:
    np.testing.assert_allclose(pose_from_transform(transform_from_pose(pose)), pose, atol=1e-13)


@pytest.mark.parametrize("tilt", [np.pi / 2, -np.pi / 2])
def test_at_the_gimbal_lock_the_rotation_survives(tilt: float) -> None:
    transform = transform_from_pose([0, 0, 0, 0.3, tilt, 0.2])
    again = transform_from_pose(pose_from_transform(transform))
    np.testing.assert_allclose(again.GetAsMatrix4(), transform.GetAsMatrix4(), atol=1e-14)


@pytest.mark.parametrize("away", [1e-16, 1e-12, 1e-9, 1e-7, 1e-4])
def test_near_the_gimbal_lock_the_rotation_survives_too(away: float) -> None:
    transform = transform_from_pose([0, 0, 0, 0.3, np.pi / 2 - away, 0.2])
    again = transform_from_pose(pose_from_transform(transform))
    np.testing.assert_allclose(again.GetAsMatrix4(), transform.GetAsMatrix4(), atol=1e-14)


@pytest.mark.parametrize("pose", random_poses(20))
def test_a_transform_survives_the_way_through_a_quaternion(pose: np.ndarray) -> None:
    transform = transform_from_pose(pose)
    values = xyz_quaternion_from_transform(transform)

    assert values[3] >= 0
    np.testing.assert_allclose(
        transform_from_xyz_quaternion(values).GetAsMatrix4(), transform.GetAsMatrix4(), atol=1e-14
    )


def test_a_quarter_turn_about_z_is_the_known_quaternion() -> None:
    values = xyz_quaternion_from_transform(
        RigidTransform(RotationMatrix.MakeZRotation(np.pi / 2), [1, 2, 3])
    )
    np.testing.assert_allclose(values, [1, 2, 3, np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-15)


@pytest.mark.parametrize("scale", [-3.0, 1e-3, 1.0])
def test_length_and_sign_of_a_quaternion_do_not_matter(scale: float) -> None:
    wxyz = np.array([0.5, -0.5, 0.5, 0.5])
    turned = transform_from_xyz_quaternion([0, 0, 0, *(scale * wxyz)]).rotation().matrix()
    np.testing.assert_allclose(
        turned, transform_from_xyz_quaternion([0, 0, 0, *wxyz]).rotation().matrix(), atol=1e-15
    )


@pytest.mark.parametrize(
    "pose", [[0] * 5, [0] * 7, [[0] * 6], [0, 0, np.nan, 0, 0, 0], [np.inf, 0, 0, 0, 0, 0]]
)
def test_a_pose_needs_six_finite_numbers(pose: list[float]) -> None:
    with pytest.raises(InvalidParameter, match="six finite numbers"):
        transform_from_pose(pose)


@pytest.mark.parametrize(
    "values", [[0, 0, 0, 1, 0, 0], [0, 0, 0, np.nan, 0, 0, 0], [1, 2, 3, 0, 0, 0, 0]]
)
def test_a_port_pose_needs_seven_finite_numbers(values: list[float]) -> None:
    with pytest.raises(InvalidParameter, match="seven finite numbers"):
        transform_from_xyz_quaternion(values)


@pytest.mark.parametrize(
    "values", ["x", None, [[1, 2], [3]], [["a"] * 4] * 4, [1, 2, 3, 4, 5, "six"], [10**400] * 6, {}]
)
@pytest.mark.parametrize(
    "function", [as_transform, transform_from_pose, transform_from_xyz_quaternion, point]
)
def test_what_is_no_array_of_numbers_is_no_pose(
    function: Callable[[Any], Any], values: Any
) -> None:
    with pytest.raises(InvalidParameter, match=r"(six|seven|three) finite numbers"):
        function(values)


def test_all_forms_of_a_pose_are_one() -> None:
    pose = [0.1, -0.2, 0.3, 0.7, -0.4, 1.9]
    transform = transform_from_pose(pose)

    for form in (
        pose,
        np.array(pose),
        transform,
        transform.GetAsMatrix4(),
        transform.GetAsMatrix4().tolist(),
    ):
        assert as_transform(form).IsNearlyEqualTo(transform, 1e-15)
        np.testing.assert_allclose(
            as_transform(form).GetAsMatrix4(), transform.GetAsMatrix4(), atol=1e-15
        )
    np.testing.assert_allclose(
        poses_from_matrices(np.array([transform.GetAsMatrix4()] * 2)), [pose, pose], atol=1e-14
    )


@pytest.mark.parametrize(
    "matrix",
    [
        2 * np.eye(4),
        np.diag([1, 1, -1, 1]),
        np.full((4, 4), np.nan),
        np.diag([1.1, 1, 1, 1]),
        np.eye(4)[::-1],
    ],
)
def test_a_matrix_that_is_no_rigid_motion_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(InvalidParameter, match="a rotation, a position, and the last row 0 0 0 1"):
        as_transform(matrix)


@pytest.mark.parametrize(("sense", "angle"), [(1.0, 0.0), (-1.0, np.pi)])
def test_the_lean_of_a_body_that_is_upright_or_upside_down_is_found_despite_rounding(
    sense: float, angle: float
) -> None:
    """Rounding brings the cosine of about a third of these bodies beyond 1 or -1, where acos fails."""
    found = []
    for rotation in Rotation.random(200, random_state=1):
        up = sense * rotation.inv().apply([0.0, 0.0, 1.0])
        x, y, z, w = rotation.as_quat().tolist()
        found.append(lean(up.tolist(), w, x, y, z))

    assert found == pytest.approx([angle] * 200, abs=1e-7)


@pytest.mark.parametrize("angle", [-2.0, -0.3, 0.3, 2.0])
def test_the_lean_of_a_body_has_no_sign(angle: float) -> None:
    found = lean([0.0, 0.0, 1.0], np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0)

    assert found == pytest.approx(abs(angle))


class TestThreePoints:
    x1, x2, y1 = (0.4000, 0.1330, 0), (0.1500, -0.3000, 0), (0.7232, -0.0536, 0.1000)

    def test_the_inclined_table_has_its_published_frame(self) -> None:
        frame = three_point_frame(self.x1, self.x2, self.y1)

        np.testing.assert_allclose(frame.translation(), [0.4, 0.133, 0], atol=5e-6)

        published = [[-0.5, -0.8660, 0], [0.8365, -0.4830, 0.2588], [-0.2241, 0.1294, 0.9659]]
        # printed with four decimals
        np.testing.assert_allclose(frame.rotation().matrix().T, published, atol=5e-5)
        np.testing.assert_allclose(
            np.rad2deg(pose_from_transform(frame)[3:]), [-120, 0, 15], atol=5e-3
        )

    def test_the_origin_is_where_the_way_to_y1_is_shortest(self) -> None:
        x1, x2, y1 = np.random.default_rng(2).normal(size=(3, 3))
        frame = three_point_frame(x1, x2, y1)

        parts = np.linspace(-3, 3, 600_001)[:, np.newaxis]
        way = np.linalg.norm((1 - parts) * x1 + parts * x2 - y1, axis=1)  # SimRob's search for it
        assert np.linalg.norm(frame.translation() - y1) == pytest.approx(way.min(), abs=1e-9)

        seen = frame.inverse() @ np.column_stack([x1, x2, y1])
        np.testing.assert_allclose(seen[1:, :2], 0, atol=1e-12)  # x1 and x2 on the x axis
        np.testing.assert_allclose(seen[[0, 2], 2], 0, atol=1e-12)
        assert seen[0, 1] > 0
        assert seen[1, 2] > 0

    @pytest.mark.parametrize(
        ("points", "message"),
        [
            (
                ([0, 0, 0], [1, 0, 0], [2, 0, 0]),
                "y1 .* three collinear points do not define a frame",
            ),
            (([0, 0, 0], [0, 0, 0], [0, 1, 0]), "a point different from x1"),
            (([0, 0, 0], [1, 0, 0], [1, 1, 0]), "x2 .* which is the foot of the perpendicular"),
            (([0, 0], [1, 0, 0], [1, 1, 0]), "x1 .* three finite numbers"),
            (([0, 0, np.inf], [1, 0, 0], [1, 1, 0]), "x1 .* three finite numbers"),
        ],
    )
    def test_points_that_fix_no_frame_are_refused(
        self, points: tuple[list[float], ...], message: str
    ) -> None:
        with pytest.raises(InvalidParameter, match=message):
            three_point_frame(*points)


def test_many_poses_are_the_matrices_of_each() -> None:
    poses = np.array([[0.1, -0.2, 0.3, 0.7, -0.4, 1.9], [1.0, 2.0, -3.0, -2.1, 1.2, -0.6]])

    matrices = pose_matrices(poses)

    for pose, matrix in zip(poses, matrices, strict=True):
        np.testing.assert_allclose(matrix, transform_from_pose(pose).GetAsMatrix4(), atol=1e-15)
