"""Signals of a run: the ports of its station, evaluated from the recorded states; and its monitors, asked about them.

So no monitor stands in the diagram that is stepped. It changes nothing, so it may look a few steps late: the run is
then cut where it would have ended, between the steps at which the monitor looked.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context, Diagram, OutputPort, PortDataType

from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.frames import Vector
from simrob_drake.parts.site import Site
from simrob_drake.results.record.history import PlantSlice, StateHistory, parts, plant_slice


class Sampler:
    """Evaluate ports of a diagram that holds a station at any time of a recorded run."""

    def __init__(
        self,
        diagram: Diagram,
        site: Site,
        history: StateHistory,
        *,
        held: Collection[OutputPort] = (),
        begins_in_motion: bool = False,
        prepare: Callable[[], None] | None = None,
        tolerant: bool = False,
    ) -> None:
        """Prepare to evaluate the ports of a station at any time of its run.

        Args:
            diagram: a diagram with the same states, in the same order, as the diagram that was stepped.
            site: the station whose ports are evaluated.
            history: the recorded states.
            held: ports with one value for each step of the solver. The value is that at the state of the step's end,
                with the inputs of the step's start: the value that a scheme with frozen inputs applies in the step.
            begins_in_motion: whether the run continues the motion of another run. The ``held`` ports then have, at the
                start of the run, the value of its first step.
            prepare: called before the first evaluation; restores the references of this run in the diagram.
            tolerant: whether values that cannot be evaluated become NaN, as after a run in which a block failed. If it
                is False, the error is raised.
        """
        self.diagram = diagram
        self._site = site
        self._held = held
        self._begins_in_motion = begins_in_motion
        self._prepare = prepare
        self._tolerant = tolerant
        self._plant = site.plant.plant
        self._context = diagram.CreateDefaultContext()
        self._plant_slice = plant_slice(diagram, self._plant, self._context)
        rules = {port: site.from_state(name) for name, port in site.outputs.items()}
        self._of_state = {port: rule for port, rule in rules.items() if rule is not None}
        self._recorded = _recorded(diagram, self._context)
        self.history = history

    @property
    def history(self) -> StateHistory:
        """The recorded states."""
        return self._history

    @history.setter
    def history(self, history: StateHistory) -> None:
        self._history = history
        self.memo: dict[Any, Any] = {}

    @property
    def step_times(self) -> Vector:
        """Ends of the accepted steps, shape (m,) [s]."""
        return self._history.times

    def sample(self, ports: Sequence[OutputPort], times: Vector) -> list[Any]:
        """Evaluate ports at times of the run.

        Args:
            ports: output ports of the diagram; the held ports among them have the value of the step at each time.
            times: times within the run, shape (k,) [s].

        Returns:
            for each port an array (k, size), or a list of k values of an abstract port.
        """
        held = [port for port in ports if port in self._held]
        others = [port for port in ports if port not in self._held]
        values = self.evaluate(others, self._at(times))
        if held:
            steps = self._history.steps(times, begins_in_motion=self._begins_in_motion)
            values |= self.evaluate(held, steps)
        return [values[port] for port in ports]

    def evaluate(self, ports: Sequence[OutputPort], states: StateHistory) -> dict[OutputPort, Any]:
        """Return the values of ports at states (k rows), as :meth:`sample` does."""
        state_port, where = self._site.state, self._plant_slice
        known: dict[OutputPort, Any] = {}
        linear = [port for port in ports if port == state_port or port in self._of_state]
        if linear and where is not None:  # the state was recorded
            known[state_port] = states.continuous[:, where.positions.start : where.velocities.stop]
        needed = dict.fromkeys([*(port for port in ports if port not in linear), *([state_port] if linear else [])])
        known |= {port: states.discrete[self._recorded[port]] for port in needed if port in self._recorded}
        known |= self._evaluated([port for port in needed if port not in known], states)
        known |= {port: self._of_state[port](known[state_port]) for port in linear if port != state_port}
        return {port: known[port] for port in ports}

    def _evaluated(self, ports: Sequence[OutputPort], states: StateHistory) -> dict[OutputPort, Any]:
        """Evaluate ports at recorded states, one row for each state, by setting the context to these states."""
        if not ports:
            return {}
        if self._prepare is not None:
            self._prepare()
        count, values = len(states.times), dict[OutputPort, Any]()
        for port in ports:
            is_vector = port.get_data_type() == PortDataType.kVectorValued
            values[port] = np.empty((count, port.size())) if is_vector else [None] * count
        targets = [(port, port.get_system().GetMyContextFromRoot(self._context), values[port]) for port in ports]
        for row in range(count):
            states.put(row, self._context)
            for port, context, rows in targets:
                rows[row] = self._value(port, context)
        return values

    def _value(self, port: OutputPort, context: Context) -> Any:
        """Evaluate one port. Returns NaN if the block fails and the sampler is tolerant."""
        try:
            value = port.Eval(context)
            return value if isinstance(value, np.ndarray) else copy(value)  # which is the cache's own, and changes
        except Exception:
            if not self._tolerant:
                raise
            return np.nan

    @property
    def looked_at(self) -> Context:
        """The diagram's context as it was looked at last."""
        return self._context

    def cut(self, time: float) -> None:
        """End the run at a time at which all was well [s]; what cannot be evaluated there is no number."""
        self.history, self._tolerant = self._history.joined(self._at(np.array([time]))), True

    def contact_results(self, times: Vector) -> Iterator[ContactResults]:
        """Yield the plant's contact results at times (k,) of the run."""
        yield from self.sample([self._site.plant.stepped.get_contact_results_output_port()], times)[0]

    def context_at(self, time: float) -> Context:
        """Return the diagram's context at a time of the run; the next call changes it."""
        if self._prepare is not None:
            self._prepare()
        self._at(np.array([time])).put(0, self._context)
        return self._context

    def _at(self, times: Vector) -> StateHistory:
        where = self._plant_slice
        return self._history.at(times, where, None if where is None else partial(self._rates, where))

    def _rates(self, where: PlantSlice, states: Vector) -> Vector:
        """Return the time derivatives (k, nq) of the plant's positions at continuous states (k, nx)."""
        plant = self._plant
        if plant.IsVelocityEqualToQDot():
            return states[:, where.velocities]
        context = plant.CreateDefaultContext()
        rates = np.empty((len(states), plant.num_positions()))
        for row, state in enumerate(states):
            plant.SetPositions(context, state[where.positions])
            rates[row] = plant.MapVelocityToQDot(context, state[where.velocities])
        return rates


def _recorded(diagram: Diagram, root: Context) -> dict[OutputPort, int]:
    """Return which discrete group of a diagram each output is that hands on what a block remembers."""
    found, groups = dict[OutputPort, int](), 0
    for system in diagram.GetSystems():
        own = _recorded(system, root) if isinstance(system, Diagram) else {}
        if isinstance(system, SampledBlock) or system.get_name() == "plant":
            groups_of = getattr(system, "outputs", {})  # Drake's own plant has none
            own = {system.GetOutputPort(name): group for name, group in groups_of.items()}
        found |= {port: groups + group for port, group in own.items()}
        groups += system.GetMyContextFromRoot(root).num_discrete_state_groups()
    return found


def sampled(sampler: Sampler, site: Site, times: Vector) -> Vector:
    """Return a station's signals at times of a run (m,): the values of their k columns, shape (m, k)."""
    ports = {signal.output: site.outputs[signal.output] for signal in site.signals if signal.output}
    ends = np.cumsum([len(signal.names) for signal in site.signals], dtype=int).tolist()
    placed = [(signal, slice(end - len(signal.names), end)) for signal, end in zip(site.signals, ends, strict=True)]
    values = np.empty((len(times), ends[-1] if ends else 0))
    for part in parts(len(times)):
        known = dict(zip(ports, sampler.sample(list(ports.values()), times[part]), strict=True))
        for signal, columns in placed:
            if signal.compute is None:
                whole = known[signal.output]
                values[part, columns] = whole if signal.entries is None else whole[:, signal.entries]
    for signal, columns in placed:
        if signal.compute is not None:
            values[:, columns] = signal.compute(sampler, times)
        elif signal.adjust is not None:
            values[:, columns] = signal.adjust(sampler, times, values[:, columns])
    return values


TOLERANCE = 1e-4  # how narrowly the moment is found [s]

Holds = Callable[[Sampler, float], bool]  # whether the condition holds at a time [s] of a sampler's run
Step = Callable[[StateHistory, float], StateHistory]
"""Steps from the last state of a history before a time to that time [s], and returns the state there."""


@dataclass(frozen=True)
class Stop:
    """Why a run ends."""

    name: str  # of the monitor
    count: int  # how many steps were recorded until it ended the run
    onset: float  # since when the condition held [s]
    why: str  # in words


class Watch:
    """Asks the monitors of a station about each recorded step, in their order."""

    def __init__(
        self, site: Site, sampler: Sampler, *, held: Collection[OutputPort] = (), begins_in_motion: bool = False
    ) -> None:
        """Prepare to watch a station.

        Args:
            site: the station with the monitors.
            sampler: evaluates the station's ports.
            held: ports with one value for each step, as in :class:`Sampler`.
            begins_in_motion: whether the run continues the motion of another run, as in :class:`Sampler`.
        """
        self._site = site
        self._sampler = sampler
        self._held = held
        self._begins_in_motion = begins_in_motion
        self._onsets = dict.fromkeys(site.monitors, NOT_YET)
        self._count = 0
        self._before: StateHistory | None = None  # the last two states of the previous call; None before the first
        self.stop: Stop | None = None  # why the run ends; None as long as it does not

    def look(self, steps: StateHistory) -> bool:
        """Evaluate the monitors at the steps since the last call. Returns True if one of these steps ends the run.

        Args:
            steps: states at the ends of these steps.
        """
        ports = {name: self._ports(name) for name in self._site.monitors}
        values = self._values({port for own in ports.values() for port in own}, steps)
        for row, time in enumerate(steps.times.tolist()):
            for name, trigger in self._site.monitors.items():
                seen = [values[port][row] for port in ports[name]]
                onset = self._onsets[name] = trigger.since(self._onsets[name], time, seen)
                if trigger.ends(onset, time):
                    self.stop = Stop(name, self._count + row + 1, onset, trigger.condition.why(*seen))
                    return True
        self._count += len(steps.times)
        return False

    def _values(self, ports: Collection[OutputPort], steps: StateHistory) -> dict[OutputPort, Any]:
        """Evaluate ports at the ends of steps. Held ports get the values that the solver kept over these steps.

        Args:
            ports: ports of the station.
            steps: states at the ends of the steps since the last call.

        Returns:
            the values of each port, one row for each step.
        """
        held = [port for port in ports if port in self._held]
        others = [port for port in ports if port not in self._held]
        values = self._sampler.evaluate(others, steps)
        if held:
            # The first of these steps begins at a state of the previous call, so that the last states are kept.
            known = steps if self._before is None else self._before.joined(steps)
            own = known.steps(steps.times, begins_in_motion=self._begins_in_motion)
            values |= self._sampler.evaluate(held, own)
            # The second last state gives the time at which the last step began.
            self._before = known.last(2)
        return values

    def holds(self, name: str, sampler: Sampler, time: float) -> bool:
        """Tell whether a monitor's condition holds at a time of a sampler's run [s]."""
        values = [rows[0] for rows in sampler.sample(self._ports(name), np.array([time]))]
        return self._site.monitors[name].holds(time, values)

    def _ports(self, name: str) -> list[OutputPort]:
        return [self._site.outputs[output] for output in self._site.monitors[name].condition.watched]


def cut_at_stop(sampler: Sampler, holds: Holds, step: Step, *, onset: float, hold: float) -> None:
    """Let a recorded run end at the moment at which its monitor would have ended it, had it looked all the time.

    The moment is guessed between two recorded states and the motion stepped again up to there, until the two states
    around it are near enough: a state in the middle of a step is not to be trusted where that step holds an impact.
    Where the motion cannot be stepped again, as after a divergence, the run stays as it was recorded. The condition
    ``holds`` since ``onset`` [s], and must do so for ``hold`` [s].
    """
    recorded = sampler.history
    try:
        if len(recorded.times) < 2:  # it held at the start
            return
        if hold > 0:
            stop = _crossing(sampler, holds, min(onset, recorded.end)) + hold
            if stop < recorded.end:
                sampler.history = recorded.joined(step(recorded, stop))
        else:
            while sampler.history.end - sampler.history.times[-2] > TOLERANCE:
                end = sampler.history.last()
                between = step(sampler.history, _crossing(sampler, holds, end.end))
                shorter = sampler.history.joined(between)
                sampler.history = shorter
                if not holds(sampler, between.end):
                    sampler.history = shorter.joined(end)
    except (RuntimeError, SystemExit):  # Drake's failed assertions come as SystemExit
        sampler.history = recorded


def _crossing(sampler: Sampler, holds: Holds, seen: float) -> float:
    """Return a time inside of the step that ends at ``seen``, where the condition begins to hold on its way."""
    times = sampler.history.times
    low = float(times[np.searchsorted(times, seen) - 1])
    inside, high = (low + TOLERANCE / 2, seen - TOLERANCE / 2), seen
    if seen - low <= TOLERANCE:
        return seen
    while high - low > TOLERANCE / 4:
        middle = (low + high) / 2
        if holds(sampler, middle):
            high = middle
        else:
            low = middle
    return float(np.clip(high, *inside))
