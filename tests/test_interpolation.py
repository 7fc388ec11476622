"""Lines, arcs, turns and poses between two, against circles and rotations given otherwise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.base.interpolation import Arc, line, poses, turn, turned_by

ANGLES = st.floats(0.1, 6.1)


def test_a_line_is_even_and_straight() -> None:
    points = line([1, 2, 3], [2, 0, 3], [0, 0.25, 1])
    np.testing.assert_allclose(points, [[1, 2, 3], [1.25, 1.5, 3], [2, 0, 3]], atol=1e-15)


@given(ANGLES, ANGLES, st.integers(0, 1000))
def test_an_arc_is_the_part_of_the_circle_that_passes_the_middle_point(
    one: float, other: float, seed: int
) -> None:
    middle, end = sorted([one, other + 0.05 if one == other else other])
    if end - middle < 0.05:
        end = middle + 0.05
    random = np.random.default_rng(seed)
    centre, radius = random.normal(size=3), random.uniform(0.01, 2)
    u, v = np.linalg.qr(random.normal(size=(3, 3)))[0].T[:2]

    def on_circle(angle: float) -> np.ndarray:
        return centre + radius * (np.cos(angle) * u + np.sin(angle) * v)

    arc = Arc.through(on_circle(0), on_circle(middle), on_circle(end))
    np.testing.assert_allclose(
        [arc.radius, arc.angle, arc.length], [radius, end, radius * end], rtol=1e-6
    )
    parts = np.linspace(0, 1, 7)
    np.testing.assert_allclose(
        arc.points(parts), [on_circle(part * end) for part in parts], atol=1e-6 * radius
    )


@pytest.mark.parametrize(
    "points",
    [
        ([0, 0, 0], [1, 0, 0], [2, 0, 0]),
        ([0, 0, 0], [0, 0, 0], [1, 0, 0]),
        ([0, 0, 0], [1, 0, 0], [0, 0, 0]),
        ([0, 0, 0], [1, 1, 0], [1, 1, 0]),
    ],
)
def test_points_on_one_line_make_no_arc(points: tuple[list[float], ...]) -> None:
    with pytest.raises(InvalidParameter, match="three points that are not collinear"):
        Arc.through(*points)


def test_a_turn_goes_about_one_axis_at_even_speed() -> None:
    start = RotationMatrix.MakeXRotation(0.4).matrix()
    end = start @ RotationMatrix.MakeZRotation(1.2).matrix()

    for part, matrix in zip((0, 0.25, 1), turn(start, end, [0, 0.25, 1]), strict=True):
        np.testing.assert_allclose(
            matrix, start @ RotationMatrix.MakeZRotation(part * 1.2).matrix(), atol=1e-14
        )
    assert turned_by(start, end) == pytest.approx(1.2)


def test_a_pose_moves_and_turns_together() -> None:
    start, end = transform_from_pose([0, 0, 0, 0, 0, 0]), transform_from_pose([1, 2, 0, 1.0, 0, 0])
    middle = RigidTransform(poses(start, end, [0.5])[0])

    assert middle.IsNearlyEqualTo(transform_from_pose([0.5, 1, 0, 0.5, 0, 0]), 1e-12)
    assert RigidTransform(poses(start, end, 1.0)[0]).IsNearlyEqualTo(end, 1e-12)
    assert RigidTransform(poses(start, end, 0.0)[0]).IsNearlyEqualTo(start, 1e-12)
