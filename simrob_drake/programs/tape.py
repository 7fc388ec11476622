"""What a workcell recorded: what ran and what came of it, and what was taken, let go and changed in between."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise
from typing import Any, TypeAlias

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.arguments import plain, seconds
from simrob_drake.base.errors import InvalidParameter, SimrobError, Unsuitable
from simrob_drake.base.messages import message
from simrob_drake.kinematics.registry import SolverLike
from simrob_drake.parts.resolved import WORLD
from simrob_drake.programs.branches import approaches
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import HasTool, Planning, PoseTargets, WorkObject, pose_numbers, row_numbers
from simrob_drake.programs.segments import Stretch, trajectory
from simrob_drake.results.record.run import AskedMove
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import ReferenceLike, simulate
from simrob_drake.stations.config import StationConfig

_SAME = 1e-12  # m and parts of a rotation: rounding
_JOINS = 1e-9  # rad or m between the end of a move and the beginning of the next

Entry: TypeAlias = dict[str, Any]  # a move as a program's file has it; between runs one that takes no time
Stage: TypeAlias = tuple[Mapping[str, ReferenceLike], float]
"""References by robot, and for how long they are followed [s]."""


@dataclass(frozen=True)
class Take:
    """One run: the station as it was, where it began, what every robot was asked to do, and what came of it."""

    config: StationConfig  # the station, with its pieces where they hung then
    start: State | None  # where it began; None at the configuration's initial posture
    references: Mapping[str, ReferenceLike]  # of every robot
    duration: float  # of the run [s]
    result: SimulationResult
    stretches: Mapping[str, tuple[Stretch, ...]] | None = None  # the motions of every robot, where moves were planned
    entry: Entry | None = None  # what a program's file has of it; None if no file can say it

    def run(self) -> SimulationResult:
        """Run it again, from the same state: the same motion, sample by sample."""
        references = dict(self.references)
        return simulate(self.config, reference=references, duration=self.duration, start=self.start, progress=False)


@dataclass
class Tape:
    """The runs of a workcell since :meth:`record`, in order, and the changes between them.

    A result holds all signals and states of its run, so they are kept from then on only.
    """

    entries: list[Take | Entry] = field(default_factory=list)  # what was recorded; it begins with a run
    running: bool = False  # whether what comes next is recorded too
    whole: bool = True  # whether a program's file can say all that happened since the first run

    @property
    def takes(self) -> list[Take]:
        """What ran."""
        return [entry for entry in self.entries if isinstance(entry, Take)]

    def record(self) -> None:
        """Forget everything, and record from now on (SimRob's ``Rec()``)."""
        self.entries, self.running, self.whole = [], True, True

    def keep(self, take: Take) -> None:
        """Keep a run, if the tape is running."""
        self.whole = self.whole and (self.running or not self.entries) and take.entry is not None
        if self.running:
            self.entries.append(take)

    def note(self, change: Entry | None) -> None:
        """Keep a change of the station, None for one that no file can say; the first run knows those before it."""
        if self.entries:
            self.whole = self.whole and self.running and change is not None
            if self.running and change is not None:
                self.entries.append(change)

    def moves(self) -> list[Any]:
        """Return what a program's file has of all that was recorded; nothing if no file can say it."""
        moves = [entry.entry if isinstance(entry, Take) else entry for entry in self.entries]
        return moves if self.whole else []

    def replay(self) -> list[SimulationResult]:
        """Run every take again from the state that it began in (SimRob's ``Rep()``); nothing else changes."""
        return [take.run() for take in self.takes]

    def check_some(self) -> None:
        """Check that something was recorded; raises InvalidParameter: nothing."""
        if not self.entries:
            raise InvalidParameter(
                message("programs.the_recording", "the recording"),
                "empty",
                message("programs.begun_with_record", "begun with record() before the moves"),
            )

    def stages(self, duration: float | None = None) -> list[Stage | Entry]:
        """Return all that was recorded in stages, so long [s]; raises InvalidParameter: nothing, or not joined."""
        self.check_some()
        takes = self.takes
        factor = 1.0 if duration is None else seconds(duration) / sum(take.duration for take in takes)
        for one, other in pairwise(takes):
            if one.stretches is None or other.stretches is None:
                raise InvalidParameter(
                    message("programs.the_recording", "the recording"),
                    message("programs.with_own_references", "with references of its own"),
                    message("programs.replayed_by_takes", "replayed take by take: replay()"),
                )
            after = other.stretches
            gaps = [np.abs(own[-1].postures[-1] - after[robot][0].postures[0]) for robot, own in one.stretches.items()]
            if max(gap.max() for gap in gaps) > _JOINS:
                raise InvalidParameter(
                    message("programs.the_recording", "the recording"),
                    message("programs.with_gaps", "with gaps"),
                    message("programs.replayed_by_takes", "replayed take by take: replay()"),
                )
        found: list[Stage | Entry] = []
        for runs, group in groupby(self.entries, lambda entry: isinstance(entry, Take)):
            entries = list(group)
            found += [_as_one([entry for entry in entries if isinstance(entry, Take)], factor)] if runs else []
            found += [entry for entry in entries if not isinstance(entry, Take)]
        return found


def _as_one(takes: list[Take], factor: float) -> Stage:
    if any(take.config != takes[0].config for take in takes):
        raise InvalidParameter(
            message("programs.the_recording", "the recording"),
            message("programs.of_changed_station", "of a station that changed"),
            message("programs.replayed_by_takes", "replayed take by take: replay()"),
        )
    if len(takes) == 1 and takes[0].stretches is None:
        if factor != 1.0:
            raise Unsuitable(
                "duration", message("programs.own_duration", "the references have a duration of their own")
            )
        return takes[0].references, takes[0].duration
    motions: dict[str, list[Stretch]] = {}
    begin = 0.0
    for take in takes:
        for robot, own in (take.stretches or {}).items():
            motions.setdefault(robot, []).extend(stretch.at(begin, factor) for stretch in own)
        begin += factor * take.duration
    return {robot: trajectory(own) for robot, own in motions.items()}, begin


def recorded(
    plan: Plan,
    key: str,
    planning: Planning,
    targets: PoseTargets | None,
    how: Mapping[str, Any],
    *,
    wobj: WorkObject = None,
    solver: SolverLike | None = None,
    **more: Any,
) -> Plan:
    """Return a plan with the entry of a file that makes it again, of what the call was given; None where none can."""
    used = planning.solver if solver is None else solver
    moved = None if wobj is None else planning.frame(wobj)
    if not isinstance(used, str):
        return replace(plan, entry=None, frame=moved)
    frame: Any = None if isinstance(wobj, str) and wobj == WORLD else wobj
    if isinstance(wobj, HasTool):
        frame = getattr(wobj, "name", None)
    elif frame is not None and not isinstance(frame, str):
        frame = pose_numbers(frame)
    rows = None if targets is None else row_numbers(targets)
    content = {"targets": rows, "robot": planning.robot, **how, "wobj": frame, **more}
    if "via" in more:
        content["via"] = row_numbers(more["via"])
    if used != "auto":
        content["solver"] = used
    if content.get("check", "") is None:  # a file without the key checks collisions
        content["check"] = "limits"
    made = {name: plain(value) for name, value in content.items() if value is not None}
    return replace(plan, entry={key: made}, frame=moved)


def run_entry(
    plans: Sequence[Plan], duration: float | None, frame: Callable[[WorkObject], RigidTransform], *, several: bool
) -> Entry | None:
    """Return what a file has of planned moves run at the same time, in a duration [s]; None if it can't say it.

    ``frame`` gives the pose of a work object now: one that has moved since the move was planned becomes a pose.
    """
    if not plans:
        return {"wait": float(duration or 0.0)}
    moves = []
    for plan in plans:
        if plan.entry is None:
            return None
        ((key, content),) = plan.entry.items()
        wobj = content.get("wobj")
        if plan.frame is not None and isinstance(wobj, str) and wobj != plan.robot:
            try:
                moved = not frame(wobj).IsNearlyEqualTo(plan.frame, _SAME)
            except SimrobError:  # a robot of another station
                moved = True
            if moved:
                content = {**content, "wobj": pose_numbers(plan.frame)}
        moves.append({key: {name: value for name, value in content.items() if several or name != "robot"}})
    if duration is None:
        return moves[0] if len(moves) == 1 else {"together": moves}
    return {"together": moves, "duration": float(duration)}


def asked_move(plan: Plan, model: StationModel) -> AskedMove:
    """Return what a run of a planned move is asked for, on a station as it is then."""
    content = next(iter(plan.entry.values())) if plan.entry else {}
    robot = model.robots[plan.robot]
    return AskedMove(
        kind=plan.kind,
        robot=plan.robot,
        duration=plan.duration,
        end=plan.end,
        tool=model.chain(plan.robot, robot.tools[robot.tcp]).forward,
        approaches=lambda rows, times: approaches(model.colliding, plan, rows, times),
        speed=content.get("speed"),
        search=plan.search,
    )


def in_words(plans: Sequence[Plan], duration: float | None, *, several: bool) -> str:
    """Return what a run of planned moves does, in a few words; whose moves they are where there are several robots."""
    names = [plan.kind for plan in plans]
    if not all(names):
        return ""
    words = (
        message("programs.plan_of_robot", "{name} of {robot}", name=name, robot=plan.robot) if several else name
        for name, plan in zip(names, plans, strict=True)
    )
    return ", ".join(words) or "wait"
