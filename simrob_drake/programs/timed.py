"""Runs of a station that is cut where something happens to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from simrob_drake.blocks.references import Course, later
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.whole import joined
from simrob_drake.simulation import Moment, Reference, Ticks

if TYPE_CHECKING:
    from simrob_drake.programs.ongoing import OngoingStation

USER = "user"
"""Who stops a run that its timeline ends."""
_END = 1e-9  # s


def run_timed(cell: OngoingStation, references: Mapping[str, Reference], duration: float) -> SimulationResult:
    """Run references on a station whose timeline has a grid, from the state that it is in.

    The run ends on the grid, not before ``duration`` [s]. The station's state and time stay as they are.

    Raises:
        SimrobError: a change that cannot be.
    """
    line, runs = cell.timeline, list[SimulationResult]()
    begun, state, left = line.now, cell.state, False
    end = line.whole(line.whole(begun) + duration)
    courses: dict[str, Course] = {}
    since, asked_for = begun, dict[str, Any](run="none yet")

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
            if settings != asked_for:
                courses, since, asked_for = runner.courses(references, state), line.now, settings
            asked = {robot: later(course, line.now - since) for robot, course in courses.items()}
            run = runner.run(
                reference=asked, duration=part, start=state, ticks=Ticks(line.grid or part, tell), on_step=cell.on_step
            )
            forces = {**run.config.forces, **line.forces(run.stop_time)}  # drags have grown
            runs.append(replace(run, config=run.config.model_copy(update={"forces": forces})))
            line.now = line.time_of(line.steps(line.now + run.stop_time))
            if run.ending == "completed" and left:
                told = f"stopped by the user at {line.now - begun:.6g} s"
                runs[-1] = replace(runs[-1], ending="monitor", stopped_by=USER, message=told)
            if runs[-1].ending != "completed":
                break
            state = run.final_state
    finally:
        line.now = begun
    return runs[0] if len(runs) == 1 else joined(runs)
