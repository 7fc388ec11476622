"""States of a run at its steps, and between them.

A solver advances a run in *steps*. After each step that the solver accepts, a `Recorder` copies the state of the
diagram. The recorded states form a `StateHistory`: one *row* for each accepted step, and row 0 for the start of the
run. States between two rows are interpolated.

Drake's state has a *continuous* part, a vector; a *discrete* part, which consists of several vectors (groups) that
change at certain times only; and *abstract* values, arbitrary objects.
"""

from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message

Rates = Callable[[Vector], Vector]
"""Computes time derivatives of the plant's positions, (k, nq), from continuous states of the diagram, (k, nx)."""

Mask = npt.NDArray[np.bool_]
"""One boolean for each row or each value."""

RUNAWAY = 1e8
"""A state of this size has diverged: no robot has such a position or speed [rad, m, rad/s, m/s]."""

_GO_ON = EventStatus.DidNothing()
"""Result of a callback after which Drake continues the run."""

_CHECK_EVERY = 20
"""Count of steps between two checks of the recorded states: a check takes longer than a record."""

_ROUNDING = 1e-9
"""Differences of time up to this value are rounding [s]. A time may lie so far outside of the run, and two records that
are so close are not the ends of a step."""


class Recorder:
    """Copies time and state of a diagram after each accepted step, whatever the solver.

    It is the simulator's *monitor*, a callback of Drake after each step. So it forces no steps, and costs a few
    microseconds for each. Every 20 steps it also checks whether the state has diverged, and shows the new steps to a
    callback; either may end the run.

    Attributes:
        times: time of each record [s].
        failure: the exception of a callback ``watchers`` or ``inspect``, which is no fault of the simulation; None if
            none of them failed.
    """

    def __init__(
        self,
        simulator: Simulator,
        *watchers: Callable[[Context], None],
        look: "Callable[[StateHistory], bool] | None" = None,
        pace: Callable[[Context], None] | None = None,
        inspect: "Iterable[Callable[[Recorder], None]]" = (),
    ) -> None:
        """Begin to record a simulator, whose present state becomes row 0.

        Args:
            simulator: the simulator. The recorder becomes its monitor.
            watchers: callbacks after each step, with the context of the diagram.
            look: callback for the steps since its last call, about every 20 steps. It returns True to end the run.
            pace: callback before each record, which may change the length of the next steps.
            inspect: callbacks after each step with the recorder, before the watchers.
        """
        self._inspect = tuple(inspect)
        self.times = array("d")
        self.failure: BaseException | None = None
        # Values of all records, one record after another: of the continuous state, and of all discrete groups.
        self._continuous = array("d")
        self._discrete = array("d")
        # Abstract values of each record; empty if the diagram has none.
        self._abstract: list[list[AbstractValue]] = []
        self._watchers = watchers
        self._look = look
        self._shown = 0  # count of records that the callback `look` has got
        self.attach(simulator, pace)

    def attach(self, simulator: Simulator, pace: Callable[[Context], None] | None = None) -> None:
        """Continue the record with another simulator, beginning with its present state.

        A run calls this where the diagram that is stepped changes, and where the solver is initialized again.

        Args:
            simulator: a simulator whose context has the same states, in the same order, as that of the former one.
            pace: as in the constructor.
        """
        self._pace = pace
        self._system = simulator.get_system()
        context = simulator.get_context()
        group_indices = range(context.num_discrete_state_groups())
        # Groups are stored one after another: the end of each group in a record of the discrete state.
        sizes = [context.get_discrete_state(index).size() for index in group_indices]
        # A former diagram may be another one than the present, so sizes and references are looked up anew.
        self._group_ends = np.cumsum(sizes, dtype=int).tolist()
        self._discrete_size = sum(sizes)
        self._continuous_size = context.num_continuous_states()
        self._abstract_indices = range(context.num_abstract_states())
        # References into the context, so that a record needs no lookup.
        self._continuous_vector = context.get_continuous_state_vector()
        self._groups = [context.get_discrete_state(index).value() for index in group_indices]
        self._record(context)
        # The simulator may be initialized already, so its present state is recorded here. If Drake calls the monitor
        # again at the same time, the later record replaces this one.
        simulator.set_monitor(self._record)

    def _record(self, context: Context) -> EventStatus:
        """Record a step and call the callbacks. Returns Drake's status for continuing or for ending the run.

        Every 20 records it also checks for divergence and calls `look`. An exception of one of the `watchers` or of
        `inspect` is kept as `failure` and raised again.
        """
        time = context.get_time()
        if self._pace is not None:
            self._pace(context)
        is_same_time = bool(self.times) and time == self.times[-1]
        if is_same_time:
            # An event at the end of a step has changed the state. The state after the event counts.
            self._drop_last()
        self._copy(time, context)
        try:
            for inspect in self._inspect:
                inspect(self)
            for watcher in self._watchers:
                watcher(context)
        except (Exception, SystemExit) as problem:
            self.failure = problem
            raise
        if len(self.times) % _CHECK_EVERY == 0:
            # Divergence is checked first: monitors would evaluate a state that has no meaning any more.
            if not self.is_sane():
                return EventStatus.ReachedTermination(self._system, "a state ran away to infinity")
            if self.look():
                return EventStatus.ReachedTermination(self._system, "a monitor ended the run")
        return _GO_ON

    def _copy(self, time: float, context: Context) -> None:
        """Append the time and the state of a context to the record."""
        self.times.append(time)
        if self._continuous_size:
            # The bytes of a whole vector are copied at once, which is much faster than appending its numbers.
            self._continuous.frombytes(self._continuous_vector.CopyToVector().tobytes())
        if self._discrete_size:
            self._discrete.frombytes(np.concatenate(self._groups).tobytes())
        if self._abstract_indices:
            # Cloned, since the context keeps changing the same objects.
            values = [context.get_abstract_state(index).Clone() for index in self._abstract_indices]
            self._abstract.append(values)

    def _drop_last(self) -> None:
        """Remove the last record, which another one of the same time replaces."""
        del self.times[-1:]
        del self._abstract[-1:]
        del self._continuous[len(self._continuous) - self._continuous_size :]
        del self._discrete[len(self._discrete) - self._discrete_size :]

    def look(self) -> bool:
        """Call the callback `look` with the steps since its last call. Returns True if it ends the run.

        Without a callback, or without new steps, nothing happens and the result is False.
        """
        if self._look is None or self._shown >= len(self.times):
            return False
        first = self._shown
        self._shown = len(self.times)
        return self._look(self._rows(first, len(self.times)))

    def is_sane(self) -> bool:
        """Whether all values of the last record have a size that is possible for a robot, or are infinite."""
        # Counted from the start: a slice from -0 would take everything if the diagram has no such state.
        continuous = self._continuous[len(self._continuous) - self._continuous_size :]
        discrete = self._discrete[len(self._discrete) - self._discrete_size :]
        return bool(_is_sane(np.array(continuous)).all() and _is_sane(np.array(discrete)).all())

    def history(self, count: int | None = None) -> "StateHistory":
        """The recorded states before the first one that has diverged, and at least row 0.

        A state has diverged if a value is NaN, or finite with an absolute value of at least RUNAWAY. Infinite values
        are regular: blocks store them for "not yet".

        Args:
            count: largest count of rows. If it is None, all rows are taken.
        """
        rows = len(self.times) if count is None else min(count, len(self.times))
        whole = self._rows(0, rows)
        sane = np.all(
            [_are_rows_sane(values) for values in (whole.continuous, *whole.discrete)], axis=0
        )
        if sane.all():
            return whole
        # The first row that is not sane: False is the smallest of all booleans.
        first_bad = int(np.argmin(sane))
        # Row 0 stays in any case, since every history needs a start.
        return self._rows(0, max(first_bad, 1))

    def _rows(self, first: int, end: int) -> "StateHistory":
        """Make a history of the records from ``first`` up to, but without, ``end``."""
        continuous = self._matrix(self._continuous, self._continuous_size, first, end)
        discrete = self._matrix(self._discrete, self._discrete_size, first, end)
        groups = [discrete[:, start:stop] for start, stop in pairwise([0, *self._group_ends])]
        return StateHistory(
            np.asarray(self.times[first:end]), continuous, groups, self._abstract[first:end]
        )

    def _matrix(self, values: "array[float]", size: int, first: int, end: int) -> Vector:
        """Values of some records as a matrix, shape (end - first, size), with one row for each record.

        The matrix of all records is a view of the memory, since a long run should not be copied. Others are copies.

        Args:
            values: values of all records, one record after another.
            size: count of values of a record.
            first: index of the first record.
            end: index after the last record.
        """
        is_everything = first == 0 and end == len(self.times)
        # A slice of an array of the standard library is a copy, unlike one of NumPy.
        part = values if is_everything else values[first * size : end * size]
        return np.asarray(part).reshape(end - first, size)


def _are_rows_sane(states: Vector) -> Mask:
    """Whether all values of a row are sane, see :func:`_is_sane`, for each row (m,) of values (m, k)."""
    masks = [_is_sane(states[part]).all(axis=1) for part in parts(len(states))]
    return np.concatenate(masks)


def _is_sane(values: Vector) -> Mask:
    """Whether each value has a size that is possible for a robot, or is infinite.

    NaN and finite values of RUNAWAY or more are not sane. Infinity is: blocks store it for "not yet", such as a
    monitor whose condition is not met, or the delay of a sampled block before the first sample.
    """
    # Comparisons with NaN are False, so NaN needs no test of its own.
    return np.asarray(np.isinf(values) | (np.abs(values) < RUNAWAY))


@dataclass(frozen=True)
class PlantSlice:
    """Ranges of indices of a continuous plant's positions and velocities in the continuous state of its diagram."""

    positions: slice
    velocities: slice


def plant_slice(diagram: Diagram, plant: MultibodyPlant, context: Context) -> PlantSlice | None:
    """Find the state of the plant in the continuous state of a diagram.

    Returns None if the plant has no continuous state, as a discrete plant, or is no direct subsystem of the diagram.

    Args:
        diagram: the diagram.
        plant: the plant.
        context: a context of the diagram.
    """
    # The continuous state of a diagram consists of those of its systems, in order.
    start = 0
    for system in diagram.GetSystems():
        size = system.GetMyContextFromRoot(context).num_continuous_states()
        if system is plant:
            if size == 0:
                return None
            middle = start + plant.num_positions()
            return PlantSlice(
                positions=slice(start, middle), velocities=slice(middle, start + size)
            )
        start += size
    return None


@dataclass(frozen=True)
class StateHistory:
    """States at the ends of the accepted steps of a run.

    Attributes:
        times: ends of the steps, and the start of the run as row 0, shape (m,) [s], rising.
        continuous: continuous states, shape (m, nx).
        discrete: values of each discrete group, shape (m, size) each.
        abstract: abstract values of each row; empty if the diagram has none.
    """

    times: Vector
    continuous: Vector
    discrete: list[Vector] = field(default_factory=list)
    abstract: list[list[AbstractValue]] = field(default_factory=list)

    def __getstate__(self) -> dict[str, Any]:
        """Content of a pickled history: Drake's abstract values as the Python objects that they contain."""
        # Drake's values cannot be pickled, but the objects in them can.
        values = [[_plain_value(value) for value in row] for row in self.abstract]
        return {**self.__dict__, "abstract": values}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled history: Python objects become Drake's abstract values again."""
        # A frozen dataclass refuses assignments, but not changes of its dict.
        self.__dict__.update(state)
        self.__dict__["abstract"] = [
            [_abstract_value(*value) for value in row] for row in state["abstract"]
        ]

    @property
    def end(self) -> float:
        """Time of the last state [s]."""
        return float(self.times[-1])

    def at(self, times: Vector, plant: PlantSlice | None, rates: Rates | None) -> "StateHistory":
        """Compute the states at any times of the run; they are exact at the ends of steps.

        Within a step, positions of the plant follow a cubic Hermite spline. The rest of the continuous state is
        interpolated linearly. Discrete and abstract values are those at the end of the step.

        Args:
            times: the times, shape (k,) [s].
            plant: part of the continuous state that is the plant; None if there is no plant in it.
            rates: computes the derivatives of the plant's positions. If ``plant`` or ``rates`` is None, positions are
                interpolated linearly, too.

        Returns:
            a history with k rows.

        Raises:
            InvalidParameter: a time is outside of the run.
        """
        # NaN fails both comparisons, so it is outside.
        is_inside = (times >= self.times[0] - _ROUNDING) & (times <= self.end + _ROUNDING)
        if not is_inside.all():
            known = message(
                "results.within_run",
                "within the run, {begin:g} to {end:g} s",
                begin=self.times[0],
                end=self.end,
            )
            raise InvalidParameter("time", compound("{time:g} s", time=times[~is_inside][0]), known)
        # Rows of the end and of the begin of the step in which each time is. At the start of the run both are row 0.
        after = self._after(times)
        before = np.maximum(after - 1, 0)
        # lengths of the steps [s]; 0 for the start of the run
        width = self.times[after] - self.times[before]
        # The share of the step that has passed at each time, from 0 to 1, shape (k, 1); 1 at the start of the run.
        elapsed = times - self.times[before]
        # Without a width to divide by, the value of `out` remains: 1, which selects the state of row 0.
        shares = np.divide(elapsed, width, out=np.ones_like(times), where=width > 0)
        part = shares[:, np.newaxis]
        low = self.continuous[before]
        high = self.continuous[after]
        # At the end of a step the recorded state itself: the sum would miss it by rounding.
        states = np.where(part == 1, high, low + part * (high - low))
        if plant is not None and rates is not None:
            columns = plant.positions
            # Many times share a step, and computing rates is slow: compute the rates of each row once. `indices` has,
            # for all of `before` and then all of `after`, the index of the row among the distinct rows.
            rows, indices = np.unique([before, after], return_inverse=True)
            index_before, index_after = indices.reshape(2, -1)
            rates_of_rows = rates(self.continuous[rows])
            # Slopes are changes over a whole step.
            low_slopes = rates_of_rows[index_before] * width[:, np.newaxis]
            high_slopes = rates_of_rows[index_after] * width[:, np.newaxis]
            states[:, columns] = _hermite(
                part, low[:, columns], high[:, columns], low_slopes, high_slopes
            )
        return StateHistory(
            times, states, [group[after] for group in self.discrete], self._values_at(after)
        )

    def steps(self, times: Vector, *, begins_in_motion: bool = False) -> "StateHistory":
        """Find the step of the solver that contains each of the given times; the end of a step belongs to the step.

        Steps of rounding length do not count, and the step before is taken instead. Solvers take such steps if a sum
        of step lengths misses by 1e-15 s a time at which the solver must stop: a tick, an edge of a push, a corner of
        a reference. A torque in such a step has no time to act.

        Args:
            times: times within the run, shape (k,) [s].
            begins_in_motion: whether the run continues the motion of another run. The time of the start then belongs
                to the first step. Otherwise the start is a step of its own, of length zero.

        Returns:
            the states at the ends of these steps, k rows. Their ``times`` are those at which the steps begin.
        """
        # The first record, the start of the run, counts as the end of a step: its difference is infinite.
        has_length = np.diff(self.times, prepend=-np.inf) > _ROUNDING
        rows = np.arange(len(self.times))
        # For each record, the row of the latest record up to there that ends a step with a length.
        last_end = np.maximum.accumulate(np.where(has_length, rows, 0))
        end = last_end[self._after(times)]
        if begins_in_motion and has_length[1:].any():
            # Row 0 is the start; the first step is the first one with a length after it.
            first_step = 1 + int(np.argmax(has_length[1:]))
            end = np.maximum(end, first_step)
        # The start of the run, as a step of length zero, begins where it ends.
        begin = self.times[np.maximum(end - 1, 0)]
        discrete = [group[end] for group in self.discrete]
        return StateHistory(begin, self.continuous[end], discrete, self._values_at(end))

    def _values_at(self, rows: npt.NDArray[np.intp]) -> list[list[AbstractValue]]:
        """Abstract values of some rows, one list for each row; empty if the diagram has no abstract values."""
        return [self.abstract[row] for row in rows] if self.abstract else []

    def _after(self, times: Vector) -> npt.NDArray[np.intp]:
        """Row of the first state that is not before each of the times; the last row for a time after the end."""
        # A time may be after the end by rounding; without the bound its row would not exist.
        return np.clip(np.searchsorted(self.times, times, side="left"), 0, len(self.times) - 1)

    def put(self, row: int, context: Context) -> None:
        """Set the time and the state of a context to those of a row.

        Args:
            row: index of the row.
            context: context of a diagram with the same states. It is changed.
        """
        context.SetTime(self.times[row])
        if self.continuous.shape[1]:
            context.SetContinuousState(self.continuous[row])
        if self.discrete:
            # All groups in one call: each call invalidates everything that depends on the discrete state.
            values = context.get_mutable_discrete_state()
            for index, group in enumerate(self.discrete):
                values.set_value(index, group[row])
        if self.abstract:
            for index, value in enumerate(self.abstract[row]):
                context.get_mutable_abstract_state(index).SetFrom(value)

    def with_end(self, later: "StateHistory") -> "StateHistory":
        """Replace the end of this history by a later one.

        Returns:
            the states of this history before the first time of ``later``, then all states of ``later``.
        """
        # Strictly before: a row of the same time is replaced by the first row of the later history.
        is_before = self.times < later.times[0]
        discrete = []
        for group, later_group in zip(self.discrete, later.discrete, strict=True):
            discrete.append(np.vstack([group[is_before], later_group]))
        kept_count = int(is_before.sum())
        return StateHistory(
            times=np.append(self.times[is_before], later.times),
            continuous=np.vstack([self.continuous[is_before], later.continuous]),
            discrete=discrete,
            abstract=[*self.abstract[:kept_count], *later.abstract],
        )

    def rows(self, part: slice) -> "StateHistory":
        """The states of a range of rows. The arrays are views of the same memory."""
        groups = [group[part] for group in self.discrete]
        return StateHistory(self.times[part], self.continuous[part], groups, self.abstract[part])

    def last(self, count: int = 1) -> "StateHistory":
        """Copy the last ``count`` states, or all states if there are fewer.

        Copies are needed because a recorder's arrays cannot grow while a view of their memory exists.
        """
        return StateHistory(
            self.times[-count:].copy(),
            self.continuous[-count:].copy(),
            [group[-count:].copy() for group in self.discrete],
            self.abstract[-count:],
        )


def python_value(value: AbstractValue) -> Any:
    """Object in an abstract value. It is None for types of Drake without Python bindings.

    A discrete plant of a user's diagram has such a value. It can be copied, but not read.
    """
    try:
        return value.get_value()
    except RuntimeError:
        return None


def _plain_value(value: AbstractValue) -> tuple[Any, bool]:
    """Object in an abstract value, and whether the value is declared as any Python object, not as a type of Drake's.

    The object is None if Python cannot read it.
    """
    return python_value(value), isinstance(value, Value[object])


def _abstract_value(content: Any, is_any_object: bool) -> AbstractValue:
    """Make an abstract value of an object, as :func:`_plain_value` gives it."""
    return Value[object](content) if is_any_object else AbstractValue.Make(content)


def _hermite(
    part: Vector, low: Vector, high: Vector, low_slope: Vector, high_slope: Vector
) -> Vector:
    """Evaluate cubic Hermite polynomials, which have given values and slopes at both ends.

    With s = ``part``, values a and b, and slopes m and n at the ends, the value is
    (1 - s)² ((1 + 2 s) a + s m) + s² ((3 - 2 s) b - (1 - s) n).

    Args:
        part: position between the ends, from 0 to 1, shape (k, 1).
        low: values at 0, shape (k, n).
        high: values at 1, shape (k, n).
        low_slope: derivatives by ``part`` at 0, shape (k, n).
        high_slope: derivatives by ``part`` at 1, shape (k, n).
    """
    left = 1 - part
    from_low = left**2 * ((1 + 2 * part) * low + part * low_slope)
    from_high = part**2 * ((3 - 2 * part) * high - left * high_slope)
    return np.asarray(from_low + from_high)


class FlightCheck(NamedTuple):
    """A check, at the end of a step, whether a floating body touches nothing, see `simulation.pace.Flight`.

    Attributes:
        time: time of the check [s].
        steps: count of steps up to the check, in the same diagram.
        is_flying: whether a body touches nothing.
        speeds: vertical velocities of the floating bodies, shape (k,) [m/s].
    """

    time: float
    steps: int
    is_flying: bool
    speeds: Vector


_PART = 1000
"""Count of rows that are evaluated at once."""


def parts(count: int) -> list[slice]:
    """Divide rows into parts of a thousand, so that intermediate results of each part need little memory.

    Args:
        count: count of the rows.
    """
    return [slice(first, first + _PART) for first in range(0, count, _PART)]
