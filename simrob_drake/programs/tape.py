"""What a workcell recorded: what ran and what came of it, and what was taken, let go and changed in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Any, TypeAlias

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.given import seconds
from simrob_drake.programs.arm_moves import ArmMove, ToolMove
from simrob_drake.programs.moves import AttachMove, ReleaseMove
from simrob_drake.programs.trajectories import Stretch, trajectory
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import Reference, simulate
from simrob_drake.stations.config import StationConfig

_JOINS = 1e-9  # rad or m between the end of a move and the beginning of the next

Change: TypeAlias = AttachMove | ReleaseMove | ToolMove
"""What takes no time."""
Stage: TypeAlias = tuple[Mapping[str, Reference], float]
"""References by robot, and for how long they are followed [s]."""


@dataclass(frozen=True)
class Take:
    """One run: the station as it was, where it began, what every robot was asked to do, and what came of it."""

    config: StationConfig  # the station, with its pieces where they hung then
    start: State | None  # where it began; None at the configuration's initial posture
    references: Mapping[str, Reference]  # of every robot
    duration: float  # of the run [s]
    result: SimulationResult
    stretches: Mapping[str, tuple[Stretch, ...]] | None = None  # the motions of every robot, where moves were planned
    move: ArmMove | None = None  # what a program's file would say; None if none can

    def run(self) -> SimulationResult:
        """Run it again, from the same state: the same motion, sample by sample."""
        references = dict(self.references)
        return simulate(self.config, reference=references, duration=self.duration, start=self.start, progress=False)


@dataclass
class Tape:
    """The runs of a workcell since :meth:`record`, in order, and the changes between them.

    A result holds all signals and states of its run, so they are kept from then on only.
    """

    entries: list[Take | Change] = field(default_factory=list)  # what was recorded; it begins with a run
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
        self.whole = self.whole and (self.running or not self.entries) and take.move is not None
        if self.running:
            self.entries.append(take)

    def note(self, change: Change | None) -> None:
        """Keep a change of the station, None for one that no file can say; the first run knows those before it."""
        if self.entries:
            self.whole = self.whole and self.running and change is not None
            if self.running and change is not None:
                self.entries.append(change)

    def moves(self) -> list[Any]:
        """Return what a program's file would say of all that was recorded; nothing if none can say it."""
        said = [entry.move if isinstance(entry, Take) else entry for entry in self.entries]
        return said if self.whole else []

    def replay(self) -> list[SimulationResult]:
        """Run every take again from the state that it began in (SimRob's ``Rep()``); nothing else changes."""
        return [take.run() for take in self.takes]

    def check_some(self) -> None:
        """Check that something was recorded.

        Raises:
            InvalidParameter: nothing.
        """
        if not self.entries:
            raise InvalidParameter("the recording", "empty", "begun with record() before the moves")

    def stages(self, duration: float | None = None) -> list[Stage | Change]:
        """Return all that was recorded to be done again, runs that follow each other as one.

        Args:
            duration: of the whole [s]; as recorded unless given.

        Raises:
            InvalidParameter: nothing was recorded, or runs that do not join: such a tape can be replayed.
        """
        self.check_some()
        takes = self.takes
        factor = 1.0 if duration is None else seconds(duration) / sum(take.duration for take in takes)
        for one, other in pairwise(takes):
            if one.stretches is None or other.stretches is None:
                raise InvalidParameter("the recording", "with references of its own", "replayed take by take: replay()")
            after = other.stretches
            gaps = [np.abs(own[-1].postures[-1] - after[robot][0].postures[0]) for robot, own in one.stretches.items()]
            if max(gap.max() for gap in gaps) > _JOINS:
                raise InvalidParameter("the recording", "with gaps", "replayed take by take: replay()")
        found: list[Stage | Change] = []
        for runs, group in groupby(self.entries, lambda entry: isinstance(entry, Take)):
            entries = list(group)
            found += [_as_one([entry for entry in entries if isinstance(entry, Take)], factor)] if runs else []
            found += [entry for entry in entries if not isinstance(entry, Take)]
        return found


def _as_one(takes: list[Take], factor: float) -> Stage:
    if any(take.config != takes[0].config for take in takes):
        raise InvalidParameter("the recording", "of a station that changed", "replayed take by take: replay()")
    if len(takes) == 1 and takes[0].stretches is None:
        if factor != 1.0:
            raise InvalidParameter("duration", "given for references of its own", "left out")
        return takes[0].references, takes[0].duration
    motions: dict[str, list[Stretch]] = {}
    begin = 0.0
    for take in takes:
        for robot, own in (take.stretches or {}).items():
            motions.setdefault(robot, []).extend(stretch.at(begin, factor) for stretch in own)
        begin += factor * take.duration
    return {robot: trajectory(own) for robot, own in motions.items()}, begin
