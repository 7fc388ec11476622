"""One run of many: a station with some keys changed, and the row of a table that becomes of it."""

from dataclasses import dataclass, field
from typing import Any

from simrob_drake.errors import SimrobError
from simrob_drake.simulation import simulate
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station
from simrob_drake.tuning.measures import measures

Row = dict[str, Any]
REFUSED, KILLED = "refused", "killed"
"""How cases end that never ran to an end: their station could not be, or their process was killed."""


@dataclass(frozen=True)
class Case:
    """A run to be made.

    Attributes:
        number: of the case, from 1.
        station: a name or a file.
        overrides: what is changed in it.
        shown: those of the changes that the table tells, by their keys.
        seed: the seed of its noise.
        allow_code: whether the station may name Python code.
    """

    number: int
    station: str
    overrides: dict[str, Any]
    shown: dict[str, Any] = field(default_factory=dict)
    seed: int = 0
    allow_code: bool = False

    def config(self) -> StationConfig:
        """Return the station with its changes.

        Raises:
            SimrobError: one that cannot be.
        """
        return load_station(self.station, self.overrides, allow_code=self.allow_code)

    def row(self, ended: str, message: str, **figures: Any) -> Row:
        """Return the case and its end as a row."""
        return {"number": self.number, **self.shown, "seed": self.seed, "ended": ended, **figures, "message": message}


def rollout(case: Case) -> Row:
    """Run a case and return its row, whatever becomes of it."""
    try:
        config = case.config()
        result = simulate(config, progress=False)
    except SimrobError as problem:
        return case.row(REFUSED, str(problem))
    times = {"duration": config.duration, "stop_time": result.stop_time}
    return case.row(result.stopped_by or result.ending, result.message, **times, **measures(result))


def killed(case: Case) -> Row:
    """Return the row of a case whose process was killed, and once more when it was alone."""
    return case.row(KILLED, "its process was killed, twice")
