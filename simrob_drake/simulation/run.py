"""One run: what a caller asks of it, checked; then stepped, sampled, and made a result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError
from pydrake.systems.framework import Context, OutputPort
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.arguments import instance, seconds, truth
from simrob_drake.blocks.references import Reference, Samples, SineReference
from simrob_drake.errors import InvalidParameter, one_of, quoted
from simrob_drake.frames import Vector, numbers
from simrob_drake.parts.forces import Push
from simrob_drake.progress import note, progress_bar
from simrob_drake.results.record.history import Recorder, StateHistory
from simrob_drake.results.record.run import FAILED
from simrob_drake.results.record.signals import Sampler, Watch, cut_at_stop, sampled
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.pace import PaceWatch
from simrob_drake.simulation.stepping import Outcome, Stepper, interrupted
from simrob_drake.stations.closed import ClosedStation
from simrob_drake.stations.config import StationConfig, check_effort
from simrob_drake.stations.physics_findings import physics_warnings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solver_config import FixedSteps

OnStep = Callable[[float, Vector], None]
_WITHOUT_ALL = (FAILED, "diverged")  # endings at which not every signal can be evaluated
_NOTHING = StateHistory(np.zeros(1), np.zeros((1, 0)))


@dataclass(frozen=True)
class Run:
    """A run that is about to be stepped."""

    config: StationConfig  # the station, as it is run
    whole: ClosedStation  # the diagram in which signals are evaluated
    stepper: Stepper  # what is stepped
    prepare: Callable[[], None] | None = None  # gives the whole diagram the references of this run back
    forget: Callable[[], None] = lambda: None  # takes them from all diagrams, so that they stand in memory once

    def result(
        self,
        *,
        progress: bool,
        on_step: OnStep | None,
        references: dict[str, Reference | Samples],
        start: State | None,
        hand: Callable[[Context], None] | None = None,
    ) -> SimulationResult:
        """Step, and return what happened; ``hand`` is called after each step, and may change what blocks remember."""
        watchers = [] if hand is None else [hand]
        if on_step is not None:
            watchers.append(_positions_watcher(self.stepper, on_step))
        with progress_bar(
            f"simulating {self.config.name}", self.config.duration, shown=truth(progress, "progress")
        ) as show:
            stepper = self.stepper
            pace = PaceWatch(self.config, lambda: stepper.built, own_blocks=stepper.has_own_blocks, show=show)
            watchers.append(pace)
            recorder, watch = watched(self.stepper, self.whole, *watchers)
            began = perf_counter()
            outcome = self.stepper.run(recorder, watch)
            stepping_time = perf_counter() - began
        known: dict[str, Any] = {"stepping_time": stepping_time, "references": references, "start": start}
        try:
            return self._evaluated(recorder, watch, outcome, **known)
        except KeyboardInterrupt:  # the run is not to be lost
            note("interrupted; the signals are computed first, interrupt again to abandon them", shown=progress)
            return self._evaluated(recorder, watch, interrupted(self.config, recorder), **known)

    def _evaluated(self, recorder: Recorder, watch: Watch, outcome: Outcome, **known: Any) -> SimulationResult:
        """Sample the signals of a run that has been stepped, and make its result.

        Args:
            recorder: has the states at all steps.
            watch: tells which monitor ended the run, if one did.
            outcome: how the stepping ended.
            known: further fields of the result, by name.
        """
        began = perf_counter()
        ports, stop = self.whole.ports, watch.stop if outcome.ending == "monitor" else None
        history = recorder.history(stop.count if stop else None)
        tolerant = outcome.ending in _WITHOUT_ALL
        held = torques_held_over_steps(ports)
        begins_in_motion = self.stepper.begins_in_motion
        sampler = Sampler(
            self.whole.diagram,
            ports,
            history,
            held=held,
            begins_in_motion=begins_in_motion,
            prepare=self.prepare,
            tolerant=tolerant,
        )
        # A monitor sees the ends of steps only. If steps have no fixed length, the moment at which its condition is met
        # is searched within the last step.
        has_fixed_steps = isinstance(self.config.solver, FixedSteps) and self.config.mode == "dynamic"
        if stop is not None and not has_fixed_steps:
            hold = ports.monitors[stop.name].hold
            probe = Sampler(
                self.whole.diagram,
                ports,
                history,
                held=held,
                begins_in_motion=begins_in_motion,
                prepare=self.prepare,
            )
            cut_at_stop(
                probe, lambda s, time: watch.holds(stop.name, s, time), self.stepper.step, onset=stop.onset, hold=hold
            )
            sampler.history = probe.history
        self.forget()
        if outcome.ending == "monitor":
            outcome = replace(outcome, message=f"{outcome.message}, at {sampler.history.end:.4g} s")
        config = self.config
        if outcome.ending == "completed" and sampler.history.end < config.duration:  # it was ended at a tick
            config = config.model_copy(update={"duration": sampler.history.end})
        outcome, times, values = self._sampled(sampler, outcome)
        positions = ports.plant.plant.num_positions()
        has_contacts = self.config.contact is not None and self.config.mode == "dynamic"
        result = SimulationResult(
            config=config,
            plant=ports.plant,
            ending=outcome.ending,
            stopped_by=outcome.stopped_by,
            message=outcome.message,
            names=[name for signal in ports.signals for name in signal.names],
            signals=tuple(ports.signals),
            notes=ports.notes,
            times=times,
            values=values,
            step_times=sampler.history.times,
            positions_at=lambda at: sampler.sample([ports.state], at)[0][:, :positions],
            signal_time=perf_counter() - began,
            contacts_at=sampler.contact_results if has_contacts else None,
            solver_warnings=physics_warnings(self.config, ports),
            context=None if self.config.mode == "kinematic" else lambda: sampler.looked_at,
            shortened=self.stepper.shortened,
            final_state=State.of(
                self.whole.diagram,
                ports,
                sampler.context_at(sampler.history.end),
                tolerant=tolerant,
            ),
            **known,
        )
        self.forget()
        return result

    def _sampled(self, sampler: Sampler, outcome: Outcome) -> tuple[Outcome, Vector, Vector]:
        """Return how the run ended, times, and values of the signals up to where a block fails."""
        times = sample_times(sampler.history.end, self.config.sample_rate)
        try:
            return outcome, times, sampled(sampler, self.whole.ports, times)
        except Exception as problem:
            time = sampler.looked_at.get_time()
            failed = self.stepper.failed(problem, sampler.looked_at, time)
            if failed is None or outcome.ending == FAILED:
                raise
        known = times[times < time]
        sampler.cut(known[-1] if known.size else 0.0)
        return self._sampled(sampler, failed)


def torques_held_over_steps(ports: StationPorts) -> list[OutputPort]:
    """Find the ports of servo torques that keep one value over each step of the solver.

    Samplers and monitors need this list: a torque between two steps is the value that the solver applied in that step,
    not a value computed from the interpolated state. The cases are:

    - ``cenic``: all torques. It holds references over a step, and servos act on the state at the step's end.
    - MuJoCo with implicit servos, which are part of its motors: MuJoCo reports the torques of the step that ended.
    - All other schemes, MuJoCo with servos as blocks, and kinematic stations: none. Blocks compute torques from the
      present state, and a kinematic station has no torques.
    """
    config = ports.config
    if config.mode == "kinematic":
        return []
    scheme = config.solver.scheme
    held = []
    for robot in ports.plant.robots.values():
        is_implicit = config.servo_of(robot.name).realization == "implicit"
        if scheme == "cenic" or (scheme == "mujoco" and is_implicit):
            held.append(ports.outputs[f"{robot.prefix}torque"])
    return held


def watched(stepper: Stepper, whole: ClosedStation, *watchers: Callable[[Context], None]) -> tuple[Recorder, Watch]:
    """Make the recorder of a run, and the watch that evaluates the station's monitors at the recorded steps.

    Args:
        stepper: steps the run.
        whole: the diagram in which the monitors' signals are evaluated.
        watchers: callbacks for the recorder to call after each step.
    """
    ports = whole.ports
    sampler = Sampler(whole.diagram, ports, _NOTHING)
    held = torques_held_over_steps(ports)
    watch = Watch(ports, sampler, held=held, begins_in_motion=stepper.begins_in_motion)
    look = watch.look if ports.monitors else None
    return Recorder(stepper.simulator, *watchers, look=look, pace=stepper.pace()), watch


def _positions_watcher(stepper: Stepper, on_step: OnStep) -> Callable[[Context], None]:
    """Make a callback for the recorder that calls ``on_step`` with the time [s] and the plant's positions (nq,)."""

    def watch(context: Context) -> None:
        ports = stepper.built.ports
        own = ports.state.get_system().GetMyContextFromRoot(context)
        on_step(context.get_time(), ports.state.Eval(own)[: ports.plant.plant.num_positions()])

    return watch


def sample_times(end: float, rate: float) -> Vector:
    """Return evenly spaced times; the end of the run is the last one, wherever it lies."""
    times = np.arange(int(np.floor(end * rate + 1e-9)) + 1) / rate
    return times if times[-1] >= end else np.append(times, end)


ReferenceLike: TypeAlias = Reference | npt.ArrayLike | Samples
"""A trajectory (n, 1), an array (m, 1 + n) with the time first, or a pair of times (m,) and positions (m, n)."""
ReferencesLike: TypeAlias = ReferenceLike | Mapping[str, ReferenceLike] | None
"""One for the only robot, or some by robot; none as the station says."""


def with_duration(config: StationConfig, duration: Any) -> StationConfig:
    """Return a configuration with a duration [s], its own if None.

    Raises InvalidParameter: no positive time, or so long that a run would have too many samples or steps.
    """
    if duration is None:
        return config
    longer = config.model_copy(update={"duration": seconds(duration)})
    check_effort(longer)
    return longer


def with_pushes(config: StationConfig, pushes: Mapping[str, Any] | None) -> StationConfig:
    """Return a configuration with other ``forces``, sections or keys, by name; raises InvalidParameter: none such."""
    if pushes is None:
        return config
    instance(pushes, "pushes", Mapping, "a mapping of names to pushes")
    others = {name: force for name, force in config.forces.items() if not isinstance(force, Push)}
    made = dict[str, Push]()
    for name, push in pushes.items():
        try:
            made[name] = push if isinstance(push, Push) else Push.model_validate({"kind": "push", **push})
        except (ValidationError, TypeError) as problem:
            expected = "a mapping of at, start, duration and force, as under forces: in a station"
            raise InvalidParameter(f"pushes: {name}", quoted(push), expected) from problem
    return config.model_copy(update={"forces": {**others, **made}})


def by_robot(config: StationConfig, reference: Any) -> dict[str, Reference | Samples]:
    """Return references by robot, arrays as times and positions; raises InvalidParameter or UnknownName: for nobody."""
    if reference is None:
        return {}
    if not isinstance(reference, Mapping):
        if config.only_robot is None:
            raise InvalidParameter("reference", "one for all", f"a mapping by robot: {', '.join(config.robots)}")
        reference = {config.only_robot: reference}
    return {one_of("robot", name, config.robots): _trajectory_or_samples(one) for name, one in reference.items()}


def _trajectory_or_samples(reference: Any) -> Reference | Samples:
    if isinstance(reference, SineReference):
        return reference
    if isinstance(reference, Trajectory):
        empty = isinstance(reference, PiecewisePolynomial) and reference.get_number_of_segments() < 1
        if empty or not reference.rows() or reference.cols() != 1:
            shape = "no segment" if empty else f"{reference.rows()} x {reference.cols()}"
            raise InvalidParameter("reference", f"a trajectory of {shape}", "of shape (n, 1), one row a joint")
        return reference
    pair = isinstance(reference, tuple) and len(reference) == 2
    times, positions = map(numbers, reference) if pair else _split(numbers(reference))
    if times.ndim != 1 or positions.ndim != 2 or not (times.size and positions.size):
        expected = "a trajectory, an array (m, 1 + n) whose first column is the time, or a pair of times and positions"
        raise InvalidParameter("reference", quoted(reference), expected)
    return times, positions


def _split(rows: Vector) -> tuple[Vector, Vector]:
    """Return the first column of an array, and the others."""
    return (rows[:, 0], rows[:, 1:]) if rows.ndim == 2 and rows.size else (rows, rows)
