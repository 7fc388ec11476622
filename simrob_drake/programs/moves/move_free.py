"""A move of an arm around obstacles, or of several at once, with what they carry."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, ClassVar, Self, Unpack

import numpy as np
import numpy.typing as npt
from pydantic import model_validator
from pydrake.math import RotationMatrix

from simrob_drake.arguments import positive, truth, whole
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.interpolation import stacked
from simrob_drake.kinematics.every_branch import goal_postures
from simrob_drake.programs.errors import GoalInCollision
from simrob_drake.programs.free_path import FreeSpace, Search, metres
from simrob_drake.programs.moves.motion import ArmMotion, Row
from simrob_drake.programs.plan import CHECKED, Plan, check_limits
from simrob_drake.programs.planning import POINTS, Planning, PoseTargets, WorkObject, degrees_hint, points_of, zone_of
from simrob_drake.programs.segments import Segment, tool_length
from simrob_drake.programs.smooth_path import shortened
from simrob_drake.programs.tape import recorded
from simrob_drake.programs.timing import How, is_free, timed
from simrob_drake.programs.torques import slowed_for_motors
from simrob_drake.sections import Boolean, Integer, Pose, Positive
from simrob_drake.stations.collisions import Overlap

PLANNING_TIME = 10.0  # how long a search for a way may take unless told [s]
_MOST_SEED = 2**31 - 2
_TURNS = 24  # about the tool, where that is free
_STRAIGHT = 2  # corners of a way that nothing makes shorter
_GOALS, _TRIED = 16, 400  # that a search is for, and that are looked at


class MoveFree(ArmMotion):
    """A tool that goes around what stands in its way; see :meth:`Arm.move_free`."""

    key: ClassVar[str] = "move_free"
    title: ClassVar[str] = "MoveFree"

    wobj: str | Pose | None = None
    """In whose frame the target is: a piece, one of its frames as `piece.frame`, a robot's tool or a pose; the world
    unless given."""
    piece: str | None = None
    """Instead of a pose: the piece, or one of its frames as `piece.frame`, where the tool is to be."""
    joints: Row | str | None = None
    """Instead of a pose: the posture [rad or m], or one of the robot's by name, such as `home`."""
    joints_deg: Row | None = None
    """The same in degrees."""
    free_turn: Boolean = False
    """The tool may turn about its z axis as it likes."""
    seed: Integer = 0
    """Of the search; another one finds another way."""
    planning_time: Positive = PLANNING_TIME
    """How long the search may take [s]."""
    show_search: Boolean = False
    """The recording shows the ways of the tool that the search tried."""

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        ways = [self.targets, self.targets_deg, self.piece, self.joints, self.joints_deg]
        if sum(value is not None for value in ways) != 1:
            raise ValueError("where to is given by one of targets, targets_deg, piece, joints and joints_deg")
        return self

    def posture(self, planning: Planning) -> npt.ArrayLike | str | None:
        """Return the posture that it leads to in SI units, if one is given."""
        if self.joints_deg is None or len(self.joints_deg) != planning.chain.size:
            return self.joints or self.joints_deg
        return np.asarray(self.joints_deg * planning.model.user_units)

    def pieces(self) -> Iterable[str]:
        """Return the piece that it leads to, or that is its work object."""
        return super().pieces() if self.piece is None else (self.piece.split(".", 1)[0],)

    def goals(self, planning: Planning) -> Vector:
        """Return the postures that will do, shape (m, n)."""
        return goals_of(
            planning, self.piece or self.rows(planning), self.posture(planning), self.wobj, self.free_turn, self.seed
        )

    def plan(self, planning: Planning) -> Plan:
        """Return the move, planned."""
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
    """Plan a move around obstacles to any posture that reaches the target, with what the arm carries.

    A search that grows two trees of postures finds the path, which is then shortened and rounded. No checked posture
    has a collision, not even of the arm with itself. Bodies that touch at the start may touch during the whole move.

    Args:
        planning: what the move starts from.
        targets: a pose of the tool in the work object's frame, a place (3,) that keeps its orientation, or the name of
            a piece or of one of its frames, where the tool is to be.
        joints: instead of it a posture (n,) [rad or m], or one of the robot's by name, such as ``home``.
        wobj: the work object.
        free_turn: the tool may turn about its z axis as it likes.
        seed: seed of the search. The same seed gives the same path, if the search has enough time.
        planning_time: longest duration of the search [s].
        show_search: whether the recording shows the paths of the tool that the search tried.
        how: see :class:`How`.

    Raises:
        StartInCollision, GoalInCollision: says what is in what, and how deep.
        Unreachable: no posture within the limits brings the tool there.
        NoFreePath: no way was found in the time; says how near the search came, and what was in its way.
        SimrobError: as of other moves.
    """
    goals = goals_of(planning, targets, joints, wobj, free_turn, seed)
    (plan,) = plan_around([planning], [goals], how, seed, planning_time, show_search=truth(show_search, "show_search"))
    own: dict[str, Any] = {
        "joints": None if joints is None else np.asarray(joints).tolist(),
        "free_turn": free_turn or None,
        "show_search": show_search or None,
    }
    own |= {"seed": seed or None, "planning_time": None if planning_time == PLANNING_TIME else planning_time}
    own["piece"], poses = (targets, None) if isinstance(targets, str) else (None, targets)
    return recorded(plan, MoveFree.key, planning, poses, how, wobj=wobj, solver="auto", **own)


def plan_together(moves: Sequence[MoveFree], plannings: Sequence[Planning]) -> list[Plan]:
    """Plan moves of several robots as one, around each other; raises InvalidParameter: moves done in different ways."""
    first, robots = moves[0], [planning.robot for planning in plannings]
    if any(move.how != first.how for move in moves) or len({*robots}) < len(robots):
        raise InvalidParameter("moves around obstacles together", "different", "of different robots, in the same time")
    goals = [move.goals(planning) for move, planning in zip(moves, plannings, strict=True)]
    shown, longest = any(move.show_search for move in moves), max(move.planning_time for move in moves)
    plans = plan_around(plannings, goals, first.how, first.seed, longest, show_search=shown)
    return [
        replace(plan, entry=move.model_copy(update={"robot": plan.robot}).entry())
        for move, plan in zip(moves, plans, strict=True)
    ]


def goals_of(
    planning: Planning,
    targets: PoseTargets | str | None,
    joints: npt.ArrayLike | str | None,
    wobj: WorkObject,
    free_turn: bool,
    seed: int,
) -> Vector:
    """Return the postures (m, n) within the limits that will do, nearest first.

    Raises InvalidParameter: none or several targets, or what is no target; Unreachable: there is no posture.
    """
    whole(seed, "seed", 0, _MOST_SEED)
    if (targets is None) == (joints is None):
        raise InvalidParameter("the target", "given twice" if joints is not None else "missing", "a pose or joints=")
    chain, start = planning.chain, planning.start
    if joints is not None:
        rows = planning.postures(joints, "joints")
        check_limits(chain, np.zeros(len(rows)), rows, lambda _: (1, "the target"), degrees_hint(chain, rows))
    else:
        poses = planning.frame(targets).GetAsMatrix4()[np.newaxis] if isinstance(targets, str) else None
        rows = planning.poses(targets, wobj) if poses is None else poses
    if len(rows) != 1:
        raise InvalidParameter("targets", f"{len(rows)} of them", "one: a move around obstacles has one target")
    if joints is not None:
        return rows
    angles = np.linspace(0.0, 2 * np.pi, _TURNS, endpoint=False) if truth(free_turn, "free_turn") else np.zeros(1)
    turns = np.array([RotationMatrix.MakeZRotation(angle).matrix() for angle in angles])
    matrices = stacked(np.zeros((len(turns), 3)), turns)
    found = goal_postures(chain, rows @ matrices, start, seed)
    if not len(found):
        solutions = planning.inverse(None).solve(rows, start)
        if not solutions.reached.all():
            raise solutions.unreachable(0, "the target")
        found = solutions.positions
    return np.asarray(found[np.argsort(np.abs((found - start) * metres(chain)).sum(axis=1), kind="stable")])


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
        how: see :class:`How`.
        seed: seed of the search.
        planning_time: longest duration of the search [s].
        show_search: whether the recording shows the paths of the tool that the search tried.

    Returns:
        one plan for each robot, all of the same duration.

    Raises:
        StartInCollision, GoalInCollision, NoFreePath: see :func:`plan_move_free`.
    """
    points, first = points_of(how, POINTS), plannings[0]
    zone_of(how, 1)
    chains, limits = [planning.chain for planning in plannings], [planning.rate_limits for planning in plannings]
    space = first.space([planning.robot for planning in plannings])
    ranges = [_range(planning, own) for planning, own in zip(plannings, goals, strict=True)]
    lower, upper = np.concatenate(ranges, axis=1)
    search = Search(
        space,
        lower,
        upper,
        np.concatenate([_metres(planning, space) for planning in plannings]),
        seed,
        positive(planning_time, "planning_time", "s"),
    )
    together = np.concatenate([speeds for speeds, _ in limits]), np.concatenate([pushes for _, pushes in limits])

    def plan(path: tuple[Vector, Vector]) -> Plan:
        """Give a path, fractions (k,) of its length with postures (k, n), its timing."""
        fractions, postures = path
        own_postures = space.parts(postures).values()
        tool_lengths = [tool_length(chain, own) for chain, own in zip(chains, own_postures, strict=True)]
        segment = Segment(fractions, postures, max(tool_lengths), np.ones(1))
        motors = partial(first.motors, [*space.start])
        fastest = timed(first.robot, [segment], how, points, together, motors)
        # Without a speed or a duration from the user, the move may take as long as the motors need.
        may_take_longer = is_free(how) and how.get("check", CHECKED) != "nothing"
        return slowed_for_motors(motors(), fastest) if may_take_longer else fastest

    corners = search.path(_free(space, goals))
    found = [search.rounded(corners)]
    if len(corners) > _STRAIGHT and (short := shortened(search, found[0][1], len(corners), together)):
        found.insert(0, short)
    whole_plan = min(map(plan, found), key=lambda own: own.duration)
    plans, begin = list[Plan](), 0
    tried = space.parts(search.branches)
    for planning in plannings:
        own = whole_plan.of_axes(planning.robot, slice(begin, begin + planning.chain.size))
        if show_search and len(search.branches):
            tool = planning.chain.forward(tried[planning.robot].reshape(-1, planning.chain.size))
            own = replace(own, search=tool[:, :3, 3].reshape(-1, 2, 3))
        plans.append(planning.looked_at(own, how, own.end[np.newaxis]))
        begin += planning.chain.size
    return plans


def _range(planning: Planning, goals: Vector) -> Vector:
    """Return where axes may go on the way to goals (m, n), shape (2, n): within their limits, fingers no further."""
    limits, ends = np.array([planning.chain.lower, planning.chain.upper]), np.vstack([planning.start, goals])
    fingers = list(planning.model.fingers)
    limits[:, fingers] = [ends.min(axis=0)[fingers], ends.max(axis=0)[fingers]]
    return limits


def _metres(planning: Planning, space: FreeSpace) -> Vector:
    """Return how far the tool of a robot, and what it carries, goes at most for a radian of each axis, (n,) [m]."""
    tool = planning.pose
    return metres(planning.chain, (space.carried(planning.robot) - tool[:3, 3]) @ tool[:3, :3])


def _free(space: FreeSpace, goals: Sequence[Vector]) -> Vector:
    """Find the nearest goals without collisions of robots that move at the same time.

    Args:
        space: the space in which the robots move.
        goals: possible goals of each robot, shape (m, n) [rad or m], the nearest first.

    Returns:
        postures of all robots, one robot after the other, shape (k, sum of n) [rad or m].

    Raises:
        GoalInCollision: every goal is in collision; names the bodies of the collision that
            is least deep.
    """
    # A combination takes one goal of each robot. It is the nearer, the smaller the sum of the
    # indices of its goals.
    combinations = sorted(product(*(range(len(rows)) for rows in goals)), key=sum)[:_TRIED]
    free_postures = list[Vector]()
    hits = list[Overlap]()  # the deepest collision of each goal that is not free
    for indices in combinations:
        posture = np.concatenate([rows[index] for rows, index in zip(goals, indices, strict=True)])
        collisions = space.collisions(posture)
        if collisions:
            hits.append(collisions[0])
        else:
            free_postures.append(posture)
            space.allow_goal(posture)
        if len(free_postures) == _GOALS:
            break
    if not free_postures:
        least = min(hits, key=lambda hit: hit.depth)
        raise GoalInCollision("the target", len(hits), least.depth, least.moved)
    return np.array(free_postures)
