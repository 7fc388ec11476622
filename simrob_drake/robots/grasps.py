"""How the fingers of a hand close, and the frame in which they grasp.

The shape of a finger is its collision shapes, meshes as convex hulls. The *opening* of a hand is a fraction: 0 with all
fingers closed, 1 with all fingers open. The *palm* is the link that holds the fingers. The *tip* of a finger is its
link that reaches farthest from the palm; the tips of the two fingers that reach farthest are measured. Parallel lines
along the direction in which these two tips close, one at each point of a grid, measure the *gap* between their inner
faces. The faces meet where the gap is smallest. The frame in which they grasp is in the middle of the faces that meet
or, if these are longer than wide, of the outermost square of them.

All points and directions are in the frame of the palm, unless something else is said.
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

GRASP = "grasp"
"""Name of the frame in which fingers grasp: z points out of the hand, and the fingers close along y."""

_LINES = 80
"""Count of lines along each side of the grid."""

_HALVINGS = 12
"""Count of bisections that find the opening at which fingers meet, to 1/4096 of the stroke."""

_SAME_GAP = 1e-3
"""Points whose gap exceeds the smallest one by at most this belong to the faces that meet [m]."""

_SKEW = 0.03
"""Largest deviation of a direction from an axis of the palm that is taken for an error of the shapes [rad]. The axis is
then taken in place of the direction."""

_SMALLEST = 1e-6
"""Lengths below this are rounding errors [m]."""

_FINGER_REACH = 0.8
"""A chain of links is a finger if it reaches this fraction of the longest finger's reach; otherwise a part of one."""

_OPENINGS = np.linspace(0.0, 1.0, 65)
"""Openings at which the gap is measured."""


class LinkFrame(NamedTuple):
    """A frame on a link.

    Attributes:
        link: name of the link.
        pose: pose of the frame in the frame of the link.
    """

    link: str
    pose: RigidTransform


def grasp_frame(model: RobotModel) -> LinkFrame | None:
    """Find the frame in which a robot's fingers grasp, on the link that holds them.

    Returns None if the robot has no fingers, or no two fingers with shapes that close on each other.
    """
    if not model.fingers:
        return None
    hand = _Hand(model)
    meeting = hand.meeting()
    if meeting is None:
        return None
    return LinkFrame(hand.palm.name(), meeting.pose)


@dataclass(frozen=True)
class Stroke:
    """Gap between the two faces of fingers that meet first, as a function of the opening of the hand.

    Attributes:
        gaps: gap between these faces [m] at evenly spaced openings from 0 to 1. It never decreases.
        fingers: count of the fingers that have shapes and reach nearly as far as the longest one; count of their axes
            if no shapes were measured.
        travel: sum over all axes of the fingers of their travel from closed to open [rad, or m for prismatic axes].
    """

    gaps: Vector
    fingers: int
    travel: float

    @property
    def widest(self) -> float:
        """Gap of the open hand [m]."""
        return float(self.gaps[-1])

    def opening(self, gap: float) -> float:
        """Opening at which the faces have a gap [m]: 0 for gaps below that of the closed hand, 1 for very wide ones."""
        return float(np.interp(gap, self.gaps, _OPENINGS))

    def effort(self, opening: float) -> float:
        """Effort of each axis per newton with which each finger presses [N·m/N, or N/N], by virtual work.

        All axes have the same effort. A change of the opening moves each face by half of the change of the gap, and
        each axis by its share of `travel`, the sum over all axes. The work of both is equal:
        effort * travel = fingers * force * d(gap)/d(opening) / 2.
        """
        # A gap that does not change needs no effort. The least slope keeps the result positive: callers divide by it.
        slope = float(np.interp(opening, _OPENINGS, np.gradient(self.gaps, _OPENINGS)))
        return self.fingers * max(slope, _SMALLEST) / 2 / self.travel


def stroke_of(model: RobotModel) -> Stroke | None:
    """Measure the gap between a robot's fingers over the opening of the hand.

    If no two shapes close on each other, sliding fingers are taken to meet where they are closed. Returns None if the
    robot has no fingers, or if no two shapes close on each other and at least one finger turns.
    """
    if not model.fingers:
        return None
    found = _Hand(model).stroke()
    is_sliding = all(model.prismatic[axis] for axis in model.fingers)
    if found is not None or not is_sliding:
        return found
    # Sliding fingers change the gap by their own travel, in proportion to the opening.
    travel = _travel(model)
    return Stroke(gaps=travel * _OPENINGS, fingers=len(model.fingers), travel=travel)


def _travel(model: RobotModel) -> float:
    """Sum over all axes of the fingers of their travel from closed to open [rad or m]."""
    return sum(abs(opened - closed) for closed, opened in model.fingers.values())


class _Meeting(NamedTuple):
    """Two fingertips that close on each other, at the opening at which they meet.

    Attributes:
        tips: the two fingertips.
        direction: unit vector from the first to the second tip, shape (3,).
        opening: the opening at which they meet, or 0 if they do not touch when closed.
        pose: pose of the frame in which they grasp.
        gap: smallest gap between their faces [m].
    """

    tips: "list[_Tip]"
    direction: Vector
    opening: float
    pose: RigidTransform
    gap: float


class _Gaps(NamedTuple):
    """The gap between the faces of two fingertips along the lines that hit both.

    Attributes:
        gaps: gap along each line, negative if the tips overlap, shape (k,) [m].
        middles: point in the middle of each gap, shape (k, 3) [m].
    """

    gaps: Vector
    middles: Vector


class _LineHits(NamedTuple):
    """Points at which lines enter and leave a fingertip, as distances along the lines.

    Attributes:
        enters: distance at which each line enters, shape (k,) [m]; infinite if it misses the tip.
        leaves: distance at which each line leaves, shape (k,) [m]; minus infinite if it misses the tip.
    """

    enters: Vector
    leaves: Vector


class _Reach(NamedTuple):
    """Reach of a finger.

    Attributes:
        distance: distance of its outermost point from the origin of the palm, with the hand closed [m].
        tip: the link with this point.
    """

    distance: float
    tip: "_Tip"


class _Tip:
    """A link of a finger with its shapes.

    Attributes:
        body: the link.
        points: corners of all its shapes in the frame of the link, shape (k, 3) [m].
    """

    def __init__(self, body: RigidBody, shapes: list[Vector]) -> None:
        """Compute the hulls of a link's shapes.

        Args:
            body: the link.
            shapes: corners of each shape in the frame of the link, shape (k, 3) each [m]. They are not in one plane.
        """
        # Imported here, since it takes long and only hands need it.
        from scipy.spatial import ConvexHull

        self.body = body
        self.points = np.vstack(shapes)
        # A point x is inside of a hull if normal @ x + offset <= 0 for all of its planes: rows (normal, offset).
        self._planes = [ConvexHull(points).equations for points in shapes]

    def hits(self, pose: RigidTransform, points: Vector, direction: Vector) -> _LineHits:
        """Compute where parallel lines enter and leave the tip.

        A line is inside of a hull between the last plane that it crosses inward and the first that it crosses outward.

        Args:
            pose: pose of the tip.
            points: a point of each line, shape (k, 3) [m].
            direction: unit vector along the lines, shape (3,).
        """
        # The planes are in the frame of the tip, so that the lines are brought there.
        to_tip = pose.inverse()
        points = (to_tip @ points.T).T
        direction = to_tip.rotation() @ direction
        # A tip may have several hulls: it begins with the first one that a line enters and ends with the last one.
        first = np.full(len(points), np.inf)
        last = np.full(len(points), -np.inf)
        for planes in self._planes:
            # A point p + t d of a line is in a plane if n·(p + t d) + offset = 0, so that t = -(n·p + offset) / n·d.
            # The slope n·d, shape (planes,), is positive where the line leaves the hull. The height n·p + offset, shape
            # (lines, planes), is positive if the point is outside.
            normals = planes[:, :3]
            slope = normals @ direction
            height = points @ normals.T + planes[:, 3]
            # Lines along a plane divide by zero. They are treated below.
            with np.errstate(divide="ignore", invalid="ignore"):
                crossing = -height / slope
            enters = np.where(slope < 0, crossing, -np.inf).max(axis=1)
            leaves = np.where(slope > 0, crossing, np.inf).min(axis=1)
            # A line along a plane never crosses it, but misses the hull if it is outside of it.
            is_outside = ((slope == 0) & (height > 0)).any(axis=1)
            is_hit = (enters < leaves) & ~is_outside
            first = np.where(is_hit, np.minimum(first, enters), first)
            last = np.where(is_hit, np.maximum(last, leaves), last)
        return _LineHits(first, last)


class _Hand:
    """The fingers of a robot by itself, seen from the palm.

    Attributes:
        palm: frame of the link that holds the fingers.
    """

    def __init__(self, model: RobotModel) -> None:
        """Build the plant of a robot with fingers."""
        self._model = model
        self._robot = lone_robot(model)
        plant = self._robot.plant
        self._context = plant.CreateDefaultContext()

        # The palm is the parent of the first joint of any finger. In the plant this link may be merged with the link
        # that carries it. Its name is therefore taken from the URDF: a frame of this name exists in any case.
        innermost = self._innermost_joint(self._finger_joints()[0])
        joint_name = plant.get_joint(JointIndex(innermost)).name()
        joint = next(joint for joint in model.joints if name_of(joint) == joint_name)
        self.palm = plant.GetFrameByName(link_of(joint, "parent"), self._robot.instance)

    def stroke(self) -> Stroke | None:
        """Measure the gap between the faces that meet first, over the opening.

        Returns None if :meth:`meeting` finds no two fingers that close on each other.
        """
        meeting = self.meeting()
        if meeting is None:
            return None
        # Follow the two points of the faces that meet, each fixed to its tip. The origin of the grasp is in the middle
        # between them.
        self._open(meeting.opening)
        # The direction leads from the first tip to the second, so the first point is on its negative side.
        touching = []
        for tip, side in zip(meeting.tips, (-1, 1), strict=True):
            point = meeting.pose.translation() + side * meeting.gap / 2 * meeting.direction
            touching.append(self._pose(tip).inverse() @ point)
        first_tip, second_tip = meeting.tips
        gaps = []
        for opening in _OPENINGS:
            self._open(opening)
            first_point = self._pose(first_tip) @ touching[0]
            second_point = self._pose(second_tip) @ touching[1]
            gaps.append((second_point - first_point) @ meeting.direction)

        # Short chains of links are parts of a finger and do not count, see `_FINGER_REACH`.
        reaches = [reach.distance for reach in self._reaches().values()]
        fingers = sum(distance > _FINGER_REACH * max(reaches) for distance in reaches)
        # The gap has to grow with the opening, or it could not be inverted. Fingers that turn may close it a little
        # again near the open end.
        return Stroke(
            gaps=np.maximum.accumulate(gaps), fingers=fingers, travel=_travel(self._model)
        )

    def meeting(self) -> _Meeting | None:
        """Find where the two fingers that reach farthest meet first when they close.

        Returns None if fewer than two fingers have shapes, if the two tips do not move against each other, if they lie
        in the palm, or if no line along their movement hits both in the closed hand.
        """
        tips = self._tips()
        if len(tips) < 2:
            return None
        closed = self._tip_middles(tips, 0.0)
        opened = self._tip_middles(tips, 1.0)
        # The movement of the second tip with respect to the first while they open.
        opening_move = (closed[0] - opened[0]) - (closed[1] - opened[1])
        direction = opening_move / max(np.linalg.norm(opening_move), _SMALLEST)
        # Outward: from the palm to the tips, across the direction in which they close.
        outward = closed.mean(axis=0)
        outward = outward - (outward @ direction) * direction
        # Tips that do not move against each other, or that lie in the palm, have no frame.
        if min(np.linalg.norm(opening_move), np.linalg.norm(outward)) < _SMALLEST:
            return None
        # The columns of the rotation are the axes of the frame: x = y × z.
        y_axis = direction
        z_axis = outward / np.linalg.norm(outward)
        rotation = np.column_stack([np.cross(y_axis, z_axis), y_axis, z_axis])
        # The direction's sign depends on the order of the tips. Of the two frames, turned by half a turn about z,
        # choose the one nearer to that of the palm: it has the larger trace.
        turned = rotation * (-1, -1, 1)
        if np.trace(rotation) < np.trace(turned):
            rotation = turned
        # Meshes are not exactly symmetric. A frame along the axes of the palm is what the maker meant.
        if np.abs(rotation - np.round(rotation)).max() < _SKEW:
            rotation = np.round(rotation)
            direction = np.round(direction)
        return self._find_meeting(tips, direction, rotation)

    def _tips(self) -> list[_Tip]:
        """Tips of the two fingers that reach farthest from the palm when closed, in the robot's order.

        Fingers without shapes have no tip, so there may be fewer than two.
        """
        # Of three fingers or more, two are enough to define the frame.
        reaches = self._reaches()
        farthest = sorted(reaches, key=lambda joint: -reaches[joint].distance)[:2]
        return [reaches[joint].tip for joint in sorted(farthest)]

    def _reaches(self) -> dict[int, _Reach]:
        """Measure how far each finger reaches when closed, by the index of its joint at the palm.

        Fingers without shapes are left out.
        """
        reaches = dict[int, _Reach]()
        self._open(0.0)
        for joint in self._finger_joints():
            tip = self._tip(joint.child_body())
            if tip is None:
                continue
            corners = (self._pose(tip) @ tip.points.T).T
            distance = float(np.linalg.norm(corners, axis=1).max())
            # A finger of several links counts once, with the link that reaches farthest.
            innermost = self._innermost_joint(joint)
            if innermost not in reaches or reaches[innermost].distance < distance:
                reaches[innermost] = _Reach(distance, tip)
        return reaches

    def _finger_joints(self) -> list[Joint]:
        """Joints of all fingers, in the robot's order."""
        return [self._robot.joints[axis] for axis in self._model.fingers]

    def _innermost_joint(self, joint: Joint) -> int:
        """Index of the joint at the palm that moves a joint of a finger: the first of the finger's joints."""
        joint_of_body = {int(own.child_body().index()): own for own in self._finger_joints()}
        parent = int(joint.parent_body().index())
        while parent in joint_of_body:
            joint = joint_of_body[parent]
            parent = int(joint.parent_body().index())
        return int(joint.index())

    def _tip(self, body: RigidBody) -> _Tip | None:
        """Collect the collision shapes of a link that have a volume. Returns None if it has none."""
        inspector = self._robot.scene_graph.model_inspector()
        outlines = []
        for shape in self._robot.plant.GetCollisionGeometriesForBody(body):
            # A flat shape, whose corners have rank 2, has no hull.
            outline = shape_outline(inspector, shape)
            is_solid = np.linalg.matrix_rank(outline - outline.mean(axis=0), tol=_SMALLEST) == 3
            if is_solid:
                outlines.append(outline)
        return _Tip(body, outlines) if outlines else None

    def _open(self, opening: float) -> None:
        """Set all fingers to an opening (0 closed, 1 open), and the other axes to their home positions."""
        position = self._model.home.copy()
        for axis, (closed, opened) in self._model.fingers.items():
            position[axis] = closed + opening * (opened - closed)
        self._robot.axes.set_positions(self._robot.plant, self._context, position)

    def _pose(self, tip: _Tip) -> RigidTransform:
        """Pose of a tip in the frame of the palm, at the present opening."""
        return self._robot.plant.CalcRelativeTransform(
            self._context, self.palm, tip.body.body_frame()
        )

    def _tip_middles(self, tips: list[_Tip], opening: float) -> Vector:
        """Compute the mean of the corners of two tips at an opening, in the frame of the palm, shape (2, 3) [m].

        The fingers stay at this opening.
        """
        self._open(opening)
        return np.array([self._pose(tip) @ tip.points.mean(axis=0) for tip in tips])

    def _find_meeting(
        self, tips: list[_Tip], direction: Vector, rotation: Vector
    ) -> _Meeting | None:
        """Find the opening at which two faces meet, by bisection, or the closed hand if they never touch.

        Args:
            tips: the two fingertips.
            direction: unit vector along which they close, shape (3,).
            rotation: rotation matrix of the frame in which they grasp, shape (3, 3).

        Returns:
            the meeting, or None if no line along the direction hits both tips of the closed hand.
        """
        # If the closed fingers only touch, or leave a gap, no search is needed.
        measured = self._measure_gaps(tips, direction, rotation, 0.0)
        opening = 0.0
        if measured is not None and measured.gaps.min() < -_SMALLEST:
            # The faces overlap when closed: find the largest opening at which they still touch.
            clear = 1.0
            for _ in range(_HALVINGS):
                middle = (opening + clear) / 2
                tried = self._measure_gaps(tips, direction, rotation, middle)
                if tried is not None and tried.gaps.min() < 0:
                    measured = tried
                    opening = middle
                else:
                    clear = middle
        if measured is None:
            return None
        is_at_face = measured.gaps <= measured.gaps.min() + _SAME_GAP
        face_points = measured.middles[is_at_face]
        # Coordinates in the frame of the grasp: across the fingers (x), and out of the hand (z).
        in_frame = face_points @ rotation
        across = in_frame[:, 0]
        out = in_frame[:, 2]
        # Of a face that is longer than wide, only the outermost square counts: hands grasp with their fingertips.
        is_in_square = out >= out.max() - np.ptp(across) - _SMALLEST
        origin = face_points[is_in_square].mean(axis=0)
        # Adding 0 turns -0.0 into 0.0.
        pose = RigidTransform(RotationMatrix(rotation), np.round(origin, 6) + 0.0)
        return _Meeting(tips, direction, opening, pose, float(measured.gaps.min()))

    def _measure_gaps(
        self, tips: list[_Tip], direction: Vector, rotation: Vector, opening: float
    ) -> _Gaps | None:
        """Measure the gap between two tips along the lines of a grid, over the area that both cover.

        Args:
            tips: the two fingertips.
            direction: unit vector along the lines, from the first to the second tip, shape (3,).
            rotation: rotation matrix of the frame in which they grasp. The grid is along its x and z axes.
            opening: the opening of the hand.

        Returns:
            the gaps, or None if no line hits both tips.
        """
        self._open(opening)
        # The area that both tips cover: the common part of their extents across the direction, along the grasp's axes.
        poses = [self._pose(tip) for tip in tips]
        corners = [
            (pose @ tip.points.T).T @ rotation for tip, pose in zip(tips, poses, strict=True)
        ]
        lower = np.max([points.min(axis=0) for points in corners], axis=0)
        upper = np.min([points.max(axis=0) for points in corners], axis=0)
        x = 0
        z = 2
        if lower[x] >= upper[x] or lower[z] >= upper[z]:
            return None
        # One line in the middle of each cell, so that no line runs along an edge of a tip.
        fractions = (np.arange(_LINES) + 0.5) / _LINES
        x_values = lower[x] + fractions * (upper[x] - lower[x])
        z_values = lower[z] + fractions * (upper[z] - lower[z])
        grid = np.stack(np.meshgrid(x_values, z_values, indexing="ij"), axis=-1).reshape(-1, 2)
        # A point of each line in the frame of the palm. Its coordinate along the line is 0.
        points = grid @ rotation[:, [x, z]].T
        # The inner face of the first tip is where lines leave it, that of the second where they enter it.
        leaves = tips[0].hits(poses[0], points, direction).leaves
        enters = tips[1].hits(poses[1], points, direction).enters
        is_hit = np.isfinite(leaves) & np.isfinite(enters)
        if not is_hit.any():
            return None
        leaves = leaves[is_hit]
        enters = enters[is_hit]
        middles = points[is_hit] + ((leaves + enters) / 2)[:, np.newaxis] * direction
        return _Gaps(enters - leaves, middles)
