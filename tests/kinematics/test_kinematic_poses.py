"""Every form of a pose, in batches, against Drake's own conversions and scipy's rotations."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from scipy.spatial.transform import Rotation

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import poses_from_matrices, rotation_vectors, transform_from_pose
from simrob_drake.kinematics import pose_errors, pose_matrices

VECTORS = np.random.default_rng(1).uniform(-1.5, 1.5, (50, 6))
MATRICES = np.array([transform_from_pose(vector).GetAsMatrix4() for vector in VECTORS])
TRANSFORMS = [RigidTransform(matrix) for matrix in MATRICES]


@pytest.mark.parametrize(
    "targets", [VECTORS, VECTORS.tolist(), MATRICES, TRANSFORMS, list(MATRICES)]
)
def test_batches(targets):
    np.testing.assert_allclose(pose_matrices(targets), MATRICES, atol=1e-15)


@pytest.mark.parametrize("target", [VECTORS[0], MATRICES[0], TRANSFORMS[0], [TRANSFORMS[0]]])
def test_single_poses(target):
    np.testing.assert_allclose(pose_matrices(target), MATRICES[:1], atol=1e-15)


def test_there_and_back():
    np.testing.assert_allclose(poses_from_matrices(MATRICES), VECTORS, atol=1e-12)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_pitch_at_right_angles(pitch):
    locked = pose_matrices([0, 0, 0, 0.3, pitch, 0.8])
    # cos(π/2) is 6e-17, not 0
    np.testing.assert_allclose(pose_matrices(poses_from_matrices(locked)), locked, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-13, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-9])
def test_rotation_vectors(angle):
    axes = np.random.default_rng(2).normal(size=(30, 3))
    vectors = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)

    found = rotation_vectors(Rotation.from_rotvec(vectors).as_matrix())

    # near π the axis loses digits
    np.testing.assert_allclose(found, vectors, atol=1e-9 if angle > 3.1 else 1e-14)


def test_half_turn():
    found = rotation_vectors(np.diag([-1.0, 1.0, -1.0])[np.newaxis])
    np.testing.assert_allclose(np.abs(found), [[0, np.pi, 0]], atol=1e-12)


def test_errors_lead_to_the_target():
    errors = pose_errors(MATRICES[1:], MATRICES[:-1])

    np.testing.assert_allclose(
        MATRICES[:-1, :3, 3] + errors[:, :3], MATRICES[1:, :3, 3], atol=1e-14
    )

    turned = Rotation.from_rotvec(errors[:, 3:]).as_matrix() @ MATRICES[:-1, :3, :3]
    np.testing.assert_allclose(turned, MATRICES[1:, :3, :3], atol=1e-12)


SCALED = np.diag([2.0, 1, 1, 1])
MIRRORED = np.diag([-1.0, 1, 1, 1])
PROJECTIVE = np.eye(4) + np.outer([0, 0, 0, 1], [0.1, 0, 0, 0])


@pytest.mark.parametrize(
    ("targets", "said"),
    [
        ([1, 2, 3], "shape"),
        (np.zeros((2, 5)), "shape"),
        (np.zeros((2, 3, 4)), "shape"),
        ([], r"targets is .*\[\]"),
        (np.zeros((0, 6)), r"targets is .*\[\]"),
        ([0, 0, 0, 0, np.nan, 0], "nan at"),
        ([[0] * 6, [0, np.inf, 0, 0, 0, 0]], r"inf at \[1, 1\]"),
        ("there", "pose vectors"),
        (None, "finite|pose vectors"),
        ([TRANSFORMS[0], [0] * 6], "the same form"),
        (SCALED, r"targets\[0\].*a rotation"),
        ([np.eye(4), MIRRORED], r"targets\[1\].*a rotation"),
        (PROJECTIVE, "last row"),
        ([[0] * 6, [0] * 5], "pose vectors"),
    ],
)
def test_bad_targets(targets, said):
    with pytest.raises(InvalidParameter, match=said):
        pose_matrices(targets)
