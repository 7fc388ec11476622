"""The states of a run at its accepted steps, and between them."""

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector

Rates = Callable[[Vector], Vector]
RUNAWAY = 1e8  # a position or speed [rad, m, rad/s, m/s] that no robot has: a run that gets there has diverged


_GO_ON = EventStatus.DidNothing()
_LOOK_EVERY = 20  # steps
# Differences of time up to this value are rounding [s]. A time may lie so far outside of the run, and two records that
# are so close are not the ends of a step.
_ROUNDING = 1e-9


class Recorder:
    """Keep time, continuous state, every discrete group and abstract state at each accepted step, whatever the solver.

    It is the simulator's monitor, which Drake calls after each step: it forces no steps and costs a few microseconds.
    Now and then it looks whether the state has run away, and asks whoever wants to look at what was recorded; either
    may end the run.
    """

    def __init__(
        self,
        simulator: Simulator,
        *watchers: Callable[[Context], None],
        look: "Callable[[StateHistory], bool] | None" = None,
        pace: Callable[[Context], None] | None = None,
    ) -> None:
        """Begin to record, as the monitor of a simulator, with the state that it starts from.

        After each accepted step watchers are called, and ``pace``, which may change the length of the next ones;
        ``look`` gets the steps since its last call now and then, and True ends the run.
        """
        self.times = array("d")
        self.failure: BaseException | None = None  # what a watcher raised, which is no fault of the simulation
        self._states: list[array[float]] = []  # of the continuous and of the discrete part, one state after another
        self._abstract: list[list[AbstractValue]] = []
        self._watchers, self._look, self._seen = watchers, look, 0
        self.attach(simulator, pace)

    def attach(self, simulator: Simulator, pace: Callable[[Context], None] | None = None) -> None:
        """Go on with a simulator whose context has the same layout, from the state that it is in."""
        self._pace = pace
        self._system = simulator.get_system()
        context = simulator.get_context()
        groups = range(context.num_discrete_state_groups())
        self._ends = np.cumsum([context.get_discrete_state(group).size() for group in groups], dtype=int).tolist()
        self._sizes = context.num_continuous_states(), self._ends[-1] if self._ends else 0
        self._states = self._states or [array("d") for _ in self._sizes]
        self._values = range(context.num_abstract_states())
        self._vector = context.get_continuous_state_vector()
        self._groups = [context.get_discrete_state(group).value() for group in groups]
        self._keep(context)
        simulator.set_monitor(self._keep)

    def _keep(self, context: Context) -> EventStatus:
        """Record a step and call the watchers: the simulator's monitor, which may end the run."""
        time = context.get_time()
        if self._pace is not None:
            self._pace(context)
        if self.times and time == self.times[-1]:  # an event at a step's end: what it left counts
            del self.times[-1:], self._abstract[-1:]
            for size, states in zip(self._sizes, self._states, strict=True):
                del states[len(states) - size :]
        self._copy(time, context)
        try:
            for watcher in self._watchers:
                watcher(context)
        except (Exception, SystemExit) as problem:
            self.failure = problem
            raise
        if len(self.times) % _LOOK_EVERY == 0:
            if not self.is_sane():
                return EventStatus.ReachedTermination(self._system, "a state ran away to infinity")
            if self.look():
                return EventStatus.ReachedTermination(self._system, "a monitor ended the run")
        return _GO_ON

    def _copy(self, time: float, context: Context) -> None:
        """Append the time and the state of a context to the record."""
        self.times.append(time)
        if self._sizes[0]:
            self._states[0].frombytes(self._vector.CopyToVector().tobytes())
        if self._sizes[1]:
            self._states[1].frombytes(np.concatenate(self._groups).tobytes())
        if self._values:
            self._abstract.append([context.get_abstract_state(index).Clone() for index in self._values])

    def look(self) -> bool:
        """Show the steps since the last look; tell whether they end the run."""
        if self._look is None or self._seen >= len(self.times):
            return False
        unseen = slice(self._seen, None)
        self._seen = len(self.times)
        return self._look(self._rows(unseen))

    def is_sane(self) -> bool:
        """Tell whether the last recorded state is made of numbers of a size that a robot can have."""
        ends = zip(self._states, self._sizes, strict=True)
        return all(_is_sane(np.array(states[len(states) - size :])).all() for states, size in ends)

    def history(self, count: int | None = None) -> "StateHistory":
        """Return what was recorded so far, up to the last sane state; its first ``count`` steps where that is given."""
        whole = self._rows(slice(0, count))
        sane = np.all([_sane(values) for values in (whole.continuous, *whole.discrete)], axis=0)
        kept = len(sane) if sane.all() else max(int(np.argmin(sane)), 1)
        return whole if kept == len(whole.times) else self._rows(slice(0, kept))

    def _rows(self, rows: slice) -> "StateHistory":
        """Make a history of some of the recorded states."""
        first, last, _ = rows.indices(len(self.times))
        everything = last - first == len(self.times)  # of which there shall be no second copy
        continuous, discrete = (
            np.asarray(states if everything else states[first * size : last * size]).reshape(last - first, size)
            for size, states in zip(self._sizes, self._states, strict=True)
        )
        groups = [discrete[:, slice(*ends)] for ends in pairwise([0, *self._ends])]
        return StateHistory(np.asarray(self.times[rows]), continuous, groups, self._abstract[rows])


def _sane(states: Vector) -> npt.NDArray[np.bool_]:
    """Tell which rows of values are sane."""
    return np.concatenate([_is_sane(states[part]).all(axis=1) for part in parts(len(states))])


def _is_sane(values: Vector) -> npt.NDArray[np.bool_]:
    """Tell which values are numbers below RUNAWAY; infinite is a monitor's "not yet"."""
    return np.asarray(np.isinf(values) | (np.abs(values) < RUNAWAY))


@dataclass(frozen=True)
class PlantSlice:
    """Where a continuous plant's positions and velocities lie in the state of its diagram."""

    positions: slice
    velocities: slice


def plant_slice(diagram: Diagram, plant: MultibodyPlant, context: Context) -> PlantSlice | None:
    """Return where the plant's state lies in a diagram's continuous state; None if it has none there."""
    start = 0
    for system in diagram.GetSystems():
        size = system.GetMyContextFromRoot(context).num_continuous_states()
        if system is plant:
            middle = start + plant.num_positions()
            return PlantSlice(slice(start, middle), slice(middle, start + size)) if size else None
        start += size
    return None


@dataclass(frozen=True)
class StateHistory:
    """States at the accepted steps of a run."""

    times: Vector  # of the steps' ends, shape (m,) [s], rising
    continuous: Vector  # continuous states, shape (m, nx)
    discrete: list[Vector] = field(default_factory=list)  # for every discrete group its values, shape (m, size)
    abstract: list[list[AbstractValue]] = field(default_factory=list)  # for every step, where there are any

    @property
    def end(self) -> float:
        """The time of the last state [s]."""
        return float(self.times[-1])

    def at(self, times: Vector, plant: PlantSlice | None, rates: Rates | None) -> "StateHistory":
        """Return the states at ``times`` (k,) [s], exact at step ends.

        Positions of the plant follow a cubic Hermite spline on the joint rates (k, nq) that ``rates`` gives, the rest
        of the continuous state a straight line; discrete values are those held over the step that ended there. Raises
        InvalidParameter: a time outside of the run, where nothing is known.
        """
        outside = ~((times >= self.times[0] - _ROUNDING) & (times <= self.end + _ROUNDING))
        if outside.any():
            known = f"within the run, {self.times[0]:g} to {self.end:g} s"
            raise InvalidParameter("time", f"{times[outside][0]:g} s", known)
        after = self._after(times)
        before = np.maximum(after - 1, 0)
        width = self.times[after] - self.times[before]
        part = np.divide(times - self.times[before], width, out=np.ones_like(times), where=width > 0)[:, np.newaxis]
        low, high = self.continuous[before], self.continuous[after]
        states = np.where(part == 1, high, low + part * (high - low))
        if plant is not None and rates is not None:
            knots = slice(None), plant.positions
            rows, place = np.unique([before, after], return_inverse=True)
            slopes = rates(self.continuous[rows])[place.reshape(2, -1)] * width[:, np.newaxis]
            states[knots] = _hermite(part, low[knots], high[knots], *slopes)
        return StateHistory(times, states, [group[after] for group in self.discrete], self._values_at(after))

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
        begin = self.times[np.maximum(end - 1, 0)]
        discrete = [group[end] for group in self.discrete]
        return StateHistory(begin, self.continuous[end], discrete, self._values_at(end))

    def _values_at(self, rows: npt.NDArray[np.intp]) -> list[list[AbstractValue]]:
        return [self.abstract[row] for row in rows] if self.abstract else []

    def _after(self, times: Vector) -> npt.NDArray[np.intp]:
        """Return the places of the first states that are not before ``times``; of the last one after the end."""
        return np.clip(np.searchsorted(self.times, times, side="left"), 0, len(self.times) - 1)

    def put(self, row: int, context: Context) -> None:
        """Set a context of the same diagram to the state of a row."""
        context.SetTime(self.times[row])
        if self.continuous.shape[1]:
            context.SetContinuousState(self.continuous[row])
        if self.discrete:
            values = context.get_mutable_discrete_state()  # at once: to set one notes all that depends on it
            for index, group in enumerate(self.discrete):
                values.set_value(index, group[row])
        for index, value in enumerate(self.abstract[row] if self.abstract else []):
            context.get_mutable_abstract_state(index).SetFrom(value)

    def joined(self, later: "StateHistory") -> "StateHistory":
        """Return these states, as far as they come before the first of ``later``, and those after them."""
        kept = self.times < later.times[0]
        return StateHistory(
            np.append(self.times[kept], later.times),
            np.vstack([self.continuous[kept], later.continuous]),
            [np.vstack([group[kept], end]) for group, end in zip(self.discrete, later.discrete, strict=True)],
            [*self.abstract[: int(kept.sum())], *later.abstract],
        )

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


def _hermite(part: Vector, low: Vector, high: Vector, low_slope: Vector, high_slope: Vector) -> Vector:
    """Return the cubic between two values with two slopes (per interval), at ``part`` from 0 to 1."""
    left = 1 - part
    return np.asarray(
        left**2 * ((1 + 2 * part) * low + part * low_slope) + part**2 * ((3 - 2 * part) * high - left * high_slope)
    )


_PART = 1000


def parts(count: int) -> list[slice]:
    """Cut rows into parts of a thousand, so that what is computed of each takes little memory at once."""
    return [slice(first, first + _PART) for first in range(0, count, _PART)]
