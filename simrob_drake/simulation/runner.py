"""Run a station: :func:`simulate` runs it once, a :class:`Runner` often, and a :class:`RunBranch` from a common start.

Each of them returns a result, however the run ends. A station's diagrams are built once, and used again by later runs.

A run may *continue* another one as if that had never been stopped: it repeats some recorded steps, its *trace*,
compares them, and goes on. The *origin* of a motion is the run with which it began. A *tick* is a time at which the
solver is initialized again. The decorator `drake_asserts` turns failed assertions of Drake into errors of this package.
"""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, Self, get_args

import numpy as np
from pydrake.systems.framework import LeafSystem

from simrob_drake.base.arguments import drake_asserts, instance, seconds
from simrob_drake.base.errors import InvalidParameter, SimrobError, one_of, quote_value
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import former_argument
from simrob_drake.blocks.references import Reference, Samples
from simrob_drake.parts.controllers import own_blocks
from simrob_drake.parts.controllers.own import (
    OwnController,
    named_blocks,
    output_owners,
    with_driven,
)
from simrob_drake.parts.forces import ForceConfig, Push
from simrob_drake.results.record.rebuilt import fits
from simrob_drake.results.record.run import DIVERGED, FAILED
from simrob_drake.results.record.state import MotionOrigin, State, Trace
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.built import (
    CommandFunctions,
    CommandRelay,
    StationDiagrams,
    functions_of,
)
from simrob_drake.simulation.resume import (
    StepsDiffer,
    continuable_trace,
    is_same_motion,
    other_station,
    restarts_of,
)
from simrob_drake.simulation.run import (
    OnStep,
    ReferencesLike,
    Run,
    by_robot,
    make_recorder,
    with_duration,
    with_pushes,
)
from simrob_drake.simulation.stepping import Outcome, Restart, Stepper, Ticks
from simrob_drake.stations.closed import check_reference, station_references
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.prescribed import alone_on, begin_on_prescribed
from simrob_drake.stations.resolve import check_parts, resolve
from simrob_drake.stations.start_overlap import check_start_overlap
from simrob_drake.stations.station import StationLike, config_of

StartTime = Literal["zero", "keep"]
"""Time at which a run begins: zero, or the time of the state in which it begins."""

Blocks = Sequence[LeafSystem] | Mapping[str, LeafSystem]
"""Blocks of the user's own, in a list or by name."""


class FailedRunWarning(RuntimeWarning):
    """Warns that a run diverged, or that a block failed in it, so that its signals end early."""


@former_argument("config_or_station", "station")
def simulate(
    station: StationLike,
    *,
    overrides: Mapping[str, Any] | None = None,
    reference: ReferencesLike = None,
    duration: float | None = None,
    blocks: Blocks = (),
    start: State | None = None,
    start_time: StartTime = "zero",
    pushes: Mapping[str, Any] | None = None,
    progress: bool = True,
    on_step: OnStep | None = None,
    commands: CommandFunctions | None = None,
    strict: bool = False,
) -> SimulationResult:
    """Run a station and return its result.

    Args:
        station: a station's name or YAML file, the content of such a file as a mapping, its configuration, or a station
            that was built from a configuration. Of such a station only the configuration is used: it is built anew.
        overrides: new values of the station, as :func:`simrob_drake.load_station` takes them.
        reference: desired positions in place of those of the configuration: a trajectory of shape (n, 1), an array
            (m, 1 + n) whose first column is the time, or a pair of times (m,) and positions (m, n); in SI units and
            radians. With several robots, a mapping by robot. Values are joined by straight lines, as in Simulink. In a
            kinematic station they are joined by a smooth curve, since a corner has no acceleration.
        duration: length of the run, in place of that of the configuration [s].
        blocks: LeafSystems of your own, in a list or by name. An input with the name of an output of the station reads
            this output. An output with the name of an input of the station (``reference``, ``feedforward`` ...) drives
            this input, in place of the configuration's source. All other outputs are signals, ``<block>.<output>``.
        start: state in which the station begins, such as the ``final_state`` of another result. Without
            ``start_time``, time begins at zero all the same: references, pushes and programs of controllers begin anew,
            and the configuration's references begin where that run's reference ended.
        start_time: ``keep`` continues the run that ended in ``start`` as if it had never been stopped: time goes on,
            and with it references, pushes and programs. The times of the result are those of the whole motion. The
            motion is equal to the last bit if ``start`` is the final state of a result. A state from a file continues
            the motion within the accuracy of the solver.
        pushes: pushes in place of those of the configuration, by name, as in
            ``{"shove": {"start": 1, "force": [5, 0, 0]}}``.
        progress: whether to show a progress bar on a terminal.
        on_step: callback with the time [s] and the positions of the whole plant (nq,): once at the start, and after
            each accepted step, perhaps a few steps beyond a monitor's stop. Each time comes once. The callback cannot
            change the run. Its exceptions are raised to the caller; KeyboardInterrupt ends the run.
        commands: functions that command walks during the run, by the name of the controller, in place of the commands
            in its section. A function is called with the time [s] after each step. It returns the speeds ahead and to
            the left [m/s] and the turn [rad/s], or None to leave the command as it is. The configuration of the result
            has the commands as a table: a run of it repeats this run to the last bit.
        strict: whether to raise an error if the result has warnings.

    Returns:
        the result, also if a monitor ended the run, if the simulation diverged, or if a block failed.

    Raises:
        SimrobError: the input cannot be run at all.
        VerdictError: with ``strict``, the run has warnings, has diverged, or one of its blocks has failed.
    """
    runner = Runner(station, blocks=blocks, overrides=overrides)
    arguments: dict[str, Any] = {
        "reference": reference,
        "duration": duration,
        "start": start,
        "start_time": start_time,
        "pushes": pushes,
    }
    result = runner.run(
        **arguments, progress=progress, on_step=on_step, commands=commands, strict=strict
    )
    # A script would otherwise go on with the signals of a run that ended early, and nothing would show it.
    if result.ending in (DIVERGED, FAILED):
        text = compound("{station}: {problem}", station=result.config.name, problem=result.message)
        warnings.warn(text, FailedRunWarning, stacklevel=2)
    return result


@dataclass(frozen=True)
class RunPlan:
    """A run that a `Runner` is about to make.

    Attributes:
        config: configuration of the station in this run.
        requested: references that the user gives, by robot.
        begins_in_motion: whether the run continues the motion of another run.
        start: state in which the run begins; None for the initial state of the station.
        begin: start of the run, in simulated time [s].
        end: end of the run [s]; None if it is ``begin`` plus the configuration's duration.
        origins: positions (n,) at which the configuration's references begin, by robot; None for the initial posture.
        ticks: times at which stepping begins anew; None if there are none.
        restart: recorded step of an earlier run at which stepping begins; None if it begins in ``start``.
        origin: the run from which stepping repeats an earlier motion up to ``begin``; None if it does not.
        repeated: the earlier run whose steps are repeated and compared; None if there is none.
        repeated_until: time up to which the steps are those of an earlier run [s].
    """

    config: StationConfig
    requested: Mapping[str, Reference | Samples]
    begins_in_motion: bool
    start: State | None = None
    begin: float = 0.0
    end: float | None = None
    origins: Mapping[str, Vector] | None = None
    ticks: Ticks | None = None
    restart: Restart | None = None
    origin: MotionOrigin | None = None
    repeated: Trace | None = None
    repeated_until: float = -np.inf


@dataclass(frozen=True)
class Callbacks:
    """The user's callbacks while a run is stepped, as in :func:`simulate`."""

    progress: bool = False
    on_step: OnStep | None = None
    commands: CommandFunctions | None = None


class Runner:
    """A station that is built once and run often: each run is that of :func:`simulate`, to the last bit.

    Attributes:
        config: the station.
    """

    def __init__(
        self,
        station: StationLike,
        *,
        blocks: Blocks = (),
        overrides: Mapping[str, Any] | None = None,
    ) -> None:
        """Take a station, blocks and overrides as :func:`simulate` does; its diagrams are built when first needed.

        Raises:
            SimrobError: there is no such station, an override is invalid, or a value in `blocks` is no LeafSystem.
        """
        self.config = config_of(station, overrides)
        # Controllers of the kind `python` are blocks of the user's own, too, from code that the station's file names.
        made = own_blocks(self.config.controllers)
        self._user_blocks = blocks
        self._blocks = {**made, **named_blocks(blocks)}
        # Inputs of the station that blocks drive, in place of the configuration's sources.
        self._driven = output_owners(self._blocks)
        inputs = with_driven(self.config.inputs, self._blocks)
        # If nothing changes, the same object is resolved: the result is known since it was loaded, so this takes no
        # time.
        is_same = inputs == self.config.inputs
        self._station = resolve(
            self.config if is_same else self.config.model_copy(update={"inputs": inputs})
        )
        self._diagrams: dict[Any, StationDiagrams] = {}
        # Runner that continued a commanded run with this one's blocks, see `resume`; None if there is none.
        self._of_commanded: Runner | None = None
        self._is_running = False

    def __repr__(self) -> str:
        return f"<Runner of {self.config!r}>"

    def like(self, config: StationConfig) -> Self | None:
        """Make a runner of another station that uses the diagrams of this one, or return None if they do not fit.

        The stations may differ in the references of robots, but not in those of prescribed axes; in the times and the
        forces of pushes; in start, duration, sample rate, name and description. The diagrams of a runner with blocks
        of the user's own never fit.

        Args:
            config: the other station.
        """
        if self._blocks or _without_playable_keys(config) != _without_playable_keys(self.config):
            return None
        # The shallow copy shares the diagrams.
        other = copy(self)
        other.config = config
        own_config = config.model_copy(update={"inputs": self._station.config.inputs})
        other._station = replace(self._station, config=own_config)
        return other

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Refuse a second run while one is under way: both would use the same diagrams.

        Raises:
            SimrobError: a run is under way, in another thread or in a callback of this one.
        """
        if self._is_running:
            raise SimrobError(
                message(
                    "simulation.one_run_at_a_time",
                    "a Runner makes one run at a time; create a Runner for each thread",
                )
            )
        self._is_running = True
        try:
            yield
        finally:
            self._is_running = False

    @drake_asserts()
    def run(
        self,
        *,
        reference: ReferencesLike = None,
        duration: float | None = None,
        start: State | None = None,
        start_time: StartTime = "zero",
        pushes: Mapping[str, Any] | None = None,
        progress: bool = False,
        on_step: OnStep | None = None,
        commands: CommandFunctions | None = None,
        ticks: Ticks | None = None,
        strict: bool = False,
    ) -> SimulationResult:
        """Run the station, and return the result that :func:`simulate` gives.

        Args:
            reference: in place of the configuration's: a trajectory of shape (n, 1), an array (m, 1 + n) whose first
                column is the time, or a pair of times (m,) and positions (m, n); in SI units and radians. With several
                robots, a mapping by robot.
            duration: length of the run, in place of the configuration's [s].
            start: state in which the station begins, such as the ``final_state`` of another result; None for the
                configuration's own start.
            start_time: ``zero`` begins at 0 s, with references and pushes anew. ``keep`` continues the run that ended
                in ``start``, at its time.
            pushes: in place of the configuration's, by name, as in ``{"shove": {"start": 1, "force": [5, 0, 0]}}``.
            progress: show a bar on a terminal. It is off by default, since a runner makes many runs.
            on_step: callback with the time [s] and the positions of the whole plant (nq,): once at the start, and
                after each accepted step.
            commands: functions of the time [s] that command walks during the run, by the name of the controller.
            ticks: evenly spaced times at which stepping begins anew, and may end; None if there are none.
            strict: raise an error if the result has warnings.

        Raises:
            SimrobError: input that cannot be run at all.
            VerdictError: with ``strict``, a run that has warnings, diverged, or in which a block failed.
        """
        # All arguments are checked before a diagram is built, which takes seconds.
        config = with_pushes(with_duration(self.config, duration), pushes)
        check_callback(on_step)
        requested = by_robot(config, reference)
        keeps_time = one_of("start_time", start_time, get_args(StartTime)) == "keep"
        # A start that the caller or the station gives continues another run, so the run begins in motion. This is
        # decided here, because _start_of() below also makes a start for a robot with prescribed axes.
        first_state = _checked_start(config, start)
        plan = RunPlan(config, requested, begins_in_motion=first_state is not None, ticks=ticks)
        if keeps_time:
            if first_state is None:
                raise InvalidParameter(
                    "start_time",
                    quote_value("keep"),
                    message(
                        "simulation.keep_needs_start",
                        "used with a start whose time is kept, such as result.final_state",
                    ),
                )
            # The references go on from where they began in the run that ended in this state.
            origins = first_state.origins or None
            plan = replace(plan, start=first_state, begin=first_state.time, origins=origins)
        else:
            start = self._start_of(config, first_state)
            plan = replace(plan, start=start, origins=_origins(start))
        # The callbacks are not part of the plan: the same plan may be run in several attempts.
        callbacks = Callbacks(progress=progress, on_step=on_step, commands=commands)
        trace = first_state.valid_trace if keeps_time and first_state is not None else None
        # Only the final state of a result has recorded steps. A state from a file begins a new motion at its time. So
        # does a state whose steps cannot be repeated.
        result = self._continue(plan, callbacks, trace) if trace is not None else None
        if result is None:
            result = self._run(plan, callbacks)
        return result.check(strict)

    @drake_asserts()
    def resume(
        self,
        result: SimulationResult,
        *,
        until: float,
        progress: bool = False,
        on_step: OnStep | None = None,
        strict: bool = False,
    ) -> SimulationResult:
        """Continue a run as if it had never been stopped, with its references, pushes, programs and commands.

        Args:
            result: a run of this station that was completed, or interrupted by the user. It may come from another
                process, by pickle.
            until: end of the run [s]. It is later than that of ``result``.
            progress: show a bar on a terminal.
            on_step: callback with the time [s] and the positions of the whole plant (nq,), after each accepted step
                after the end of ``result``.
            strict: raise an error if the result has warnings.

        Returns:
            the whole run, from the start of ``result``: equal, to the last bit, to a run that was not stopped. A solver
            that keeps more than its state and the length of its steps, such as ``radau3``, may have to step again from
            the start for that.

        Raises:
            InvalidParameter: the run cannot be continued, is of another station, or ended at ``until`` or later.
            SimrobError: functions commanded the run, and the blocks that this Runner was given are in use already: then
                a Runner with new blocks can continue the run. Otherwise as :func:`simulate`.
            VerdictError: as :func:`simulate`.
        """
        expected = message("simulation.a_result", "a result of simulate() or of a Runner")
        trace = continuable_trace(instance(result, "result", SimulationResult, expected))
        check_callback(on_step)
        # The end is that of the whole motion, not the length of what is added.
        end = seconds(until, "until")
        if end <= result.stop_time:
            later = message(
                "simulation.later_than",
                "later than the end of the run, {end:g} s",
                end=result.stop_time,
            )
            raise InvalidParameter("until", compound("{until:g} s", until=end), later)
        # The commands of the earlier run are in the configuration of its controllers. Controllers are built into the
        # diagrams, so it takes a Runner with this configuration, and diagrams of its own, to repeat the commands.
        if result.commanded:
            is_in_use = any(runner._diagrams for runner in (self, self._of_commanded) if runner)
            if self._user_blocks and is_in_use:
                text = message(
                    "simulation.commanded_needs_new_blocks",
                    "a block can be in one diagram only: to resume a run that functions commanded needs a Runner with "
                    "new blocks",
                )
                raise SimrobError(text)
            commanded = {name: result.config.controllers[name] for name in result.commanded}
            controllers = {**self.config.controllers, **commanded}
            runner = type(self)(
                self.config.model_copy(update={"controllers": controllers}),
                blocks=self._user_blocks,
            )
            if self._user_blocks:
                self._of_commanded = runner
            # The new Runner has the commands in its configuration, so this is a run without functions for it.
            resumed = runner.resume(
                replace(result, commanded=()),
                until=end,
                progress=progress,
                on_step=on_step,
                strict=strict,
            )
            return replace(resumed, commanded=result.commanded)
        config = with_duration(self.config, end - result.start_time)
        # The earlier run may have had pushes of its own, see `run`.
        config = config.model_copy(update={"forces": result.config.forces})
        plan = RunPlan(
            config,
            result.references,
            begins_in_motion=trace.origin.begins_in_motion,
            start=result.start,
            begin=result.start_time,
            end=end,
            origins=result.final_state.origins or None,
            repeated_until=result.stop_time,
        )
        callbacks = Callbacks(progress=progress, on_step=on_step)
        whole = self._continue(plan, callbacks, trace)
        if whole is None:
            raise InvalidParameter("result", *other_station(config))
        # The result is that of the whole motion, and so is the time for stepping it.
        elapsed = result.stepping_time + whole.stepping_time
        return replace(whole, stepping_time=elapsed).check(strict)

    def _continue(
        self, plan: "RunPlan", callbacks: "Callbacks", trace: Trace
    ) -> SimulationResult | None:
        """Run a plan from recorded steps of an earlier run, which are repeated and compared.

        Args:
            plan: the run.
            callbacks: the user's callbacks.
            trace: the earlier run.

        Returns:
            the result, or None if nothing repeats the recorded steps to the last bit, since the station is another one.
        """
        # Callbacks have seen these steps already.
        repeated_until = max(trace.history.end, plan.repeated_until)
        plan = replace(plan, repeated=trace, repeated_until=repeated_until)
        attempts = [replace(plan, restart=restart) for restart in restarts_of(trace, plan.config)]
        # The last resort is to step the whole motion again. It takes as long as the earlier run did.
        if is_same_motion(trace.origin.config, plan.config):
            attempts.append(replace(plan, origin=trace.origin))
        for attempt in attempts:
            with suppress(StepsDiffer):
                return self._run(attempt, callbacks)
        return None

    def _run(self, plan: "RunPlan", callbacks: "Callbacks") -> SimulationResult:
        """Run a plan once, see :meth:`_run_alone`.

        Raises:
            SimrobError: another run is under way.
        """
        with self._alone():
            return self._run_alone(plan, callbacks)

    def _run_alone(self, plan: "RunPlan", callbacks: "Callbacks") -> SimulationResult:
        """Run a plan once, while no other run uses the diagrams.

        Args:
            plan: the run. With a restart, stepping begins at a recorded step of an earlier run; with an origin, at the
                start of the run with which the motion began.
            callbacks: the user's callbacks.

        Returns:
            The result. Its configuration names the user's blocks, and contains the commands of the run.

        Raises:
            StepsDiffer: the steps that the run repeats are not the recorded ones, or the recorded states do not fit the
                diagram.
        """
        config = plan.config
        restart = plan.restart
        # The run itself is the first one of its motion, unless it repeats an earlier run from its origin.
        origin = plan.origin or MotionOrigin(config, plan.start, plan.begin, plan.begins_in_motion)
        # A relay passes commands to controllers: those of the user's functions, and those of the repeated motion.
        relay = CommandRelay(config, callbacks.commands, begin=plan.begin)
        earlier_relay = CommandRelay(config, functions_of(origin.commands), begin=origin.begin)
        end = plan.begin + config.duration if plan.end is None else plan.end
        diagrams = self._diagrams_for(
            config, plan.requested, plan.origins, steps_whole=plan.ticks is not None, end=end
        )
        # The diagrams may play other references by the time at which signals are evaluated.
        references = diagrams.references
        # The states were recorded in another diagram, with other states: they could not even be copied.
        if restart is not None and not fits(restart.history, diagrams.whole):
            raise StepsDiffer
        stepper = Stepper(
            config,
            diagrams.diagram_at,
            diagrams.edges,
            blocks=self._blocks,
            begin=origin.begin,
            end=end,
            ticks=plan.ticks,
            begins_in_motion=origin.begins_in_motion,
            restart=restart,
        )
        context = stepper.simulator.get_mutable_context()
        # With a restart, the context is already in a recorded state of the run.
        if restart is None:
            # Only the initial state of a station is checked: a state that was reached in a run may have deep contacts.
            # A station with prescribed axes has a start in any case, see _start_of(), and is not checked.
            if origin.start is None:
                check_start_overlap(config, stepper.built.ports, context)
            else:
                origin.start.put(stepper.built.diagram, stepper.built.ports, context)
        whole = diagrams.whole
        run = Run(
            config,
            whole,
            stepper,
            # Before and after signals are evaluated: restore the references in the whole diagram, and remove them.
            lambda: whole.play(references, config.forces),
            diagrams.forget,
            begin=plan.begin,
            restart=restart,
            repeated=plan.repeated,
            repeated_until=plan.repeated_until,
            origin=origin if plan.repeated is None else plan.repeated.origin,
            origins=dict(plan.origins or {}),
        )
        # The result's configuration names the user's blocks, so that plots and summaries can show them.
        blocks = {name: OwnController.of(block) for name, block in self._blocks.items()}
        controllers = {
            **config.controllers,
            **{name: blocks[name] for name in blocks if name not in config.controllers},
        }
        pass_commands = (
            (lambda context: relay.pass_on(stepper.built.diagram, context))
            if callbacks.commands
            else None
        )
        # Only a motion that is repeated from its start needs its commands again. A restart's state contains them.
        repeat_commands = (
            (lambda context: earlier_relay.pass_on(stepper.built.diagram, context))
            if origin.commands
            else None
        )
        result = run.result(
            progress=callbacks.progress,
            on_step=callbacks.on_step,
            references=dict(plan.requested),
            start=plan.start,
            pass_commands=pass_commands,
            repeat_commands=repeat_commands,
        )
        config = relay.config_with_commands(
            result.config.model_copy(update={"controllers": controllers})
        )
        trace = result.trace
        # A run that is continued from the start of this motion needs its commands, too. If the motion began in an
        # earlier run, the configuration of that run stays. So does the trace of the final state: a run that begins
        # in this state does not repeat the commands.
        if trace is not None and plan.repeated is None:
            commanded = relay.config_with_commands(trace.origin.config)
            own_origin = replace(trace.origin, config=commanded, commands=relay.commands)
            trace = replace(trace, origin=own_origin)
        return replace(result, config=config, commanded=tuple(relay.commands), trace=trace)

    @drake_asserts()
    def ports(self, *, watched: bool = False) -> StationPorts:
        """Return the ports of the diagram in which the signals of the runs are evaluated. It is built if needed.

        Runs use this diagram unless their references are of other kinds, or their pushes at other places, than those of
        the configuration.

        Args:
            watched: whether the runs have ticks, so that this diagram is stepped, too.

        Raises:
            SimrobError: the station cannot be built, see :func:`simulate`.
        """
        start = self._start_of(self.config, None)
        diagrams = self._diagrams_for(self.config, {}, _origins(start), steps_whole=watched)
        return diagrams.whole.ports

    @drake_asserts()
    def branch(self, at: float, *, reference: ReferencesLike = None) -> "RunBranch":
        """Run the station up to a time, from which runs with other pushes go on.

        Args:
            at: the time [s]: after the start of the run, and not after the start of the pushes.
            reference: as in :func:`simulate`.

        Raises:
            InvalidParameter: the time is not within the run.
            SimrobError: input that cannot be run at all.
        """
        config = self.config
        # A branch at an end of the run would have nothing before it, or nothing after it.
        if not 0 < at < config.duration:
            raise InvalidParameter(
                "at",
                at,
                message(
                    "simulation.moment_within_run",
                    "a time within the run, greater than 0 and less than {duration:g} s",
                    duration=config.duration,
                ),
            )
        start = self._start_of(config, None)
        diagrams = self._diagrams_for(config, by_robot(config, reference), _origins(start))
        begins_in_motion = _checked_start(config, None) is not None
        return RunBranch(
            self, reference, at, diagrams, self._blocks, start, begins_in_motion=begins_in_motion
        )

    def fork(self, at: float, *, reference: ReferencesLike = None) -> "RunBranch":
        """Former name of :meth:`branch`. It goes in 0.2."""
        text = message(
            "simulation.fork_is_branch",
            "Runner.fork() is now Runner.branch(); the former name is removed in 0.2",
        )
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return self.branch(at, reference=reference)

    @drake_asserts()
    def check(self, reference: ReferencesLike = None) -> None:
        """Check the start and the references of a run without doing it. Diagrams are built only for a given start.

        Args:
            reference: as in :func:`simulate`.

        Raises:
            SimrobError: the state at the start cannot be read or does not fit the station, or a robot cannot follow its
                reference.
        """
        start = _checked_start(self.config, None)
        self._check_references(self.references(reference, start), self.config.duration)
        if start is not None:
            diagrams = self._diagrams_for(
                self.config, by_robot(self.config, reference), _origins(start)
            )
            # Putting the state into a context finds states that do not fit. No step is made.
            built = diagrams.diagram_at(0.0)
            start.put(built.diagram, built.ports, built.diagram.CreateDefaultContext())

    def references(self, reference: ReferencesLike, start: State | None) -> dict[str, Reference]:
        """Find the reference of each robot in a run that begins in a state, by the robot's name.

        Args:
            reference: references of the user, as in :func:`simulate`. Robots without one follow those of the station's
                configuration.
            start: the state; None for the initial state of the station.

        Raises:
            SimrobError: a reference does not fit its robot.
        """
        return station_references(self._station, by_robot(self.config, reference), _origins(start))

    def _start_of(self, config: StationConfig, start: State | None) -> State | None:
        """Find the state in which a run begins, with prescribed axes on their references.

        A prescribed axis follows a reference of the station exactly, whatever forces act.

        Args:
            config: configuration of the station in this run.
            start: state that the user gives; None for the station's own start.

        Returns:
            the state. It is None if no state is given and no axis is prescribed: the run then begins in the initial
            state of the station.
        """
        checked = _checked_start(config, start)
        robots = self._station.robots
        if not any(robot.prescribed for robot in robots.values()):
            return checked
        rest = {name: np.zeros(len(robot.axes)) for name, robot in robots.items()}
        initial = {name: robot.initial for name, robot in robots.items()}
        # Prescribed axes may move at the start, so even the station's own start needs a state with their velocities.
        state = checked or State(initial, rest, initial)
        for name, robot in robots.items():
            positions = state.positions.get(name, robot.initial)
            velocities = state.velocities.get(name, rest[name])
            state = state.with_axes(robot, *begin_on_prescribed(robot, positions, velocities))
        return state

    def _diagrams_for(
        self,
        config: StationConfig,
        requested: Mapping[str, Reference | Samples],
        origins: Mapping[str, Vector] | None,
        *,
        steps_whole: bool = False,
        end: float | None = None,
    ) -> StationDiagrams:
        """Find or make the diagrams for a run, and give them its references and pushes.

        Building diagrams takes much longer than a short run, so those of earlier runs are used again if they differ in
        nothing but trajectories and the times and sizes of pushes.

        Args:
            config: configuration of the station in this run.
            requested: references that the user gives, by robot.
            origins: positions (n,) at which the configuration's references begin, by robot; None for the initial
                posture.
            steps_whole: whether to step the whole diagram, see :class:`StationDiagrams`; it has ticks then.
            end: end of the run, up to which references are checked [s]; None if it is the configuration's duration.

        Raises:
            SimrobError: a reference does not fit its robot, or blocks of the user's own would be in two diagrams.
        """
        references = station_references(self._station, requested, origins)
        self._check_references(references, config.duration if end is None else end)
        key = (steps_whole, *_force_places(config))
        diagrams = self._diagrams.get(key)
        if diagrams is None or not diagrams.fits(references):
            # Drake lets a block be in one diagram only, and the earlier diagram has it.
            if self._diagrams and self._blocks:
                text = message(
                    "simulation.blocks_in_one_diagram",
                    "a block can be in one diagram only: pushes at other places, and sine "
                    "references, need a Runner with new blocks",
                )
                raise SimrobError(text)
            station = self._station
            # Pushes at other places may name bodies that do not exist.
            if config.forces != self.config.forces:
                station = resolve(station.config.model_copy(update={"forces": config.forces}))
                check_parts(station)
            diagrams = StationDiagrams(station, references, self._blocks, steps_whole=steps_whole)
            self._diagrams[key] = diagrams
        diagrams.play(references, config.forces)
        return diagrams

    def _check_references(self, references: Mapping[str, Reference], end: float) -> None:
        """Check that robots can follow their references, and axes those that the station prescribes.

        Args:
            references: reference of each robot, by the robot's name.
            end: end of the run [s]. References are checked from the time 0, also for a run that begins later.

        Raises:
            SimrobError: a reference does not fit its robot.
        """
        for robot in self._station.robots.values():
            # A block of the user's own takes the place of this reference, which then moves nothing.
            if f"{robot.prefix}reference" not in self._driven:
                check_reference(robot, references[robot.name], end)
            # Axes whose references the station prescribes, by their index.
            for axis, reference in robot.prescribed.items():
                check_reference(alone_on(robot, axis), reference, end)


class _ForcePlace(NamedTuple):
    """Part of a force that is built into a diagram: its name, its kind, and the body or robot on which it acts.

    ``at`` is None for the only robot.
    """

    name: str
    kind: str
    at: str | None


def _force_places(config: StationConfig) -> list[_ForcePlace]:
    """Places of a station's forces. Forces with other places need another diagram; their times and sizes do not."""
    return [_ForcePlace(name, force.kind, force.at) for name, force in config.forces.items()]


def _without_playable_keys(config: StationConfig) -> StationConfig:
    """Copy a configuration without the keys that its diagrams do not depend on.

    Two configurations whose copies are equal can use the same diagrams: references of robots, and times and forces of
    pushes, are given to them for each run; duration, sample rate and start belong to the run. References of prescribed
    axes are built into the diagrams, so these keys are kept.
    """
    # A robot may have a reference section of its own.
    robots = {
        name: robot.model_copy(update={"reference": None}) for name, robot in config.robots.items()
    }
    forces = dict(config.forces)
    for name, force in config.forces.items():
        if isinstance(force, Push):
            forces[name] = force.model_copy(update={"start": 0.0, "duration": 0.0, "force": ()})
    ignored = {
        "reference": None,
        "duration": 0.0,
        "sample_rate": 0.0,
        "start": None,
        "name": "",
        "description": "",
    }
    return config.model_copy(update={**ignored, "robots": robots, "forces": forces})


def check_callback(on_step: OnStep | None) -> None:
    """Check the user's callback after each step. It may be None.

    Raises:
        InvalidParameter: it cannot be called.
    """
    if on_step is not None and not callable(on_step):
        expected = message(
            "simulation.function_of_time_and_positions", "a function of time and positions"
        )
        raise InvalidParameter("on_step", on_step, expected)


def _origins(start: State | None) -> dict[str, Vector] | None:
    """Positions (n,) [rad or m] at which the configuration's references begin in a run from a state, by robot.

    The run begins anew, at the time 0: its references begin where those of the run before ended. Without a state the
    result is None, for the initial postures.
    """
    return start.references if start else None


def _checked_start(config: StationConfig, start: State | None) -> State | None:
    """Check the state in which a run begins.

    Args:
        config: configuration of the station, which may name a file with a state.
        start: state that the user gives; None for that of the configuration.

    Returns:
        the state, or None if neither gives one.

    Raises:
        InvalidParameter: the value is no State, or has values that are no finite numbers.
        InvalidConfig: the file of the configuration cannot be read, or holds no state.
    """
    if start is None:
        return State.at_start_of(config)
    check_state(start)
    return start


def check_state(start: State) -> None:
    """Check the state in which a run should begin.

    Raises:
        InvalidParameter: it is no State, or has values that are no finite numbers.
    """
    expected = message("simulation.a_state", "a State, such as the final_state of a result")
    instance(start, "start", State, expected).check()


class RunBranch:
    """A run up to a time, and several runs with different pushes that continue it.

    The time before the branch is stepped once for all calls of :meth:`outcome`, and once more by the first call of
    :meth:`run`. Under ``cenic`` and discrete solvers, a continued run is equal to a run with the same pushes from the
    start, to the last bit.

    Attributes:
        at: time of the branch [s].
        begun: how the run up to the branch ended. Its ``ending`` is ``completed`` if nothing ended it before.
    """

    def __init__(
        self,
        runner: Runner,
        reference: ReferencesLike,
        at: float,
        diagrams: StationDiagrams,
        blocks: Mapping[str, LeafSystem],
        start: State | None,
        *,
        begins_in_motion: bool,
    ) -> None:
        """Step a station up to the time of the branch.

        Args:
            runner: runs the station.
            reference: references of the user, as in :func:`simulate`.
            at: time of the branch [s].
            diagrams: diagrams of the station, which play its references and pushes.
            blocks: the user's own blocks, by name.
            start: state in which the run begins, or None for the initial state of the station.
            begins_in_motion: whether the run continues the motion of another run.
        """
        self.at = at
        self._runner = runner
        self._user_reference = reference
        self._config = runner.config
        self._diagrams = diagrams
        self._blocks = blocks
        self._references = diagrams.references
        self._origins = _origins(start)
        # The run up to the branch, with signals. It is made when it is needed: `outcome` needs no signals.
        self._trunk: SimulationResult | None = None
        config_until_branch = self._config.model_copy(update={"duration": at})
        self._stepper = self._make_stepper(
            config_until_branch, diagrams, begins_in_motion=begins_in_motion
        )
        if start is not None:
            built = self._stepper.built
            start.put(built.diagram, built.ports, self._stepper.simulator.get_mutable_context())
        self.begun = self._outcome(self._stepper, diagrams)

    @drake_asserts()
    def outcome(self, pushes: Mapping[str, Any]) -> Outcome:
        """Step on under pushes, and return how the run ends. No signals are computed.

        If the run ended before the branch, this end is returned.

        Args:
            pushes: pushes that begin at the time of the branch or later, by name, as in :meth:`run`. They take the
                place of all pushes of the station, also of those that began before the branch and still act.

        Raises:
            InvalidParameter: a push that cannot be, or that begins before the branch.
            SimrobError: the pushes have other names or places than those of the station, and the runner has blocks of
                the user's own, which can be in one diagram only.
        """
        # The run ended before the branch, whatever the pushes after it.
        if self.begun.ending != "completed":
            return self.begun
        config = with_pushes(self._config, pushes)
        self._check_times(pushes or {}, config.forces)
        diagrams = self._diagrams_with(config)
        reached = self._stepper.simulator.get_context()
        return self._outcome(self._make_stepper(config, diagrams, reached=reached), diagrams)

    def _diagrams_with(self, config: StationConfig) -> StationDiagrams:
        """Find or make the diagrams that play the references of the branch and the forces of a configuration."""
        if _force_places(config) == _force_places(self._config):
            # The diagrams may have played the pushes of another branch since.
            self._diagrams.play(self._references, config.forces)
            return self._diagrams
        # They have the same states as those of the branch, since a push has no state. They play the references that the
        # user gave for the branch, from the same positions.
        requested = by_robot(config, self._user_reference)
        return self._runner._diagrams_for(config, requested, self._origins)

    @drake_asserts()
    def run(
        self,
        *,
        pushes: Mapping[str, Any] | None = None,
        progress: bool = False,
        on_step: OnStep | None = None,
        strict: bool = False,
    ) -> SimulationResult:
        """Run on under pushes, and return the whole run with its signals.

        The first call runs the time before the branch once more, with signals, and keeps this run for later calls.

        Args:
            pushes: pushes that begin at the time of the branch or later, by name, as in
                ``{"shove": {"start": 1, "force": [5, 0, 0]}}``. They take the place of the station's own ones of these
                times. If it is None, the station's own ones act.
            progress: show a bar on a terminal.
            on_step: callback with the time [s] and the positions of the whole plant (nq,), after each accepted step
                after the branch.
            strict: raise an error if the result has warnings.

        Raises:
            InvalidParameter: a push that cannot be, or that begins before the branch.
            SimrobError, VerdictError: as :meth:`Runner.run`.
        """
        if self._trunk is None:
            self._trunk = self._runner.run(reference=self._user_reference, duration=self.at)
        trunk = self._trunk
        # A run that ended before the branch is the whole run. Each run of a Runner has recorded states.
        if trunk.ending != "completed" or trunk.trace is None:
            return trunk.check(strict)
        # The new pushes begin at the branch or later, so a run with them is the same up to the branch. The recorded run
        # gets their configuration, and is resumed with it.
        forces = self._forces(pushes)
        origin = trunk.trace.origin
        pushed_origin = replace(origin, config=origin.config.model_copy(update={"forces": forces}))
        pushed = replace(
            trunk,
            config=trunk.config.model_copy(update={"forces": forces}),
            trace=replace(trunk.trace, origin=pushed_origin),
        )
        return self._runner.resume(
            pushed, until=self._config.duration, progress=progress, on_step=on_step, strict=strict
        )

    def _forces(self, pushes: Mapping[str, Any] | None) -> dict[str, ForceConfig]:
        """Forces of a run that goes on from the branch, by name: the station's own ones before it, and the pushes.

        Args:
            pushes: the pushes from the branch on; None for the station's own ones.

        Raises:
            InvalidParameter: a push that cannot be, or that begins before the branch.
        """
        own_forces = self._config.forces
        if pushes is None:
            return dict(own_forces)
        earlier = {
            name: force
            for name, force in own_forces.items()
            if isinstance(force, Push) and force.start < self.at
        }
        forces = with_pushes(self._config, pushes).forces
        self._check_times(pushes, forces)
        return {**earlier, **forces}

    def _check_times(self, pushes: Mapping[str, Any], forces: Mapping[str, ForceConfig]) -> None:
        """Check that pushes begin at the time of the branch or later.

        Args:
            pushes: the pushes by name, as the user gave them.
            forces: all forces by name, with these pushes.

        Raises:
            InvalidParameter: a push begins before the branch.
        """
        # The run up to the branch was stepped without the new pushes, so these cannot begin before.
        for name in pushes:
            push = forces[name]
            if isinstance(push, Push) and push.start < self.at:
                raise InvalidParameter(
                    message("simulation.push_called", "pushes: {name}", name=name),
                    message("simulation.push_at_time", "a push at {start:g} s", start=push.start),
                    message(
                        "simulation.push_after_branch",
                        "a push at {at:g} s, the time of the branch, or later",
                        at=self.at,
                    ),
                )

    def _make_stepper(
        self, config: StationConfig, diagrams: StationDiagrams, **more: Any
    ) -> Stepper:
        """Make a stepper of diagrams of the station. The other arguments are those of :class:`Stepper`."""
        return Stepper(config, diagrams.diagram_at, diagrams.edges, blocks=self._blocks, **more)

    def _outcome(self, stepper: Stepper, diagrams: StationDiagrams) -> Outcome:
        """Step to the end of the stepper's run, and evaluate its monitors. Returns how it ended.

        Args:
            stepper: steps one of the diagrams.
            diagrams: the diagrams, of which the whole one has the monitors' signals.
        """
        recorder, watch = make_recorder(stepper, diagrams.whole)
        return stepper.run(recorder, watch)


Fork = RunBranch
"""Former name of `RunBranch`. Until 0.2."""
