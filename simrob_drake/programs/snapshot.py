"""What a robot goes back to when something is undone."""

from dataclasses import dataclass

from simrob_drake.programs.program import Program
from simrob_drake.results.record.state import State
from simrob_drake.stations.config import StationConfig


@dataclass(frozen=True)
class Snapshot:
    """A program, where a station is, how it is, and its time [s]."""

    program: Program
    state: State | None
    config: StationConfig
    now: float
