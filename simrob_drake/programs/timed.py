"""Runs of a station that is cut where something happens to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

from simrob_drake.blocks.references import Reference, later
from simrob_drake.programs.timeline import Timeline
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.whole import joined
from simrob_drake.simulation import Moment, OnStep, ReferenceLike, Runner, Ticks
from simrob_drake.stations.config import StationConfig

USER = "user"
"""Who stops a run that its timeline ends."""
_END = 1e-9  # s


class Timed(Protocol):
    """A station that goes on from its state, along a timeline."""

    config: StationConfig
    state: State | None
    timeline: Timeline

    def runner_of(self, config: StationConfig) -> Runner:
        """Return what runs the station as a configuration of it says."""

    @property
    def on_step(self) -> OnStep | None:
        """What is told of each step of a run."""


def run_timed(cell: Timed, references: Mapping[str, ReferenceLike], duration: float) -> SimulationResult:
    """Run references on a station whose timeline has a grid, from the state that it is in.

    The run ends on the grid, not before ``duration`` [s]. The station's state and time stay as they are.

    Raises:
        SimrobError: a change that cannot be.
    """
    line, runs = cell.timeline, list[SimulationResult]()
    begun, state, left = line.now, cell.state, False
    end = line.whole(line.whole(begun) + duration)
    played: dict[str, Reference] = {}
    since, of_runner = begun, dict[str, Any](run="none yet")

    def tell(moment: Moment) -> bool:
        nonlocal left
        known, now = len(line.changes), line.now
        ended = line.tell(now + moment.time, moment)
        moment.play_forces(line.forces(end - now))
        left = left or ended
        return left or len(line.changes) != known

    try:
        while not runs or (not left and end - line.now > _END):
            part = line.part(end)
            station = line.station(cell.config, part)
            runner = cell.runner_of(station)
            settings = {key: value for key, value in line.settings().items() if "reference" in key.split(".")}
            if settings != of_runner:
                played, since, of_runner = runner.references(references, state), line.now, settings
            rest = {robot: later(reference, line.now - since) for robot, reference in played.items()}
            run = runner.run(
                reference=rest, duration=part, start=state, ticks=Ticks(line.grid or part, tell), on_step=cell.on_step
            )
            forces = {**run.config.forces, **line.forces(run.stop_time)}  # drags have grown
            runs.append(replace(run, config=run.config.model_copy(update={"forces": forces})))
            line.now = line.time_of(line.steps(line.now + run.stop_time))
            if run.ending == "completed" and left:
                message = f"stopped by the user at {line.now - begun:.6g} s"
                runs[-1] = replace(runs[-1], ending="monitor", stopped_by=USER, message=message)
            if runs[-1].ending != "completed":
                break
            state = run.final_state
    finally:
        line.now = begun
    return runs[0] if len(runs) == 1 else joined(runs)
