"""References: desired joint positions over time, as Drake trajectories and the sources that play them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydrake.polynomial import Polynomial
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder, ConstantVectorSource, Demultiplexer, Sine, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.blocks.events import EventTimes
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector

BLEND = (10.0, -15.0, 6.0)
"""Factors of :math:`s^3, s^4, s^5` in the shortest polynomial from 0 to 1 with zero velocity and acceleration there."""
PEAK = 1.875
"""Largest over mean speed of it."""
_JUMP = 1e-9  # rad or rad/s: what counts as a corner


@dataclass(frozen=True)
class ReferenceSource:
    """The ports of a reference, each of size n; the derivatives are None where they were not asked for."""

    position: OutputPort  # rad
    velocity: OutputPort | None = None  # rad/s
    acceleration: OutputPort | None = None  # rad/s²


def smooth(part: Vector) -> Vector:
    """Return :math:`10 s^3 - 15 s^4 + 6 s^5`, the part of a way from rest to rest at a part s of its time, 0 to 1."""
    return np.asarray(part**3 * (BLEND[0] + BLEND[1] * part + BLEND[2] * part**2))


def hold(position: npt.ArrayLike) -> Trajectory:
    """Stay at ``position``, shape (n,) [rad]."""
    return PiecewisePolynomial(np.asarray(position, dtype=float)[:, np.newaxis])


def ramp(start: npt.ArrayLike, target: npt.ArrayLike, *, duration: float, start_time: float = 0.0) -> Trajectory:
    """Go from ``start`` to ``target``, each (n,) [rad], at constant speed in ``duration`` [s]."""
    times = [start_time, start_time + duration]
    return PiecewisePolynomial.FirstOrderHold(times, np.column_stack([start, target]))


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
    breaks = [start_time, *times]
    if (np.diff(breaks) <= 0).any():
        raise InvalidParameter("times", list(times), f"rising, the first after {start_time:g} s")
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

    Raises:
        InvalidParameter: as :func:`table`.
    """
    breaks, samples = _checked(times, positions)
    return PiecewisePolynomial.CubicHermite(breaks, samples.T, _checked(times, velocities)[1].T)


def hermite_samples(trajectory: Trajectory, start: float, end: float, rate: float) -> tuple[Vector, Vector, Vector]:
    """Return times (m,) and positions and velocities (m, n) that give a trajectory back from ``start`` to ``end`` [s].

    Exactly, if it is made of cubics with continuous velocity: then its own breaks are enough. Another is sampled
    ``rate`` times a second between them.
    """
    cubic = isinstance(trajectory, PiecewisePolynomial) and _is_smooth_cubic(trajectory)
    grid = np.linspace(start, end, 2 if cubic else max(int((end - start) * rate), 1) + 1)
    if isinstance(trajectory, PiecewisePolynomial):
        breaks = np.array(trajectory.get_segment_times())
        grid = np.union1d(grid, breaks[(breaks > start) & (breaks < end)])
    return grid, trajectory.vector_values(grid).T, trajectory.MakeDerivative().vector_values(grid).T


def _is_smooth_cubic(trajectory: PiecewisePolynomial) -> bool:
    pieces = range(trajectory.get_number_of_segments())
    degrees = [
        trajectory.getSegmentPolynomialDegree(piece, row) for piece in pieces for row in range(trajectory.rows())
    ]
    return max(degrees) <= 3 and not set(corner_times(trajectory)) - {trajectory.start_time(), trajectory.end_time()}


def _checked(times: npt.ArrayLike, values: npt.ArrayLike) -> tuple[Vector, Vector]:
    breaks, samples = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    if breaks.ndim != 1 or samples.ndim != 2 or len(breaks) != len(samples) or len(breaks) < 2:
        raise InvalidParameter(
            "reference", f"{breaks.shape} times, {samples.shape} positions", "(m,) and (m, n), m > 1"
        )
    if not (np.isfinite(breaks).all() and np.isfinite(samples).all()):
        row = int(np.flatnonzero(~(np.isfinite(breaks) & np.isfinite(samples).all(axis=1)))[0])
        raise InvalidParameter("reference", f"row {row} with {breaks[row]}, {samples[row]}", "finite")
    if (np.diff(breaks) <= 0).any():
        row = int(np.flatnonzero(np.diff(breaks) <= 0)[0])
        raise InvalidParameter("reference times", f"{breaks[row]:g}, {breaks[row + 1]:g}", "rising from row to row [s]")
    return breaks, samples


def corner_times(trajectory: Trajectory) -> list[float]:
    """Return the times at which a piecewise polynomial's value or velocity jumps, its ends included.

    Other trajectories are taken as smooth inside; only their ends count.
    """
    start, end = trajectory.start_time(), trajectory.end_time()
    if not np.isfinite([start, end]).all():
        return []
    if not isinstance(trajectory, PiecewisePolynomial):
        return [time for time in (start, end) if time >= 0]
    velocity = trajectory.derivative()
    zero = np.zeros((trajectory.rows(), 1))
    times = trajectory.get_segment_times()
    corners = []
    for index, time in enumerate(times):
        before = trajectory.slice(index - 1, 1) if index else None
        after = trajectory.slice(index, 1) if index < len(times) - 1 else None
        jump = 0.0
        if before and after:
            jump = float(np.abs(before.value(time) - after.value(time)).max())
        left = before.derivative().value(time) if before else zero
        right = velocity.slice(index, 1).value(time) if after else zero
        if max(jump, float(np.abs(left - right).max())) > _JUMP and time >= 0:
            corners.append(time)
    return corners


def add_trajectory(
    builder: DiagramBuilder, trajectory: Trajectory, *, name: str = "reference_source", derivatives: bool = False
) -> ReferenceSource:
    """Add a source that plays a trajectory of shape (n, 1), holds its ends, and makes its corners events.

    Raises:
        InvalidParameter: a trajectory that is no column.
    """
    if trajectory.cols() != 1:
        raise InvalidParameter("trajectory", f"{trajectory.rows()} x {trajectory.cols()}", "of shape (n, 1)")
    source = builder.AddNamedSystem(name, TrajectorySource(trajectory, 2 if derivatives else 0))
    corners = corner_times(trajectory)
    if corners:
        builder.AddNamedSystem(f"{name}.corners", EventTimes(corners))
    if not derivatives:
        return ReferenceSource(source.get_output_port())
    split = builder.AddNamedSystem(f"{name}.derivatives", Demultiplexer([trajectory.rows()] * 3))
    builder.Connect(source.get_output_port(), split.get_input_port())
    return ReferenceSource(*(split.get_output_port(order) for order in range(3)))


def add_sine(
    builder: DiagramBuilder,
    centre: Vector,
    amplitude: Vector,
    *,
    frequency: float,
    phase: Vector,
    name: str = "reference_source",
) -> ReferenceSource:
    r"""Add :math:`q = q_c + a \sin(2 \pi f t + \varphi)` with its derivatives.

    Args:
        builder: the diagram under construction.
        centre: q_c, shape (n,) [rad].
        amplitude: a, shape (n,) [rad].
        frequency: f [Hz].
        phase: the angle at the start, shape (n,) [rad].
        name: of the source block.
    """
    count = len(centre)
    wave = builder.AddNamedSystem(name, Sine(amplitude, np.full(count, 2 * np.pi * frequency), phase))
    middle = builder.AddNamedSystem(f"{name}.centre", ConstantVectorSource(centre))
    sum_ = builder.AddNamedSystem(f"{name}.sum", Adder(2, count))
    builder.Connect(wave.get_output_port(0), sum_.get_input_port(0))
    builder.Connect(middle.get_output_port(), sum_.get_input_port(1))
    return ReferenceSource(sum_.get_output_port(), wave.get_output_port(1), wave.get_output_port(2))
