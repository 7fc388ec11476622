"""Step a station from edge to edge, and tell how a run ended."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from traceback import walk_tb

import numpy as np
from pydrake.systems.analysis import Simulator, SimulatorStatus
from pydrake.systems.framework import Context, LeafSystem

from simrob_drake.blocks.sampled import BlockFails
from simrob_drake.frames import Vector
from simrob_drake.parts.forces import ForceConfig
from simrob_drake.results.record.history import Recorder, StateHistory
from simrob_drake.results.record.run import DIVERGED, INTERRUPTED, Ending
from simrob_drake.results.record.signals import Watch
from simrob_drake.results.record.state import State
from simrob_drake.simulation.pace import Flight, creeping
from simrob_drake.stations.closed import ClosedStation
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.steps import apply_solver, controlled_by, likely_cause, stepped_by

_ROUNDING = 1e-9  # s
_SLIPS = (TypeError, AttributeError, NameError, LookupError)
_ENDED = SimulatorStatus.ReturnReason.kReachedTerminationCondition


@dataclass(frozen=True)
class Moment:
    """A station in the middle of a run; it is not to be kept."""

    time: float  # since the run began [s]
    _built: ClosedStation
    _context: Context

    def value(self, output: str) -> Vector:
        """Return what an output of the station gives now, such as ``position``."""
        return self._built.ports.value(output, self._context)

    def play_forces(self, forces: Mapping[str, ForceConfig]) -> None:
        """Let pushes and drags go on in another way from now on."""
        self._built.play_forces(forces)

    def state(self) -> State:
        """Return the whole state, from which a run can begin."""
        return State.of(self._built.diagram, self._built.ports, self._context)


@dataclass(frozen=True)
class Ticks:
    """Moments at even times of a run from which on all depends on nothing but the state that was reached.

    There a solver forgets what it learned of the steps before: so a run can be done again from each of these moments,
    or ended at one and gone on with by another run, to the last bit.
    """

    every: float  # time from one to the next [s]
    tell: Callable[[Moment], bool] = lambda moment: False
    """Is told of each that was reached, before the run goes on; True ends the run there."""

    def times(self, end: float, edges: Sequence[float]) -> list[float]:
        """Return the moments within a run and its end, as they stand in ``edges`` where they stand there [s]."""
        count = int(np.ceil(end / self.every - _ROUNDING))
        times = [round(self.every * number, 12) for number in range(1, count)] + [end]
        known = np.array([np.inf, *edges])
        near = [known[np.abs(known - time).argmin()] for time in times]
        return [float(edge) if abs(edge - time) < _ROUNDING else time for edge, time in zip(near, times, strict=True)]


@dataclass(frozen=True)
class Outcome:
    """How a run ended, who ended it and why."""

    ending: Ending
    stopped_by: str | None
    message: str


class Stepper:
    """Steps a station over stretches of time between which its diagram may change; all have the same states.

    A run is cut at nothing but the edges: a solver's steps end where a call to advance ends, so other pieces would
    change the result.
    """

    def __init__(
        self,
        config: StationConfig,
        diagram_at: Callable[[float], ClosedStation],
        edges: list[float],
        *,
        blocks: Mapping[str, LeafSystem],
        ticks: Ticks | None = None,
        reached: Context | None = None,
        begins_in_motion: bool = False,
    ) -> None:
        """Prepare to step a station.

        Args:
            config: configuration of the station, with the duration of the run.
            diagram_at: returns the diagram that is stepped from a given time on [s].
            edges: times at which a step must end, in order [s].
            blocks: the user's own blocks, by name.
            ticks: times at which the solver is initialized again; None if there are no such times.
            reached: final context of another stepper of the same run, from which this stepper continues; None at the
                start of a run.
            begins_in_motion: whether the run continues the motion of another run, so that it may begin with long steps.
        """
        self._config = config
        self._diagram_at = diagram_at
        self._blocks = blocks
        first = 0.0 if reached is None else reached.get_time()
        self._edges = [edge for edge in edges if first < edge < config.duration] + [config.duration]
        self._ticks, self._moments = ticks, set[float]()
        if ticks is not None:
            self._moments = set(ticks.times(config.duration, self._edges))
            self._edges = sorted({*self._edges, *self._moments})
        self.built = diagram_at(first)  # the diagram that is stepped now
        used = {id(built): built for built in map(diagram_at, [first, *self._edges[:-1]])}
        self._simulators = {key: self._simulator(built) for key, built in used.items()}
        # how often the solver has tried a step again, shorter; None where all steps are of one length
        self.shortened = None if controlled_by(config) is None else 0
        self.begins_in_motion = begins_in_motion or reached is not None
        if reached is not None:
            _copy_state(reached, self.simulator.get_mutable_context())

    @property
    def simulator(self) -> Simulator:
        """That of the diagram that is stepped now."""
        return self._simulators[id(self.built)]

    @property
    def has_own_blocks(self) -> bool:
        """Whether there are blocks of the user's own."""
        return bool(self._blocks)

    def pace(self) -> Callable[[Context], None] | None:
        """Return what is to look at each step from now on, and changes the length of the next, if anything does."""
        return self._pace(self.built, self.simulator)

    def run(self, recorder: Recorder, watch: Watch) -> Outcome:
        """Step to the end, or until something ends the run."""
        try:
            return self._outcome(recorder, watch)
        finally:
            self._count_steps()
            for simulator in self._simulators.values():
                simulator.clear_monitor()  # it holds who watches, who may hold it: no collector sees through Drake

    def _outcome(self, recorder: Recorder, watch: Watch) -> Outcome:
        """Step from edge to edge until the run ends. Returns how the run ended."""
        try:
            status = self._initialize()
            for edge in self._edges:
                if status.reason() == _ENDED:
                    break
                self._change_diagram(recorder)
                status = self.simulator.AdvanceTo(edge)
                if edge in self._moments and status.reason() != _ENDED and self._at_tick(edge, recorder):
                    break
        except KeyboardInterrupt:
            return interrupted(self._config, recorder)
        except (Exception, SystemExit) as problem:  # Drake's failed assertions come as SystemExit
            if recorder.failure is not None:
                raise
            with suppress(Exception):  # the block that failed is looked at by monitors, too
                recorder.look()
            failed = self.failed(problem, self.simulator.get_context(), recorder.times[-1])
            return self._stopped(watch) or failed or self._diverged(recorder, problem)
        recorder.look()
        stopped = self._stopped(watch)
        if stopped is not None:
            return stopped
        if not recorder.is_sane():
            return self._diverged(recorder, RuntimeError("a state ran away to infinity"))
        if status.reason() == _ENDED:
            return Outcome("monitor", status.system().get_name().rpartition(".")[2], status.message())
        return Outcome("completed", None, f"ran to its end at {self.simulator.get_context().get_time():.6g} s")

    def step(self, history: StateHistory, time: float) -> StateHistory:
        """Return the state at ``time`` [s], stepped again from the last record; raises RuntimeError: one ran away."""
        before = int((history.times < time).sum()) - 1
        built = self._diagram_at(float(history.times[before]))
        simulator = self._simulator(built)
        history.put(before, simulator.get_mutable_context())
        recorder = Recorder(simulator, pace=self._pace(built, simulator))
        simulator.AdvanceTo(time)
        if not recorder.is_sane():
            raise RuntimeError("a state ran away between two recorded ones")
        return recorder.history().last()

    def _at_tick(self, time: float, recorder: Recorder) -> bool:
        """Tell of a tick, and whether the run ends with it; else begin anew there."""
        assert self._ticks is not None  # who told of the moments
        ended = recorder.look() or self._ticks.tell(Moment(time, self.built, self.simulator.get_context()))
        if not ended and time < self._edges[-1]:
            self._begin_anew(recorder)
        return ended

    def _begin_anew(self, recorder: Recorder) -> None:
        """Let the simulator forget all but the state: it takes an integrator that is new."""
        context = self.simulator.get_mutable_context()
        time = context.get_time()
        self._count_steps()
        apply_solver(self.simulator, self._config)
        context.SetTime(time)  # which a new integrator sets to zero
        recorder.attach(self.simulator, self.pace())
        self._initialize_in_motion()

    def _change_diagram(self, recorder: Recorder) -> None:
        """Go on with the diagram of this stretch, in the state that was reached."""
        context = self.simulator.get_context()
        built = self._diagram_at(context.get_time())
        if built is self.built:
            return
        self._count_steps()
        self.built = built
        _copy_state(context, self.simulator.get_mutable_context())
        recorder.attach(self.simulator, self.pace())
        self._initialize_in_motion()

    def _count_steps(self) -> None:
        """Count what the present integrator has shortened, before it begins anew."""
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
        """
        # stepped_by() returns settings only if the scheme is cenic.
        if self.begins_in_motion and stepped_by(self._config) is not None:
            return self._initialize_in_motion()
        return self.simulator.Initialize()

    def _initialize_in_motion(self) -> SimulatorStatus:
        """Initialize the simulator with long steps: the motion continues, and no short first step is needed."""
        integrator = self.simulator.get_mutable_integrator()
        if not integrator.get_fixed_step_mode():
            integrator.request_initial_step_size_target(integrator.get_maximum_step_size())
        return self.simulator.Initialize()

    def _pace(self, built: ClosedStation, simulator: Simulator) -> Callable[[Context], None] | None:
        solver = stepped_by(self._config)
        return None if solver is None else Flight(built.ports.plant.plant, solver, simulator).look

    def _simulator(self, built: ClosedStation) -> Simulator:
        simulator = Simulator(built.diagram)
        apply_solver(simulator, self._config)
        return simulator

    def _stopped(self, watch: Watch) -> Outcome | None:
        return None if watch.stop is None else Outcome("monitor", watch.stop.name, watch.stop.why)

    def failed(self, problem: BaseException, context: Context, time: float) -> Outcome | None:
        """Return how a block of the user's own, or one that cannot go on, ended the run [s]; None if none did."""
        if isinstance(problem, BlockFails):
            return Outcome("failed", problem.block, f"{problem.block} failed at {time:.4g} s: it {problem}")
        for frame, line in reversed(list(walk_tb(problem.__traceback__))):
            for name, block in self._blocks.items():
                within = frame.f_code.co_qualname.startswith(f"{type(block).__qualname__}.")  # such as a lambda
                if frame.f_locals.get("self", block if within else None) is block:
                    where = _failing_port(block, context, type(problem)) or frame.f_code.co_name
                    cause = f"{type(problem).__name__}: {problem} (line {line})"
                    return Outcome("failed", name, f"the block {name} failed at {time:.4g} s in {where}: {cause}")
        if isinstance(problem, _SLIPS):  # no solver raises these
            code, line = deque(walk_tb(problem.__traceback__), maxlen=1)[0]
            where = f"{code.f_globals.get('__name__')}, line {line}"
            cause = f"a fault of the program, at {time:.4g} s: {type(problem).__name__}: {problem} ({where})"
            return Outcome("failed", code.f_code.co_qualname, cause)
        return None

    def _diverged(self, recorder: Recorder, problem: BaseException) -> Outcome:
        first_sentence = " ".join(str(problem).split()).split(". ")[0].rstrip(".")
        own = isinstance(problem, ValueError) or "cannot be computed" in first_sentence  # what a block computes
        cause = "" if own else f"; {likely_cause(self._config, self.built.ports.plant)}"
        return Outcome("diverged", DIVERGED, f"diverged at {recorder.history().end:.4g} s: {first_sentence}{cause}")


def interrupted(config: StationConfig, recorder: Recorder) -> Outcome:
    """Return the outcome of a run that its user interrupted."""
    slow = creeping(config, recorder.times)
    return Outcome("interrupted", INTERRUPTED, f"interrupted at {recorder.times[-1]:.4g} s" + (slow and f"; {slow}"))


def _failing_port(block: LeafSystem, context: Context, kind: type[BaseException]) -> str:
    """Name the first output of a block that raises an error of a class. Returns an empty text if there is none."""
    for index in range(block.num_output_ports()):
        port = block.get_output_port(index)
        try:
            port.Eval(block.GetMyContextFromRoot(context))
        except kind:
            return f"its output {port.get_name()}"
    return ""


def _copy_state(source: Context, target: Context) -> None:
    """Copy time and state between contexts of the same layout."""
    target.SetTime(source.get_time())
    if source.num_continuous_states():
        target.SetContinuousState(source.get_continuous_state_vector().CopyToVector())
    for group in range(source.num_discrete_state_groups()):
        target.SetDiscreteState(group, source.get_discrete_state(group).value())
    for index in range(source.num_abstract_states()):
        target.get_mutable_abstract_state(index).SetFrom(source.get_abstract_state(index))
