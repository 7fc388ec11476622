"""The geometry of six-axis arms that have a closed form: a spherical wrist, or three parallel axes as cobots have."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from simrob_drake.errors import SimrobError
from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.screws import skew

_LENGTH = 1e-4  # m that axes may miss each other by: published figures are rounded, and the solver polishes
_ANGLE = 1e-4  # rad that parallel axes may differ by, likewise: rpy="0 1.5708 0" is off by 4e-6
_ALONG = 1e-3  # sine below which two axes count as one direction

Complex = np.ndarray[Any, np.dtype[np.complex128]]


class NoClosedForm(SimrobError):
    """A robot whose geometry the analytic solver does not cover."""

    def __init__(self, problem: str) -> None:
        """Say what the geometry lacks, and which solver takes any robot."""
        super().__init__(f"there is no closed form for this arm: {problem}; the numeric solver takes any robot")


@dataclass(frozen=True, eq=False)
class SixAxisArm:
    """An arm of six revolute axes, 2 parallel to 3, neither to 1, with a wrist of one of two kinds.

    Spherical: axes 4, 5 and 6 meet in one point, the wrist centre. Parallel, as the UR arms have it: axis 4 is parallel
    to axis 3, and axes 5 and 6 meet in the wrist centre.

    Axis 1 need not meet axis 2 (shoulder offset along the arm), nor the wrist centre lie in the plane of axis 1 and
    the arm (shoulder offset across it, as the Puma has), nor axis 4 point at axis 3 (elbow offset).
    """

    axes: Vector  # unit axes 1 ... 6 at zero, shape (6, 3)
    shoulder: Vector  # a point on axis 1 [m], shape (3,)
    upper_arm: Vector  # a point on axis 2, in the base at zero [m], shape (3,)
    centre: Vector  # the wrist centre at zero [m], shape (3,)
    parallel: bool  # whether axis 4 is parallel to axis 3
    senses: tuple[float, float]  # of axes 3 and 4: 1 where they point as axis 2 does, -1 where against it
    upper: complex  # from axis 2 to axis 3 at zero, as a complex number in the plane across axis 2 [m]
    fore: complex  # from axis 3 to the wrist centre, or to axis 4 if parallel, likewise
    hand: complex  # from axis 4 to the wrist centre if parallel, else 0
    home: Vector  # pose of the tool at zero, shape (4, 4)

    @classmethod
    def of(cls, chain: Chain) -> SixAxisArm:
        """Recognise the geometry in a chain.

        Raises:
            NoClosedForm: what it lacks.
        """
        if chain.size != 6 or len(chain.order) != 6 or not chain.revolute.all():
            raise NoClosedForm(f"it has {len(chain.order)} moving axes, and the form is for six revolute ones")
        order = list(chain.order)
        axes, points = chain.axes[order], chain.points[order]
        if np.linalg.norm(np.cross(axes[1], axes[2])) > _ANGLE:
            raise NoClosedForm("axis 3 is not parallel to axis 2")
        for one, other in ((0, 1), (3, 4), (4, 5)):
            if np.linalg.norm(np.cross(axes[one], axes[other])) < _ALONG:
                raise NoClosedForm(f"axis {one + 1} is parallel to axis {other + 1}")
        parallel = bool(np.linalg.norm(np.cross(axes[2], axes[3])) <= _ANGLE)
        first = 4 if parallel else 3
        centre, miss = _nearest_point(axes[first:], points[first:])
        if miss > _LENGTH:
            count = "two" if parallel else "three"
            raise NoClosedForm(f"the last {count} axes do not meet in a point: they miss it by {miss:.3g} m")
        plane = _plane(axes[1])
        wrist = points[3] if parallel else centre
        upper, fore, hand = (complex(plane @ way) for way in (points[2] - points[1], wrist - points[2], centre - wrist))
        if min(abs(upper), abs(fore)) < _LENGTH:
            raise NoClosedForm(f"{'axis 4' if parallel else 'the wrist centre'} or axis 2 lies on axis 3")
        senses = (float(np.sign(axes[1] @ axes[2])), float(np.sign(axes[1] @ axes[3])))
        return cls(axes, points[0], points[1], centre, parallel, senses, upper, fore, hand, chain.home)

    @cached_property
    def plane(self) -> Complex:
        """Complex row (3,) whose product with a vector is its part across axis 2; turning by q multiplies by e^iq."""
        return _plane(self.axes[1])

    @cached_property
    def side(self) -> float:
        """How far the wrist centre lies from axis 1 along axis 2 [m]."""
        return float(self.axes[1] @ (self.centre - self.shoulder))

    @cached_property
    def spins(self) -> Vector:
        """The matrix of the cross product with each axis, shape (6, 3, 3)."""
        return skew(self.axes)

    def turn(self, axis: int, angles: Vector, vectors: Vector) -> Vector:
        """Turn vectors (..., 3) about an axis, 0 to 5, at zero, by angles (...)."""
        sine, versine = np.sin(angles)[..., np.newaxis], 1.0 - np.cos(angles)[..., np.newaxis]
        across = vectors @ self.spins[axis].T
        turned: Vector = vectors + sine * across + versine * (across @ self.spins[axis].T)
        return turned

    def forward(self, positions: Vector) -> Vector:
        """Return the poses of the tool (k, 4, 4) for positions (k, 6) of axes 1 ... 6, from this geometry alone."""
        q = positions.T
        third, fourth = self.senses
        hand = self.hand * np.exp(1j * fourth * q[3])
        planar = np.exp(1j * q[1]) * (self.upper + (self.fore + hand) * np.exp(1j * third * q[2]))
        along = self.axes[1] * (self.axes[1] @ (self.centre - self.upper_arm))
        arm = planar[:, np.newaxis].real * self.plane.real + planar[:, np.newaxis].imag * self.plane.imag + along
        centres = self.shoulder + self.turn(0, q[0], self.upper_arm - self.shoulder + arm)
        columns = np.column_stack([self.home[:3, :3], self.home[:3, 3] - self.centre]).T[:, np.newaxis]
        bent = (q[0], q[1] + third * q[2], q[3], q[4], q[5])
        for axis, angles in zip((5, 4, 3, 1, 0), reversed(bent), strict=True):
            columns = self.turn(axis, np.broadcast_to(angles, (4, len(positions))), columns)
        poses = np.zeros((len(positions), 4, 4))
        poses[:, :3] = columns.transpose(1, 2, 0)
        poses[:, :3, 3] += centres
        poses[:, 3, 3] = 1.0
        return poses


def _plane(axis: Vector) -> Complex:
    """Return a complex row u + iv with unit vectors u, v across an axis; u, v and the axis are right-handed."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    plane: Complex = first + 1j * np.cross(axis, first)
    return plane


def _nearest_point(axes: Vector, points: Vector) -> tuple[Vector, float]:
    """Return the point nearest to lines in the sense of least squares, and its largest distance from one."""
    across = np.eye(3) - axes[:, :, np.newaxis] * axes[:, np.newaxis, :]
    point = np.linalg.lstsq(across.sum(axis=0), (across @ points[..., np.newaxis]).sum(axis=0)[:, 0], rcond=None)[0]
    misses = (across @ (point - points)[..., np.newaxis])[..., 0]
    return point, float(np.linalg.norm(misses, axis=1).max())
