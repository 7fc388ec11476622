r"""What constraints of CAD leave free between two bodies, as one joint.

Each constraint forbids velocities: rows :math:`a` with :math:`a^\top (\omega, v) = 0` for the turning rate and the
velocity of the origin of one body seen from the other. What all of them leave over is a joint, by the directions in
which the body can turn and slide.
"""

from collections.abc import Callable, Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.simulink.cad.assembly import End, Tie

_SAME = 1e-5
"""Of directions, and of metres: what counts as parallel or in one place."""
_LINES = {"line", "cylinder", "circle", "cone"}
_POINTS = {"point", "sphere"}


def joint_of(ties: Sequence[Tie]) -> tuple[str, RigidTransform] | None:
    """Return the joint block that constraints between two bodies leave, and its frame; None if there is none such.

    Raises:
        ValueError: a constraint that is not known; the text says which.
    """
    rows = np.vstack([np.zeros((1, 6)), *(_rows(tie) for tie in ties)])
    _, sizes, directions = np.linalg.svd(rows)
    free = directions[int((sizes > _SAME).sum()) :]
    if not len(free):
        return "Weld Joint", ties[0].base.pose
    turns, slides = _split(free)
    make = _LEFT_OVER.get((len(turns), len(slides)))
    made = make(turns, slides) if make else None
    if made is not None and len(slides) + (made[0] == "Prismatic Joint") > 1:  # any place will do: one at the bodies
        made[1].set_translation(ties[0].base.pose.translation())
    return made


def _split(free: Vector) -> tuple[Vector, Vector]:
    """Return free motions (n, 6) as those that turn, and pure slides (m, 3), orthonormal."""
    left, sizes, _ = np.linalg.svd(free[:, :3])
    count = int((sizes > _SAME).sum())
    mixed = left.T @ free
    slides = mixed[count:, 3:]
    if len(slides):
        slides = np.linalg.svd(slides)[2][: len(slides)]
    turns = mixed[:count]
    turns = turns / np.linalg.norm(turns[:, :3], axis=1, keepdims=True)
    turns[:, 3:] -= turns[:, 3:] @ slides.T @ slides if len(slides) else 0.0
    return turns, slides


def _hinge(turns: Vector, slides: Vector) -> tuple[str, RigidTransform] | None:
    """Return a hinge, or with slides across a planar joint, along a cylindrical one."""
    axis, speed = turns[0, :3], turns[0, 3:]
    along = slides @ axis
    if abs(axis @ speed) > _SAME or not (len(slides) == 0 or np.allclose(np.abs(along), len(slides) == 1, atol=_SAME)):
        return None
    kind = ("Revolute Joint", "Cylindrical Joint", "Planar Joint")[len(slides)]
    return kind, RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), np.cross(axis, speed))


def _slider(_: Vector, slides: Vector) -> tuple[str, RigidTransform]:
    kind = ("Prismatic Joint", "Rectangular Joint", "Cartesian Joint")[len(slides) - 1]
    axis = np.cross(slides[0], slides[1]) if len(slides) == 2 else slides[0]
    return kind, RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), np.zeros(3))


def _ball(turns: Vector, _: Vector) -> tuple[str, RigidTransform] | None:
    """Return a ball joint about the point c that stays: v = c × ω for every turn."""
    across = np.vstack([-_cross(turn[:3]) for turn in turns])
    middle = np.linalg.lstsq(across, turns[:, 3:].reshape(-1), rcond=None)[0]
    if np.abs(across @ middle - turns[:, 3:].reshape(-1)).max() > _SAME:
        return None
    return "Spherical Joint", RigidTransform(middle)


_LEFT_OVER: dict[tuple[int, int], Callable[[Vector, Vector], tuple[str, RigidTransform] | None]] = {
    **dict.fromkeys([(1, 0), (1, 1), (1, 2)], _hinge),
    **dict.fromkeys([(0, 1), (0, 2), (0, 3)], _slider),
    (3, 0): _ball,
}


def _rows(tie: Tie) -> Vector:
    """Return what a constraint forbids, shape (n, 6)."""
    one, other = sorted((tie.base, tie.follower), key=lambda end: _RANK[_shape(tie, end)])
    shapes = _shape(tie, one), _shape(tie, other)
    if tie.kind not in _KINDS:
        raise ValueError(f"a constraint {tie.kind} is not known here; {', '.join(sorted(_KINDS))} are")
    if tie.kind in ("Fixed", "Lock", "Rigid"):
        return np.eye(6)
    a, b = (_axis(end) for end in (one, other))
    if tie.kind in ("Perpendicular", "Angle"):
        across = np.cross(a, b)
        size = float(np.linalg.norm(across))
        return _turning(across / size) if size > _SAME else _turning(*_perpendicular(a))
    if tie.kind == "Parallel":
        return _parallel(shapes, a, b)
    return np.vstack([_parallel(shapes, a, b), _touching(tie.kind, shapes, one, other)])


def _parallel(shapes: tuple[str, str], a: Vector, b: Vector) -> Vector:
    """Return the turns that lines and planes forbid which stay parallel; points forbid none."""
    if "point" in shapes:
        return np.zeros((0, 6))
    if shapes == ("line", "plane"):
        across = np.cross(a, b)
        return _turning(across / max(float(np.linalg.norm(across)), 1e-12))
    return _turning(*_perpendicular(b))


def _touching(kind: str, shapes: tuple[str, str], one: End, other: End) -> Vector:
    """Return the slides that are forbidden where shapes touch, or keep their distance."""
    place, normal = one.pose.translation(), _axis(other)
    between = place - other.pose.translation()
    if shapes[1] == "plane":
        return _sliding(place, normal)
    if shapes[1] == "line":
        between = between - (between @ normal) * normal
    far = float(np.linalg.norm(between)) > _SAME
    if kind in ("Distance", "Tangent") and far:
        return _sliding(place, between / np.linalg.norm(between))
    return _sliding(place, *(_perpendicular(normal) if shapes[1] == "line" else np.eye(3)))


def _shape(tie: Tie, end: End) -> str:
    if end.kind == "plane":
        return "plane"
    if end.kind in _LINES or end.kind in _POINTS:
        return "line" if end.kind in _LINES else "point"
    raise ValueError(f"the geometry '{end.kind}' of a {tie.kind} is not known here")


def _axis(end: End) -> Vector:
    return np.asarray(end.pose.rotation().matrix()[:, 2])


def _perpendicular(axis: Vector) -> Vector:
    return np.asarray(RotationMatrix.MakeFromOneVector(axis, 2).matrix()[:, :2].T)


def _turning(*directions: Vector) -> Vector:
    return np.hstack([np.array(directions), np.zeros((len(directions), 3))])


def _sliding(place: Vector, *directions: Vector) -> Vector:
    """Return rows for the velocity v + ω × p of a place p along directions."""
    return np.array([np.concatenate([np.cross(place, direction), direction]) for direction in directions])


def _cross(vector: Vector) -> Vector:
    return np.asarray(np.cross(np.eye(3), vector))


_RANK = {"point": 0, "line": 1, "plane": 2}
_KINDS = {
    "Coincident", "Concentric", "Distance", "Tangent", "Parallel", "Perpendicular", "Angle", "Fixed", "Lock", "Rigid",
}  # fmt: skip
