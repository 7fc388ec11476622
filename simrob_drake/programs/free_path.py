"""Paths of robots around obstacles: a search between two trees of postures, in the space in which they touch nothing.

Distances are measured by how far tools move: a radian of an axis counts as many metres as it may move the tool.
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
"""Fraction of the tolerances that a search uses: its path is rounded, and then keeps to
all of them."""


@dataclass(eq=False)
class FreeSpace:
    """The postures without collisions of robots that move together, by the one policy.

    The robots move with what they carry; other robots stand where they are.
    """

    model: StationModel  # the station with collision shapes, its robots where they stand
    start: Mapping[str, Vector]  # where the robots that move begin, (n,) each, by name
    met: Counter[str] = field(default_factory=Counter)  # how often each thing was in the way
    _begun: Mapping[Bodies, float] = field(default_factory=dict)
    _at_goal: set[Bodies] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Allow what touches at the start.

        Raises:
            StartInCollision: a robot begins deep in something else.
        """
        lengths = [len(posture) for posture in self.start.values()]
        self._ends = np.cumsum(lengths)[:-1]
        self.model.place_robots(self.start)
        self._begun = self.model.policy.allowed_from_start(self.start)
        start = self.model.policy.overlaps(self.start)
        deep = [overlap for overlap in start if not overlap.robot and overlap.depth > START_TOLERANCE]
        if deep:
            raise StartInCollision(deep[0].depth, deep[0].moved)

    @property
    def posture(self) -> Vector:
        """Where all that move begin, one after the other, shape (n,) [rad or m]."""
        return np.concatenate(list(self.start.values()))

    def parts(self, rows: Vector) -> dict[str, Vector]:
        """Return postures (..., n) of all that move by robot."""
        return dict(zip(self.start, np.split(rows, self._ends, axis=-1), strict=True))

    def collisions(self, posture: Vector, share: float = 1.0) -> list[Overlap]:
        """Find the collisions in a posture (n,), the deepest first.

        Args:
            posture: of all that move [rad or m].
            share: fraction of the tolerances that is used.
        """
        self.model.place_robots(self.parts(posture))
        policy = self.model.policy
        found = policy.overlaps(self.start, self._begun, share)
        if found and all(overlap.bodies in self._at_goal for overlap in found):
            return policy.overlaps(self.start, self._begun)
        return found

    def allow_goal(self, posture: Vector) -> None:
        """Allow bodies their whole tolerance in the search if a goal (n,) needs it."""
        found = self.collisions(posture, SEARCHED)
        self._at_goal.update(overlap.bodies for overlap in found)

    def free(self, posture: Vector) -> bool:
        """Whether a posture (n,) is free in a search; if not, count what is in the way."""
        found = self.collisions(posture, SEARCHED)
        self.met.update(found[0].bodies if found else ())
        return not found

    def obstacles(self, most: int = 3) -> list[str]:
        """Return what was in the way most often, without the robots that move."""
        policy = self.model.policy
        inspector = self.model.station.scene_graph.model_inspector()
        owners = dict(map(policy.owner, inspector.GetAllGeometryIds(Role.kProximity)))
        others = [body for body, _ in self.met.most_common() if owners[body] not in self.start]
        return others[:most]

    def carried(self, robot: str) -> Vector:
        """Return the corners of boxes around what a robot carries, where they are at the start, shape (k, 3) [m]."""
        self.model.place_robots(self.start)
        query, corners = self.model.query(), np.array([*product((-1.0, 1.0), repeat=3)])
        found = [np.zeros((0, 3))]
        for shape in query.inspector().GetAllGeometryIds(Role.kProximity):
            owner, own = self.model.policy.owner(shape)
            box = query.inspector().GetObbInGeometryFrame(shape)
            if own == robot and box is not None and owner in {*self.model.robots[robot].held, *self.model.holders}:
                pose = query.GetPoseInWorld(shape) @ box.pose()
                found.append((pose.rotation().matrix() @ (corners * box.half_width()).T).T + pose.translation())
        return np.vstack(found)


_LOOK = 0.02  # m between the looks of a search
CLOSE_LOOK = 0.005  # m between those at the way that is found
_RANGE = 1.0  # m: the longest branch of a tree
_STRAIGHT = 8  # goals that are tried by a straight way first
_DEGREE = 5
_ROUND = (0.2, 0.1, 0.05, 0.02)  # m between the points that round corners are made of
_THINNEST = 0.1  # m of an arm that turns about itself
_POSTURES = 100
_NOTHING = np.zeros((0, 3))
_ROUNDING = 1e-9  # m
_FROM_START = 1  # how the search marks the tree that grows from the start


def metres(chain: Chain, carried: Vector = _NOTHING) -> Vector:
    """Return how far a radian of each axis moves tool, 10 cm around it, and points (k, 3) in its frame, (n,) [m]."""
    postures = random_postures(chain, _POSTURES, 0)
    jacobians = chain.jacobian(postures)[:, np.newaxis]
    arms = np.vstack([np.zeros(3), carried]) @ chain.forward(postures)[:, :3, :3].swapaxes(1, 2)
    points = jacobians[:, :, :3] + np.cross(jacobians[:, :, 3:], arms[..., np.newaxis], axis=2)
    moved = np.linalg.norm(points, axis=2).max(axis=0)
    moved[0] += _THINNEST * chain.revolute
    return np.asarray(np.maximum(moved.max(axis=0), _THINNEST))  # a finger does not move the tool


class _Plan(NamedTuple):
    """What a search found.

    Attributes:
        from_start: postures that it reached from the start, shape (k, n).
        branches: pairs of postures between which it found free motions, shape (m, 2, n).
        corners: of the path, shape (c, n); None if there is none.
    """

    from_start: Vector
    branches: Vector
    corners: Vector | None


@dataclass
class Search:
    """A search for a way of robots that move together, each number (n,) being of all their axes in turn."""

    space: FreeSpace  # what is free
    # limits of the axes
    lower: Vector
    upper: Vector
    scale: Vector  # how many metres a radian counts, see :func:`metres`
    seed: int  # two searches with the same one find the same, if they have the time
    seconds: float  # how long it may take
    branches: Vector = field(init=False)  # of the trees that have grown, from posture to posture, shape (k, 2, n)

    def __post_init__(self) -> None:
        """Begin with trees of nothing."""
        self.branches = np.zeros((0, 2, len(self.scale)))

    def path(self, goals: Vector) -> Vector:
        """Return corners (k, n) of a way to one of goals (m, n), nearest first; raises NoFreePath: what was near."""
        start = self.space.posture
        for goal in goals[:_STRAIGHT]:
            if all(self.space.free(posture) for posture in self._between(np.array([start, goal]), _LOOK)[1:]):
                return np.array([start, goal])
        return self._found(start, goals)

    def rounded(self, corners: Vector) -> tuple[Vector, Vector]:
        """Return a smooth way near straight lines: its parts (k,) from 0 to 1 by length, and postures (k, n) there.

        It is a spline whose control points lie on the lines, so it cuts the corners, as near as it must to be free.
        Raises NoFreePath: it touches something at its nearest.
        """
        whole = self.length(corners)
        hit: Overlap | None = None
        if whole < _ROUNDING:
            return np.linspace(0.0, 1.0, 2 * _DEGREE), corners[:1].repeat(2 * _DEGREE, axis=0)
        for step in _ROUND:
            control = self._between(corners, min(step, whole / (2 * _DEGREE)))
            inner = np.linspace(0.0, 1.0, len(control) - _DEGREE + 1)
            knots = np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])
            looks = int(np.ceil(whole / CLOSE_LOOK)) + 2 * len(control)
            rows = np.asarray(BSpline(knots, control, _DEGREE)(np.linspace(0.0, 1.0, looks)))
            hits = (self.space.collisions(row) for row in rows)
            hit = next((found[0] for found in hits if found), None)
            if hit is None:
                return self.gone(rows), rows
        assert hit is not None  # the last attempt ended in a collision
        one, other = hit.moved
        raise NoFreePath(f"the way that was found leads {one} {1e3 * hit.depth:.1f} mm into {other}: try another seed")

    def length(self, rows: Vector) -> float:
        """Return how long a way through postures (k, n) is [m]."""
        return float(np.linalg.norm(np.diff(rows * self.scale, axis=0), axis=1).sum())

    def gone(self, rows: Vector) -> Vector:
        """Return which part of a way is gone at postures (k, n) on it, from 0 to 1, by length, shape (k,)."""
        gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(rows * self.scale, axis=0), axis=1)))
        return np.asarray(gone / gone[-1])

    def _between(self, corners: Vector, step: float) -> Vector:
        """Return postures on straight lines, at most a step [m] apart."""
        ways = np.linalg.norm(np.diff(corners * self.scale, axis=0), axis=1)
        parts = [np.linspace(0.0, 1.0, int(np.ceil(way / step)) + 1)[1:, np.newaxis] for way in ways]
        lines = [one + part * (other - one) for part, one, other in zip(parts, corners, corners[1:], strict=False)]
        return np.vstack([corners[:1], *lines])

    def _found(self, start: Vector, goals: Vector) -> Vector:
        """Search for a path and shorten it, shape (k, n).

        Raises:
            NoFreePath: none was found in the time that there is.
        """
        plan = self._planned(start, goals)
        if plan.corners is None:
            raise self._none(plan.from_start, goals)
        self.branches = plan.branches
        corners = plan.corners
        nearest_goal = np.abs(goals - corners[-1]).sum(axis=1).argmin()
        corners[0] = start
        corners[-1] = goals[nearest_goal]
        return corners

    def _planned(self, start: Vector, goals: Vector) -> "_Plan":
        """Search by OMPL. None of its objects outlives this call, in which no error is raised: it reports leaks."""
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
        is_from_start = [vertex.getTag() == _FROM_START for vertex in vertices]
        if not problem.hasExactSolution():
            return _Plan(from_start=reached[is_from_start], branches=np.zeros((0, 2, len(start))), corners=None)
        edges = [(index, other) for index in range(len(vertices)) for other in tree.getEdges(index)]
        branches = reached[np.array(edges, dtype=int).reshape(-1, 2)]

        path = problem.getSolutionPath()
        simplifier = geometric.PathSimplifier(info)
        simplifier.reduceVertices(path)
        simplifier.ropeShortcutPath(path)
        simplifier.partialShortcutPath(path)
        corners = np.array([self._posture(path.getState(index)) for index in range(path.getStateCount())])
        return _Plan(from_start=reached[is_from_start], branches=branches, corners=corners)

    def _box(self, ends: Vector) -> Any:
        """Return the space of postures, in metres; axes without limits turn a half turn beyond the ends (k, n)."""
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

    def _none(self, reached: Vector, goals: Vector) -> NoFreePath:
        """Return what to say of a search that found nothing: how near it came from the start, and what it met."""
        ways = np.array([self.space.posture, *reached])[:, np.newaxis] - goals
        gaps = np.linalg.norm(ways * self.scale, axis=2)
        row, which = np.unravel_index(int(gaps.argmin()), gaps.shape)
        short = f"{which + 1} of {len(goals)} is nearest, with a motion of {gaps[row, which]:.2g} m left"
        met = ", ".join(self.space.obstacles()) or "the arm itself"
        return NoFreePath(
            f"no free way was found in {self.seconds:g} s: of the goals number {short}; in the way: {met}"
        )
