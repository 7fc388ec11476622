"""Step a station through a run, and describe how the run ended.

An *edge* is a time at which a step of the solver must end, such as the start of a push. The diagram that is stepped may
change at an edge; all diagrams of a run have the same states. A *tick* is a time at which the solver is initialized
again, see `Ticks`. A *block of the user's own* is a LeafSystem that the caller adds to the diagram. A *recorder* is
called by the simulator after each step and keeps the state; a *watch* evaluates the station's monitors, which may end
the run. ``cenic`` is a scheme of Drake that holds inputs, such as references, constant over a step.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from traceback import walk_tb
from types import FrameType

import numpy as np
from pydrake.systems.analysis import Simulator, SimulatorStatus
from pydrake.systems.framework import Context, LeafSystem

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import Message, compound, message, message_of
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.blocks.sampled import BlockFails
from simrob_drake.parts.forces import ForceConfig
from simrob_drake.results.record.history import FlightCheck, Recorder, StateHistory
from simrob_drake.results.record.run import DIVERGED, INTERRUPTED, Ending
from simrob_drake.results.record.signals import Watch
from simrob_drake.results.record.state import State
from simrob_drake.simulation.pace import CHECKS_KEPT, Flight, creeping
from simrob_drake.stations.closed import ClosedStation
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.steps import controlled_by, likely_cause, set_solver, stepped_by

_ROUNDING = 1e-9
"""Times that differ by less are equal [s]."""

# Drake raises RuntimeError and SystemExit when a solver fails, never one of these.
_PROGRAMMING_ERRORS = (TypeError, AttributeError, NameError, LookupError)
"""Classes of errors that come from faulty code, not from a solver."""

_ENDED = SimulatorStatus.ReturnReason.kReachedTerminationCondition
"""Drake's reason for a run that a monitor, or the recorder, has ended."""


@dataclass(frozen=True)
class Moment:
    """A station in the middle of a run. Valid only until the run continues, so do not keep it."""

    time: float
    """Simulated time [s]."""
    _built: ClosedStation
    """The diagram that is stepped, with the station."""
    _context: Context
    """Context of this diagram."""

    def value(self, output: str) -> Vector:
        """Present value of an output of the station by its name, such as ``position``."""
        return self._built.ports.outputs.value(output, self._context)

    def play_forces(self, forces: Mapping[str, ForceConfig]) -> None:
        """Replace pushes and drags of the station by others of the same names and places, from now on.

        Forces that are not named stay, and names that the station does not have are ignored.
        """
        self._built.play_forces(forces)

    def state(self) -> State:
        """The whole state of the station, from which another run can begin."""
        return State.of(self._built.diagram, self._built.ports, self._context)


@dataclass(frozen=True)
class Ticks:
    """Evenly spaced times of a run at which the solver is initialized again.

    There the solver forgets what it learned from earlier steps, so the rest of the run depends on the state only. A run
    can be repeated from each tick, or ended at a tick and continued by another run, with results that are equal to the
    last bit.

    Attributes:
        every: time between two ticks [s].
        tell: callback for each tick that is reached, before the run continues, and for the planned end of the run. It
            returns True to end the run. It is not called at a tick at which a monitor ends the run.
    """

    every: float
    tell: Callable[[Moment], bool] = lambda moment: False

    def times(self, end: float, edges: Sequence[float]) -> list[float]:
        """Times of the ticks in a run, and of its end [s].

        The first tick is one interval after the time 0. A tick, or the end, that differs from an edge by rounding gets
        exactly the time of the edge.

        Args:
            end: end of the run [s].
            edges: times of the edges [s]. There may be none.
        """
        # The end of the run is added below: rounding must not add a tick just before it.
        count = int(np.ceil(end / self.every - _ROUNDING))
        # Rounding to a picosecond makes a product such as 3 * 0.1 equal to the time that a file writes, 0.3.
        ticks = [round(self.every * number, 12) for number in range(1, count)]
        # Infinity is an edge that is near to no time, for the case that there are no edges.
        known = np.array([np.inf, *edges])
        times = []
        for time in [*ticks, end]:
            nearest_edge = known[np.abs(known - time).argmin()]
            # Two stops that differ by rounding would have a step of 1e-16 s between them.
            is_edge = abs(nearest_edge - time) < _ROUNDING
            times.append(float(nearest_edge) if is_edge else time)
        return times


@dataclass(frozen=True)
class Restart:
    """A recorded step of a run, at which stepping begins again.

    Attributes:
        history: recorded states.
        row: row of the step in the history.
        first_step: length of the next step that the solver tries [s]; None for the solver's own choice.
        check: the check of flight at the end of this step, see `Flight`; None if there was none.
    """

    history: StateHistory
    row: int
    first_step: float | None = None
    check: FlightCheck | None = None

    @property
    def time(self) -> float:
        """Time of the step [s]."""
        return float(self.history.times[self.row])


@dataclass(frozen=True)
class Outcome:
    """Description of the end of a run.

    Attributes:
        ending: how the run ended.
        stopped_by: name of the monitor or block that ended the run, or of the function in which an error of Python code
            was raised; "diverged" or "interrupted"; None if the run was completed.
        message: how and why the run ended, in words.
    """

    ending: Ending
    stopped_by: str | None
    message: str


class Stepper:
    """Steps a station from edge to edge; its diagram may change at each edge.

    A call to advance the simulator goes from one edge to the next, and nowhere else: a step of the solver ends where
    such a call ends, so more calls would change the result.

    Attributes:
        built: the diagram that is stepped now, with the station.
        begin: time at which stepping begins [s].
        end: planned end of the run [s].
        begins_in_motion: whether the run continues the motion of another run or of another stepper.
        shortened: how often the solver tried a step again with a shorter length; None if all steps have one length.
        user_context: the caller's context, which the run advances; None if there is none.
    """

    def __init__(
        self,
        config: StationConfig,
        diagram_at: Callable[[float], ClosedStation],
        edges: list[float],
        *,
        blocks: Mapping[str, LeafSystem],
        begin: float = 0.0,
        end: float | None = None,
        ticks: Ticks | None = None,
        reached: Context | None = None,
        begins_in_motion: bool = False,
        restart: Restart | None = None,
        context: Context | None = None,
    ) -> None:
        """Prepare to step a station.

        Args:
            config: configuration of the station, with the duration of the run.
            diagram_at: returns the diagram that is stepped from a given time on [s].
            edges: times at which a step must end, in order [s].
            blocks: the user's own blocks, by name.
            begin: start of the run, in simulated time [s].
            end: end of the run [s]; None if it is ``begin`` plus the duration of the configuration.
            ticks: times at which the solver is initialized again; None if there are no such times.
            reached: final context of another stepper of the same run, from which this stepper continues; None at the
                start of a run.
            begins_in_motion: whether the run continues the motion of another run, so that it may begin with long steps.
            restart: recorded step of another run from which this stepper steps again; None if there is none. It takes
                the place of ``begin``.
            context: context of the diagram that is stepped, if it is always the same diagram. The run advances it. If
                it is None, the simulators make their own contexts.
        """
        self.user_context = context
        self._config = config
        self._diagram_at = diagram_at
        self._blocks = blocks
        self.end = begin + config.duration if end is None else end
        if reached is not None:
            begin = reached.get_time()
        if restart is not None:
            begin = restart.time
        self.begin = begin
        self._restart = restart
        # Edges before the start, as in a run that continues another one, are over.
        self._edges = [edge for edge in edges if begin < edge < self.end] + [self.end]
        self._ticks = ticks
        self._tick_times = set[float]()
        if ticks is not None:
            self._tick_times = {time for time in ticks.times(self.end, self._edges) if time > begin}
            self._edges = sorted({*self._edges, *self._tick_times})
        self.built = diagram_at(begin)
        # One simulator for each diagram, by the id() of the diagram. The last edge is the end of the run.
        self._simulators = dict[int, Simulator]()
        for time in [begin, *self._edges[:-1]]:
            built = diagram_at(time)
            if id(built) not in self._simulators:
                self._simulators[id(built)] = self._simulator(built, context)
        has_variable_steps = controlled_by(config) is not None
        self.shortened = 0 if has_variable_steps else None
        self.begins_in_motion = begins_in_motion or reached is not None
        # Adapts the lengths of the steps that are taken now; None for other schemes than cenic.
        self._flight: Flight | None = None
        # Checks by the objects that had this task in earlier diagrams.
        self._flight_checks: list[FlightCheck] = []
        context = self.simulator.get_mutable_context()
        context.SetTime(begin)
        # Time and state come from the other stepper, or from the recorded step, if there is one.
        if reached is not None:
            _copy_state(reached, context)
        if restart is not None:
            restart.history.put(restart.row, context)

    @property
    def simulator(self) -> Simulator:
        """Simulator of the diagram that is stepped now."""
        return self._simulators[id(self.built)]

    @property
    def has_own_blocks(self) -> bool:
        """Whether there are blocks of the user's own."""
        return bool(self._blocks)

    def pace(self) -> Callable[[Context], None] | None:
        """Make a callback for each step, which may change the length of the next steps.

        Returns None for other schemes than ``cenic``, whose steps nothing changes.

        It belongs to the present diagram and solver: call this method again when they change. The checks of the
        callback before are kept, see :attr:`flight_checks`.
        """
        if self._flight is not None:
            self._flight_checks.extend(self._flight.checks)
        self._flight = self._make_flight(self.built, self.simulator)
        if self._flight is None:
            return None
        if self._restart is not None and self._restart.check is not None:
            self._flight.resume(self._restart.check)
            # The check belongs to the step of the restart. Later diagrams begin with a check of their own.
            self._restart = replace(self._restart, check=None)
        return self._flight.look

    @property
    def flight_checks(self) -> tuple[FlightCheck, ...]:
        """The last checks whether something flies, in order; empty for other schemes than ``cenic``."""
        latest = [] if self._flight is None else list(self._flight.checks)
        return tuple([*self._flight_checks, *latest][-CHECKS_KEPT:])

    def run(self, recorder: Recorder, watch: Watch) -> Outcome:
        """Step to the end of the run, or until something ends it earlier. Returns how the run ended.

        Args:
            recorder: records each step.
            watch: evaluates the station's monitors at the recorded steps.

        Raises:
            Exception: a callback of the user has failed, which is no end of a run.
        """
        try:
            return self._outcome(recorder, watch)
        finally:
            self._count_steps()
            for simulator in self._simulators.values():
                # The monitor is the recorder, which may refer to the simulator. Python's garbage collector does not
                # find such a cycle, since one of its references is in C++.
                simulator.clear_monitor()

    def _outcome(self, recorder: Recorder, watch: Watch) -> Outcome:
        """Step from edge to edge until the run ends. Returns how the run ended.

        Args:
            recorder: records each step. It may end the run, for a monitor.
            watch: evaluates the station's monitors at the recorded steps.

        Raises:
            Exception: a callback of the user has failed, which is no end of a run.
        """
        try:
            # A monitor may end the run at its start already, which the status reports.
            status = self._initialize()
            for edge in self._edges:
                if status.reason() == _ENDED:
                    break
                self._change_diagram(recorder)
                status = self.simulator.AdvanceTo(edge)
                is_tick = edge in self._tick_times and status.reason() != _ENDED
                if is_tick and self._ends_at_tick(edge, recorder):
                    break
        except KeyboardInterrupt:
            return interruption_outcome(self._config, recorder, self.end)
        # Drake's failed assertions come as SystemExit.
        except (Exception, SystemExit) as problem:
            # A callback of the user has failed: the caller gets its exception.
            if recorder.failure is not None:
                raise
            # A monitor may have ended the run at a step before the failure: it looks at the steps that it has not seen.
            # It may evaluate the failed block and fail as well, which does not matter.
            with suppress(Exception):
                recorder.look()
            failed = self.failure_outcome(problem, self.simulator.get_context(), recorder.times[-1])
            # A monitor's end comes first, then a failed block. Otherwise the solver has diverged.
            return (
                self._monitor_outcome(watch)
                or failed
                or self._divergence_outcome(recorder, problem)
            )
        # The monitors have not seen the last steps yet.
        recorder.look()
        stopped = self._monitor_outcome(watch)
        if stopped is not None:
            return stopped
        if not recorder.is_sane():
            return self._divergence_outcome(
                recorder,
                RuntimeError(
                    message("simulation.state_ran_away", "a state grew beyond any physical value")
                ),
            )
        # A block in the diagram has ended the run: the last part of its name is that of the monitor or block.
        if status.reason() == _ENDED:
            return Outcome(
                "monitor", status.system().get_name().rpartition(".")[2], self._reason(status)
            )
        return Outcome(
            "completed",
            None,
            message(
                "simulation.ran_to_its_end",
                "ran to its end at {time:.6g} s",
                time=self.simulator.get_context().get_time(),
            ),
        )

    def _reason(self, status: SimulatorStatus) -> str:
        """Reason why a block ended the run. A monitor's is a message with an id, which Drake's status loses."""
        block = status.system()
        if isinstance(block, Monitor):
            return block.reason(block.GetMyContextFromRoot(self.simulator.get_context()))
        return str(status.message())

    def step(self, history: StateHistory, time: float) -> StateHistory:
        """Compute the state at a time by stepping from the last recorded state before it.

        The run itself is not changed: a simulator of its own makes the step.

        Args:
            history: recorded states.
            time: the time [s], after the first recorded one.

        Returns:
            A history with this state alone.

        Raises:
            RuntimeError: the state diverged.
        """
        # Row of the last recorded state before the time.
        before = int((history.times < time).sum()) - 1
        # The diagram that was stepped at that time, with the pushes of that time.
        built = self._diagram_at(float(history.times[before]))
        # A copy of the caller's context has its parameters, which a default context may not have.
        own_context = None if self.user_context is None else self.user_context.Clone()
        simulator = self._simulator(built, own_context)
        history.put(before, simulator.get_mutable_context())
        flight = self._make_flight(built, simulator)
        recorder = Recorder(simulator, pace=None if flight is None else flight.look)
        # The step is made with the same limits as in the run, so it is a part of the recorded step.
        simulator.AdvanceTo(time)
        if not recorder.is_sane():
            raise RuntimeError(
                message(
                    "simulation.state_ran_away_between",
                    "a state grew beyond any physical value between two recorded states",
                )
            )
        return recorder.history().last()

    def _ends_at_tick(self, time: float, recorder: Recorder) -> bool:
        """Call the callback of the ticks, and initialize the solver again unless the run ends.

        Monitors look at the steps up to the tick first: the callback is not called if one of them ends the run.

        Args:
            time: time of the tick, or of the end of the run [s].
            recorder: records the run.

        Returns:
            True if a monitor or the callback ends the run.
        """
        # A tick was reached, so there are ticks.
        assert self._ticks is not None
        moment = Moment(time, self.built, self.simulator.get_context())
        is_ended = recorder.look() or self._ticks.tell(moment)
        # The last edge is the end of the run, after which no step follows.
        if not is_ended and time < self._edges[-1]:
            self._restart_solver(recorder)
        return is_ended

    def _restart_solver(self, recorder: Recorder) -> None:
        """Replace the integrator by a new one, so that nothing but the state is carried over."""
        context = self.simulator.get_mutable_context()
        time = context.get_time()
        self._count_steps()
        set_solver(self.simulator, self._config)
        # A new integrator has set the time to zero.
        context.SetTime(time)
        recorder.attach(self.simulator, self.pace())
        self._initialize_in_motion()

    def _change_diagram(self, recorder: Recorder) -> None:
        """Continue with the diagram for the present time, if it is another one, in the state that was reached.

        The recorder is attached to the other simulator, whose solver is initialized.
        """
        context = self.simulator.get_context()
        built = self._diagram_at(context.get_time())
        if built is self.built:
            return
        self._count_steps()
        self.built = built
        # All diagrams of a run have the same states in the same order.
        _copy_state(context, self.simulator.get_mutable_context())
        recorder.attach(self.simulator, self.pace())
        self._initialize_in_motion()

    def _count_steps(self) -> None:
        """Add the shortened steps of the present integrator to :attr:`shortened`.

        Call it once before the integrator is replaced or left for that of another diagram, and at the end of the run.
        """
        # Solvers with steps of one length try no step again.
        if self.shortened is not None:
            integrator = self.simulator.get_integrator()
            self.shortened += integrator.get_num_step_shrinkages_from_error_control()
            self.shortened += integrator.get_num_step_shrinkages_from_substep_failures()

    def _initialize(self) -> SimulatorStatus:
        """Initialize the simulator at the start of the run.

        A run that continues another run must not begin with short steps under ``cenic``. This scheme holds references
        over a step, so that a servo lags behind its reference by the length of a step. If the steps became shorter,
        the servos would catch up with torques and motions that an uninterrupted run does not have. Other schemes
        evaluate references within their steps, and have no such lag.

        Returns:
            The status, which tells if a monitor ends the run at its start.
        """
        if self._restart is not None:
            return self._initialize_again(self._restart)
        # `stepped_by` returns settings only for a scheme that holds inputs over a step, as `cenic` does.
        is_cenic = stepped_by(self._config) is not None
        if self.begins_in_motion and is_cenic:
            return self._initialize_in_motion()
        return self.simulator.Initialize()

    def _initialize_in_motion(self) -> SimulatorStatus:
        """Initialize the simulator so that its first step may have the largest length, since the motion continues."""
        integrator = self.simulator.get_mutable_integrator()
        if not integrator.get_fixed_step_mode():
            integrator.request_initial_step_size_target(integrator.get_maximum_step_size())
        return self.simulator.Initialize()

    def _initialize_again(self, restart: Restart) -> SimulatorStatus:
        """Initialize the simulator at a recorded step, with the length of the next step that the restart tries."""
        integrator = self.simulator.get_mutable_integrator()
        if restart.first_step is not None and not integrator.get_fixed_step_mode():
            # Infinity stands for the largest length.
            first_step = min(restart.first_step, integrator.get_maximum_step_size())
            integrator.request_initial_step_size_target(first_step)
        return self.simulator.Initialize()

    def _make_flight(self, built: ClosedStation, simulator: Simulator) -> Flight | None:
        """Make the object that adapts the lengths of steps under ``cenic``. Returns None for other schemes."""
        solver = stepped_by(self._config)
        return None if solver is None else Flight(built.ports.plant.plant, solver, simulator)

    def _simulator(self, built: ClosedStation, context: Context | None) -> Simulator:
        """Make a simulator for a diagram, with the solver of the station.

        Args:
            built: the diagram.
            context: context that the simulator advances; None for a default context.
        """
        simulator = (
            Simulator(built.diagram) if context is None else Simulator(built.diagram, context)
        )
        set_solver(simulator, self._config)
        return simulator

    def _monitor_outcome(self, watch: Watch) -> Outcome | None:
        """Outcome of a run that a monitor ended, or None if none did."""
        return None if watch.stop is None else Outcome("monitor", watch.stop.name, watch.stop.why)

    def failure_outcome(
        self, problem: BaseException, context: Context, time: float
    ) -> Outcome | None:
        """Outcome of a run that ended by an exception of Python code. Returns None if no such code is to blame.

        The exception is an error, or the report of a block that cannot go on (`BlockFails`). It is the fault of a block
        of the user's own if that block's code is in the traceback, else of the program if its class is that of a
        programming error. Otherwise the solver has diverged.

        Args:
            problem: the exception.
            context: context of the diagram in which it was raised.
            time: time for the message [s]: the last recorded time, or the time at which signals were evaluated.
        """
        if isinstance(problem, BlockFails):
            return Outcome(
                "failed",
                problem.block,
                message(
                    "simulation.block_failed",
                    "{block} failed at {time:.4g} s: it {problem}",
                    block=problem.block,
                    time=time,
                    problem=problem,
                ),
            )
        # A block of the user's own is to blame if one of its methods is in the traceback. The innermost one counts.
        error = compound("{name}: {problem}", name=type(problem).__name__, problem=problem)
        trace = list(walk_tb(problem.__traceback__))
        for frame, line in reversed(trace):
            for name, block in self._blocks.items():
                if _runs_code_of(frame, block):
                    # The name of a port says more to the user than that of a function in the block.
                    where = _failing_port(block, context, type(problem)) or frame.f_code.co_name
                    text = message(
                        "simulation.code_of_block_failed",
                        "the block {name} failed at {time:.4g} s in {where}: {error} (line {line})",
                        name=name,
                        time=time,
                        where=where,
                        error=error,
                        line=line,
                    )
                    return Outcome("failed", name, text)
        # No block of the user's own: the function that raised the error is named in the place of a block.
        if isinstance(problem, _PROGRAMMING_ERRORS):
            frame, line = trace[-1]
            where = message(
                "simulation.module_and_line",
                "{module}, line {line}",
                module=frame.f_globals.get("__name__"),
                line=line,
            )
            text = message(
                "simulation.fault_of_program",
                "an error in the code at {time:.4g} s: {error} ({where})",
                time=time,
                error=error,
                where=where,
            )
            return Outcome("failed", frame.f_code.co_qualname, text)
        return None

    def _divergence_outcome(self, recorder: Recorder, problem: BaseException) -> Outcome:
        """Outcome of a run in which a state diverged or the solver failed, with the likely cause.

        Args:
            recorder: the recorded states.
            problem: the exception, whose first sentence is shown.
        """
        first_sentence = message_of(problem)
        # An error of Drake may have several sentences and lines.
        if not isinstance(first_sentence, Message):
            first_sentence = " ".join(first_sentence.split()).split(". ")[0].rstrip(".")
        # A block that cannot compute its output says so itself. Otherwise solver and servos are examined.
        has_cause = isinstance(problem, ValueError) or "cannot be computed" in first_sentence
        cause = (
            ""
            if has_cause
            else compound("; {cause}", cause=likely_cause(self._config, self.built.ports.plant))
        )
        return Outcome(
            "diverged",
            DIVERGED,
            message(
                "simulation.diverged",
                "diverged at {end:.4g} s: {problem}{cause}",
                end=recorder.history().end,
                problem=first_sentence,
                cause=cause,
            ),
        )


def interruption_outcome(config: StationConfig, recorder: Recorder, end: float) -> Outcome:
    """Outcome of a run that its user interrupted. The message contains a hint if the solver's last steps were tiny.

    Args:
        config: configuration of the station.
        recorder: the recorded steps.
        end: planned end of the run [s], for the time that is left in the hint.
    """
    text = message("simulation.interrupted", "interrupted at {time:.4g} s", time=recorder.times[-1])
    # A user who interrupts a run most often does so because it takes too long.
    hint = creeping(config, recorder.times, end)
    if hint:
        text += compound("; {hint}", hint=hint)
    return Outcome("interrupted", INTERRUPTED, text)


def _runs_code_of(frame: FrameType, block: LeafSystem) -> bool:
    """Whether a frame of a traceback runs a method of a block, or a function inside a method, such as a lambda.

    A function that does not use ``self`` is recognised by the name of the block's class. So it is not found inside of
    a method that this class inherits, and it matches every block of the class: the caller takes the first one.
    """
    # The local variable `self` of a method is the block, unless the method gives it another name.
    if "self" in frame.f_locals:
        return frame.f_locals["self"] is block
    # Functions that do not use `self` are recognised by the class in their names, such as `Gain.sample.<lambda>`.
    return frame.f_code.co_qualname.startswith(f"{type(block).__qualname__}.")


def _failing_port(block: LeafSystem, context: Context, kind: type[BaseException]) -> str:
    """Name the first output of a block that raises an error of a class. Returns an empty text if there is none.

    Args:
        block: the block.
        context: context of the diagram.
        kind: the class of the error.
    """
    for index in range(block.num_output_ports()):
        port = block.get_output_port(index)
        try:
            # The traceback shows the line, but not which output was evaluated, so all are tried once more.
            port.Eval(block.GetMyContextFromRoot(context))
        except kind:
            return message("simulation.output_called", "its output {port}", port=port.get_name())
    return ""


def _copy_state(source: Context, target: Context) -> None:
    """Copy time and state from one context to another, of diagrams whose states are the same in the same order."""
    target.SetTime(source.get_time())
    # Drake fails an assertion if an empty state is set.
    if source.num_continuous_states():
        target.SetContinuousState(source.get_continuous_state_vector().CopyToVector())
    for group in range(source.num_discrete_state_groups()):
        target.SetDiscreteState(group, source.get_discrete_state(group).value())
    for index in range(source.num_abstract_states()):
        target.get_mutable_abstract_state(index).SetFrom(source.get_abstract_state(index))
