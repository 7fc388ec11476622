"""One run of a station: check the caller's arguments, step the station, evaluate its signals, and make the result.

The *stepped* diagram of a run contains only what affects the motion. It may be another one from a time on, see
`StationDiagrams`. The *whole* diagram has the same states, and also the blocks that compute signals; it may be the
stepped one, too. Signals are evaluated in it after the run, from the recorded states.

A *recorder* keeps the states after each step: the *history*, one row for each. A *watch* evaluates the monitors, which
may end a run. A *sampler* evaluates signals at recorded states. A run may *repeat* recorded steps of an earlier run
that it continues, and compare them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.systems.framework import Context, OutputPort
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.base.arguments import instance, seconds, truth
from simrob_drake.base.errors import InvalidConfig, InvalidParameter, one_of, quote_value
from simrob_drake.base.frames import Vector, numbers
from simrob_drake.base.messages import compound, message
from simrob_drake.base.progress import note, progress_bar
from simrob_drake.base.sections import validate_section
from simrob_drake.blocks.references import Reference, ReferenceSignal, Samples
from simrob_drake.parts.forces import Push
from simrob_drake.results.record.history import Recorder, StateHistory
from simrob_drake.results.record.run import FAILED, INTERRUPTED, stop_message
from simrob_drake.results.record.signals import Sampler, Stop, Watch, cut_at_stop, sample_signals
from simrob_drake.results.record.state import MotionOrigin, State, Trace
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.pace import PaceWatch
from simrob_drake.simulation.resume import RepeatedSteps, StepsDiffer, last_free_row
from simrob_drake.simulation.stepping import Outcome, Restart, Stepper, interruption_outcome
from simrob_drake.stations.closed import ClosedStation
from simrob_drake.stations.config import StationConfig, check_effort
from simrob_drake.stations.physics_findings import physics_warnings
from simrob_drake.stations.ports import StationPorts

OnStep = Callable[[float, Vector], None]
"""Callback of the user after each step, with the time [s] and the positions of the plant (nq,)."""

# The last states may be infinite, or make a block of the user's own fail again.
_INCOMPLETE_ENDINGS = (FAILED, "diverged")
"""Endings after which not every signal can be evaluated."""

_ROUNDING = 1e-9
"""Times that differ by less are equal [s]."""

_NO_STATES = StateHistory(np.zeros(1), np.zeros((1, 0)))
"""History for a sampler that gets its states later."""


class SignalSamples(NamedTuple):
    """Signals of a run at its samples."""

    outcome: Outcome
    """How the run ended: as the stepping did, or because a block failed when signals were evaluated."""
    times: Vector
    """Times of the samples, shape (m,) [s]."""
    values: Vector
    """Columns of all signals, shape (m, k)."""


@dataclass(frozen=True)
class Run:
    """A run that is about to be stepped.

    Attributes:
        config: configuration of the station in this run.
        whole: the diagram in which signals are evaluated.
        stepper: steps the stepped diagram.
        prepare: restores the references and forces of this run in the whole diagram, which may have served another run
            since. None if the diagram serves this run alone.
        forget: removes the references from all diagrams, so that only one copy is kept in memory.
        begin: start of the run, in simulated time [s].
        restart: recorded step at which stepping begins; None if it begins at the start of the run or of the motion. The
            result contains the recorded steps before it.
        repeated: the earlier run whose last steps are repeated and compared; None if there is none.
        repeated_until: time up to which callbacks of the user have seen the steps, in an earlier run [s].
        origins: positions (n,) at which the references of the configuration begin, by robot, for the final state.
        origin: the run that the motion began with; None in a diagram of the user's own.
        in_own_diagram: whether the station is part of a diagram of the user's own.
    """

    config: StationConfig
    whole: ClosedStation
    stepper: Stepper
    prepare: Callable[[], None] | None = None
    forget: Callable[[], None] = lambda: None
    begin: float = 0.0
    restart: Restart | None = None
    repeated: Trace | None = None
    repeated_until: float = -np.inf
    origins: Mapping[str, Vector] = field(default_factory=dict)
    origin: MotionOrigin | None = None
    in_own_diagram: bool = False

    @property
    def end(self) -> float:
        """Planned end of the run [s]."""
        return self.stepper.end

    def result(
        self,
        *,
        progress: bool,
        on_step: OnStep | None,
        references: dict[str, Reference | Samples],
        start: State | None,
        pass_commands: Callable[[Context], None] | None = None,
        repeat_commands: Callable[[Context], None] | None = None,
    ) -> SimulationResult:
        """Step the run and make its result.

        Args:
            progress: whether to show a progress bar.
            on_step: callback of the user after each step, or None.
            references: references that the user gave, by robot, for the result.
            start: state from which the run begins, for the result; None for the station's own start.
            pass_commands: callback after each step that passes the user's commands to controllers. It gets the context
                of the stepped diagram and may change the states of blocks. None if there are no commands.
            repeat_commands: such a callback that gives the commands of the repeated run again; None if it had none.

        Raises:
            StepsDiffer: the run continues another one, but the steps that it repeats differ, or a monitor, a failure or
                a divergence ended it before `begin`.
            KeyboardInterrupt: the user interrupted the run before `begin`, or the callback of a tick ended it there; or
                the user interrupted the evaluation of the signals twice.
            Exception: a callback of the user has raised it.
        """
        repeated = (
            None if self.repeated is None else RepeatedSteps(self.repeated, self.stepper.begin)
        )
        watchers = list[Callable[[Context], None]]()
        if repeat_commands is not None:
            watchers.append(repeat_commands)
        if pass_commands is not None:
            watchers.append(self._after_repeated(pass_commands))
        if on_step is not None:
            watchers.append(self._after_repeated(_positions_watcher(self.stepper, on_step)))
        # The bar shows the time since the start of this run, not the time of the whole motion.
        title = message("simulation.simulating", "simulating {station}", station=self.config.name)
        stepper = self.stepper
        with progress_bar(title, self.end - self.begin, shown=truth(progress, "progress")) as show:
            pace = PaceWatch(
                self.config,
                lambda: stepper.built,
                own_blocks=stepper.has_own_blocks,
                show=show,
                begin=self.begin,
                end=self.end,
            )
            watchers.append(pace)
            recorder, watch = make_recorder(stepper, self.whole, *watchers, repeated=repeated)
            # A monitor with `hold` counts time since its condition was met, which may be in the earlier run: it first
            # gets the recorded steps of that run.
            if self.restart is not None:
                watch.look(self.restart.history.rows(slice(0, self.restart.row)))
            began = perf_counter()
            outcome = self.stepper.run(recorder, watch)
            stepping_time = perf_counter() - began
        stop = watch.stop if outcome.ending == "monitor" else None
        # The run ended within the steps that are repeated, before `begin`: it has no state of its own, and no result.
        if self._ended_at(recorder, stop) < self.begin:
            # The earlier run got further, so this run differs from it, such as by a monitor or a block. Otherwise the
            # user has interrupted it, or a tick has ended it.
            if outcome.ending not in ("completed", INTERRUPTED):
                raise StepsDiffer
            raise KeyboardInterrupt
        known: dict[str, Any] = {
            "stepping_time": stepping_time,
            "references": references,
            "start": start,
        }
        try:
            return self._make_result(recorder, watch, outcome, **known)
        # The interrupt came after the stepping. The signals are computed again, so that the run is not lost.
        except KeyboardInterrupt:
            note(
                message(
                    "simulation.interrupted_computing",
                    "interrupted; the signals are still computed, interrupt again to abandon them",
                ),
                shown=progress,
            )
            return self._make_result(
                recorder, watch, interruption_outcome(self.config, recorder, self.end), **known
            )

    def _make_result(
        self, recorder: Recorder, watch: Watch, outcome: Outcome, **known: Any
    ) -> SimulationResult:
        """Evaluate the signals of a run that has been stepped, and make its result.

        Args:
            recorder: the recorded states.
            watch: contains the monitor that ended the run, if one did.
            outcome: how the stepping ended.
            known: further fields of the result, by name, which are passed on.

        Raises:
            KeyboardInterrupt: the user interrupted the evaluation. It can be repeated.
        """
        began = perf_counter()
        ports = self.whole.ports
        stop = watch.stop if outcome.ending == "monitor" else None
        history = self._whole_history(recorder, stop)
        # Values that cannot be evaluated become NaN then.
        tolerant = outcome.ending in _INCOMPLETE_ENDINGS
        # A monitor sees the ends of steps only. In continuous time, the time at which its condition is met is searched
        # within the last step.
        if stop is not None and not self.config.engine.has_discrete_states:
            history = self._cut_history(history, watch, stop)
        sampler = self._sampler(history, tolerant=tolerant)
        # The stepped diagrams need their trajectories no more. The sampler restores those of the whole diagram.
        self.forget()
        end = sampler.history.end
        if outcome.ending == "monitor":
            outcome = replace(outcome, message=stop_message(outcome.message, end))
        config = self.config
        if outcome.ending == "completed" and end < self.end:
            # The callback of a tick has ended the run: that is its duration now.
            config = config.model_copy(update={"duration": end - self.begin})
        samples = self._sample(sampler, outcome)
        outcome = samples.outcome
        position_count = ports.plant.plant.num_positions()
        has_contacts = self.config.has_contact_forces
        origin = self.origin or MotionOrigin(
            config, None, self.begin, self.stepper.begins_in_motion
        )
        # A run that continues this one begins at a step on which the end of this run had no influence.
        free_row = last_free_row(sampler.history, config)
        trace = Trace(sampler.history, self.stepper.flight_checks, origin, free_row)
        # Only such a run can be continued, so only its final state carries the recorded steps, see `continuable_trace`.
        is_whole = outcome.ending in ("completed", INTERRUPTED) and not self.in_own_diagram
        result = SimulationResult(
            config=config,
            plant=ports.plant,
            ending=outcome.ending,
            stopped_by=outcome.stopped_by,
            message=outcome.message,
            names=[name for signal in ports.outputs.signals for name in signal.names],
            signals=tuple(ports.outputs.signals),
            notes=ports.outputs.notes,
            times=samples.times,
            values=samples.values,
            step_times=self._step_times(sampler.history),
            positions_at=lambda times: sampler.sample([ports.state], times)[0][:, :position_count],
            signal_time=perf_counter() - began,
            contacts_at=sampler.contact_results if has_contacts else None,
            solver_warnings=physics_warnings(self.config, ports),
            context=self._final_context(sampler),
            shortened=self.stepper.shortened,
            final_state=replace(
                State.of(
                    self.whole.diagram,
                    ports,
                    sampler.context_at(sampler.history.end),
                    tolerant=tolerant,
                ),
                origins=dict(self.origins),
            ).with_trace(trace if is_whole else None),
            trace=trace,
            in_own_diagram=self.in_own_diagram,
            **known,
        )
        # Evaluating the signals has restored the references: they are removed again.
        self.forget()
        return result

    def _ended_at(self, recorder: Recorder, stop: Stop | None) -> float:
        """Time at which the run ended [s]. It is -inf if a monitor ended it before the step at which stepping began.

        Args:
            recorder: the run's own states.
            stop: the end of the run by a monitor, or None if no monitor ended it.
        """
        if stop is None:
            return recorder.times[-1]
        # A monitor also counts the recorded steps before the restart.
        steps_before = 0 if self.restart is None else self.restart.row
        own_count = stop.count - steps_before
        return recorder.times[own_count - 1] if own_count > 0 else -np.inf

    def _after_repeated(self, watcher: Callable[[Context], None]) -> Callable[[Context], None]:
        """Make a callback that calls another one only after the steps that repeat those of an earlier run.

        Args:
            watcher: the other callback, with the context of the stepped diagram.
        """

        def call_after_repeated(context: Context) -> None:
            """Callback after each step, with the context of the stepped diagram."""
            if context.get_time() > self.repeated_until:
                watcher(context)

        return call_after_repeated

    def _whole_history(self, recorder: Recorder, stop: Stop | None) -> StateHistory:
        """States of the run: the recorded ones of the run that it continues, and then its own.

        Args:
            recorder: the run's own states.
            stop: the end of the run by a monitor, after which states do not count; None if no monitor ended it.
        """
        if self.restart is None:
            return recorder.history(stop.count if stop else None)
        before = self.restart.history.rows(slice(0, self.restart.row))
        # The monitors have seen the states before, too.
        own_history = recorder.history(stop.count - len(before.times) if stop else None)
        return before.with_end(own_history)

    def _step_times(self, history: StateHistory) -> Vector:
        """Start of the run and the ends of its steps [s], without steps of the run that it continues.

        Args:
            history: states of the run, perhaps with some from before its start.
        """
        times = history.times
        return times if times[0] == self.begin else np.append(self.begin, times[times > self.begin])

    def _sampler(self, history: StateHistory, *, tolerant: bool) -> Sampler:
        """Make the sampler that evaluates the whole diagram at recorded states.

        Args:
            history: the states.
            tolerant: whether values that cannot be evaluated become NaN, instead of an error.
        """
        return Sampler(
            self.whole.diagram,
            self.whole.ports,
            history,
            held=torques_held_over_steps(self.whole.ports),
            begins_in_motion=self.stepper.begins_in_motion,
            prepare=self.prepare,
            tolerant=tolerant,
            context=self.stepper.user_context,
        )

    def _final_context(self, sampler: Sampler) -> Callable[[], Context]:
        """Make a function that returns a new context at the end of the run.

        In a diagram of the user's own, this is a copy of the stepped context: it contains the logs of the user's log
        sinks. If a monitor ended the run before the last step, the stepped context is moved to the end of the run, too.

        Args:
            sampler: evaluates the whole diagram, at the states of the run.
        """
        stepped = self.stepper.user_context
        if stepped is None:
            return sampler.final_context
        sampler.history.last().put(0, stepped)
        # The caller may advance the stepped context further.
        at_end: Context = stepped.Clone()

        def copied_context() -> Context:
            """Copy the context at the end of the run."""
            return at_end.Clone()

        return copied_context

    def _cut_history(self, history: StateHistory, watch: Watch, stop: Stop) -> StateHistory:
        """Shorten the history of a run: it ends when the condition of its monitor has been met for the time ``hold``.

        If the monitor has no ``hold``, this is the time at which its condition was first met.

        Args:
            history: states up to the step at which the monitor ended the run.
            watch: the monitors.
            stop: the end of the run.
        """
        probe = self._sampler(history, tolerant=False)

        def holds(sampler: Sampler, time: float) -> bool:
            """Whether the condition of the monitor is met at a time [s] of the sampler's history."""
            return watch.holds(stop.name, sampler, time)

        # The history of the probe is shortened in place, by stepping again within the last step.
        hold = self.whole.ports.outputs.monitors[stop.name].hold
        cut_at_stop(probe, holds, self.stepper.step, onset=stop.onset, hold=hold)
        return probe.history

    def _sample(self, sampler: Sampler, outcome: Outcome) -> SignalSamples:
        """Evaluate all signals of the run.

        If Python code fails, such as a block of the user's own, the history of the sampler is shortened to the samples
        before the failure, and the signals are evaluated once more. A failure in a run that has failed already is
        raised.

        Args:
            sampler: evaluates the whole diagram. Its history may be shortened.
            outcome: how the stepping ended.

        Raises:
            Exception: the error of the evaluation, if no such code is to blame, see `Stepper.failure_outcome`, or if
                the run has failed already.
        """
        times = sample_times(sampler.history.end, self.config.sample_rate, begin=self.begin)
        try:
            return SignalSamples(outcome, times, sample_signals(sampler, self.whole.ports, times))
        except Exception as problem:
            time_of_failure = sampler.looked_at.get_time()
            failed = self.stepper.failure_outcome(problem, sampler.looked_at, time_of_failure)
            # No Python code is to blame, or it has failed again: a shorter history does not help.
            if failed is None or outcome.ending == FAILED:
                raise
        # The sample at the failure itself has no value.
        good_times = times[times < time_of_failure]
        sampler.cut(good_times[-1] if good_times.size else self.begin)
        return self._sample(sampler, failed)


def torques_held_over_steps(ports: StationPorts) -> list[OutputPort]:
    """Find the output ports of servo torques that have one value for each step of the solver.

    Samplers and monitors need this list: between two steps, such a torque is the value that the solver applied in the
    step, not a value computed from the interpolated state. The cases are:

    - Engines such as ``cenic``: all torques. They hold references over a step, and servos act on the state at its end.
    - Engines such as MuJoCo with implicit servos, which are part of its motors: they report the torques of the step
      that ended.
    - All others, servos as blocks, and kinematic stations: none. Blocks compute torques from the present state, and a
      kinematic station has no torques of its own.

    Args:
        ports: ports of the station, with its configuration.
    """
    config = ports.config
    engine = config.engine
    held = []
    for robot in ports.plant.robots.values():
        is_implicit = config.servo_of(robot.name).realization == "implicit"
        if engine.holds_inputs_over_steps or (engine.reports_torques_of_last_step and is_implicit):
            held.append(ports.outputs[f"{robot.prefix}torque"])
    return held


def make_recorder(
    stepper: Stepper,
    whole: ClosedStation,
    *watchers: Callable[[Context], None],
    repeated: RepeatedSteps | None = None,
) -> tuple[Recorder, Watch]:
    """Make the recorder of a run, and the watch that evaluates the station's monitors at the recorded steps.

    The recorder begins with the present state of the simulator. If the station has no monitors, it does not call the
    watch; it still checks now and then that the states have not diverged.

    Args:
        stepper: steps the run.
        whole: the diagram in which the monitors' signals are evaluated.
        watchers: callbacks for the recorder to call after each step.
        repeated: compares the steps that repeat those of an earlier run; None if there are none.
    """
    ports = whole.ports
    sampler = Sampler(whole.diagram, ports, _NO_STATES, context=stepper.user_context)
    held = torques_held_over_steps(ports)
    watch = Watch(ports, sampler, held=held, begins_in_motion=stepper.begins_in_motion)
    # The recorder calls `look` with several steps at a time, which saves time.
    look = watch.look if ports.outputs.monitors else None
    # The comparison comes before the user's callbacks, which must not see steps of a run that is given up.
    compare = [] if repeated is None else [repeated.compare]
    recorder = Recorder(
        stepper.simulator, *watchers, look=look, pace=stepper.pace(), inspect=compare
    )
    return recorder, watch


def _positions_watcher(stepper: Stepper, on_step: OnStep) -> Callable[[Context], None]:
    """Make a callback for the recorder that calls ``on_step`` with the time [s] and the plant's positions (nq,).

    The recorder sees some times more than once: the start of the run, events at the end of a step, and times at which
    the diagram changes. The user's callback gets each time once.
    """
    last_time = -np.inf

    def call_on_step(context: Context) -> None:
        """Callback of the recorder after each step, with the context of the stepped diagram."""
        nonlocal last_time
        if context.get_time() <= last_time:
            return
        last_time = context.get_time()
        # The state of the plant has its positions first.
        ports = stepper.built.ports
        own_context = ports.state.get_system().GetMyContextFromRoot(context)
        state = ports.state.Eval(own_context)
        on_step(context.get_time(), state[: ports.plant.plant.num_positions()])

    return call_on_step


def sample_times(end: float, rate: float, *, begin: float = 0.0) -> Vector:
    """Times of the samples of a run, shape (m,) [s]: evenly spaced, and the start and the end of the run.

    The even times are multiples of the sample time, also for a run that does not begin at 0. A multiple that is at the
    start but for rounding is left out. So the first and the last interval may be shorter than the others.

    Args:
        end: end of the run [s].
        rate: samples per second [Hz].
        begin: start of the run [s].
    """
    # The small part of a sample time keeps rounding from losing a sample at the end.
    intervals = int(np.floor(end * rate + 1e-9))
    # A quotient of integers has one rounding. A sum of periods would collect one with each sample.
    times = np.arange(intervals + 1) / rate
    if begin > 0:
        times = np.append(begin, times[times > begin + _ROUNDING])
    return times if times[-1] >= end else np.append(times, end)


ReferenceLike: TypeAlias = Reference | npt.ArrayLike | Samples
"""A trajectory (n, 1), an array (m, 1 + n) with the time first, or a pair of times (m,) and positions (m, n)."""

ReferencesLike: TypeAlias = ReferenceLike | Mapping[str, ReferenceLike] | None
"""A reference for the only robot, or references by robot. None means the references of the station's file."""


def with_duration(config: StationConfig, duration: Any) -> StationConfig:
    """Change the duration of a configuration.

    Args:
        config: the configuration.
        duration: the new duration [s]. If it is None, the configuration is returned as it is.

    Raises:
        InvalidParameter: the duration is no positive time, or so long that a run would have too many samples or steps.
    """
    if duration is None:
        return config
    changed = config.model_copy(update={"duration": seconds(duration)})
    # The configuration was checked when it was loaded, with its own duration.
    check_effort(changed)
    return changed


def with_pushes(config: StationConfig, pushes: Mapping[str, Any] | None) -> StationConfig:
    """Replace the pushes of a configuration: forces on a body for some time, in its section ``forces``.

    Args:
        config: the configuration.
        pushes: the new pushes by name, each a `Push` or a mapping of its keys. If it is None, the configuration is
            returned as it is. Forces of other kinds stay, but for those whose name a new push has.

    Raises:
        InvalidParameter: a push is invalid, or `pushes` is no mapping.
    """
    if pushes is None:
        return config
    instance(
        pushes,
        "pushes",
        Mapping,
        message("simulation.pushes_by_name", "a mapping of names to pushes"),
    )
    # Springs, drags and sines belong to the station, and act in every run of it.
    forces: dict[str, Any] = {
        name: force for name, force in config.forces.items() if not isinstance(force, Push)
    }
    for name, push in pushes.items():
        key = message("simulation.push_called", "pushes: {name}", name=name)
        if isinstance(push, Push):
            forces[name] = push
            continue
        expected = message(
            "simulation.a_push",
            "a mapping with the keys at, start, duration and force, as under forces: in a station",
        )
        instance(push, key, Mapping, expected)
        try:
            forces[name] = validate_section(Push, {"kind": "push", **push}, key)
        except InvalidConfig as problem:
            # The error names the argument of the function, instead of a file's key.
            wrong = compound(
                "{expected} ({key}: {problem})",
                expected=expected,
                key=problem.key,
                problem=problem.problem,
            )
            raise InvalidParameter(key, quote_value(push), wrong) from None
    return config.model_copy(update={"forces": forces})


def by_robot(config: StationConfig, reference: Any) -> dict[str, Reference | Samples]:
    """Convert the references that a user gives to references by the name of the robot.

    Args:
        config: configuration of the station.
        reference: a `ReferencesLike`, unchecked.

    Returns:
        trajectories, or samples as pairs of times and positions; empty if the user gives no references.

    Raises:
        InvalidParameter: a reference is invalid, or there is a single one for several robots.
        UnknownName: there is no such robot.
    """
    if reference is None:
        return {}
    references = reference
    if not isinstance(reference, Mapping):
        # With several robots, it is not clear which of them the reference is for.
        if config.only_robot is None:
            raise InvalidParameter(
                "reference",
                message("simulation.one_for_all", "one reference for several robots"),
                message(
                    "simulation.mapping_by_robot",
                    "a mapping of robots to references; the robots are {robots}",
                    robots=", ".join(config.robots),
                ),
            )
        references = {config.only_robot: reference}
    return {
        one_of(message("base.robot", "robot"), name, config.robots): _trajectory_or_samples(own)
        for name, own in references.items()
    }


def _trajectory_or_samples(reference: Any) -> Reference | Samples:
    """Check the type and the dimensions of one reference of a user.

    Whether it fits a robot is not checked here, nor whether there are as many positions as times.

    Args:
        reference: a `ReferenceLike`, unchecked.

    Returns:
        a trajectory, or a reference of this package, as it is; arrays as a pair of times and positions [rad or m].

    Raises:
        InvalidParameter: the reference has another type or shape.
    """
    if isinstance(reference, ReferenceSignal):
        return reference
    if isinstance(reference, Trajectory):
        # A trajectory without segments fails an assertion of Drake when its size is read.
        empty = (
            isinstance(reference, PiecewisePolynomial) and reference.get_number_of_segments() < 1
        )
        if empty or not reference.rows() or reference.cols() != 1:
            shape = (
                message("simulation.no_segment", "no segment")
                if empty
                else f"{reference.rows()} x {reference.cols()}"
            )
            raise InvalidParameter(
                "reference",
                message("simulation.trajectory_of", "a trajectory of {shape}", shape=shape),
                message("simulation.of_shape_n_1", "of shape (n, 1), with one row for each axis"),
            )
        return reference
    # A list of two rows is an array, a tuple of two is a pair: so both forms can be told apart.
    is_pair = isinstance(reference, tuple) and len(reference) == 2
    if is_pair:
        times = numbers(reference[0])
        positions = numbers(reference[1])
    else:
        times, positions = _split(numbers(reference))
    if times.ndim != 1 or positions.ndim != 2 or not (times.size and positions.size):
        expected = message(
            "simulation.a_reference",
            "a trajectory, an array (m, 1 + n) whose first column is the time, or a pair of times and positions",
        )
        raise InvalidParameter("reference", quote_value(reference), expected)
    return times, positions


def _split(rows: Vector) -> tuple[Vector, Vector]:
    """Split an array (m, 1 + n) into times (m,) and positions (m, n).

    An array without two dimensions, or without any number, is returned twice, and refused by the caller.
    """
    if rows.ndim != 2 or not rows.size:
        return rows, rows
    return rows[:, 0], rows[:, 1:]
