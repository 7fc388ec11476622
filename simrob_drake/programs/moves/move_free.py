"""A move of an arm around obstacles, or of several arms at once, with what they carry.

A goal is a posture that reaches the target of the move: a pose of the tool can be reached by several postures. A search
finds a path to one of the goals, which is then rounded or optimised, and timed.

`Planning` describes the start of one robot's move: its posture, its chain of axes, its limits and its surroundings. A
*work object* is the frame in which a pose is given. Postures of several robots are one array: the axes of one robot
after those of the other.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, ClassVar, Self, Unpack

import numpy as np
import numpy.typing as npt
from pydantic import model_validator
from pydrake.math import RotationMatrix

from simrob_drake.base.arguments import positive, truth, whole
from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, Integer, Pose, Positive
from simrob_drake.kinematics.every_branch import goal_postures
from simrob_drake.programs.errors import GoalInCollision
from simrob_drake.programs.free_path import FreeSpace, Search, TimelessPath, metres_per_radian
from simrob_drake.programs.moves.motion import ArmMotion, Row
from simrob_drake.programs.plan import CHECKED, Plan, check_limits
from simrob_drake.programs.planning import (
    POINTS,
    Planning,
    PoseTargets,
    WorkObject,
    degrees_hint,
    points_of,
)
from simrob_drake.programs.segments import PathPoint, Segment, tool_length, zone_size
from simrob_drake.programs.smooth_path import RateLimits, find_faster_path
from simrob_drake.programs.tape import with_entry
from simrob_drake.programs.timing import How, is_free, plan_timed
from simrob_drake.programs.torques import slowed_for_motors
from simrob_drake.stations.collisions import Overlap

PLANNING_TIME = 10.0  # longest duration of a search by default [s]
_LARGEST_SEED = 2**31 - 2
_TURNS = 24  # count of angles about the tool's z axis that are tried if the tool may turn about it
_STRAIGHT = 2  # count of corners of a straight path, which cannot be shortened
_MOST_GOALS = 16  # largest count of goals of a search
_MOST_TRIES = 400  # largest count of goals that are checked for collisions


class MoveFree(ArmMotion):
    """A move of the tool around obstacles; see :meth:`Arm.move_free`."""

    key: ClassVar[str] = "move_free"

    wobj: str | Pose | None = None
    """Frame of the target: a piece, one of its frames as `piece.frame`, a robot's tool or a pose. If it is not set, the
    world."""
    piece: str | None = None
    """Target instead of a pose: a piece, or one of its frames as `piece.frame`, to which the tool is moved."""
    joints: Row | str | None = None
    """Target instead of a pose: a posture [rad or m], or the name of one of the robot's postures, such as `home`."""
    joints_deg: Row | None = None
    """Target instead of a pose: a posture in degrees (sliding axes in metres)."""
    free_turn: Boolean = False
    """Whether the tool may reach the target at any angle about its z axis."""
    seed: Integer = 0
    """Seed of the search; another seed finds another path."""
    planning_time: Positive = PLANNING_TIME
    """Longest duration of the search [s]."""
    show_search: Boolean = False
    """Whether the recording shows the paths of the tool that the search tried."""

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        """Check that the target is given by exactly one key."""
        targets = [self.targets, self.targets_deg, self.piece, self.joints, self.joints_deg]
        requests = [target for target in targets if target is not None]
        if len(requests) != 1:
            raise ValueError(
                message(
                    "programs.one_target",
                    "exactly one of targets, targets_deg, piece, joints and joints_deg must be set",
                )
            )
        return self

    def posture(self, planning: Planning) -> npt.ArrayLike | str | None:
        """Target posture (n,) [rad or m], or its name. It is None if the target is a pose or a piece.

        A posture may leave out the fingers. Degrees of a wrong count are returned unchanged: the planner refuses them.
        """
        if self.joints_deg is None:
            return self.joints
        units = planning.units_of(len(self.joints_deg))
        return self.joints_deg if units is None else np.asarray(self.joints_deg * units)

    def pieces(self) -> Iterable[str]:
        """Names of the pieces that the move refers to: its target, or else its work object."""
        if self.piece is None:
            return super().pieces()
        # A frame of a piece is written as `piece.frame`.
        name, _, _ = self.piece.partition(".")
        return (name,)

    def goals(self, planning: Planning) -> Vector:
        """Compute the postures that reach the target, shape (m, n) [rad or m], the nearest first.

        For the errors see :func:`goals_of`.
        """
        return goals_of(
            planning,
            self.piece or self.rows(planning),
            self.posture(planning),
            self.wobj,
            self.free_turn,
            self.seed,
        )

    def plan(self, planning: Planning) -> Plan:
        """Plan the move; see :func:`plan_move_free`."""
        return plan_move_free(
            planning, self.piece or self.rows(planning), joints=self.posture(planning), wobj=self.wobj,
            free_turn=self.free_turn, seed=self.seed, planning_time=self.planning_time, show_search=self.show_search,
            **self.how,
        )  # fmt: skip


def plan_move_free(
    planning: Planning,
    targets: PoseTargets | str | None = None,
    *,
    joints: npt.ArrayLike | str | None = None,
    wobj: WorkObject = None,
    free_turn: bool = False,
    seed: int = 0,
    planning_time: float = PLANNING_TIME,
    show_search: bool = False,
    **how: Unpack[How],
) -> Plan:
    """Plan a move around obstacles to any posture that reaches the target, with what the arm carries or holds.

    A straight path of the axes is tried first. Otherwise a search that grows two trees of postures finds the path,
    which is then shortened and rounded. No checked posture has a collision, not even of the arm with itself. Bodies
    that touch at the start may touch during the whole move.

    Args:
        planning: the start of the move: posture, limits, surroundings.
        targets: a pose of the tool in the work object's frame, a place (3,) that keeps its orientation, or the name of
            a piece or of one of its frames, where the tool is to be. It is None if `joints` is given.
        joints: a posture (n,) [rad or m], or one of the robot's by name, such as ``home``. It is None if `targets` is
            given.
        wobj: the work object. If it is None, the world.
        free_turn: whether the tool may reach the target at any angle about its z axis.
        seed: seed of the search. The same seed gives the same path, if the search has enough time.
        planning_time: longest duration of the search [s].
        show_search: whether the recording shows the paths of the tool that the search tried.
        how: see :class:`How`.

    Raises:
        StartInCollision, GoalInCollision: bodies overlap at the start or at every goal that was tried; names them and
            the depth.
        Unreachable: no posture within the limits brings the tool to the target.
        NoFreePath: no path was found in the time. The message has the nearest goal and the obstacles.
        SimrobError: the errors of other moves.
    """
    goals = goals_of(planning, targets, joints, wobj, free_turn, seed)
    (plan,) = plan_around(
        [planning], [goals], how, seed, planning_time, show_search=truth(show_search, "show_search")
    )
    # Keys of the move in a program's file. None leaves a key out, which then has its default. A name as target is
    # written under `piece`, other targets under `targets`.
    piece = targets if isinstance(targets, str) else None
    poses = None if isinstance(targets, str) else targets
    own_keys: dict[str, Any] = {
        "joints": None if joints is None else np.asarray(joints).tolist(),
        "free_turn": free_turn or None,
        "show_search": show_search or None,
        "seed": seed or None,
        "planning_time": None if planning_time == PLANNING_TIME else planning_time,
        "piece": piece,
    }
    return with_entry(
        plan, MoveFree.key, planning, poses, how, wobj=wobj, solver="auto", **own_keys
    )


def plan_together(moves: Sequence[MoveFree], plannings: Sequence[Planning]) -> list[Plan]:
    """Plan moves of several robots that move at the same time, around each other.

    Args:
        moves: one move for each robot. The seed of the first move and the longest planning time of all are used, and
            the search is shown if any move wants it.
        plannings: the start of each move, in the same order.

    Returns:
        one plan for each robot, all of the same duration.

    Raises:
        InvalidParameter: two moves have different durations, speeds or other options, or the same robot.
        SimrobError: see :func:`plan_move_free`.
    """
    first = moves[0]
    robots = {planning.robot for planning in plannings}
    have_equal_options = all(move.how == first.how for move in moves)
    # All robots share one path over time, so its options are those of all moves.
    if not have_equal_options or len(robots) < len(plannings):
        raise Unsuitable(
            "together",
            message(
                "programs.moves_around_together", "moves around obstacles are planned as one path"
            ),
            message(
                "programs.different_robots_same_time",
                "give them different robots and equal options",
            ),
        )
    goals = [move.goals(planning) for move, planning in zip(moves, plannings, strict=True)]
    show_search = any(move.show_search for move in moves)
    planning_time = max(move.planning_time for move in moves)
    plans = plan_around(
        plannings, goals, first.how, first.seed, planning_time, show_search=show_search
    )
    recorded_plans = []
    for move, plan in zip(moves, plans, strict=True):
        # The recorded move names its robot even if the file leaves it out: the moves are of different robots.
        named_move = move.model_copy(update={"robot": plan.robot})
        recorded_plans.append(replace(plan, entry=named_move.entry()))
    return recorded_plans


def goals_of(
    planning: Planning,
    targets: PoseTargets | str | None,
    joints: npt.ArrayLike | str | None,
    wobj: WorkObject,
    free_turn: bool,
    seed: int,
) -> Vector:
    """Compute the postures within the limits that reach a target, shape (m, n) [rad or m], the nearest first.

    Args:
        planning: the start of the move.
        targets: a pose of the tool, a place that keeps its orientation, or the name of a piece or of one of its frames
            as ``piece.frame``; None if `joints` is given.
        joints: a posture (n,) [rad or m] or its name; None if `targets` is given.
        wobj: the work object, in whose frame a pose or place is. If it is None, the world.
        free_turn: whether the tool may reach a pose at any angle about its z axis.
        seed: seed of the inverse kinematics, which may start from random postures.

    Raises:
        InvalidParameter: the target is missing, given twice, or no single pose or posture; the seed is out of range.
        UnknownName: there is no such piece, frame, work object or posture.
        JointLimitExceeded: the given posture is beyond a limit.
        Unreachable: no posture within the limits reaches the pose.
    """
    whole(seed, "seed", 0, _LARGEST_SEED)
    if (targets is None) == (joints is None):
        problem = message("programs.without_target", "neither a pose nor joints are given")
        if joints is not None:
            problem = message("programs.given_twice", "a pose and joints are given")
        raise Unsuitable(
            message("programs.the_target", "the target"),
            problem,
            message("programs.give_one_of_two", "give one of the two"),
        )
    if joints is not None:
        return _posture_goal(planning, joints)
    if isinstance(targets, str):
        poses = planning.frame(targets).GetAsMatrix4()[np.newaxis]
    else:
        poses = planning.poses(targets, wobj)
    _check_single(poses)
    chain = planning.chain
    start = planning.start
    angles = (
        np.linspace(0.0, 2 * np.pi, _TURNS, endpoint=False)
        if truth(free_turn, "free_turn")
        else np.zeros(1)
    )
    rotations = np.array([RotationMatrix.MakeZRotation(angle).matrix() for angle in angles])
    # Transforms without translation, shape (k, 4, 4), with k = 1 if the tool may not turn: multiplied from the right,
    # they turn the tool about its own z axis.
    turns = stack_poses(np.zeros((len(rotations), 3)), rotations)
    goals = goal_postures(chain, poses @ turns, start, seed)
    if not len(goals):
        # Another solver, which searches one posture from the start, may still find one. If it does not, its error has
        # the remaining distance.
        solutions = planning.inverse(None).solve(poses, start)
        if not solutions.reached.all():
            raise solutions.unreachable(0, message("programs.the_target", "the target"))
        goals = solutions.positions
    # A search uses the first goals that are free of collisions, so the nearest ones come first: those that move the
    # tool least, with each axis weighted by how far it can move the tool [m].
    distances = np.abs((goals - start) * metres_per_radian(chain)).sum(axis=1)
    return np.asarray(goals[np.argsort(distances, kind="stable")])


def _posture_goal(planning: Planning, joints: npt.ArrayLike | str) -> Vector:
    """Goal of a move to a posture (n,) [rad or m], which is given or named, as a single row (1, n).

    Raises:
        UnknownName: the robot has no posture of this name.
        InvalidParameter: several postures are given, or one of a wrong shape or with numbers that are not finite.
        JointLimitExceeded: the posture is beyond a limit.
    """
    postures = planning.postures(joints, "joints")
    hint = degrees_hint(planning.chain, postures)
    # A target has no time: the zeros are needed for the call only.
    check_limits(
        planning.chain,
        np.zeros(len(postures)),
        postures,
        lambda _: PathPoint(1, message("programs.the_target", "the target")),
        hint,
    )
    _check_single(postures)
    return postures


def _check_single(targets: Vector) -> None:
    """Check that an array contains a single target: a pose (1, 4, 4) or a posture (1, n).

    Raises:
        InvalidParameter: it contains several.
    """
    if len(targets) != 1:
        raise InvalidParameter(
            message("programs.count_of_targets", "count of targets"),
            len(targets),
            message("programs.one_target_around", "1 for a move around obstacles"),
        )


def plan_around(
    plannings: Sequence[Planning],
    goals: Sequence[Vector],
    how: How,
    seed: int,
    planning_time: float,
    *,
    show_search: bool = False,
) -> list[Plan]:
    """Plan the path of several robots that move at the same time around obstacles.

    Args:
        plannings: the start of each robot's move.
        goals: possible goals of each robot, shape (m, n) [rad or m], the nearest first.
        how: options of the move, for all robots; see :class:`How`.
        seed: seed of the search.
        planning_time: longest duration of the search [s].
        show_search: whether the recording shows the paths of the tool that the search tried.

    Returns:
        one plan for each robot, all of the same duration.

    Raises:
        StartInCollision, GoalInCollision, NoFreePath: see :func:`plan_move_free`.
        Unsuitable: the options have a zone other than ``fine``.
        SimrobError: the move exceeds a limit, or an option has an invalid value.
    """
    points = points_of(how, POINTS)
    if zone_size(how.get("zone", "fine")):
        problem = message(
            "programs.around_without_zones", "a move around obstacles has a single target"
        )
        raise Unsuitable("zone", problem)
    # Every planning can prepare the space of any robots of its station.
    space = plannings[0].space([planning.robot for planning in plannings])
    ranges = [
        _search_range(planning, own_goals)
        for planning, own_goals in zip(plannings, goals, strict=True)
    ]
    lower, upper = np.concatenate(ranges, axis=1)
    search = Search(
        space=space,
        lower=lower,
        upper=upper,
        scale=np.concatenate([_distance_scale(planning, space) for planning in plannings]),
        seed=seed,
        seconds=positive(planning_time, "planning_time", "s"),
    )
    limits = _joined_limits(plannings)

    corners = search.path(_free_goals(space, goals))
    round_path = search.round_corners(corners)
    paths = [round_path]
    if len(corners) > _STRAIGHT:
        faster_path = find_faster_path(search, round_path.postures, len(corners), limits)
        if faster_path is not None:
            paths.insert(0, faster_path)  # of plans with the same duration the first one is taken
    # Which path is faster is known only with its timing: both get one. A joint plan has the axes of all robots.
    joint_plans = [_timed_path(plannings, space, path, limits, how, points) for path in paths]
    joint_plan = min(joint_plans, key=lambda plan: plan.duration)

    plans = []
    # Pairs of postures of each robot that the search trees connect, shape (k, 2, n).
    branches = space.split_by_robot(search.branches)
    first_axis = 0  # index of the robot's first axis among those of all robots
    for planning in plannings:
        axis_count = planning.chain.size
        own_plan = joint_plan.of_axes(planning.robot, slice(first_axis, first_axis + axis_count))
        first_axis += axis_count
        if show_search and len(search.branches):
            tool_poses = planning.chain.forward(branches[planning.robot].reshape(-1, axis_count))
            own_plan = replace(own_plan, search=tool_poses[:, :3, 3].reshape(-1, 2, 3))
        # Collisions are not checked again: the path was found without them.
        plans.append(planning.check_limits_of(own_plan, how, own_plan.end[np.newaxis]))
    return plans


def _timed_path(
    plannings: Sequence[Planning],
    space: FreeSpace,
    path: TimelessPath,
    limits: RateLimits,
    how: How,
    points: int,
) -> Plan:
    """Give a path its timing: as the options demand or, if they leave it free, in the usual time or as motors allow.

    Args:
        plannings: the start of each robot's move.
        space: the space in which the robots move.
        path: the path of all robots.
        limits: limits of the axes of all robots. They are kept here only if the timing is free; with a duration or a
            speed of the user's they are checked later.
        how: see :class:`How`.
        points: count of points on the way to the target.

    Returns:
        one plan with the axes of all robots, under the name of the first robot.
    """
    own_postures = space.split_by_robot(path.postures)
    tool_lengths = [
        tool_length(planning.chain, own_postures[planning.robot]) for planning in plannings
    ]
    # The path of all robots counts as long as that of the tool that goes farthest. Its only target is at its end, at
    # the fraction 1.
    segment = Segment(path.fractions, path.postures, max(tool_lengths), np.ones(1))
    first = plannings[0]
    robots = list(space.start)
    motors = partial(first.motors, robots)  # made only if the timing needs them
    fastest = plan_timed(first.robot, [segment], how, points, limits, motors)
    # If the timing is free, the move may take as long as the motors need.
    may_take_longer = is_free(how) and how.get("check", CHECKED) != "nothing"
    return slowed_for_motors(motors(), fastest) if may_take_longer else fastest


def _joined_limits(plannings: Sequence[Planning]) -> RateLimits:
    """Limits of the axes of all robots, one robot after the other."""
    speeds = []
    accelerations = []
    for planning in plannings:
        own_speeds, own_accelerations = planning.rate_limits
        speeds.append(own_speeds)
        accelerations.append(own_accelerations)
    return RateLimits(np.concatenate(speeds), np.concatenate(accelerations))


def _search_range(planning: Planning, goals: Vector) -> Vector:
    """Lowest and highest positions of a robot's axes that a search may use, shape (2, n) [rad or m].

    These are the limits of the axes. But fingers only move between their start and their goals, so that they do not
    open or close needlessly.

    Args:
        planning: the start of the robot's move.
        goals: the goals, shape (m, n) [rad or m].
    """
    ends = np.vstack([planning.start, goals])
    search_range = np.array([planning.chain.lower, planning.chain.upper])
    fingers = list(planning.model.fingers)  # indices of axes
    search_range[:, fingers] = [ends.min(axis=0)[fingers], ends.max(axis=0)[fingers]]
    return search_range


def _distance_scale(planning: Planning, space: FreeSpace) -> Vector:
    """Largest distance that a radian (or metre) of each axis moves the tool or the pieces on it, shape (n,) [m].

    It is estimated, and at least 0.1 m; see :func:`metres_per_radian`.
    """
    tool = planning.pose
    # From the world to the frame of the tool: R' (p - t), here for rows.
    carried_points = (space.carried_points(planning.robot) - tool[:3, 3]) @ tool[:3, :3]
    return metres_per_radian(planning.chain, carried_points)


def _free_goals(space: FreeSpace, goals: Sequence[Vector]) -> Vector:
    """Find the nearest goals without collisions of robots that move at the same time: at most 16, among at most 400.

    The collision tolerances that the found goals need are recorded in the space, see :meth:`FreeSpace.allow_goal`.

    Args:
        space: the space in which the robots move.
        goals: possible goals of each robot, shape (m, n) [rad or m], the nearest first.

    Returns:
        postures of all robots, one robot after the other, shape (k, sum of n) [rad or m].

    Raises:
        GoalInCollision: every goal that was checked is in collision. It names the bodies that collide deepest in the
            goal where this depth is least.
    """
    # A combination takes one goal of each robot. It is the nearer, the smaller the sum of the
    # indices of its goals.
    index_ranges = [range(len(own_goals)) for own_goals in goals]
    combinations = sorted(product(*index_ranges), key=sum)[:_MOST_TRIES]
    free_postures = list[Vector]()
    hits = list[Overlap]()  # the deepest collision of each combination that is not free
    for indices in combinations:
        posture = np.concatenate(
            [own_goals[index] for own_goals, index in zip(goals, indices, strict=True)]
        )
        collisions = space.collisions(posture)
        if collisions:
            hits.append(collisions[0])
        else:
            free_postures.append(posture)
            space.allow_goal(posture)
        if len(free_postures) == _MOST_GOALS:
            break
    if not free_postures:
        least = min(hits, key=lambda hit: hit.depth)
        raise GoalInCollision(
            message("programs.the_target", "the target"), len(hits), least.depth, least.moved
        )
    return np.array(free_postures)
