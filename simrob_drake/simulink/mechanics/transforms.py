"""The pose of a Rigid Transform's follower frame in its base frame, by each of the methods that the block offers."""

from collections.abc import Callable

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.simulink.model.nodes import Node

AXES = {
    "+X": np.array([1.0, 0.0, 0.0]),
    "+Y": np.array([0.0, 1.0, 0.0]),
    "+Z": np.array([0.0, 0.0, 1.0]),
    "-X": np.array([-1.0, 0.0, 0.0]),
    "-Y": np.array([0.0, -1.0, 0.0]),
    "-Z": np.array([0.0, 0.0, -1.0]),
}
_TURNS = {
    "X": RotationMatrix.MakeXRotation,
    "Y": RotationMatrix.MakeYRotation,
    "Z": RotationMatrix.MakeZRotation,
}


def rigid_transform(node: Node) -> RigidTransform:
    """Return X_BF of a Rigid Transform block; the offset is resolved in the base frame.

    Raises:
        InvalidModel: a method or figure that cannot be.
    """
    return RigidTransform(rotation(node), translation(node))


def translation(node: Node) -> Vector:
    """Return the offset of a block's translation parameters, shape (3,) [m]."""
    method = node.text("TranslationMethod", "None")
    if method == "None":
        return np.zeros(3)
    if method == "Cartesian":
        return node.numbers("TranslationCartesianOffset", "[0 0 0]", unit="m", size=3)
    if method == "StandardAxis":
        return axis(node, "TranslationStandardAxis") * node.number("TranslationStandardOffset", unit="m")
    if method == "Cylindrical":
        radius = node.number("TranslationROffset", unit="m")
        angle = node.number("TranslationThetaOffset", unit="rad")
        return np.array([radius * np.cos(angle), radius * np.sin(angle), node.number("TranslationZOffset", unit="m")])
    raise node.refusal(f"has the unknown translation method '{method}'")


def rotation(node: Node, prefix: str = "") -> RotationMatrix:
    """Return R_BF of a block's rotation parameters; joints have them with a prefix, such as ``PositionTarget``.

    Raises:
        InvalidModel: a method or figure that cannot be.
    """
    method = node.text(f"{prefix}RotationMethod", "None")
    if method not in _ROTATIONS:
        raise node.refusal(f"has the unknown rotation method '{method}'")
    return _ROTATIONS[method](node, prefix)


def _aligned(node: Node, prefix: str) -> RotationMatrix:
    follower = _triad(node, f"{prefix}FollAlignAxisA", f"{prefix}FollAlignAxisB")
    base = _triad(node, f"{prefix}BaseAlignAxisA", f"{prefix}BaseAlignAxisB")
    return RotationMatrix(base @ follower.T)


def _matrix(node: Node, prefix: str) -> RotationMatrix:
    matrix = node.numbers(f"{prefix}RotationMatrix", "[1 0 0;0 1 0;0 0 1]", size=9).reshape(3, 3)
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) or np.linalg.det(matrix) < 0:
        raise node.refusal(f"its {prefix}RotationMatrix is no rotation: not orthonormal and right-handed")
    return RotationMatrix.ProjectToRotationMatrix(matrix)


def _quaternion(node: Node, prefix: str) -> RotationMatrix:
    quaternion = node.numbers(f"{prefix}Quaternion", "[1 0 0 0]", size=4)
    if np.linalg.norm(quaternion) < 1e-9:
        raise node.refusal(f"its {prefix}Quaternion is zero")
    return RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))


def axis(node: Node, name: str) -> Vector:
    """Return the direction that a parameter such as ``+Z`` names."""
    text = node.text(name, "+Z")
    if text not in AXES:
        raise node.refusal(f"{name} is '{text}'; it must be one of {', '.join(AXES)}")
    return AXES[text]


def _about(node: Node, direction: Vector, prefix: str) -> RotationMatrix:
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        raise node.refusal("turns about an axis of length zero")
    return RotationMatrix(AngleAxis(node.number(f"{prefix}RotationAngle", unit="rad"), direction / length))


def _triad(node: Node, first: str, second: str) -> Vector:
    """Return two axes and their cross product as columns, shape (3, 3)."""
    one, other = axis(node, first), axis(node, second)
    if abs(one @ other) > 0.5:
        raise node.refusal(f"{first} and {second} are along one line; two axes span a frame")
    return np.column_stack([one, other, np.cross(one, other)])


def _sequence(node: Node, prefix: str) -> RotationMatrix:
    letters = node.text(f"{prefix}RotationSequence", "XYZ")
    if len(letters) != 3 or any(letter not in _TURNS for letter in letters):
        raise node.refusal(f"has the rotation sequence '{letters}'; it must be three axes such as ZYX")
    angles = node.numbers(f"{prefix}RotationSequenceAngles", "[0 0 0]", unit="rad", size=3)
    turns = [_TURNS[letter](angle) for letter, angle in zip(letters, angles, strict=True)]
    if node.text(f"{prefix}RotationSequenceAxes", "FollowerAxes") == "BaseAxes":
        turns.reverse()  # about fixed axes the later turn stands to the left
    return turns[0] @ turns[1] @ turns[2]


_ROTATIONS: dict[str, Callable[[Node, str], RotationMatrix]] = {
    "None": lambda *_: RotationMatrix(),
    "StandardAxis": lambda node, prefix: _about(node, axis(node, f"{prefix}RotationStandardAxis"), prefix),
    "ArbitraryAxis": lambda node, prefix: _about(
        node, node.numbers(f"{prefix}RotationArbitraryAxis", "[0 0 1]", size=3), prefix
    ),
    "AlignedAxes": _aligned,
    "RotationSequence": _sequence,
    "RotationMatrix": _matrix,
    "Quaternion": _quaternion,
}
