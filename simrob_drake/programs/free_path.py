"""Paths of robots around obstacles, found by a search that grows two trees of postures without collisions.

Distances between postures are measured in metres: a radian of an axis counts as the largest distance that it can move
the tool.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Role
from scipy.interpolate import BSpline

from simrob_drake.extras import needed
from simrob_drake.frames import Vector
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.numeric import random_postures
from simrob_drake.programs.errors import NoFreePath, StartInCollision
from simrob_drake.programs.model import StationModel
from simrob_drake.stations.collisions import START_TOLERANCE, Bodies, Overlap

SEARCHED = 0.5
"""Fraction of the collision tolerances that a search uses. Rounding moves the path slightly,
and the rounded path may use the whole tolerances."""


@dataclass(eq=False)
class FreeSpace:
    """The postures in which robots that move at the same time do not collide.

    The station's collision policy decides what counts as a collision. The robots move with
    the pieces that they carry; all other robots stand still.
    """

    model: StationModel  # the station with collision shapes, and its robots in their present postures
    start: Mapping[str, Vector]  # start posture of each robot that moves, (n,) [rad or m], by name
    met: Counter[str] = field(default_factory=Counter)  # how often a search collided with each body
    # overlap [m] that each pair of bodies may keep, because the pair touches at the start
    _depths_at_start: Mapping[Bodies, float] = field(default_factory=dict)
    # pairs of bodies that nearly touch at a goal: the search uses their whole tolerance
    _close_at_goal: set[Bodies] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Record which bodies touch at the start; these may stay as deep on the path.

        Raises:
            StartInCollision: a robot overlaps a body of another owner by more than
                START_TOLERANCE at the start.
        """
        # Indices at which the joined posture of all robots is split into one for each robot.
        axis_counts = [len(posture) for posture in self.start.values()]
        self._split_indices = np.cumsum(axis_counts)[:-1]
        self.model.place_robots(self.start)
        self._depths_at_start = self.model.policy.allowed_from_start(self.start)
        overlaps_at_start = self.model.policy.overlaps(self.start)
        too_deep = [
            overlap for overlap in overlaps_at_start if overlap.is_between_owners and overlap.depth > START_TOLERANCE
        ]
        if too_deep:
            deepest = too_deep[0]
            raise StartInCollision(deepest.depth, deepest.moved)

    @property
    def posture(self) -> Vector:
        """Start posture of all robots that move, one robot after the other, shape (n,) [rad or m]."""
        return np.concatenate(list(self.start.values()))

    def parts(self, rows: Vector) -> dict[str, Vector]:
        """Split postures (..., n) of all robots that move into the postures of each robot, by name."""
        return dict(zip(self.start, np.split(rows, self._split_indices, axis=-1), strict=True))

    def collisions(self, posture: Vector, share: float = 1.0) -> list[Overlap]:
        """Find the collisions in a posture, the deepest first.

        If only pairs collide that :meth:`allow_goal` has named, `share` is ignored.

        Args:
            posture: positions of all robots that move, shape (n,) [rad or m].
            share: factor on the tolerances, from 0 to 1.
        """
        self.model.place_robots(self.parts(posture))
        policy = self.model.policy
        found = policy.overlaps(self.start, self._depths_at_start, share)
        # A goal may need more than a share of the tolerance, as at a piece that is grasped.
        if found and all(overlap.bodies in self._close_at_goal for overlap in found):
            return policy.overlaps(self.start, self._depths_at_start)
        return found

    def allow_goal(self, posture: Vector) -> None:
        """Let the search use the whole tolerance for the pairs of bodies that need it at a goal (n,) [rad or m]."""
        found = self.collisions(posture, SEARCHED)
        self._close_at_goal.update(overlap.bodies for overlap in found)

    def free(self, posture: Vector) -> bool:
        """Whether a posture (n,) is free of collisions, by the tolerances of a search.

        If the posture is not free, the two bodies that collide deepest are counted in `met`.
        """
        found = self.collisions(posture, SEARCHED)
        self.met.update(found[0].bodies if found else ())
        return not found

    def obstacles(self, most: int = 3) -> list[str]:
        """Names of the bodies with which the search collided most often, without the robots that move.

        Args:
            most: largest count of names.
        """
        policy = self.model.policy
        inspector = self.model.station.scene_graph.model_inspector()
        robots = dict(map(policy.owner, inspector.GetAllGeometryIds(Role.kProximity)))  # robot of each body, by name
        others = [body for body, _ in self.met.most_common() if robots[body] not in self.start]
        return others[:most]

    def carried(self, robot: str) -> Vector:
        """Corners of the bounding boxes of the pieces that a robot carries or holds, shape (k, 3) [m].

        The corners are in the world, at the start. Without any piece, k is 0.
        """
        self.model.place_robots(self.start)
        query, corners = self.model.query(), np.array([*product((-1.0, 1.0), repeat=3)])
        found = [np.zeros((0, 3))]
        carried = {*self.model.robots[robot].held, *self.model.holders}
        for shape in query.inspector().GetAllGeometryIds(Role.kProximity):
            body, owner = self.model.policy.owner(shape)
            box = query.inspector().GetObbInGeometryFrame(shape)
            if owner == robot and box is not None and body in carried:
                pose = query.GetPoseInWorld(shape) @ box.pose()
                found.append((pose.rotation().matrix() @ (corners * box.half_width()).T).T + pose.translation())
        return np.vstack(found)


_LOOK = 0.02  # distance between the postures that a search checks [m]
CLOSE_LOOK = 0.005  # distance between the checked postures of the final path [m]
_RANGE = 1.0  # length of the longest branch of a search tree [m]
_STRAIGHT = 8  # count of goals to which a straight line is tried first
_DEGREE = 5  # degree of the spline that rounds corners
_ROUND = (0.2, 0.1, 0.05, 0.02)  # distances between the spline's control points, tried in this order [m]
_THINNEST = 0.1  # least distance that a radian counts [m]: the radius of an arm that turns about its own axis
_POSTURES = 100  # count of random postures from which the motion of a tool is estimated
_NOTHING = np.zeros((0, 3))
_ROUNDING = 1e-9  # m
_FROM_START = 1  # how the search marks the tree that grows from the start


def metres(chain: Chain, carried: Vector = _NOTHING) -> Vector:
    """Largest distance that a radian (or metre) of each axis moves the tool or carried points, shape (n,) [m].

    Args:
        chain: the arm.
        carried: points of what the arm carries, in the frame of the tool, shape (k, 3) [m].
    """
    postures = random_postures(chain, _POSTURES, 0)
    jacobians = chain.jacobian(postures)[:, np.newaxis]
    arms = np.vstack([np.zeros(3), carried]) @ chain.forward(postures)[:, :3, :3].swapaxes(1, 2)
    points = jacobians[:, :, :3] + np.cross(jacobians[:, :, 3:], arms[..., np.newaxis], axis=2)
    moved = np.linalg.norm(points, axis=2).max(axis=0)
    moved[0] += _THINNEST * chain.revolute
    return np.asarray(np.maximum(moved.max(axis=0), _THINNEST))  # a finger does not move the tool


class _Plan(NamedTuple):
    """Result of a search.

    Attributes:
        from_start: postures that the search reached from the start, shape (k, n).
        branches: pairs of postures with a free motion in between, shape (m, 2, n).
        corners: corners of the path, shape (c, n). It is None if no path was found.
    """

    from_start: Vector
    branches: Vector
    corners: Vector | None


@dataclass
class Search:
    """A search for a path of robots that move at the same time.

    A posture (n,) contains the axes of all these robots, one robot after the other.
    """

    space: FreeSpace  # decides which postures are free of collisions
    # limits of the axes, each (n,) [rad or m]
    lower: Vector
    upper: Vector
    scale: Vector  # metres that one radian (or metre) of each axis counts, shape (n,), see :func:`metres`
    seed: int  # two searches with the same seed find the same path, if both have enough time
    seconds: float  # longest duration of the search [s]
    branches: Vector = field(init=False)  # pairs of postures that the search trees connect, shape (k, 2, n)

    def __post_init__(self) -> None:
        """Start with empty search trees."""
        self.branches = np.zeros((0, 2, len(self.scale)))

    def path(self, goals: Vector) -> Vector:
        """Find a path without collisions to one of several goals (m, n), sorted by distance, the nearest first.

        Straight lines to the nearest goals are tried before the search.

        Returns:
            the corners of the path, shape (k, n) [rad or m].

        Raises:
            NoFreePath: no path was found within `seconds`; names the bodies in the way.
        """
        start = self.space.posture
        for goal in goals[:_STRAIGHT]:
            if all(self.space.free(posture) for posture in self._between(np.array([start, goal]), _LOOK)[1:]):
                return np.array([start, goal])
        return self._found(start, goals)

    def rounded(self, corners: Vector) -> tuple[Vector, Vector]:
        """Round the corners (c, n) of a path.

        The smooth path is a spline whose control points lie on the straight lines between
        the corners. If it collides, the control points are put closer together, which keeps
        the spline nearer to the lines.

        Returns:
            fractions (k,) of the length, from 0 to 1, and the postures (k, n) [rad or m] there.

        Raises:
            NoFreePath: even the spline nearest to the lines collides.
        """
        whole = self.length(corners)
        hit: Overlap | None = None
        if whole < _ROUNDING:
            return np.linspace(0.0, 1.0, 2 * _DEGREE), corners[:1].repeat(2 * _DEGREE, axis=0)
        for step in _ROUND:
            control = self._between(corners, min(step, whole / (2 * _DEGREE)))
            inner = np.linspace(0.0, 1.0, len(control) - _DEGREE + 1)
            knots = np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])
            count = int(np.ceil(whole / CLOSE_LOOK)) + 2 * len(control)
            rows = np.asarray(BSpline(knots, control, _DEGREE)(np.linspace(0.0, 1.0, count)))
            hits = (self.space.collisions(row) for row in rows)
            hit = next((found[0] for found in hits if found), None)
            if hit is None:
                return self.gone(rows), rows
        assert hit is not None  # the last attempt ended in a collision
        one, other = hit.moved
        raise NoFreePath(f"the way that was found leads {one} {1e3 * hit.depth:.1f} mm into {other}: try another seed")

    def length(self, rows: Vector) -> float:
        """Length of a path through postures (k, n) [m]."""
        return float(np.linalg.norm(np.diff(rows * self.scale, axis=0), axis=1).sum())

    def gone(self, rows: Vector) -> Vector:
        """Fraction of a path's length at each of its postures (k, n), from 0 to 1, shape (k,)."""
        gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(rows * self.scale, axis=0), axis=1)))
        return np.asarray(gone / gone[-1])

    def _between(self, corners: Vector, step: float) -> Vector:
        """Postures (k, n) on the straight lines between corners (c, n), at most a step [m] apart."""
        lengths = np.linalg.norm(np.diff(corners * self.scale, axis=0), axis=1)
        parts = [np.linspace(0.0, 1.0, int(np.ceil(length / step)) + 1)[1:, np.newaxis] for length in lengths]
        lines = [one + part * (other - one) for part, one, other in zip(parts, corners, corners[1:], strict=False)]
        return np.vstack([corners[:1], *lines])

    def _found(self, start: Vector, goals: Vector) -> Vector:
        """Search for a path from a start (n,) to one of several goals (m, n), and shorten the path.

        Returns the corners of the path, shape (k, n) [rad or m].

        Raises:
            NoFreePath: no path was found within `seconds`.
        """
        plan = self._planned(start, goals)
        if plan.corners is None:
            raise self._no_path_error(plan.from_start, goals)
        self.branches = plan.branches
        corners = plan.corners
        # The search works in metres: put back the exact ends, without rounding errors.
        nearest_goal = np.abs(goals - corners[-1]).sum(axis=1).argmin()
        corners[0] = start
        corners[-1] = goals[nearest_goal]
        return corners

    def _planned(self, start: Vector, goals: Vector) -> "_Plan":
        """Search with OMPL's RRT-Connect from a start (n,) to goals (m, n).

        OMPL reports objects that are never freed. So all its objects end with this call, and
        no error is raised here, whose traceback would keep them.
        """
        with needed("move_free", "plan"):
            from ompl import base, geometric, util
        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(self.seed + 1)
        info = base.SpaceInformation(self._box(np.vstack([start, goals])))
        info.setStateValidityChecker(lambda state: self.space.free(self._posture(state)))
        info.setup()

        problem = base.ProblemDefinition(info)
        problem.addStartState(self._state(info, start))
        goal = base.GoalStates(info)
        for posture in goals:
            goal.addState(self._state(info, posture))
        problem.setGoal(goal)

        planner = geometric.RRTConnect(info)
        planner.setRange(_RANGE)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(self.seconds)

        tree = base.PlannerData(info)
        planner.getPlannerData(tree)
        vertices = [tree.getVertex(index) for index in range(tree.numVertices())]
        reached = np.array([self._posture(vertex.getState()) for vertex in vertices])
        # RRT-Connect grows a second tree from the goals.
        is_from_start = [vertex.getTag() == _FROM_START for vertex in vertices]
        if not problem.hasExactSolution():
            return _Plan(from_start=reached[is_from_start], branches=np.zeros((0, 2, len(start))), corners=None)
        edges = [(index, other) for index in range(len(vertices)) for other in tree.getEdges(index)]
        # Without edges the array is empty, and needs its second dimension.
        branches = reached[np.array(edges, dtype=int).reshape(-1, 2)]

        path = problem.getSolutionPath()
        simplifier = geometric.PathSimplifier(info)
        simplifier.reduceVertices(path)
        simplifier.ropeShortcutPath(path)
        simplifier.partialShortcutPath(path)
        corners = np.array([self._posture(path.getState(index)) for index in range(path.getStateCount())])
        return _Plan(from_start=reached[is_from_start], branches=branches, corners=corners)

    def _box(self, ends: Vector) -> Any:
        """OMPL's space of postures, scaled to metres.

        An axis without limits may go half a turn beyond its positions in ``ends``: the start
        and the goals, shape (k, n).
        """
        from ompl import base

        space, bounds = base.RealVectorStateSpace(len(self.scale)), base.RealVectorBounds(len(self.scale))
        lower = np.where(np.isfinite(self.lower), self.lower, ends.min(axis=0) - np.pi)
        upper = np.where(np.isfinite(self.upper), self.upper, ends.max(axis=0) + np.pi)
        for axis, (least, most) in enumerate(zip(lower * self.scale, upper * self.scale, strict=True)):
            bounds.setLow(axis, float(least) - _ROUNDING)
            bounds.setHigh(axis, float(most) + _ROUNDING)
        space.setBounds(bounds)
        space.setLongestValidSegmentFraction(_LOOK / space.getMaximumExtent())
        return space

    def _state(self, info: Any, posture: Vector) -> Any:
        made = info.allocState()
        for axis, value in enumerate((posture * self.scale).tolist()):
            made[axis] = value
        return made

    def _posture(self, state: Any) -> Vector:
        return np.array([state[axis] for axis in range(len(self.scale))]) / self.scale

    def _no_path_error(self, reached: Vector, goals: Vector) -> NoFreePath:
        """Error of a search without a path: the goal that came nearest, and the bodies that were in the way.

        Args:
            reached: postures that the search reached from the start, shape (k, n).
            goals: the goals, shape (m, n).
        """
        differences = np.array([self.space.posture, *reached])[:, np.newaxis] - goals
        gaps = np.linalg.norm(differences * self.scale, axis=2)  # [m], from each posture to each goal
        row, goal = np.unravel_index(int(gaps.argmin()), gaps.shape)
        short = f"{goal + 1} of {len(goals)} is nearest, with a motion of {gaps[row, goal]:.2g} m left"
        met = ", ".join(self.space.obstacles()) or "the arm itself"
        return NoFreePath(
            f"no free way was found in {self.seconds:g} s: of the goals number {short}; in the way: {met}"
        )
