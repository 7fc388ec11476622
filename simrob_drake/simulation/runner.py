"""Run a station: reference in, result out, however the run ends."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, LeafSystem, OutputPort
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import Course, Samples
from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.frames import Vector
from simrob_drake.given import drake_asserts, instance
from simrob_drake.parts.controllers import own_blocks
from simrob_drake.parts.controllers.own import OwnController, driven_inputs, named_blocks
from simrob_drake.progress import note, progress_bar
from simrob_drake.results.record.history import History, Recorder
from simrob_drake.results.record.run import FAILED
from simrob_drake.results.record.signals import Sampler, sampled
from simrob_drake.results.record.state import State
from simrob_drake.results.record.watch import Watch, cut_at_stop
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.built import StationDiagrams, needed_inputs
from simrob_drake.simulation.pace import pace_watcher
from simrob_drake.simulation.stepping import Outcome, Stepper, interrupted
from simrob_drake.simulation.wanted import Reference, by_robot, with_duration, with_pushes
from simrob_drake.stations.closed import ClosedStation, check_course, station_courses
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import check_parts, resolve
from simrob_drake.stations.solver_config import DiscreteSolver
from simrob_drake.stations.station import StationLike, config_of
from simrob_drake.stations.steps import step_findings

OnStep = Callable[[float, Vector], None]
Blocks = Sequence[LeafSystem] | Mapping[str, LeafSystem]
_NOT_OWN = ("pydrake", "simrob_drake")
_NOTHING = History(np.zeros(1), np.zeros((1, 0)))


def simulate(
    config_or_station: StationLike,
    *,
    reference: Reference | Mapping[str, Reference] | None = None,
    duration: float | None = None,
    blocks: Blocks = (),
    start: State | None = None,
    progress: bool = True,
    on_step: OnStep | None = None,
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
        blocks: LeafSystems of your own, in a list or by name. An input that is named as an output of the station reads
            it; an output that is named as an input of the station (``reference``, ``feedforward`` ...) drives it in
            place of the configuration's source; other outputs are signals, ``<block>.<output>``.
        start: where the station begins, such as the ``final_state`` of another result; time begins at zero all the
            same, and the configuration's references begin where that run's reference ended.
        progress: show a bar on a terminal.
        on_step: called after each accepted step with the time [s] and the positions of the whole plant (nq,), perhaps
            a few steps beyond a monitor's stop; it cannot change the run. What it raises goes on to the caller;
            KeyboardInterrupt ends the run.

    Returns:
        the result, also when a monitor ended the run, when the simulation diverged, or when a block failed.

    Raises:
        SimrobError: input that cannot be run at all.
    """
    runner = Runner(config_or_station, blocks=blocks)
    return runner.run(reference=reference, duration=duration, start=start, progress=progress, on_step=on_step)


class Runner:
    """A station that is built once and run often: each run is that of :func:`simulate`, to the last bit.

    Attributes:
        config: the station.
    """

    def __init__(self, station: StationLike, *, blocks: Blocks = ()) -> None:
        """Take a station; its diagrams are built at the first run.

        Args:
            station: as :func:`simulate` takes it.
            blocks: likewise.

        Raises:
            SimrobError: no such station, or a block that is none.
        """
        self.config = config_of(station)
        made = own_blocks(self.config.controllers)
        self._blocks = {**made, **named_blocks(blocks)}
        needed = [name for name in needed_inputs(self._blocks) if name not in self.config.inputs]
        self._station = resolve(self.config.model_copy(update={"inputs": (*self.config.inputs, *needed)}))
        self._diagrams: dict[Any, StationDiagrams] = {}

    @drake_asserts()
    def run(
        self,
        *,
        reference: Reference | Mapping[str, Reference] | None = None,
        duration: float | None = None,
        start: State | None = None,
        pushes: Mapping[str, Any] | None = None,
        progress: bool = False,
        on_step: OnStep | None = None,
    ) -> SimulationResult:
        """Run the station, as :func:`simulate` does.

        Args:
            reference: as of :func:`simulate`.
            duration: in place of the configuration's [s].
            start: as of :func:`simulate`.
            pushes: in place of the configuration's, by name: ``{"shove": {"start": 1, "force": [5, 0, 0]}}``.
            progress: show a bar on a terminal.
            on_step: as of :func:`simulate`.

        Raises:
            SimrobError: input that cannot be run at all.
        """
        config = with_pushes(with_duration(self.config, duration), pushes)
        if on_step is not None and not callable(on_step):
            raise InvalidParameter("on_step", on_step, "a function of time and positions")
        start = _checked_start(config, start)
        given = by_robot(config, reference)
        courses = station_courses(self._station, given, start.references if start else None)
        driven = driven_inputs(self._blocks)
        for robot in self._station.robots.values():
            if f"{robot.prefix}reference" not in driven:
                check_course(robot, courses[robot.name], config.duration)
        diagrams = self._diagrams_for(config, courses)
        diagrams.play(courses, config.forces)
        stepper = Stepper(config, diagrams.stepped, diagrams.edges, blocks=self._blocks)
        if start is not None:
            start.put(stepper.built.diagram, stepper.built.ports, stepper.simulator.get_mutable_context())
        whole = diagrams.whole
        run = _Run(config, whole, stepper, lambda: whole.play(courses, config.forces), diagrams.forget)
        blocks = {name: OwnController.of(block) for name, block in self._blocks.items()}
        own = {**config.controllers, **{name: blocks[name] for name in blocks if name not in config.controllers}}
        result = run.result(progress=progress, on_step=on_step, references=given, start=start)
        return replace(result, config=config.model_copy(update={"controllers": own}))

    def _diagrams_for(self, config: StationConfig, courses: Mapping[str, Course]) -> StationDiagrams:
        """Return the diagrams for a run: those of other runs, if forces act at the same places."""
        places = tuple((name, force.kind, force.at) for name, force in config.forces.items())
        known = self._diagrams.get(places)
        if known is None or not known.fits(courses):
            if self._diagrams and self._blocks:
                told = "blocks stand in one diagram: pushes at other places, and sines, need a Runner with new ones"
                raise SimrobError(told)
            station = self._station
            if config.forces != self.config.forces:
                station = resolve(station.config.model_copy(update={"forces": config.forces}))
                check_parts(station)
            known = self._diagrams[places] = StationDiagrams(station, courses, self._blocks)
        return known


@drake_asserts()
def simulate_diagram(
    diagram: Diagram,
    ports: StationPorts,
    *,
    duration: float | None = None,
    context: Context | None = None,
    progress: bool = True,
    on_step: OnStep | None = None,
) -> SimulationResult:
    """Run a Diagram of your own that contains a station, and return the same result as :func:`simulate` does.

    Args:
        diagram: all of whose inputs are fed.
        ports: what :func:`add_station` gave, or ``station.ports``.
        duration: in place of that of the station's configuration [s].
        context: of the diagram, to begin in; its default one unless given.
        progress: show a bar on a terminal.
        on_step: as of :func:`simulate`.

    Returns:
        the result; its ``station.yaml`` holds the station alone.

    Raises:
        SimrobError: a solver that cannot run the station where it stands.
    """
    instance(diagram, "diagram", Diagram, "a Diagram of Drake that contains a station")
    instance(ports, "ports", StationPorts, "what add_station() gave, or station.ports")
    config = with_duration(ports.config, duration)
    built = ClosedStation(diagram, ports)
    names = [
        system.get_name() for system in diagram.GetSystems() if type(system).__module__.split(".")[0] not in _NOT_OWN
    ]
    blocks = {name: diagram.GetSubsystemByName(name) for name in names}
    stepper = Stepper(config, lambda time: built, sorted(set(ports.edges)), blocks=blocks)
    if context is not None:
        expected = "a Context of the diagram, such as diagram.CreateDefaultContext() gives"
        instance(context, "context", Context, expected)
        stepper.simulator.get_mutable_context().SetTimeStateAndParametersFrom(context)
    return _Run(config, built, stepper).result(progress=progress, on_step=on_step, references={}, start=None)


@dataclass(frozen=True)
class _Run:
    """A run that is about to be stepped.

    Attributes:
        config: the station, as it is run.
        whole: the diagram in which signals are evaluated.
        stepper: what is stepped.
        prepare: gives the whole diagram the references of this run back.
        forget: takes them from all diagrams, so that they stand in memory once.
    """

    config: StationConfig
    whole: ClosedStation
    stepper: Stepper
    prepare: Callable[[], None] | None = None
    forget: Callable[[], None] = lambda: None

    def result(
        self,
        *,
        progress: bool,
        on_step: OnStep | None,
        references: dict[str, Trajectory | Samples],
        start: State | None,
    ) -> SimulationResult:
        """Step, and return what happened."""
        watchers = [] if on_step is None else [_positions_watcher(self.stepper, on_step)]
        with progress_bar(f"simulating {self.config.name}", self.config.duration, shown=progress) as show:
            if show is not None:
                watchers.append(pace_watcher(self.config, show))
            ports = self.whole.ports
            watch = Watch(ports, Sampler(self.whole.diagram, ports, _NOTHING))
            recorder = Recorder(
                self.stepper.simulator,
                *watchers,
                look=watch.look if ports.monitors else None,
                pace=self.stepper.pace(),
            )
            began = perf_counter()
            outcome = self.stepper.run(recorder, watch)
            stepping_time = perf_counter() - began
        told: dict[str, Any] = {"stepping_time": stepping_time, "references": references, "start": start}
        try:
            return self._evaluated(recorder, watch, outcome, **told)
        except KeyboardInterrupt:  # the run is not to be lost
            note("interrupted; the signals are computed first, interrupt again to abandon them", shown=progress)
            return self._evaluated(recorder, watch, interrupted(self.config, recorder), **told)

    def _evaluated(self, recorder: Recorder, watch: Watch, outcome: Outcome, **told: Any) -> SimulationResult:
        """Sample the signals of a run that has been stepped."""
        began = perf_counter()
        ports, stop = self.whole.ports, watch.stop if outcome.ending == "monitor" else None
        history = recorder.history(stop.count if stop else None)
        sampler = Sampler(
            self.whole.diagram,
            ports,
            history,
            held=self._held_ports(),
            prepare=self.prepare,
            tolerant=outcome.ending == FAILED,
        )
        if stop is not None and not (isinstance(self.config.solver, DiscreteSolver) and self.config.mode == "dynamic"):
            hold = ports.monitors[stop.name].hold
            asked = Sampler(self.whole.diagram, ports, history, prepare=self.prepare)
            cut_at_stop(
                asked, lambda s, time: watch.holds(stop.name, s, time), self.stepper.step, onset=stop.onset, hold=hold
            )
            sampler.history = asked.history
        self.forget()
        if outcome.ending == "monitor":
            outcome = replace(outcome, message=f"{outcome.message}, at {sampler.history.end:.4g} s")
        outcome, times, values = self._sampled(sampler, outcome)
        positions = ports.plant.plant.num_positions()
        has_contacts = self.config.contact is not None and self.config.mode == "dynamic"
        result = SimulationResult(
            config=self.config,
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
            warnings=self._warnings(),
            final_state=State.of(
                self.whole.diagram,
                ports,
                sampler.context_at(sampler.history.end),
                tolerant=outcome.ending == FAILED,
            ),
            **told,
        )
        self.forget()
        return result

    def _sampled(self, sampler: Sampler, outcome: Outcome) -> tuple[Outcome, Vector, Vector]:
        """Return how the run ended, times, and values of the signals up to where a block fails."""
        times = _sample_times(sampler.history.end, self.config.sample_rate)
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

    def _held_ports(self) -> list[OutputPort]:
        """Return the torques, where the scheme lets references stand still over a step: that is what was applied."""
        if self.config.mode == "kinematic" or self.config.solver.scheme != "cenic":
            return []
        ports = self.whole.ports
        return [ports.outputs[f"{robot.prefix}torque"] for robot in ports.plant.robots.values()]

    def _warnings(self) -> list[str]:
        """Return why the result may be wrong though the run went to its end."""
        if self.config.mode == "kinematic":
            return []
        findings = step_findings(self.config, self.whole.ports.plant)
        return [finding.text for finding in findings if finding.level == "warning"]


def _checked_start(config: StationConfig, start: State | None) -> State | None:
    if start is None:
        return State.at_start_of(config)
    instance(start, "start", State, "a State, such as the final_state of a result").check()
    return start


def _positions_watcher(stepper: Stepper, on_step: OnStep) -> Callable[[Context], None]:
    def watch(context: Context) -> None:
        ports = stepper.built.ports
        own = ports.state.get_system().GetMyContextFromRoot(context)
        on_step(context.get_time(), ports.state.Eval(own)[: ports.plant.plant.num_positions()])

    return watch


def _sample_times(end: float, rate: float) -> Vector:
    """Return evenly spaced times; the end of the run is the last one, wherever it lies."""
    times = np.arange(int(np.floor(end * rate + 1e-9)) + 1) / rate
    return times if times[-1] >= end else np.append(times, end)
