"""Signals and monitors of a run, evaluated from its recorded states.

While a run is stepped, only its states are recorded, see `StateHistory`. A `Sampler` evaluates output ports of the
station at any time of the run: it sets a context of the diagram to a recorded state, or to one between two of them.

A *held* port has one value for each step of the solver, which is kept over the whole step: a scheme that freezes the
inputs of the plant applies this value. The values of all other ports may change within a step.

A *monitor* is a condition that ends a run, such as the fall of a robot. It changes nothing, so it is not part of the
diagram that is stepped. A `Watch` evaluates the monitors from the recorded states every few steps. A run that ends is
then cut at the time at which the condition was met, see `cut_at_stop`.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context, Diagram, OutputPort, PortDataType

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.parts.site import Site
from simrob_drake.results.record.history import PlantSlice, StateHistory, parts, plant_slice


class Sampler:
    """Evaluates output ports of a station at any time of a recorded run.

    Attributes:
        diagram: the diagram that contains the station.
        memo: a cache in which callers keep results that depend on the history; emptied when the history changes.
    """

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
        context: Context | None = None,
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
            prepare: called whenever a context of the diagram is evaluated or returned; restores the references of this
                run in the diagram. None if the diagram serves this run alone.
            tolerant: whether values that cannot be evaluated become NaN, as after a run in which a block failed. If it
                is False, the error is raised.
            context: context of the diagram, for its parameters; it is copied. If it is None, the parameters are the
                diagram's default ones.
        """
        self.diagram = diagram
        self._site = site
        self._held = held
        self._begins_in_motion = begins_in_motion
        self._prepare = prepare
        self._tolerant = tolerant
        self._plant = site.plant.plant
        self._context = diagram.CreateDefaultContext() if context is None else context.Clone()
        self._plant_slice = plant_slice(diagram, self._plant, self._context)
        # Outputs that are a function of the plant's state alone, with this function: they need no context.
        self._of_state = dict[OutputPort, Callable[[Vector], Vector]]()
        for name, port in site.outputs.items():
            function = site.outputs.from_state(name)
            if function is not None:
                self._of_state[port] = function
        self._recorded = _recorded_groups(diagram, self._context)
        self.history = history

    @property
    def history(self) -> StateHistory:
        """The recorded states."""
        return self._history

    @history.setter
    def history(self, history: StateHistory) -> None:
        """Replace the recorded states, and forget what was computed from the former ones."""
        self._history = history
        self.memo: dict[Any, Any] = {}

    @property
    def step_times(self) -> Vector:
        """Start of the run and ends of the accepted steps, shape (m,) [s]."""
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
        # Other ports are functions of the state at the time itself, interpolated between two steps.
        values = self.evaluate(others, self._at(times))
        if held:
            steps = self._history.steps(times, begins_in_motion=self._begins_in_motion)
            values |= self.evaluate(held, steps)
        return [values[port] for port in ports]

    def evaluate(self, ports: Sequence[OutputPort], states: StateHistory) -> dict[OutputPort, Any]:
        """Evaluate ports at given states, in the cheapest way for each port.

        Args:
            ports: output ports of the diagram.
            states: the states, k rows.

        Returns:
            the values of each port: an array (k, size), or a list of k values of an abstract port.
        """
        state_port = self._site.state  # positions and velocities of the plant
        needs_state = [port for port in ports if port == state_port or port in self._of_state]
        others = [port for port in ports if port not in needs_state]
        known: dict[OutputPort, Any] = {}
        if needs_state:
            # A discrete plant has no continuous state: its state port is evaluated like any other.
            plant = self._plant_slice
            if plant is None:
                others.append(state_port)
            else:  # the state itself was recorded
                known[state_port] = states.continuous[
                    :, plant.positions.start : plant.velocities.stop
                ]

        # An output whose value is a discrete group was recorded as well. All others are evaluated by Drake.
        # A dict, not a set: the ports stay in order, and a port that is asked for twice is evaluated once.
        needed = dict.fromkeys(others)
        for port in needed:
            if port in self._recorded:
                known[port] = states.discrete[self._recorded[port]]
        known |= self._evaluate_with_drake([port for port in needed if port not in known], states)
        for port in needs_state:
            if port != state_port:
                known[port] = self._of_state[port](known[state_port])
        return {port: known[port] for port in ports}

    def _evaluate_with_drake(
        self, ports: Sequence[OutputPort], states: StateHistory
    ) -> dict[OutputPort, Any]:
        """Evaluate ports with Drake, by setting the context to each of the states.

        Args:
            ports: output ports of the diagram.
            states: the states, k rows.

        Returns:
            the values of each port: an array (k, size), or a list of k values of an abstract port.
        """
        if not ports:
            return {}
        # References of trajectories are set in the diagram, which may have run with other ones since.
        if self._prepare is not None:
            self._prepare()
        count = len(states.times)
        values = dict[OutputPort, Any]()
        contexts = dict[OutputPort, Context]()
        for port in ports:
            is_vector = port.get_data_type() == PortDataType.kVectorValued
            values[port] = np.empty((count, port.size())) if is_vector else [None] * count
            contexts[port] = port.get_system().GetMyContextFromRoot(self._context)
        # All ports at one state, then all at the next: setting the context is slow, and the ports share what Drake
        # caches for a state.
        for row in range(count):
            states.put(row, self._context)
            for port in ports:
                values[port][row] = self._value(port, contexts[port])
        return values

    def _value(self, port: OutputPort, context: Context) -> Any:
        """Evaluate one port. Returns a copy of its value, or NaN if the block fails and the sampler is tolerant.

        If the sampler is not tolerant, the error of the block is raised.

        Args:
            port: the port.
            context: context of the port's system.
        """
        try:
            value = port.Eval(context)
            # An abstract value is an object in Drake's cache, which the next evaluation changes. Arrays are copies.
            return value if isinstance(value, np.ndarray) else copy(value)
        except Exception:
            if not self._tolerant:
                raise
            return np.nan

    @property
    def looked_at(self) -> Context:
        """The diagram's context, with the state that was evaluated last."""
        return self._context

    def cut(self, time: float) -> None:
        """End the history at a time [s], with the interpolated state there, and make the sampler tolerant.

        This is for a run in which a block failed: values that cannot be evaluated become NaN instead of the same error.
        """
        end = self._at(np.array([time]))
        self.history = self._history.with_end(end)
        self._tolerant = True

    def contact_results(self, times: Vector) -> Iterator[ContactResults]:
        """Yield the plant's contact results at times (k,) [s] of the run."""
        yield from self.sample(
            [self._site.plant.plant_block.get_contact_results_output_port()], times
        )[0]

    def context_at(self, time: float) -> Context:
        """The diagram's context at a time of the run [s]. The next evaluation changes it."""
        if self._prepare is not None:
            self._prepare()
        self._at(np.array([time])).put(0, self._context)
        return self._context

    def final_context(self) -> Context:
        """A new context of the diagram, with the time and the state at the end of the run."""
        context = self._context.Clone()
        self._history.last().put(0, context)
        return context

    def _at(self, times: Vector) -> StateHistory:
        """States at times (k,) [s] of the run, interpolated between the recorded ones."""
        plant = self._plant_slice
        rates = None if plant is None else partial(self._rates, plant)
        return self._history.at(times, plant, rates)

    def _rates(self, part: PlantSlice, states: Vector) -> Vector:
        """Time derivatives of the plant's positions, shape (k, nq).

        They differ from the velocities for free bodies, whose orientations are quaternions.

        Args:
            part: positions and velocities of the plant in the continuous states.
            states: continuous states of the diagram, shape (k, nx).
        """
        plant = self._plant
        if plant.IsVelocityEqualToQDot():
            return states[:, part.velocities]
        # Quaternions change by q_dot = N(q) v, so that Drake needs the positions, one row at a time.
        context = plant.CreateDefaultContext()
        rates = np.empty((len(states), plant.num_positions()))
        for row, state in enumerate(states):
            plant.SetPositions(context, state[part.positions])
            rates[row] = plant.MapVelocityToQDot(context, state[part.velocities])
        return rates


def _recorded_groups(diagram: Diagram, root: Context) -> dict[OutputPort, int]:
    """Find the output ports whose value is a discrete group, so that it was recorded.

    Args:
        diagram: a diagram, whose subdiagrams are searched, too.
        root: a context of the root diagram.

    Returns:
        for each such port the index of the group among the discrete groups of the diagram.
    """
    found = dict[OutputPort, int]()
    # Index of the first group of each system: the groups of a diagram are those of its systems, in order.
    first_group = 0
    for system in diagram.GetSystems():
        own = dict[
            OutputPort, int
        ]()  # ports of this system, with the index of the group within the system
        if isinstance(system, Diagram):
            own = _recorded_groups(system, root)
        if isinstance(system, SampledBlock) or system.get_name().rpartition(".")[2] == "plant":
            # Sampled blocks, and another engine in place of Drake's plant, have an attribute with the group of each
            # output by its name. Drake's own plant has no such attribute.
            group_of_output: dict[str, int] = getattr(system, "outputs", {})
            own = {system.GetOutputPort(name): group for name, group in group_of_output.items()}
        for port, group in own.items():
            found[port] = first_group + group
        first_group += system.GetMyContextFromRoot(root).num_discrete_state_groups()
    return found


def sample_signals(sampler: Sampler, site: Site, times: Vector) -> Vector:
    """Evaluate all signals of a station.

    Args:
        sampler: evaluates the station's ports.
        site: the station, which declares the signals.
        times: times of the run, shape (m,) [s].

    Returns:
        the columns of all signals, in the order in which the station declares them, shape (m, k).
    """
    columns_of_signals = []
    column_count = 0
    for signal in site.outputs.signals:
        columns = slice(column_count, column_count + len(signal.names))
        columns_of_signals.append((signal, columns))
        column_count = columns.stop
    values = np.empty((len(times), column_count))

    # Most signals are values of an output port. They are evaluated for a part of the times at once, to save memory.
    ports = {
        signal.output: site.outputs[signal.output]
        for signal in site.outputs.signals
        if signal.output
    }
    for part in parts(len(times)):
        values_of_ports = sampler.sample(list(ports.values()), times[part])
        known = dict(zip(ports, values_of_ports, strict=True))
        for signal, columns in columns_of_signals:
            if signal.compute is None:
                # A signal may be some entries of an output, such as the positions among the state.
                whole = known[signal.output]
                values[part, columns] = (
                    whole if signal.entries is None else whole[:, signal.entries]
                )
    # The others need the whole run.
    for signal, columns in columns_of_signals:
        # A sensor whose output no block uses is not stepped. It is replayed over all samples, since its noise and its
        # delay depend on the samples before.
        if signal.compute is not None:
            values[:, columns] = signal.compute(sampler, times)
        # A signal may be a port's values with a change that depends on the time or on other ports.
        elif signal.adjust is not None:
            values[:, columns] = signal.adjust(sampler, times, values[:, columns])
    return values


TOLERANCE = 1e-4
"""Largest error of the time at which a monitor ends a run [s]."""

Holds = Callable[[Sampler, float], bool]
"""Evaluates the condition of a monitor at a time [s] of the run of a sampler."""

Step = Callable[[StateHistory, float], StateHistory]
"""Steps from the last state of a history before a time to that time [s], and returns the state there."""


@dataclass(frozen=True)
class Stop:
    """The end of a run by a monitor.

    Attributes:
        name: name of the monitor.
        count: count of recorded states up to the end of the run, including the start.
        onset: the condition has been met since this time [s].
        why: the reason, in words.
    """

    name: str
    count: int
    onset: float
    why: str


class Watch:
    """Evaluates the monitors of a station at the recorded steps.

    Attributes:
        stop: how a monitor ended the run; None as long as none did.
    """

    def __init__(
        self,
        site: Site,
        sampler: Sampler,
        *,
        held: Collection[OutputPort] = (),
        begins_in_motion: bool = False,
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
        # Since when the condition of each monitor is met [s]; NOT_YET if it is not.
        self._onsets = dict.fromkeys(site.outputs.monitors, NOT_YET)
        self._count = 0  # count of records that were evaluated
        # The last two states of the previous call. It is None before the first call.
        self._before: StateHistory | None = None
        self.stop: Stop | None = None

    def look(self, steps: StateHistory) -> bool:
        """Evaluate the monitors at the steps since the last call. Returns True if one of these steps ends the run.

        Args:
            steps: states at the ends of these steps.
        """
        # A trigger is a monitor's condition with the time for which it must hold before it ends the run. An onset is
        # the time since which the condition holds; NOT_YET if it does not.
        # All monitors at once, so that a port that several of them watch is evaluated once.
        ports_of_monitors = {name: self._ports(name) for name in self._site.outputs.monitors}
        all_ports = set[OutputPort]().union(*ports_of_monitors.values())
        values = self._values(all_ports, steps)
        for row, time in enumerate(steps.times.tolist()):
            for name, trigger in self._site.outputs.monitors.items():
                signals = [values[port][row] for port in ports_of_monitors[name]]
                onset = trigger.next_onset(self._onsets[name], time, signals)
                self._onsets[name] = onset
                # Of monitors that are met at the same step, the one that was declared first ends the run.
                if trigger.ends_run(onset, time):
                    reason = trigger.condition.why(*signals)
                    self.stop = Stop(name, count=self._count + row + 1, onset=onset, why=reason)
                    return True
        self._count += len(steps.times)
        return False

    def _values(self, ports: Collection[OutputPort], steps: StateHistory) -> dict[OutputPort, Any]:
        """Evaluate ports at the ends of steps. Held ports get the values that the solver kept over these steps.

        The last steps are kept for the next call, if there are held ports.

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
            known = steps if self._before is None else self._before.with_end(steps)
            states_of_steps = known.steps(steps.times, begins_in_motion=self._begins_in_motion)
            values |= self._sampler.evaluate(held, states_of_steps)
            # The second last state gives the time at which the last step began.
            self._before = known.last(2)
        return values

    def holds(self, name: str, sampler: Sampler, time: float) -> bool:
        """Whether a monitor's condition is met.

        Args:
            name: name of the monitor.
            sampler: evaluates the ports in a run.
            time: a time of this run [s].
        """
        values = [rows[0] for rows in sampler.sample(self._ports(name), np.array([time]))]
        return self._site.outputs.monitors[name].holds(time, values)

    def _ports(self, name: str) -> list[OutputPort]:
        """Output ports that a monitor's condition needs, in the order of its arguments."""
        return [
            self._site.outputs[output]
            for output in self._site.outputs.monitors[name].condition.watched
        ]


def cut_at_stop(sampler: Sampler, holds: Holds, step: Step, *, onset: float, hold: float) -> None:
    """Shorten the history of a sampler to the time at which its monitor ends the run.

    The monitor was evaluated at the ends of steps only. The time at which its condition is first met is estimated
    between two recorded states. The motion is stepped again up to this time plus ``hold``. If ``hold`` is 0, this is
    repeated until the states before and after are close together, since a state interpolated within a step is wrong if
    the step contains an impact. If the motion cannot be stepped again, as after a divergence, the history stays as it
    is.

    Args:
        sampler: the run, whose history is changed.
        holds: evaluates the condition of the monitor.
        step: steps the motion again, from the last recorded state before a time to that time.
        onset: the first recorded time of the last, uninterrupted span in which the condition is met [s].
        hold: how long the condition must be met before it ends the run [s].
    """
    recorded = sampler.history
    if len(recorded.times) < 2:  # the condition was met at the start
        return
    try:
        if hold > 0:
            _cut_after_hold(sampler, holds, step, onset, hold)
        else:
            _cut_at_onset(sampler, holds, step)
    except (RuntimeError, SystemExit):  # Drake's failed assertions come as SystemExit
        sampler.history = recorded


def _cut_after_hold(sampler: Sampler, holds: Holds, step: Step, onset: float, hold: float) -> None:
    """Shorten the history so that it ends when the condition has been met for the time ``hold`` [s].

    The history stays as it is if it does not end later than that.

    Args:
        sampler: the run, whose history is changed.
        holds: evaluates the condition of the monitor.
        step: steps the motion again, from the last recorded state before a time to that time.
        onset: the first recorded time of the last, uninterrupted span in which the condition is met [s].
        hold: how long the condition must be met before it ends the run, more than 0 [s].
    """
    recorded = sampler.history
    # A condition that must be met for a while began long before the end of the run, in a step that need not be
    # refined: an error of a part of a step is small compared to that while.
    first_met = _crossing(sampler, holds, onset)
    stop = first_met + hold
    if stop < recorded.end:
        sampler.history = recorded.with_end(step(recorded, stop))


def _cut_at_onset(sampler: Sampler, holds: Holds, step: Step) -> None:
    """Shorten the last step of the history until it is at most TOLERANCE long and the condition is met only at its end.

    Args:
        sampler: the run, whose history is changed. The condition is met at its end.
        holds: evaluates the condition of the monitor.
        step: steps the motion again, from the last recorded state before a time to that time.
    """
    while sampler.history.end - sampler.history.times[-2] > TOLERANCE:
        # The old end is kept, since it is the only state at which the condition is known to be met.
        end = sampler.history.last()
        between = step(sampler.history, _crossing(sampler, holds, end.end))
        shorter = sampler.history.with_end(between)
        sampler.history = shorter
        if not holds(sampler, between.end):
            # The condition is met between the new state and the old end.
            sampler.history = shorter.with_end(end)


def _crossing(sampler: Sampler, holds: Holds, seen: float) -> float:
    """Estimate, by bisection of interpolated states, when the condition of a monitor was met within a step.

    Args:
        sampler: the run.
        holds: evaluates the condition.
        seen: a recorded time at which the condition is met [s]: the end of the step, or the start of the run.

    Returns:
        the time [s], strictly inside of the step, so that a new state can be inserted there. It is ``seen`` if the
        step is as short as the tolerance, or if the condition was met at the start of the run.
    """
    times = sampler.history.times
    row = int(np.searchsorted(times, seen))
    if row == 0:  # no step comes before
        return seen
    begin = float(times[row - 1])
    if seen - begin <= TOLERANCE:
        return seen
    low = begin  # the condition is not met
    high = seen  # the condition is met
    # A quarter of the tolerance leaves room for the clipping at the end, which moves the time by up to half of
    # it.
    while high - low > TOLERANCE / 4:
        middle = (low + high) / 2
        if holds(sampler, middle):
            high = middle
        else:
            low = middle
    return float(np.clip(high, begin + TOLERANCE / 2, seen - TOLERANCE / 2))
