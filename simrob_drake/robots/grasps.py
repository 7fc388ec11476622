"""Where the fingers of a hand grasp, and how they close: where the inner faces of two of them meet first.

Fingers are their shapes that collide, meshes as convex hulls. Lines along the direction in which two fingertips close
tell how far their faces are apart, over a grid across it; they meet where they are nearest. Of faces that are longer
than wide the outermost square counts.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import Joint, JointIndex, RigidBody

from simrob_drake.base.frames import Vector
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.outlines import shape_outline
from simrob_drake.robots.parse import lone_robot
from simrob_drake.robots.urdf import link_of, name_of

GRASP = "grasp"  # the frame in which fingers grasp: z points out of the hand, and the fingers close along y

_LINES = 80  # along each side of the grid
_HALVINGS = 12  # of the way, to find where fingers meet
_NEAR = 1e-3  # m: faces that are so little farther apart than the nearest meet, too
_SKEW = 0.03  # rad: so far off the axes of the hand is along them
_LEAST = 1e-6  # m
_LONG = 0.8  # of the reach of the longest finger: what reaches less far is a link of one, not a finger
_PARTS = np.linspace(0.0, 1.0, 65)  # of the way, at which it is told how far fingers are apart


def grasp_frame(model: RobotModel) -> tuple[str, RigidTransform] | None:
    """Return the link that holds a robot's fingers, and the pose there of the frame in which they grasp.

    None without fingers, or where they are no two that have shapes and close on each other.
    """
    hand = _Hand(model) if model.fingers else None
    met = hand and hand.meeting()
    return None if not hand or not met else (hand.palm.name(), met.pose)


@dataclass(frozen=True)
class Stroke:
    """How the fingers of a hand close, seen where the inner faces of two of them meet first."""

    gaps: Vector
    """How far these faces are apart [m], at the parts of the way from closed to open, which are evenly spaced."""
    fingers: int  # how many there are
    way: float  # how far all their axes go from closed to open, summed up [rad, or m of those that slide]

    @property
    def widest(self) -> float:
        """How far the faces are apart when open [m]."""
        return float(self.gaps[-1])

    def part(self, width: float) -> float:
        """Return which part of the way fingers are open, their faces so far apart [m]; closed is nought."""
        return float(np.interp(width, self.gaps, _PARTS))

    def effort(self, part: float) -> float:
        """Return the effort of each axis [N·m, or N] a newton with which each finger presses, by virtual work."""
        slope = float(np.interp(part, _PARTS, np.gradient(self.gaps, _PARTS)))
        return self.fingers * max(slope, _LEAST) / 2 / self.way


def stroke_of(model: RobotModel) -> Stroke | None:
    """Return how a robot's fingers close; None where no shapes tell that of fingers that turn, and without fingers.

    Without shapes, fingers that slide meet where they are closed.
    """
    found = _Hand(model).stroke() if model.fingers else None
    if found or not model.fingers or not all(model.prismatic[place] for place in model.fingers):
        return found
    way = sum(abs(opened - closed) for closed, opened in model.fingers.values())
    return Stroke(way * _PARTS, len(model.fingers), way)


class _Meeting(NamedTuple):
    """Two fingertips, the frame in which they grasp, and how far their faces are apart in it [m]."""

    tips: "list[_Tip]"
    way: Vector  # from the one to the other, a unit vector (3,)
    part: float  # of the way from closed to open
    pose: RigidTransform
    gap: float


class _Tip:
    """The outermost link of a finger: its body, and points of its shapes in its frame, (k, 3) each [m]."""

    def __init__(self, body: RigidBody, shapes: list[Vector]) -> None:
        from scipy.spatial import ConvexHull  # slow to load, and only hands need it

        self.body, self.points = body, np.vstack(shapes)
        self.planes = [ConvexHull(points).equations for points in shapes]

    def spans(self, pose: RigidTransform, points: Vector, way: Vector) -> tuple[Vector, Vector]:
        """Return where lines from (k, 3) along a unit vector enter and leave the tip, (k,) [m]; inf, -inf if never."""
        inside = pose.inverse()
        points, way = (inside @ points.T).T, inside.rotation() @ way
        first, last = np.full(len(points), np.inf), np.full(len(points), -np.inf)
        for planes in self.planes:
            slope, height = planes[:, :3] @ way, points @ planes[:, :3].T + planes[:, 3]
            with np.errstate(divide="ignore", invalid="ignore"):
                at = -height / slope
            enters = np.where(slope < 0, at, -np.inf).max(axis=1)
            leaves = np.where(slope > 0, at, np.inf).min(axis=1)
            hit = (enters < leaves) & ~((slope == 0) & (height > 0)).any(axis=1)
            first = np.where(hit, np.minimum(first, enters), first)
            last = np.where(hit, np.maximum(last, leaves), last)
        return first, last


class _Hand:
    """The fingers of a robot alone, seen from the link that holds them."""

    def __init__(self, model: RobotModel) -> None:
        self._model, self._robot = model, lone_robot(model)
        self._context = self._robot.plant.CreateDefaultContext()
        first = self._robot.plant.get_joint(JointIndex(self._row(self._joints()[0]))).name()
        palm = next(link_of(joint, "parent") for joint in model.joints if name_of(joint) == first)
        self.palm = self._robot.plant.GetFrameByName(palm, self._robot.instance)

    def stroke(self) -> Stroke | None:
        """Return how the fingers close; None if no two close on each other."""
        met = self.meeting()
        if met is None:
            return None
        self._put(met.part)
        ends = [met.pose.translation() + side * met.gap / 2 * met.way for side in (-1, 1)]
        touching = [self._pose(tip).inverse() @ end for tip, end in zip(met.tips, ends, strict=True)]
        gaps = []
        for part in _PARTS:
            self._put(part)
            left, right = (self._pose(tip) @ end for tip, end in zip(met.tips, touching, strict=True))
            gaps.append((right - left) @ met.way)
        ways = sum(abs(opened - closed) for closed, opened in self._model.fingers.values())
        reaches = [reach for reach, _ in self._reaches().values()]
        return Stroke(np.maximum.accumulate(gaps), sum(reach > _LONG * max(reaches) for reach in reaches), ways)

    def meeting(self) -> _Meeting | None:
        """Return where two fingers meet first when they close, or are nearest; None if no two close on each other."""
        tips = self._tips()
        if len(tips) < 2:
            return None
        ends = [self._far_points(tips, part) for part in (0.0, 1.0)]
        closing = (ends[0][0] - ends[1][0]) - (ends[0][1] - ends[1][1])
        way = closing / max(np.linalg.norm(closing), _LEAST)
        out = ends[0].mean(axis=0)
        out = out - (out @ way) * way
        if min(np.linalg.norm(closing), np.linalg.norm(out)) < _LEAST:
            return None
        axes = np.column_stack([way, out / np.linalg.norm(out)])
        turn = np.column_stack([np.cross(*axes.T), axes])
        if np.trace(turn) < np.trace(turn * (-1, -1, 1)):  # as near to the axes of the hand as it can be
            turn = turn * (-1, -1, 1)
        if np.abs(turn - np.round(turn)).max() < _SKEW:  # hands are drawn along their axes
            turn, way = np.round(turn), np.round(way)
        return self._met(tips, way, turn)

    def _tips(self) -> list[_Tip]:
        """Return the tips of the two fingers that reach farthest from the palm when closed, in the robot's order."""
        reaches = self._reaches()
        far = sorted(reaches, key=lambda row: -reaches[row][0])[:2]
        return [reaches[row][1] for row in sorted(far)]

    def _reaches(self) -> dict[int, tuple[float, _Tip]]:
        """Return how far rows of links that start at the palm reach when closed [m], and the link of each that does."""
        rows = dict[int, tuple[float, _Tip]]()
        self._put(0.0)
        for joint in self._joints():
            tip = self._tip(joint.child_body())
            if tip is None:
                continue
            reach = float(np.linalg.norm((self._pose(tip) @ tip.points.T).T, axis=1).max())
            row = self._row(joint)
            if row not in rows or rows[row][0] < reach:
                rows[row] = reach, tip
        return rows

    def _joints(self) -> list[Joint]:
        return [self._robot.joints[place] for place in self._model.fingers]

    def _row(self, joint: Joint) -> int:
        """Return the index of the joint next to the palm from which a joint of a finger follows."""
        inboard = {int(own.child_body().index()): own for own in self._joints()}
        while (index := int(joint.parent_body().index())) in inboard:
            joint = inboard[index]
        return int(joint.index())

    def _tip(self, body: RigidBody) -> _Tip | None:
        inspector = self._robot.scene_graph.model_inspector()
        shapes = self._robot.plant.GetCollisionGeometriesForBody(body)
        points = [shape_outline(inspector, shape) for shape in shapes]
        thick = [own for own in points if np.linalg.matrix_rank(own - own.mean(axis=0), tol=_LEAST) == 3]
        return _Tip(body, thick) if thick else None

    def _put(self, part: float) -> None:
        """Open the fingers by a part of their way."""
        position = self._model.home.copy()
        for place, (closed, opened) in self._model.fingers.items():
            position[place] = closed + part * (opened - closed)
        self._robot.axes.set_positions(self._robot.plant, self._context, position)

    def _pose(self, tip: _Tip) -> RigidTransform:
        return self._robot.plant.CalcRelativeTransform(self._context, self.palm, tip.body.body_frame())

    def _far_points(self, tips: list[_Tip], part: float) -> Vector:
        """Return the middle of each tip, the fingers open by a part of their way, shape (2, 3) [m]."""
        self._put(part)
        return np.array([self._pose(tip) @ tip.points.mean(axis=0) for tip in tips])

    def _met(self, tips: list[_Tip], way: Vector, turn: Vector) -> _Meeting | None:
        """Return where faces meet first when the fingers close along a unit vector, or are nearest."""
        apart, low, high = self._gaps(tips, way, turn, 0.0), 0.0, 1.0
        if apart is not None and apart[0].min() < -_LEAST:
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                tried = self._gaps(tips, way, turn, middle)
                if tried is not None and tried[0].min() < 0:
                    apart, low = tried, middle
                else:
                    high = middle
        if apart is None:
            return None
        gaps, middles = apart
        met = middles[gaps <= gaps.min() + _NEAR]
        across, _, out = (met @ turn).T
        place = met[out >= out.max() - np.ptp(across) - _LEAST].mean(axis=0)
        pose = RigidTransform(RotationMatrix(turn), np.round(place, 6) + 0.0)
        return _Meeting(tips, way, low, pose, float(gaps.min()))

    def _gaps(self, tips: list[_Tip], way: Vector, turn: Vector, part: float) -> tuple[Vector, Vector] | None:
        """Return how far the faces of two tips are apart along lines of a grid (k,), and between them (k, 3) [m]."""
        self._put(part)
        poses = [self._pose(tip) for tip in tips]
        seen = [(pose @ tip.points.T).T @ turn for tip, pose in zip(tips, poses, strict=True)]
        low, high = np.max([own.min(axis=0) for own in seen], axis=0), np.min([own.max(axis=0) for own in seen], axis=0)
        if low[0] >= high[0] or low[2] >= high[2]:
            return None
        middles = (np.arange(_LINES) + 0.5) / _LINES
        sides = [low[axis] + middles * (high[axis] - low[axis]) for axis in (0, 2)]
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)
        points = grid @ turn[:, [0, 2]].T
        (_, leaves), (enters, _) = (tip.spans(pose, points, way) for tip, pose in zip(tips, poses, strict=True))
        hit = np.isfinite(leaves) & np.isfinite(enters)
        if not hit.any():
            return None
        enters, leaves = enters[hit], leaves[hit]
        return enters - leaves, points[hit] + ((leaves + enters) / 2)[:, np.newaxis] * way
