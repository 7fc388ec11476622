"""Where the fingers of a hand grasp: where the inner faces of two of them meet first when they close.

Fingers are their shapes that collide, meshes as convex hulls. Lines along the direction in which two fingertips close
tell how far their faces are apart, over a grid across it; they meet where they are nearest. Of faces that are longer
than wide the outermost square counts.
"""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import Joint, RigidBody

from simrob_drake.frames import Vector
from simrob_drake.robots.bodies import fingers_of
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.outlines import shape_outline
from simrob_drake.robots.parse import lone_robot

GRASP = "grasp"  # the frame in which fingers grasp: z points out of the hand, and the fingers close along y

_LINES = 80  # along each side of the grid
_HALVINGS = 12  # of the way, to find where fingers meet
_NEAR = 1e-3  # m: faces that are so little farther apart than the nearest meet, too
_SKEW = 0.03  # rad: so far off the axes of the hand is along them
_LEAST = 1e-6  # m


def grasp_frame(model: RobotModel) -> tuple[str, RigidTransform] | None:
    """Return the link that holds a robot's fingers, and the pose there of the frame in which they grasp.

    None without fingers, or where they are no two that have shapes and close on each other.
    """
    found = fingers_of(model.element)
    pose = None if found is None or not model.fingers else _Hand(model, found[1]).grasp()
    return None if found is None or pose is None else (found[1], pose)


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

    def __init__(self, model: RobotModel, palm: str) -> None:
        self._model, self._robot = model, lone_robot(model)
        self._context = self._robot.plant.CreateDefaultContext()
        self._palm = self._robot.plant.GetFrameByName(palm, self._robot.instance)

    def grasp(self) -> RigidTransform | None:
        """Return the pose of the frame in which two fingers grasp; None if no two close on each other."""
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
        place = self._meeting(tips, way, turn)
        return None if place is None else RigidTransform(RotationMatrix(turn), np.round(place, 6) + 0.0)

    def _tips(self) -> list[_Tip]:
        """Return the tips of the two fingers that reach farthest from the palm when closed, in the robot's order."""
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
        far = sorted(rows, key=lambda row: -rows[row][0])[:2]
        return [rows[row][1] for row in sorted(far)]

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
        return self._robot.plant.CalcRelativeTransform(self._context, self._palm, tip.body.body_frame())

    def _far_points(self, tips: list[_Tip], part: float) -> Vector:
        """Return the middle of each tip, the fingers open by a part of their way, shape (2, 3) [m]."""
        self._put(part)
        return np.array([self._pose(tip) @ tip.points.mean(axis=0) for tip in tips])

    def _meeting(self, tips: list[_Tip], way: Vector, turn: Vector) -> Vector | None:
        """Return where faces meet first when the fingers close along a unit vector, or are nearest, shape (3,) [m]."""
        apart, low, high = self._gaps(tips, way, turn, 0.0), 0.0, 1.0
        if apart is not None and apart[0].min() < 0:
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
        return np.asarray(met[out >= out.max() - np.ptp(across) - _LEAST].mean(axis=0))

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
