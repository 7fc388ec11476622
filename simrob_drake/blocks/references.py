"""References: desired joint positions over time, as Drake trajectories and the sources that play them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.math import BsplineBasis
from pydrake.polynomial import Polynomial
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, Sine, TrajectorySource
from pydrake.trajectories import BsplineTrajectory, CompositeTrajectory, PiecewisePolynomial, Trajectory

from simrob_drake.base.arguments import SHORTEST
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector, numbers
from simrob_drake.blocks.block import fed, summed

BLEND = (10.0, -15.0, 6.0)
"""Factors of :math:`s^3, s^4, s^5` in the shortest polynomial from 0 to 1 with zero velocity and acceleration there."""
PEAK = 1.875
"""Largest over mean speed of it."""
_JUMP = 1e-9  # rad or rad/s: what counts as a corner
_RATE = 1000.0  # Hz
_CUBIC = 4  # order of a spline, as of a polynomial of so many coefficients


Samples = tuple[npt.ArrayLike, npt.ArrayLike]
"""Times (m,) [s] and positions (m, n) [rad]."""


@dataclass(frozen=True)
class SineReference:
    r"""The reference :math:`q = q_c + a \sin(2 \pi f t + \varphi)`.

    Attributes:
        centre: q_c, shape (n,) [rad].
        amplitude: a, shape (n,) [rad].
        frequency: f [Hz].
        phase: the angle at the start, shape (n,) [rad].
    """

    centre: Vector
    amplitude: Vector
    frequency: float
    phase: Vector

    def values(self, times: Vector, order: int = 0) -> Vector:
        """Return the positions at times (m,) [s], shape (m, n) [rad], or their derivative of an order."""
        rate = 2 * np.pi * self.frequency
        swing = self.amplitude * rate**order * np.sin(rate * times[:, np.newaxis] + self.phase + order * np.pi / 2)
        return np.asarray(swing if order else self.centre + swing)


Reference: TypeAlias = Trajectory | SineReference
"""Desired joint positions over time: a trajectory (n, 1), which holds its ends, or a sine."""


@dataclass(frozen=True)
class ReferenceSource:
    """A reference in a diagram.

    Attributes:
        position: port of size n [rad].
        velocity, acceleration: its derivatives [rad/s, rad/s²]; None where they were not asked for.
        player: the block that plays a trajectory; None of a sine.
    """

    position: OutputPort
    velocity: OutputPort | None = None
    acceleration: OutputPort | None = None
    player: TrajectorySource | None = None


def reference_values(reference: Reference, times: Vector, order: int = 0) -> Vector:
    """Return where a reference is at times (m,) [s], shape (m, n) [rad], or a derivative; it holds its ends."""
    if isinstance(reference, SineReference):
        return reference.values(times, order)
    inside = np.clip(times, reference.start_time(), reference.end_time())
    derivative = reference.MakeDerivative(order) if order else reference
    values = np.asarray(derivative.vector_values(inside.tolist())).T
    return np.asarray(values * (inside == times)[:, np.newaxis]) if order else values


def smooth(part: Vector) -> Vector:
    """Return :math:`10 s^3 - 15 s^4 + 6 s^5`, the part of a way from rest to rest at a part s of its time, 0 to 1."""
    return np.asarray(part**3 * (BLEND[0] + BLEND[1] * part + BLEND[2] * part**2))


def hold(position: npt.ArrayLike) -> Trajectory:
    """Stay at ``position``, shape (n,) [rad]."""
    return PiecewisePolynomial(np.asarray(position, dtype=float)[:, np.newaxis])


def ramp(
    start: npt.ArrayLike, target: npt.ArrayLike, *, duration: float, start_time: float = 0.0, blend: float = 0.0
) -> Trajectory:
    """Go from ``start`` to ``target``, each (n,) [rad], at constant speed.

    With a ``blend`` [s] the speed grows and falls evenly for so long at either end, less than half of the duration.
    """
    ends = np.array([start, target], dtype=float)
    if not blend:
        return table([start_time, start_time + duration], ends, linear=True)
    speed = (ends[1] - ends[0]) / (duration - blend)
    reached, rest = speed * blend / 2, np.zeros_like(speed)
    times = start_time + np.array([0.0, blend, duration - blend, duration])
    return hermite(times, [ends[0], ends[0] + reached, ends[1] - reached, ends[1]], [rest, speed, speed, rest])


def move(start: npt.ArrayLike, target: npt.ArrayLike, *, duration: float, start_time: float = 0.0) -> Trajectory:
    """Go from ``start`` to ``target``, each (n,) [rad], resting at both ends, with continuous acceleration."""
    return sequence(start, [start_time + duration], [target], start_time=start_time)


def sequence(
    start: npt.ArrayLike, times: Sequence[float], targets: Sequence[npt.ArrayLike], *, start_time: float = 0.0
) -> Trajectory:
    """Go through ``targets``, each (n,) [rad], at ``times`` [s], resting at each.

    Between two of them by the polynomial of :func:`smooth`.

    Raises:
        InvalidParameter: times that do not rise.
    """
    breaks = _rising(np.array([start_time, *times], dtype=float), "times")
    points = [np.asarray(point, dtype=float) for point in (start, *targets)]
    segments = []
    for low, high, before, after in zip(points, points[1:], breaks, breaks[1:], strict=False):
        span, distance = after - before, high - low
        shape = BLEND / span ** np.array([3, 4, 5])
        segments.append(
            np.array([[Polynomial([q, 0.0, 0.0, *(shape * d)])] for q, d in zip(low, distance, strict=True)])
        )
    return PiecewisePolynomial(segments, breaks)


def table(times: npt.ArrayLike, positions: npt.ArrayLike, *, linear: bool = False) -> Trajectory:
    """Follow samples, ``times`` (m,) [s] and ``positions`` (m, n) [rad], by a cubic spline or straight lines.

    Raises:
        InvalidParameter: fewer than two samples, times that do not rise, or values that are not finite.
    """
    breaks, samples = _checked(times, positions)
    if linear or len(breaks) < 3:
        return PiecewisePolynomial.FirstOrderHold(breaks, samples.T)
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(breaks, samples.T)


def hermite(times: npt.ArrayLike, positions: npt.ArrayLike, velocities: npt.ArrayLike) -> Trajectory:
    """Go through samples with given velocities, both (m, n) [rad, rad/s], by a cubic between each two ``times`` [s].

    It is a spline with double knots, since a piecewise polynomial of Drake takes thirty times the memory.

    Raises:
        InvalidParameter: as :func:`table`.
    """
    breaks, samples = _checked(times, positions)
    rates, third = _checked(times, velocities)[1], np.diff(breaks)[:, np.newaxis] / 3
    points = np.repeat(samples, 2, axis=0)
    points[1:-1:2] += third * rates[:-1]
    points[2::2] -= third * rates[1:]
    knots = np.concatenate([breaks[[0, 0]], np.repeat(breaks, 2), breaks[[-1, -1]]])
    return BsplineTrajectory(BsplineBasis(_CUBIC, knots.tolist()), list(points[:, :, np.newaxis]))


def hermite_samples(trajectory: Trajectory, start: float, end: float, rate: float) -> tuple[Vector, Vector, Vector]:
    """Return times (m,) and positions and velocities (m, n) that give a trajectory back from ``start`` to ``end`` [s].

    Exactly, if it is made of cubics with continuous velocity: then its own breaks are enough. Another is sampled
    ``rate`` times a second between them.
    """
    breaks, cubic = _breaks(trajectory)
    grid = np.linspace(start, end, 2 if cubic else max(int((end - start) * rate), 1) + 1)
    inner = breaks[(breaks > start + SHORTEST) & (breaks < end - SHORTEST)]
    apart = np.abs(np.subtract.outer(grid, inner)).min(axis=1, initial=np.inf) > SHORTEST
    grid = np.union1d(grid[apart], inner)
    return grid, trajectory.vector_values(grid).T, trajectory.MakeDerivative().vector_values(grid).T


def _breaks(trajectory: Trajectory) -> tuple[Vector, bool]:
    """Return where the pieces of a trajectory meet [s], and whether they are cubics with continuous velocity."""
    if isinstance(trajectory, BsplineTrajectory):
        breaks, counts = np.unique(trajectory.basis().knots(), return_counts=True)
        if trajectory.basis().order() <= _CUBIC and (counts[1:-1] <= _CUBIC - 2).all():
            return breaks, True
    if isinstance(trajectory, CompositeTrajectory):
        return np.array(trajectory.get_segment_times()), False
    if not isinstance(trajectory, PiecewisePolynomial):
        return np.zeros(0), False
    pieces = range(trajectory.get_number_of_segments())
    degrees = [
        trajectory.getSegmentPolynomialDegree(piece, row) for piece in pieces for row in range(trajectory.rows())
    ]
    corners = set(corner_times(trajectory)) - {trajectory.start_time(), trajectory.end_time()}
    return np.array(trajectory.get_segment_times()), max(degrees) < _CUBIC and not corners


def _checked(times: npt.ArrayLike, values: npt.ArrayLike) -> tuple[Vector, Vector]:
    breaks, samples = numbers(times), numbers(values)
    if breaks.ndim != 1 or samples.ndim != 2 or len(breaks) != len(samples) or len(breaks) < 2:
        shapes = f"{breaks.shape} times, {samples.shape} positions"
        raise InvalidParameter("reference", shapes, "(m,) and (m, n), m > 1")
    if not (np.isfinite(breaks).all() and np.isfinite(samples).all()):
        row = int(np.flatnonzero(~(np.isfinite(breaks) & np.isfinite(samples).all(axis=1)))[0])
        raise InvalidParameter("reference", f"row {row} with {breaks[row]}, {samples[row]}", "finite")
    return _rising(breaks, "reference times"), samples


def _rising(times: Vector, name: str) -> Vector:
    """Check that each time (m,) [s] is later than the one before, by more than rounding."""
    close = np.flatnonzero(~(np.diff(times) >= SHORTEST))
    if close.size:
        expected = f"rising by {SHORTEST:g} s or more each [s]"
        raise InvalidParameter(name, f"{times[close[0]]:g}, {times[close[0] + 1]:g}", expected)
    return times


def later(reference: Reference, time: float) -> Reference:
    """Return a reference as it goes on from a time on [s], which becomes zero; before it, it is what it was.

    What is no polynomial, spline or sine is sampled a thousand times a second.
    """
    if isinstance(reference, SineReference):
        return replace(reference, phase=reference.phase + 2 * np.pi * reference.frequency * time)
    if time >= reference.end_time():
        return hold(reference_values(reference, np.array([time]))[0])
    return _moved(reference, time)


def _moved(trajectory: Trajectory, time: float) -> Trajectory:
    if isinstance(trajectory, PiecewisePolynomial):
        moved = trajectory.Clone()
        moved.shiftRight(-time)
        return moved
    if isinstance(trajectory, BsplineTrajectory):
        basis = trajectory.basis()
        return BsplineTrajectory(
            BsplineBasis(basis.order(), [knot - time for knot in basis.knots()]), trajectory.control_points()
        )
    if isinstance(trajectory, CompositeTrajectory):
        segments = range(trajectory.get_number_of_segments())
        return CompositeTrajectory([_moved(trajectory.segment(number), time) for number in segments])
    times, *samples = hermite_samples(trajectory, trajectory.start_time(), trajectory.end_time(), _RATE)
    return hermite(times - time, *samples)


def corner_times(trajectory: Reference) -> list[float]:
    """Return the times at which a piecewise polynomial's value or velocity jumps, its ends included.

    Other trajectories are taken as smooth inside; only their ends count.
    """
    if isinstance(trajectory, SineReference):
        return []
    start, end = trajectory.start_time(), trajectory.end_time()
    if not np.isfinite([start, end]).all():
        return []
    if not isinstance(trajectory, PiecewisePolynomial):
        return [time for time in (start, end) if time >= 0]
    times, rates = np.array(trajectory.get_segment_times()), trajectory.derivative()
    before = times - 4 * np.spacing(np.maximum(np.abs(times), 1.0))
    left, right = rates.vector_values(before), rates.vector_values(times)
    left[:, 0] = right[:, -1] = 0.0  # it rests before and after
    jumps = np.maximum(np.abs(left - right), np.abs(trajectory.vector_values(before) - trajectory.vector_values(times)))
    found: list[float] = times[(jumps.max(axis=0) > _JUMP) & (times >= 0)].tolist()
    return found


def add_reference(
    builder: DiagramBuilder, reference: Reference, *, name: str = "reference_source", derivatives: int = 0
) -> ReferenceSource:
    """Add the source of a reference; that of a trajectory holds its ends.

    Steps must end at its :func:`corner_times`: error control measures steps that are smooth, and a scheme that
    freezes its inputs over a step misses what happens within it.

    Args:
        builder: of the diagram.
        reference: to play.
        name: of the source.
        derivatives: how many are given, too; a sine gives both.

    Raises:
        InvalidParameter: a trajectory that is no column.
    """
    if isinstance(reference, SineReference):
        count = len(reference.centre)
        frequency = np.full(count, 2 * np.pi * reference.frequency)
        wave = builder.AddNamedSystem(name, Sine(reference.amplitude, frequency, reference.phase))
        middle = fed(builder, f"{name}.centre", ConstantVectorSource(reference.centre))
        position = summed(builder, f"{name}.sum", wave.get_output_port(0), middle)
        return ReferenceSource(position, wave.get_output_port(1), wave.get_output_port(2))
    if reference.cols() != 1:
        raise InvalidParameter("trajectory", f"{reference.rows()} x {reference.cols()}", "of shape (n, 1)")
    source = builder.AddNamedSystem(name, TrajectorySource(reference, derivatives))
    if not derivatives:
        return ReferenceSource(source.get_output_port(), player=source)
    split = builder.AddNamedSystem(f"{name}.derivatives", Demultiplexer([reference.rows()] * (1 + derivatives)))
    builder.Connect(source.get_output_port(), split.get_input_port())
    position, velocity, *further = (split.get_output_port(order) for order in range(1 + derivatives))
    return ReferenceSource(position, velocity, further[0] if further else None, source)


add_course = add_reference
"""Its former name."""
