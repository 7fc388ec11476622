"""Paths of robots around obstacles, found by a search that grows two trees of postures without collisions.

One tree grows from the start and one from the goals, until they meet (the RRT-Connect algorithm of the Open Motion
Planning Library, OMPL). A posture contains the positions of all axes that move; if several robots move at the same
time, it contains the axes of one robot after the other. A path is given by its corners: between two corners it is
straight.

Distances between postures are measured in metres: a radian of an axis counts as the largest distance that it can move
the tool.

The collision policy of a station decides which pairs of bodies collide, and from which overlap on (their tolerance).
The owner of a body is the robot to which it belongs, or that carries it or holds it between its fingers.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Role
from scipy.interpolate import BSpline

from simrob_drake.base.extras import importing_extra
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.numeric import random_postures
from simrob_drake.programs.errors import NoFreePath, StartInCollision
from simrob_drake.programs.model import StationModel
from simrob_drake.stations.collisions import START_TOLERANCE, Bodies, Overlap

SEARCHED = 0.5
"""Fraction of the collision tolerances that a search uses. Rounding moves the path slightly,
and the rounded path may use the whole tolerances."""
CLOSE_LOOK = 0.005
"""Distance between the checked postures of the final path [m]."""

_LOOK = 0.02  # distance between the postures that a search checks [m]
_LONGEST_BRANCH = 1.0  # length of the longest branch of a search tree [m]
_STRAIGHT_TRIES = 8  # count of goals to which a straight line is tried first
_DEGREE = 5  # degree of the spline that rounds corners
# Distances between the spline's control points, tried in this order [m]: the widest one gives the smoothest path.
_SPACINGS = (0.2, 0.1, 0.05, 0.02)
_LEAST_LEVER = 0.1  # least distance that a radian counts [m]: the radius of an arm that turns about its own axis
_SAMPLES = 100  # count of random postures from which the motion of a tool is estimated
_NO_POINTS = np.zeros((0, 3))
_ROUNDING = 1e-9  # [m]
_FROM_START = 1  # tag by which OMPL marks the postures of the tree that grows from the start
# Corners of a box with half widths of 1, shape (8, 3).
_CORNER_SIGNS = np.array([*product((-1.0, 1.0), repeat=3)])


@dataclass(eq=False)
class FreeSpace:
    """The postures in which robots that move at the same time do not collide.

    The station's collision policy decides what counts as a collision, and by which tolerances. The robots move with
    the pieces that they carry or hold; all other robots stand still.

    Attributes:
        model: the station with collision shapes, and its robots in their present postures.
        start: start posture of each robot that moves, by name, shape (n,) [rad or m].
        hit_counts: how often a search collided with each body, by name.
    """

    model: StationModel
    start: Mapping[str, Vector]
    hit_counts: Counter[str] = field(default_factory=Counter)
    # Overlap [m] that each pair of bodies may keep, because the pair touches at the start.
    _depths_at_start: Mapping[Bodies, float] = field(default_factory=dict)
    # Pairs of bodies that nearly touch at a goal: the search uses their whole tolerance.
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
        # Robots that do not move are already in their postures in the model.
        self.model.place_robots(self.start)
        self._depths_at_start = self.model.policy.allowed_from_start(self.start)
        # The deepest overlap is first.
        for overlap in self.model.policy.overlaps(self.start):
            if overlap.is_between_owners and overlap.depth > START_TOLERANCE:
                raise StartInCollision(overlap.depth, overlap.moved)

    @property
    def posture(self) -> Vector:
        """Start posture of all robots that move, one robot after the other, shape (n,) [rad or m]."""
        return np.concatenate(list(self.start.values()))

    def split_by_robot(self, postures: Vector) -> dict[str, Vector]:
        """Split postures (..., n) of all robots that move into the postures of each robot, by name."""
        own_postures = np.split(postures, self._split_indices, axis=-1)
        return dict(zip(self.start, own_postures, strict=True))

    def collisions(self, posture: Vector, share: float = 1.0) -> list[Overlap]:
        """Find the collisions in a posture, the deepest first.

        If all pairs that collide are among those that :meth:`allow_goal` has recorded, `share` is ignored: the result
        is that of the whole tolerances.

        Args:
            posture: positions of all robots that move, shape (n,) [rad or m]. The robots of the model are left there.
            share: factor on the tolerances (overlaps that do not count as collisions), from 0 to 1.
        """
        self.model.place_robots(self.split_by_robot(posture))
        policy = self.model.policy
        found = policy.overlaps(self.start, self._depths_at_start, share)
        # A goal may need more than a share of the tolerance, as at a piece that is grasped.
        if found and all(overlap.bodies in self._close_at_goal for overlap in found):
            return policy.overlaps(self.start, self._depths_at_start)
        return found

    def allow_goal(self, posture: Vector) -> None:
        """Record the pairs of bodies that need more than the search's share of the tolerance at a goal (n,).

        From then on, :meth:`collisions` uses the whole tolerance where only such pairs collide. The posture itself must
        be free by the whole tolerances.
        """
        found = self.collisions(posture, SEARCHED)
        self._close_at_goal.update(overlap.bodies for overlap in found)

    def collides(self, posture: Vector) -> bool:
        """Whether a posture (n,) collides, by the tolerances of a search; counts the collision in `hit_counts`.

        If the posture collides, the two bodies that collide deepest are counted.
        """
        found = self.collisions(posture, SEARCHED)
        if found:
            self.hit_counts.update(found[0].bodies)
        return bool(found)

    def obstacles(self, most: int = 3) -> list[str]:
        """Names of the bodies in which the search collided most often, without robots that move and what they carry.

        Args:
            most: largest count of names.
        """
        shapes = self.model.station.scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity)
        # The policy's owner of a shape is a pair: the body's name, and the robot's name or an empty string.
        robot_of_body = dict(self.model.policy.owner(shape) for shape in shapes)
        bodies = [body for body, _ in self.hit_counts.most_common()]
        return [body for body in bodies if robot_of_body[body] not in self.start][:most]

    def carried_points(self, robot: str) -> Vector:
        """Corners of the bounding boxes of the pieces on a robot's tools or between its fingers, shape (k, 3) [m].

        Pieces on links that are no tools, such as a backpack on a trunk, do not count.

        The corners are in the world, at the start. Without any piece, k is 0. As a side effect, the robots of the model
        are placed in their start postures.
        """
        self.model.place_robots(self.start)
        query = self.model.query()
        # The pieces that hang on its tools, and those that fingers of any robot hold now: below, `owner` leaves out
        # those of other robots.
        pieces = {*self.model.robots[robot].held, *self.model.holders}
        corners = [_NO_POINTS]
        for shape in query.inspector().GetAllGeometryIds(Role.kProximity):
            body, owner = self.model.policy.owner(shape)
            box = query.inspector().GetObbInGeometryFrame(shape)
            # A shape without limits, such as a half space, has no box.
            if owner == robot and box is not None and body in pieces:
                pose = query.GetPoseInWorld(shape) @ box.pose()
                # Positions in the box (8, 3), one in each row: R p is written as (R p')' for rows.
                corners_in_box = _CORNER_SIGNS * box.half_width()
                corners.append((pose.rotation().matrix() @ corners_in_box.T).T + pose.translation())
        return np.vstack(corners)


def metres_per_radian(chain: Chain, carried: Vector = _NO_POINTS) -> Vector:
    """Largest distance that a radian (or metre) of each axis moves the tool or carried points, shape (n,) [m].

    The distance is estimated from random postures of the arm. Each axis counts at least 0.1 m. At the tool centre point
    0.1 m is added for each revolute axis, for the links around it.

    Args:
        chain: the arm.
        carried: points of what the arm carries, in the frame of the tool, shape (k, 3) [m].
    """
    # Always the same random postures, from the seed 0.
    postures = random_postures(chain, _SAMPLES, 0)
    # The first point is the tool centre point, shape (points, 3).
    points_in_tool = np.vstack([np.zeros(3), carried])
    # The lever of a point, from the tool centre point, is R p with the rotation R of the tool; for rows of points it is
    # the product with R'. Shape (postures, points, 3), along the axes of the world.
    levers = points_in_tool @ chain.forward(postures)[:, :3, :3].swapaxes(1, 2)
    # The velocity of a point at the lever r is v + w x r, here for a unit speed of each axis: the first three rows of a
    # Jacobian are v, the last three w. Shape (postures, points, 3, n).
    jacobians = chain.jacobian(postures)[:, np.newaxis]
    velocities = jacobians[:, :, :3] + np.cross(
        jacobians[:, :, 3:], levers[..., np.newaxis], axis=2
    )
    largest_speeds = np.linalg.norm(velocities, axis=2).max(axis=0)  # (points, n)
    # The tool centre point stands for the last links, too, which have a width: a revolute axis through this point does
    # not move it, but turns the links around it. All revolute axes get the addition, since the links are near the point
    # in each case. Carried points get none: they are the corners of what they stand for.
    largest_speeds[0] += _LEAST_LEVER * chain.revolute
    # A finger does not move the tool, but its motion has to count, too. Sliding axes get no addition above.
    return np.asarray(np.maximum(largest_speeds.max(axis=0), _LEAST_LEVER))


class TimelessPath(NamedTuple):
    """A smooth path through many postures, without timing.

    Attributes:
        fractions: fraction of the path's length at each posture, from 0 to 1, shape (k,).
        postures: the postures, shape (k, n) [rad or m].
    """

    fractions: Vector
    postures: Vector


class _SearchResult(NamedTuple):
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

    Attributes:
        space: decides which postures are free of collisions.
        lower: lower limits of the axes, shape (n,) [rad or m].
        upper: upper limits of the axes, shape (n,) [rad or m].
        scale: metres that one radian (or metre) of each axis counts, shape (n,), see :func:`metres_per_radian`.
        seed: seed of the random numbers. Two searches with the same seed find the same path, if both have enough time.
        seconds: longest duration of the search [s].
        branches: pairs of postures that the search trees connect, shape (k, 2, n).
    """

    space: FreeSpace
    lower: Vector
    upper: Vector
    scale: Vector
    seed: int
    seconds: float
    branches: Vector = field(init=False)

    def __post_init__(self) -> None:
        """Start with empty search trees."""
        self.branches = np.zeros((0, 2, len(self.scale)))

    def path(self, goals: Vector) -> Vector:
        """Find a path without collisions to one of several goals (m, n), sorted by distance, the nearest first.

        Straight lines to the nearest goals are tried first. If none is free, the search begins, which stores its trees
        in `branches`. The path may lead to any goal, not only to the nearest one.

        Returns:
            the corners of the path with its start and the goal, shape (k, n) [rad or m].

        Raises:
            NoFreePath: no path was found within `seconds`; names the bodies in the way.
            SimrobError: no straight line is free, and OMPL is not installed.
        """
        start = self.space.posture
        for goal in goals[:_STRAIGHT_TRIES]:
            line = np.array([start, goal])
            # Without the first posture, the start: `FreeSpace` has checked it.
            postures = self._interpolate(line, _LOOK)[1:]
            if not any(self.space.collides(posture) for posture in postures):
                return line
        return self._search_corners(start, goals)

    def round_corners(self, corners: Vector) -> TimelessPath:
        """Round the corners (c, n) of a path.

        The smooth path is a spline whose control points lie on the straight lines between
        the corners. If it collides, the control points are put closer together, which keeps
        the spline nearer to the lines. If the path has no length, its posture is repeated.

        Raises:
            NoFreePath: even the spline nearest to the lines collides.
        """
        path_length = self.length(corners)
        # The goal is the start: the path stays there.
        if path_length < _ROUNDING:
            count = 2 * _DEGREE
            return TimelessPath(np.linspace(0.0, 1.0, count), corners[:1].repeat(count, axis=0))
        hit: Overlap | None = None
        for spacing in _SPACINGS:
            # Even a short path has enough control points for a spline of this degree.
            widest = path_length / (2 * _DEGREE)
            control_points = self._interpolate(corners, min(spacing, widest))
            # Repeated knots at both ends let the spline begin and end at the ends of the path.
            inner_knots = np.linspace(0.0, 1.0, len(control_points) - _DEGREE + 1)
            knots = np.concatenate([np.zeros(_DEGREE), inner_knots, np.ones(_DEGREE)])
            spline = BSpline(knots, control_points, _DEGREE)
            # The spline is not longer than the lines. It is not evenly fast, so further postures are added.
            count = int(np.ceil(path_length / CLOSE_LOOK)) + 2 * len(control_points)
            postures = np.asarray(spline(np.linspace(0.0, 1.0, count)))
            hit = self._first_hit(postures)
            if hit is None:
                return TimelessPath(self.length_fractions(postures), postures)
        # The last attempt ended in a collision: otherwise its path was returned.
        assert hit is not None
        one, other = hit.moved
        raise NoFreePath(
            message(
                "programs.way_leads_into",
                "on the path that was found, {one} overlaps {other} by {depth:.1f} mm; try another seed",
                one=one,
                depth=1e3 * hit.depth,
                other=other,
            )
        )

    def _first_hit(self, postures: Vector) -> Overlap | None:
        """Deepest collision of the first of several postures (k, n) that collides, by the whole tolerances.

        It is None if none of the postures collides.
        """
        for posture in postures:
            found = self.space.collisions(posture)
            if found:
                return found[0]
        return None

    def length(self, postures: Vector) -> float:
        """Length of a path through postures (k, n) [m]."""
        return float(self._distances(postures).sum())

    def length_fractions(self, postures: Vector) -> Vector:
        """Fraction of a path's length at each of its postures (k, n), from 0 to 1, shape (k,).

        The path must have a length greater than 0.
        """
        lengths = np.append(0.0, np.cumsum(self._distances(postures)))
        return np.asarray(lengths / lengths[-1])

    def _distances(self, postures: Vector) -> Vector:
        """Distance of each posture of a path (k, n) to the next one, shape (k - 1,) [m]."""
        return np.asarray(np.linalg.norm(np.diff(postures * self.scale, axis=0), axis=1))

    def _interpolate(self, corners: Vector, step: float) -> Vector:
        """Compute postures (k, n) on the straight lines between corners (c, n), at most a step [m] apart."""
        lines = [corners[:1]]
        for distance, (begin, end) in zip(self._distances(corners), pairwise(corners), strict=True):
            step_count = int(np.ceil(distance / step))
            # Each line leaves its first posture out: the line before ends in it.
            fractions = np.linspace(0.0, 1.0, step_count + 1)[1:, np.newaxis]
            lines.append(begin + fractions * (end - begin))
        return np.vstack(lines)

    def _search_corners(self, start: Vector, goals: Vector) -> Vector:
        """Search for a path from a start (n,) to one of several goals (m, n), and store the trees in `branches`.

        Returns the corners of the path, shape (k, n) [rad or m].

        Raises:
            NoFreePath: no path was found within `seconds`.
        """
        result = self._run_planner(start, goals)
        if result.corners is None:
            raise self._no_path_error(result.from_start, goals)
        self.branches = result.branches
        corners = result.corners
        # The search works in metres: put back the exact ends, without rounding errors.
        nearest_goal = np.abs(goals - corners[-1]).sum(axis=1).argmin()
        corners[0] = start
        corners[-1] = goals[nearest_goal]
        return corners

    def _run_planner(self, start: Vector, goals: Vector) -> _SearchResult:
        """Search with OMPL's RRT-Connect from a start (n,) to goals (m, n), and remove needless corners of the path.

        OMPL reports objects that are never freed. So all its objects end with this call, and
        the error for a search without a path is raised by the caller: its traceback would keep them.

        Raises:
            SimrobError: OMPL is not installed. The message has the command that installs it.
        """
        with importing_extra("move_free", "plan"):
            from ompl import base, geometric, util
        util.setLogLevel(util.LOG_NONE)
        # OMPL does not accept the seed 0.
        util.RNG.setSeed(self.seed + 1)
        info = base.SpaceInformation(self._scaled_space(np.vstack([start, goals])))
        info.setStateValidityChecker(lambda state: not self.space.collides(self._posture(state)))
        info.setup()

        problem = base.ProblemDefinition(info)
        problem.addStartState(self._state(info, start))
        goal = base.GoalStates(info)
        for posture in goals:
            goal.addState(self._state(info, posture))
        problem.setGoal(goal)

        planner = geometric.RRTConnect(info)
        planner.setRange(_LONGEST_BRANCH)
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
            return _SearchResult(
                from_start=reached[is_from_start],
                branches=np.zeros((0, 2, len(start))),
                corners=None,
            )
        # Pairs of indices of vertices that a tree connects.
        edges = [(index, other) for index in range(len(vertices)) for other in tree.getEdges(index)]
        # Without edges the array is empty, and needs its second dimension.
        branches = reached[np.array(edges, dtype=int).reshape(-1, 2)]

        path = problem.getSolutionPath()
        # A tree wanders: its path has corners that a straight line between later ones makes needless.
        simplifier = geometric.PathSimplifier(info)
        simplifier.reduceVertices(path)
        simplifier.ropeShortcutPath(path)
        simplifier.partialShortcutPath(path)
        corners = np.array(
            [self._posture(path.getState(index)) for index in range(path.getStateCount())]
        )
        return _SearchResult(from_start=reached[is_from_start], branches=branches, corners=corners)

    def _scaled_space(self, ends: Vector) -> Any:
        """Make OMPL's space of postures, scaled to metres, within the limits of the axes.

        An axis without limits may go half a turn beyond its positions in ``ends``: the start
        and the goals, shape (k, n).
        """
        from ompl import base

        axis_count = len(self.scale)
        lower = np.where(np.isfinite(self.lower), self.lower, ends.min(axis=0) - np.pi)
        upper = np.where(np.isfinite(self.upper), self.upper, ends.max(axis=0) + np.pi)
        bounds = base.RealVectorBounds(axis_count)
        for axis, (low, high) in enumerate(
            zip(lower * self.scale, upper * self.scale, strict=True)
        ):
            # A start at its limit stays within the bounds in spite of rounding.
            bounds.setLow(axis, float(low) - _ROUNDING)
            bounds.setHigh(axis, float(high) + _ROUNDING)
        space = base.RealVectorStateSpace(axis_count)
        space.setBounds(bounds)
        # OMPL expects the distance between checked postures as a fraction of the space's diagonal.
        space.setLongestValidSegmentFraction(_LOOK / space.getMaximumExtent())
        return space

    def _state(self, info: Any, posture: Vector) -> Any:
        """Make OMPL's state of a posture (n,): the same, scaled to metres."""
        state = info.allocState()
        for axis, value in enumerate((posture * self.scale).tolist()):
            state[axis] = value
        return state

    def _posture(self, state: Any) -> Vector:
        """Posture (n,) [rad or m] of OMPL's state, which is scaled to metres."""
        return np.array([state[axis] for axis in range(len(self.scale))]) / self.scale

    def _no_path_error(self, reached: Vector, goals: Vector) -> NoFreePath:
        """Make the error of a search without a path, with the nearest goal and the bodies that were in the way.

        Args:
            reached: postures that the search reached from the start, shape (k, n).
            goals: the goals, shape (m, n).
        """
        differences = np.array([self.space.posture, *reached])[:, np.newaxis] - goals
        # Distance from each posture to each goal, shape (k + 1, m) [m]. The first posture is the start, for a search
        # that reached nothing.
        gaps = np.linalg.norm(differences * self.scale, axis=2)
        row, goal = np.unravel_index(int(gaps.argmin()), gaps.shape)
        nearest = message(
            "programs.nearest_goal",
            "{goal} of {count}, with {gap:.2g} m of motion left",
            goal=goal + 1,
            count=len(goals),
            gap=gaps[row, goal],
        )
        # Without other bodies in the way, the arm collided with itself.
        obstacles = ", ".join(self.space.obstacles()) or message(
            "programs.the_arm_itself", "the arm itself"
        )
        return NoFreePath(
            message(
                "programs.no_free_way",
                "no free path was found in {seconds:g} s; the nearest goal is number {nearest}; obstacles: {obstacles}",
                seconds=self.seconds,
                nearest=nearest,
                obstacles=obstacles,
            )
        )
