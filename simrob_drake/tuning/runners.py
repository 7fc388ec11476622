"""Stations that a process has built, kept for the runs to come that differ in nothing that is built."""

from collections import deque

from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import ReferenceLike, Runner
from simrob_drake.stations.config import StationConfig

_KEPT: deque[Runner] = deque(maxlen=4)  # some megabytes each


def run(config: StationConfig, reference: ReferenceLike | None = None) -> SimulationResult:
    """Run a station as :func:`~simrob_drake.simulation.simulate` does, to the last bit.

    Raises:
        SimrobError: input that cannot be run at all.
    """
    return runner_of(config).run(reference=reference)


def runner_of(config: StationConfig) -> Runner:
    """Return the runner of a station.

    What was built for a run of the same station with other references, pushes, length or start is used again.

    Raises:
        SimrobError: a station that cannot be run at all.
    """
    runner = next((found for kept in _KEPT if (found := kept.like(config)) is not None), None)
    if runner is None:
        runner = Runner(config)
        _KEPT.append(runner)
    return runner
