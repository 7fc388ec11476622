"""Run a station: reference in, result out, however the run ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.systems.analysis import Simulator, SimulatorStatus
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort
from pydrake.trajectories import Trajectory

from simrob_drake.errors import InvalidParameter, UnknownName, shortened
from simrob_drake.frames import Vector
from simrob_drake.lifetime import built
from simrob_drake.progress import note, progress_bar
from simrob_drake.results.record.computed import contacts_at, with_computed
from simrob_drake.results.record.history import Recorder
from simrob_drake.results.record.run import DIVERGED, INTERRUPTED, Ending
from simrob_drake.results.record.signals import Sampler, sampled
from simrob_drake.results.record.state import State
from simrob_drake.results.record.stop_time import cut_at_stop
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.checks import likely_cause, step_findings
from simrob_drake.stations.closed import add_closed_station, check_references
from simrob_drake.stations.config import StationConfig, check_samples
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.references import Samples
from simrob_drake.stations.sensors import with_sensors_in_loop
from simrob_drake.stations.solve import apply_solver
from simrob_drake.stations.station import StationLike, config_of

Reference: TypeAlias = Trajectory | npt.ArrayLike | Samples
"""A trajectory (n, 1), an array (m, 1 + n) with the time first, or a pair of times (m,) and positions (m, n)."""


def simulate(
    config_or_station: StationLike,
    *,
    reference: Reference | Mapping[str, Reference] | None = None,
    duration: float | None = None,
    start: State | None = None,
    progress: bool = True,
    on_step: Callable[[float, Vector], None] | None = None,
) -> SimulationResult:
    """Run a station and return what happened.

    Args:
        config_or_station: a station's name or YAML file, its configuration, or a station made from one, which is built
            anew from it.
        reference: in place of the configuration's: a trajectory of shape (n, 1), an array (m, 1 + n) whose first
            column is the time, or a pair of times (m,) and positions (m, n); SI units and radians. With several
            robots, a mapping by robot. Values are joined by straight lines, as Simulink joins them; in a kinematic
            station by a smooth curve, since a corner has no acceleration.
        duration: in place of the configuration's [s].
        start: where the station begins, such as the ``final_state`` of another result; time begins at zero all the
            same, and the configuration's references begin where that run's reference ended.
        progress: show a bar on a terminal.
        on_step: called after each accepted step with the time [s] and the positions of the whole plant (nq,); it
            cannot change the run. What it raises goes on to the caller; KeyboardInterrupt ends the run.

    Returns:
        the result, also when a monitor ended the run or when the simulation diverged.

    Raises:
        SimrobError: input that cannot be run at all.
    """
    config = config_of(config_or_station)
    if duration is not None:
        config = config.model_copy(update={"duration": _checked_duration(duration)})
        check_samples(config.duration, config.sample_rate)
    if start is None:
        start = State.at_start_of(config)
    elif not isinstance(start, State):
        raise InvalidParameter("start", shortened(repr(start)), "a State, such as the final_state of a result")
    given = _by_robot(config, reference)
    run = _Run.assembled(config, given, start)
    watchers = [] if on_step is None else [_positions_watcher(run.stepped, on_step)]
    with progress_bar(f"simulating {config.name}", config.duration, shown=progress) as show:
        if show is not None:
            watchers.append(lambda context: show(context.get_time()))
        recorder = Recorder(run.simulator, *watchers)
        began = perf_counter()
        outcome = _advance(run, recorder)
        stepping_time = perf_counter() - began
    try:
        return _evaluated(run, recorder, outcome, stepping_time, given, start)
    except KeyboardInterrupt:  # the run is not to be lost
        note("interrupted; the signals are computed first, interrupt again to abandon them", shown=progress)
        return _evaluated(run, recorder, _interrupted(recorder), stepping_time, given, start)


@dataclass(frozen=True)
class _Run:
    """A closed station, ready to be stepped.

    Sensors that only report are not in the diagram that is stepped, but in one of the same states beside it.
    """

    config: StationConfig
    diagram: Diagram
    ports: StationPorts
    simulator: Simulator
    stepped: StationPorts

    @classmethod
    def assembled(
        cls, config: StationConfig, references: Mapping[str, Trajectory | Samples], start: State | None
    ) -> _Run:
        began_at = start.references if start else None
        diagram, ports = cls._closed(config, references, began_at)
        check_references(diagram, ports)
        in_loop = with_sensors_in_loop(config)
        leaner, stepped = (diagram, ports) if in_loop == config else cls._closed(in_loop, references, began_at)
        simulator = Simulator(leaner)
        apply_solver(simulator, config)
        if start is not None:
            start.put(leaner, stepped, simulator.get_mutable_context())
        return cls(config, diagram, ports, simulator, stepped)

    @staticmethod
    def _closed(
        config: StationConfig,
        references: Mapping[str, Trajectory | Samples],
        began_at: Mapping[str, Vector] | None,
    ) -> tuple[Diagram, StationPorts]:
        builder = DiagramBuilder()
        ports = add_closed_station(builder, config, references, began_at)
        return built(builder), ports


@dataclass(frozen=True)
class _Outcome:
    """How a run ended, who ended it and why."""

    ending: Ending
    stopped_by: str | None
    message: str


def _checked_duration(duration: float) -> float:
    if isinstance(duration, bool) or not isinstance(duration, (int, float, np.number)):
        raise InvalidParameter("duration", repr(duration), "a positive time [s]")
    if not (np.isfinite(duration) and duration > 0):
        raise InvalidParameter("duration", duration, "a positive time [s]")
    return float(duration)


def _by_robot(config: StationConfig, reference: Any) -> dict[str, Trajectory | Samples]:
    """Return references by robot, arrays split into times and positions."""
    if reference is None:
        return {}
    if not isinstance(reference, Mapping):
        if config.only_robot is None:
            raise InvalidParameter("reference", "one for all", f"a mapping by robot: {', '.join(config.robots)}")
        reference = {config.only_robot: reference}
    for robot in reference:
        if robot not in config.robots:
            raise UnknownName("robot", robot, config.robots)
    return {robot: _trajectory_or_samples(value) for robot, value in reference.items()}


def _trajectory_or_samples(reference: Any) -> Trajectory | Samples:
    if isinstance(reference, Trajectory):
        return reference
    try:
        if isinstance(reference, tuple) and len(reference) == 2:
            return np.asarray(reference[0], dtype=float), np.asarray(reference[1], dtype=float)
        rows = np.asarray(reference, dtype=float)
    except (TypeError, ValueError) as problem:
        expected = "a trajectory, an array (m, 1 + n) whose first column is the time, or a pair of times and positions"
        raise InvalidParameter("reference", shortened(repr(reference)), expected) from problem
    if rows.ndim != 2 or rows.shape[1] < 2:
        raise InvalidParameter("reference", f"an array of shape {rows.shape}", "of shape (m, 1 + n), the time first")
    return rows[:, 0], rows[:, 1:]


def _positions_watcher(ports: StationPorts, on_step: Callable[[float, Vector], None]) -> Callable[[Context], None]:
    system, count = ports.state.get_system(), ports.plant.plant.num_positions()

    def watch(context: Context) -> None:
        on_step(context.get_time(), ports.state.Eval(system.GetMyContextFromRoot(context))[:count])

    return watch


def _advance(run: _Run, recorder: Recorder) -> _Outcome:
    """Step to the end, or until something ends the run.

    The run is one AdvanceTo(): a solver's steps end where a call ends, so pieces would change the result.
    """
    duration, ended = run.config.duration, SimulatorStatus.ReturnReason.kReachedTerminationCondition
    try:
        status = run.simulator.Initialize()
        if status.reason() != ended:
            status = run.simulator.AdvanceTo(duration)
    except KeyboardInterrupt:
        return _interrupted(recorder)
    except (RuntimeError, SystemExit) as problem:  # Drake's failed assertions come as SystemExit
        if recorder.failure is not None:
            raise
        return _diverged(run, recorder, str(problem))
    if not recorder.is_sane():
        return _diverged(run, recorder, "a state ran away to infinity")
    if status.reason() == ended:
        return _Outcome("monitor", status.system().get_name().removeprefix("monitor."), status.message())
    return _Outcome("completed", None, f"ran to its end at {duration:g} s")


def _interrupted(recorder: Recorder) -> _Outcome:
    return _Outcome("interrupted", INTERRUPTED, f"interrupted at {recorder.times[-1]:.4g} s")


def _diverged(run: _Run, recorder: Recorder, problem: str) -> _Outcome:
    first_sentence = " ".join(problem.split()).split(". ")[0].rstrip(".")
    cause = likely_cause(run.config, run.ports.plant)
    message = f"diverged at {recorder.history().end:.4g} s: {first_sentence}; {cause}"
    return _Outcome("diverged", DIVERGED, message)


def _evaluated(
    run: _Run,
    recorder: Recorder,
    outcome: _Outcome,
    stepping_time: float,
    given: Mapping[str, Trajectory | Samples],
    start: State | None,
) -> SimulationResult:
    """Sample the signals of a run that has been stepped."""
    began = perf_counter()
    sampler = Sampler(run.diagram, run.ports.plant.plant, recorder.history(), held=_held_ports(run))
    if outcome.ending == "monitor":
        cut_at_stop(sampler, run.ports.monitors[str(outcome.stopped_by)], run.config)
        outcome = replace(outcome, message=f"{outcome.message}, at {sampler.history.end:.4g} s")
    times = _sample_times(sampler.history.end, run.config.sample_rate)
    names, values = with_computed(sampler, run.ports, times, *sampled(sampler, run.ports, times))
    positions = run.ports.plant.plant.num_positions()
    return SimulationResult(
        config=run.config,
        plant=run.ports.plant,
        ending=outcome.ending,
        stopped_by=outcome.stopped_by,
        message=outcome.message,
        names=names,
        times=times,
        values=values,
        step_times=sampler.history.times,
        positions_at=lambda at: sampler.sample([run.ports.state], at)[0][:, :positions],
        stepping_time=stepping_time,
        signal_time=perf_counter() - began,
        references=dict(given),
        contacts_at=contacts_at(sampler, run.ports),
        warnings=_warnings(run),
        start=start,
        final_state=State.of(run.diagram, run.ports, sampler.context_at(sampler.history.end)),
    )


def _held_ports(run: _Run) -> list[OutputPort]:
    """Return the torques of a run whose scheme lets references stand still over a step: that is what was applied."""
    if run.config.mode == "kinematic" or run.config.solver.scheme != "cenic":
        return []
    return [run.ports.outputs[f"{robot.prefix}torque"] for robot in run.ports.plant.robots.values()]


def _warnings(run: _Run) -> list[str]:
    """Return why the result may be wrong though the run went to its end."""
    if run.config.mode == "kinematic":
        return []
    findings = step_findings(run.config, run.ports.plant)
    return [finding.text for finding in findings if finding.level == "warning"]


def _sample_times(end: float, rate: float) -> Vector:
    """Return evenly spaced times; the end of the run is the last one, wherever it lies."""
    times = np.arange(int(np.floor(end * rate + 1e-9)) + 1) / rate
    return times if times[-1] >= end else np.append(times, end)
