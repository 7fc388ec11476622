"""Recording of a workcell: its runs, and the changes of the station between them.

A *take* is one run with everything that is needed to repeat it. An *entry* is a move as the file of a program has it:
``{"wait": 1.0}`` is an entry of the kind ``wait``. If all that happened can be written as entries, the recording can be
saved as a program. A *stretch* is a part of a planned motion. A *work object* (`wobj`) is the frame of the targets.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.arguments import plain, seconds
from simrob_drake.base.errors import SimrobError, Unsuitable
from simrob_drake.base.messages import message
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.branches import approaches
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import (
    HasTool,
    Planning,
    PoseTargets,
    WorkObject,
    pose_numbers,
    row_numbers,
)
from simrob_drake.programs.segments import Stretch, trajectory
from simrob_drake.results.record.run import AskedMove
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import ReferenceLike, simulate
from simrob_drake.stations.config import StationConfig

_SAME = 1e-12  # largest difference of two equal poses, by rounding [m, or 1 for rotations]
_JOINS = 1e-9  # largest distance between the end of a move and the begin of the next [rad or m]

Entry: TypeAlias = dict[str, Any]
"""A move as the file of a program has it, such as ``{"wait": 1.0}``."""


class Stage(NamedTuple):
    """References that are followed in one run.

    Attributes:
        references: reference of each robot, by name.
        duration: duration of the run [s].
    """

    references: Mapping[str, ReferenceLike]
    duration: float


@dataclass(frozen=True)
class Take:
    """One run, with everything that is needed to repeat it.

    Attributes:
        config: the station, with its pieces on the parents that they had.
        start: state at the start. It is None for the initial posture of the station.
        references: reference of every robot, by name.
        duration: duration of the run [s].
        result: result of the run.
        stretches: motions of every robot, by name. It is None if the references are no planned moves.
        entry: entry of a program's file that makes this run again. It is None if no file can.
    """

    config: StationConfig
    start: State | None
    references: Mapping[str, ReferenceLike]
    duration: float
    result: SimulationResult
    stretches: Mapping[str, tuple[Stretch, ...]] | None = None
    entry: Entry | None = None

    def run(self) -> SimulationResult:
        """Run this take again from the same state. The motion is the same, sample by sample."""
        references = dict(self.references)
        return simulate(
            self.config,
            reference=references,
            duration=self.duration,
            start=self.start,
            progress=False,
        )


@dataclass
class Tape:
    """Runs of a workcell since :meth:`record`, and the changes of the station between them.

    A result keeps all signals and states of its run in memory. So results are kept only if the user wants to record.

    Attributes:
        entries: runs, and changes between them as entries, in their order. The first one is a run.
        running: whether the next run and the next change are recorded.
        whole: whether a program's file can say all that happened since the first run.
    """

    entries: list[Take | Entry] = field(default_factory=list)
    running: bool = False
    whole: bool = True

    @property
    def takes(self) -> list[Take]:
        """The recorded runs."""
        return [entry for entry in self.entries if isinstance(entry, Take)]

    def record(self) -> None:
        """Delete the recording, and record from now on (SimRob's ``Rec()``)."""
        self.entries = []
        self.running = True
        self.whole = True

    def keep(self, take: Take) -> None:
        """Record a run, if the tape is running. Note whether a program's file can still say all that happened."""
        # A run that is left out makes a gap, unless it is before the first recorded one.
        makes_gap = bool(self.entries) and not self.running
        # One missing part is enough: the saved program would not do the same. This applies to a run before the first
        # recorded one, too, if no file can say it; `record` begins anew.
        if makes_gap or take.entry is None:
            self.whole = False
        if self.running:
            self.entries.append(take)

    def note(self, change: Entry | None) -> None:
        """Record a change of the station between two runs, if the tape is running.

        A change that is not recorded, or that no file can say, is noted: then the recording is no program.

        Args:
            change: entry of the change. It is None if no file can say it.
        """
        # Changes before the first run need no entry: a take has the station as it was at the start of its run.
        if not self.entries:
            return
        if self.running and change is not None:
            self.entries.append(change)
        else:
            self.whole = False

    def moves(self) -> list[Any]:
        """Entries of a program that repeats the recording. The list is empty if a part of it is no entry."""
        moves = [entry.entry if isinstance(entry, Take) else entry for entry in self.entries]
        return moves if self.whole else []

    def replay(self) -> list[SimulationResult]:
        """Run every take again from its own start (SimRob's ``Rep()``). The station does not change."""
        return [take.run() for take in self.takes]

    def check_some(self) -> None:
        """Check that a run was recorded.

        Raises:
            InvalidParameter: nothing was recorded.
        """
        if not self.entries:
            raise Unsuitable(
                message("programs.the_recording", "the recording"),
                message("programs.nothing_recorded", "it is empty"),
                message("programs.begun_with_record", "call record() before the moves"),
            )

    def stages(self, duration: float | None = None) -> list[Stage | Entry]:
        """Divide the recording into stages: runs that follow each other are one, and each change is one.

        Args:
            duration: duration of all runs together [s], to which each run is stretched or shortened in proportion. If
                it is None, as recorded.

        Returns:
            A stage for all runs up to the next change, and the entry of each change, in order.

        Raises:
            InvalidParameter: nothing was recorded; or a run does not begin where the one before ended, has references
                that are no planned moves and is not the only run, or has another station without a recorded change.
            Unsuitable: a duration is given, and the only run has references that are no planned moves.
        """
        self.check_some()
        takes = self.takes
        factor = 1.0
        if duration is not None:
            factor = seconds(duration) / sum(take.duration for take in takes)
        for earlier, later in pairwise(takes):
            _check_joined(earlier, later)
        stages: list[Stage | Entry] = []
        # Runs are joined only up to a change of the station, which needs a station of its own.
        for are_takes, group in groupby(self.entries, lambda entry: isinstance(entry, Take)):
            entries = list(group)
            if are_takes:
                stages.append(
                    _join_takes([entry for entry in entries if isinstance(entry, Take)], factor)
                )
            stages += [entry for entry in entries if not isinstance(entry, Take)]
        return stages


def _check_joined(earlier: Take, later: Take) -> None:
    """Check that one run begins where the other ended, by the planned motions of each robot.

    Raises:
        InvalidParameter: a robot would jump between them, or one has references that are no planned moves.
    """
    if earlier.stretches is None or later.stretches is None:
        raise _not_joined(
            message(
                "programs.with_own_references",
                "a run follows references that are no planned moves",
            )
        )
    # One motion of the joined run must begin where the one before ended: otherwise the axes would jump.
    for robot, stretches in earlier.stretches.items():
        gap = np.abs(stretches[-1].postures[-1] - later.stretches[robot][0].postures[0])
        if gap.max() > _JOINS:
            raise _not_joined(
                message("programs.with_gaps", "a run does not begin where the one before ended")
            )


def _not_joined(problem: str) -> Unsuitable:
    """Make the error for a recording that cannot be one run. Its takes can still be run one by one."""
    return Unsuitable(
        message("programs.the_recording", "the recording"),
        problem,
        message("programs.replayed_by_takes", "run its takes one by one: replay()"),
    )


def _join_takes(takes: list[Take], factor: float) -> Stage:
    """Join runs that follow each other.

    Args:
        takes: the runs, which begin where the one before ended.
        factor: factor of their durations.

    Returns:
        The stage, with one reference over all runs for each robot.

    Raises:
        InvalidParameter: the station was changed between them.
        Unsuitable: the factor is not 1, and a run has references that are no planned moves.
    """
    first = takes[0]
    if any(take.config != first.config for take in takes):
        raise _not_joined(
            message("programs.of_changed_station", "the station was changed between two runs")
        )
    # A single run of any reference can be repeated as it is, but not stretched in time.
    if len(takes) == 1 and first.stretches is None:
        if factor != 1.0:
            raise Unsuitable(
                "duration",
                message("programs.own_duration", "the references have a duration of their own"),
            )
        return Stage(first.references, first.duration)
    motions = dict[str, list[Stretch]]()
    begin = 0.0
    for take in takes:
        for robot, stretches in (take.stretches or {}).items():
            motions.setdefault(robot, []).extend(stretch.at(begin, factor) for stretch in stretches)
        begin += factor * take.duration
    return Stage({robot: trajectory(stretches) for robot, stretches in motions.items()}, begin)


def with_entry(
    plan: Plan,
    key: str,
    planning: Planning,
    targets: PoseTargets | None,
    how: Mapping[str, Any],
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
    are_postures: bool = False,
    **more: Any,
) -> Plan:
    """Make a copy of a plan with the entry of a program's file that makes the move again.

    Args:
        plan: the plan.
        key: key of the move, such as ``move_l``.
        planning: the start of the move.
        targets: targets as the user gave them. If it is None, the move has others, which are in `more`.
        how: options of the move as the user gave them.
        wobj: the work object. If it is None, the world.
        solver: solver of the inverse kinematics. If it is None, that of the robot. Moves without one give ``auto``.
        are_postures: whether the targets are postures of the axes, not poses or places of the tool.
        **more: further keys of the move. Keys with the value None are left out.

    Returns:
        The plan with its entry and the pose of its work object. The entry is None if no file can say the move, because
        its solver has no name.
    """
    # A solver of the user's own is an object without a name. A file cannot say it.
    solver_name = planning.solver if solver is None else solver
    wobj_pose = None if wobj is None else planning.frame(wobj)
    if not isinstance(solver_name, str):
        return replace(plan, entry=None, frame=wobj_pose)
    content = {
        "targets": None if targets is None else row_numbers(targets, are_postures=are_postures),
        "robot": planning.robot,
        **how,
        "wobj": _wobj_entry(wobj),
        **more,
    }
    if "via" in more:
        content["via"] = row_numbers(more["via"])
    if solver_name != "auto":
        content["solver"] = solver_name
    # A file without the key checks collisions, so that None has to be written.
    if "check" in content and content["check"] is None:
        content["check"] = "limits"
    # Arrays become lists, as YAML and JSON need them.
    entry = {name: plain(value) for name, value in content.items() if value is not None}
    return replace(plan, entry={key: entry}, frame=wobj_pose)


def _wobj_entry(wobj: WorkObject) -> Any:
    """Work object as a program's file has it: a name, a pose [x y z Rz Ry Rx], or None for the world."""
    if isinstance(wobj, HasTool):  # an arm
        return getattr(wobj, "name", None)
    if isinstance(wobj, str):
        return None if wobj == WORLD else wobj
    return None if wobj is None else pose_numbers(wobj)


def run_entry(
    plans: Sequence[Plan],
    duration: float | None,
    frame: Callable[[WorkObject], RigidTransform],
    *,
    several: bool,
) -> Entry | None:
    """Make the entry of a program's file for planned moves that run at the same time.

    Args:
        plans: the plans. Without any, the entry is a wait.
        duration: duration of the run [s]. If it is None, until the last move ends.
        frame: function that gives the pose of a work object now.
        several: whether the station has several robots, so that the moves have to name theirs.

    Returns:
        The entry, or None if no file can say one of the moves.
    """
    if not plans:
        return {"wait": float(duration or 0.0)}
    moves = []
    for plan in plans:
        if plan.entry is None:
            return None
        # An entry has exactly one key: the kind of its move.
        ((key, content),) = plan.entry.items()
        if _has_wobj_moved(plan, content.get("wobj"), frame):
            # Its name would mean another pose now.
            assert plan.frame is not None
            content = {**content, "wobj": pose_numbers(plan.frame)}
        # Without the robot's name, a file for the only robot of a station stays valid for other stations, whose robot
        # has another name.
        if not several:
            content = {name: value for name, value in content.items() if name != "robot"}
        moves.append({key: content})
    if duration is not None:
        return {"together": moves, "duration": float(duration)}
    return moves[0] if len(moves) == 1 else {"together": moves}


def _has_wobj_moved(plan: Plan, wobj: Any, frame: Callable[[WorkObject], RigidTransform]) -> bool:
    """Whether a work object that has a name is elsewhere than when a move was planned.

    Args:
        plan: the plan of the move.
        wobj: the work object as the plan's entry has it. The robot's own tool moves with it, and does not count.
        frame: function that gives the pose of a work object now.
    """
    if plan.frame is None or not isinstance(wobj, str) or wobj == plan.robot:
        return False
    try:
        return not frame(wobj).IsNearlyEqualTo(plan.frame, _SAME)
    except SimrobError:  # a robot of another station
        return True


def asked_move(plan: Plan, model: StationModel) -> AskedMove:
    """Describe a planned move for the result of its run, which then reports about it.

    Args:
        plan: the plan.
        model: the station in which it runs.
    """
    # The keys of the move; none if no file can say it.
    content = next(iter(plan.entry.values())) if plan.entry else {}
    robot = model.robots[plan.robot]
    return AskedMove(
        kind=plan.kind,
        robot=plan.robot,
        duration=plan.duration,
        end=plan.end,
        tool=model.chain(plan.robot, robot.tools[robot.tcp]).forward,
        # A function, because distances along the whole run take long, and are needed only for reports.
        approaches=lambda rows, times: approaches(model.colliding, plan, rows, times),
        speed=content.get("speed"),
        search=plan.search,
    )


def plans_caption(plans: Sequence[Plan], *, several: bool) -> str:
    """Caption of a run of planned moves, such as "move_l" or "move_j of left, grip of right".

    Args:
        plans: the plans. Without any, the caption is "wait".
        several: whether the station has several robots, so that the caption names theirs.

    Returns:
        The caption, or an empty text if a plan has no kind.
    """
    if not plans:
        return "wait"
    # A list that leaves out one of the moves would be wrong.
    if not all(plan.kind for plan in plans):
        return ""
    if not several:
        return ", ".join(plan.kind for plan in plans)
    return ", ".join(
        message("programs.plan_of_robot", "{name} of {robot}", name=plan.kind, robot=plan.robot)
        for plan in plans
    )
