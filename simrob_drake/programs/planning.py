"""What planning a move of an arm starts from, and what all planned moves share: points, zones, checks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from simrob_drake.arguments import whole
from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.frames import Vector
from simrob_drake.kinematics.analytic import SolverLike, solver_for
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.solver import Solver
from simrob_drake.programs.checks import check_limits, check_rates
from simrob_drake.programs.plan import Check, Plan, target_name
from simrob_drake.programs.segments import Segment, pose_segment
from simrob_drake.programs.targets import PoseTargets, WorkObject, world_poses
from simrob_drake.programs.timing import How, Limits, remedy, through_all, timed
from simrob_drake.programs.zones import Way, through_zones, zone_size
from simrob_drake.robots.catalog import RobotModel

POINTS, ARC_POINTS = 10, 20
"""Points on the way to a target unless others are asked for, as in SimRob; of arcs."""

_MOST_POINTS = 10_000
_POINTS_A_ZONE, _ENOUGH = 4, 2000


@dataclass(frozen=True)
class Planning:
    """What planning a move of one robot starts from."""

    robot: str  # its name in the station
    model: RobotModel
    chain: Chain  # from the world to the tool
    start: Vector  # the posture from which the move begins, shape (n,) [rad or m]
    solver: SolverLike  # of moves that name none
    rate_limits: Limits  # of the axes
    frame: Callable[[WorkObject], RigidTransform]  # gives the pose of a work object in the world
    collide: Callable[[Plan], None]  # raises where a plan leads into something

    @property
    def pose(self) -> Vector:
        """The pose of the tool at the start, shape (4, 4)."""
        return np.asarray(self.chain.forward(self.start)[0])

    def inverse(self, solver: SolverLike | None) -> Solver:
        """Return the solver of the inverse kinematics, the usual one if None."""
        return solver_for(self.chain, self.solver if solver is None else solver)

    def poses(self, targets: PoseTargets, wobj: WorkObject) -> Vector:
        """Return targets in a work object's frame as poses in the world, shape (k, 4, 4)."""
        return world_poses(targets, self.frame(wobj), self.pose[:3, :3])

    def along(self, ways: Sequence[Way], inverse: Solver, how: How, points: int) -> Plan:
        """Plan a move whose tool goes one way after the other."""
        zone = zone_of(how, len(ways))
        start, segments = self.start, list[Segment]()
        for index, (way, count) in enumerate(grouped(ways, zone, points)):
            name = target_name(index, len(ways))
            segments.append(pose_segment(inverse, way, start, points=count, target=name))
            start = segments[-1].end
        return self.checked(segments, how, points)

    def checked(
        self,
        segments: list[Segment],
        how: How,
        points: int,
        rows: Vector | None = None,
        *,
        through: bool = False,
        hint: str = "",
    ) -> Plan:
        """Give segments their times, and look at the move: first at the targets, for which messages may have a hint."""
        check: Check = how.get("check", "limits")
        one_of("check", check, get_args(Check))
        plan = (through_all if through else timed)(self.robot, segments, how, points, self.rate_limits)
        if check != "nothing":
            names = [(points, target_name(index, len(plan.arrivals))) for index in range(len(plan.arrivals))]
            ends = np.array([segment.end for segment in segments]) if rows is None else rows
            looks, times = plan.looks, plan.arrivals[-len(ends) :]
            check_limits(self.chain, times, ends, lambda at: names[int(np.searchsorted(plan.arrivals, at))], hint)
            check_limits(self.chain, looks, plan.postures(looks), plan.named)
            for order, limits in enumerate(self.rate_limits, 1):
                check_rates(self.chain, plan.trajectory, looks, limits, order, plan.named, partial(remedy, how, order))
        if check == "collision":
            self.collide(plan)
        return replace(plan, check=check)


def zone_of(how: How, count: int) -> float:
    """Return the zone of a move to so many targets [m]; 0 to rest at each."""
    zone = zone_size(how.get("zone", "fine"))
    if zone and count < 2:
        expected = "with several targets in one call, such as move_l([first, second]): a move rests at its last"
        raise InvalidParameter("zone", how["zone"], expected)
    if zone and "times" in how:
        raise InvalidParameter("times", how["times"], "left out with a zone: what is passed has no time of its own")
    return zone


def grouped(ways: Sequence[Way], zone: float, points: int) -> list[tuple[Way, int]]:
    """Return what is gone without a rest, and of how many points: each way, or with a zone [m] all as one."""
    if not zone:
        return [(way, points) for way in ways]
    whole = through_zones(ways, zone)
    enough = min(int(_POINTS_A_ZONE * whole.length / zone), _ENOUGH)  # for a spline that bends in the zones alone
    return [(whole, max(points * len(ways), enough))]


def points_of(how: How, default: int) -> int:
    """Return how many points are on the way to a target; other keys than those of :class:`How` are refused."""
    for key in how:
        one_of("option of a move", key, How.__annotations__)
    return whole(how.get("points", default), "points", 1, _MOST_POINTS)


def degrees_hint(chain: Chain, rows: npt.NDArray[np.float64]) -> str:
    """Return what to ask of postures (k, n) that would do if they were in degrees; empty if they would not."""
    turned = np.where(chain.revolute, np.deg2rad(rows), rows)
    fit = ((turned >= chain.lower) & (turned <= chain.upper)).all()
    whole_turns = (np.abs(rows) > 2 * np.pi) & chain.revolute
    return (
        "; angles are in radians: were these degrees? np.deg2rad(...) turns them" if fit and whole_turns.any() else ""
    )
