"""What a workcell recorded, to be run again."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.errors import InvalidParameter
from simrob_drake.given import seconds
from simrob_drake.programs.trajectories import Stretch, trajectory
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import simulate
from simrob_drake.stations.config import StationConfig

_JOINS = 1e-9  # rad or m between the end of a move and the beginning of the next


@dataclass(frozen=True)
class Take:
    """One run: the station as it was, where it began, and what every robot was asked to do."""

    config: StationConfig  # the station, with its pieces where they hung then
    start: State | None  # where it began; None at the configuration's initial posture
    stretches: Mapping[str, tuple[Stretch, ...]]  # the motion of every robot, from time 0 to the duration
    duration: float  # of the run [s]

    def run(self) -> SimulationResult:
        """Run it again, from the same state: the same motion, sample by sample."""
        references: dict[str, Trajectory] = {robot: trajectory(own) for robot, own in self.stretches.items()}
        return simulate(self.config, reference=references, duration=self.duration, start=self.start, progress=False)


@dataclass
class Tape:
    """The runs of a workcell since :meth:`record`, in order."""

    takes: list[Take] = field(default_factory=list)  # what was recorded
    running: bool = False  # whether what comes next is recorded too

    def record(self) -> None:
        """Forget everything, and record from now on (SimRob's ``Rec()``)."""
        self.takes, self.running = [], True

    def keep(self, take: Take) -> None:
        """Keep a run, if the tape is running."""
        if self.running:
            self.takes.append(take)

    def replay(self) -> list[SimulationResult]:
        """Run every take again from the state that it began in (SimRob's ``Rep()``); nothing else changes."""
        return [take.run() for take in self.takes]

    def simulate(self, config: StationConfig | None = None, *, duration: float | None = None) -> SimulationResult:
        """Run all takes as one, on the station that they were recorded on or on another (SimRob's ``Sim``).

        Args:
            config: another station with robots of the same names and axes, such as the dynamic one; it begins at its
                own initial posture if the recording began at that of its station.
            duration: of the whole [s]; as recorded unless given.

        Raises:
            InvalidParameter: nothing was recorded; pieces changed hands, or the takes do not join: such a tape can be
                replayed, take by take.
        """
        if not self.takes:
            raise InvalidParameter("the recording", "empty", "begun with record() before the moves")
        first = self.takes[0]
        stretches: dict[str, list[Stretch]] = {robot: [] for robot in first.config.robots}
        begin = 0.0
        factor = 1.0 if duration is None else seconds(duration) / sum(take.duration for take in self.takes)
        for take in self.takes:
            if take.config != first.config:
                problem = "of a program in which a piece changes hands or a tool changes"
                raise InvalidParameter("the recording", problem, "replayed take by take: replay()")
            for robot, own in take.stretches.items():
                if stretches[robot] and np.abs(stretches[robot][-1].postures[-1] - own[0].postures[0]).max() > _JOINS:
                    raise InvalidParameter("the recording", "with gaps", "replayed take by take: replay()")
                stretches[robot] += [stretch.at(begin, factor) for stretch in own]
            begin += factor * take.duration
        whole = {robot: tuple(own) for robot, own in stretches.items()}
        return Take(config or first.config, first.start, whole, begin).run()
