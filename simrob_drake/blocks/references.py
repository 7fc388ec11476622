"""References: desired joint positions over time, as Drake trajectories and the sources that play them."""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

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
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.block import add_and_connect, add_sum

BLEND = (10.0, -15.0, 6.0)
"""Factors of :math:`s^3, s^4, s^5` in the shortest polynomial from 0 to 1 with zero velocity and acceleration there."""
PEAK = 1.875
"""Largest over mean speed of it."""
_JUMP = 1e-9  # largest change of a position [rad or m] or velocity [rad/s or m/s] that counts as rounding
_RATE = 1000.0  # samples of a trajectory that is no cubic, or of a sine [Hz]
_CUBIC = 4  # order of a spline, as of a polynomial of so many coefficients


Samples = tuple[npt.ArrayLike, npt.ArrayLike]
"""Times (m,) [s] and positions (m, n) [rad]."""


class ReferenceSignal(ABC):
    """Desired positions of n axes as a function of time, for everything that uses a reference.

    There are two kinds: `SineReference`, and `TrajectoryReference` for a trajectory of Drake. The functions of this
    module take both, and plain trajectories of Drake.
    """

    @property
    @abstractmethod
    def size(self) -> int:
        """Count of axes n."""

    @property
    @abstractmethod
    def span(self) -> tuple[float, float]:
        """Start and end of the motion [s]. Before and after it the reference stands still. They may be infinite."""

    @property
    @abstractmethod
    def oscillates(self) -> bool:
        """Whether the motion repeats for ever, so that samples between two times cannot stand for it."""

    @property
    @abstractmethod
    def player_key(self) -> Hashable:
        """Identifies the source that plays the reference in a diagram.

        A source can play another reference instead if its key is equal.
        """

    @property
    @abstractmethod
    def corner_times(self) -> list[float]:
        """Times at which the position or the velocity jumps, without negative ones [s]. Steps must end there."""

    @abstractmethod
    def values(self, times: Vector, order: int = 0) -> Vector:
        """Compute the positions at times (m,) [s], shape (m, n) [rad or m], or their derivative of an order."""

    @abstractmethod
    def later(self, time: float) -> "Reference":
        """The reference as it goes on from a time [s], which becomes zero."""

    @abstractmethod
    def as_sine(self) -> "SineReference | None":
        """The reference as a sine, without amplitude if it stands still. Returns None if it is another motion."""

    @abstractmethod
    def as_polynomial(self) -> PiecewisePolynomial | None:
        """The reference as a piecewise polynomial. Returns None if it is no such function."""

    @abstractmethod
    def add_source(self, builder: DiagramBuilder, name: str, derivatives: int) -> "ReferenceSource":
        """Add the source that plays the reference.

        Args:
            builder: builder of the diagram.
            name: name of the source.
            derivatives: count of derivatives that are needed, 0 to 2. The source may give more.

        Returns:
            the ports of the positions and the derivatives.
        """

    @abstractmethod
    def table(self, duration: float) -> "ReferenceTable":
        """Samples from which the reference can be reconstructed by interpolation.

        Args:
            duration: duration of the run [s], up to which the reference is needed.
        """


@dataclass(frozen=True)
class ReferenceTable:
    """Samples of a reference, as a file holds them.

    Attributes:
        interpolation: how the samples are joined, as the key ``interpolation`` of a table in a station file.
        times: shape (m,) [s].
        values: positions, shape (m, n) [rad or m]; with ``hermite``, positions and velocities, shape (m, 2 n).
    """

    interpolation: Literal["cubic", "hermite"]
    times: Vector
    values: Vector


@dataclass(frozen=True)
class SineReference(ReferenceSignal):
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
        """Compute the positions at times (m,) [s], shape (m, n) [rad], or their derivative of an order."""
        rate = 2 * np.pi * self.frequency
        swing = self.amplitude * rate**order * np.sin(rate * times[:, np.newaxis] + self.phase + order * np.pi / 2)
        return np.asarray(swing if order else self.centre + swing)

    @property
    def size(self) -> int:
        """Count of axes n."""
        return len(self.centre)

    @property
    def span(self) -> tuple[float, float]:
        """A sine never begins and never ends."""
        return -np.inf, np.inf

    @property
    def oscillates(self) -> bool:
        """A sine repeats for ever."""
        return True

    @property
    def player_key(self) -> Hashable:
        """A source plays one sine only: the key consists of all parameters."""
        parameters = [self.centre, self.amplitude, self.phase]
        return ("sine", self.frequency, *(tuple(np.asarray(values).tolist()) for values in parameters))

    @property
    def corner_times(self) -> list[float]:
        """A sine has no corners."""
        return []

    def later(self, time: float) -> "SineReference":
        """The sine as it goes on from a time [s], which becomes zero."""
        return replace(self, phase=self.phase + 2 * np.pi * self.frequency * time)

    def as_sine(self) -> "SineReference":
        """The sine itself."""
        return self

    def as_polynomial(self) -> None:
        """A sine is no polynomial."""

    def add_source(self, builder: DiagramBuilder, name: str, derivatives: int) -> "ReferenceSource":
        """Add Drake's `Sine` and a constant for the centre, and sum them.

        The result always has both derivatives, whatever `derivatives` says.
        """
        angular_frequency = np.full(len(self.centre), 2 * np.pi * self.frequency)  # [rad/s]
        wave = builder.AddNamedSystem(name, Sine(self.amplitude, angular_frequency, self.phase))
        centre = add_and_connect(builder, f"{name}.centre", ConstantVectorSource(self.centre))
        position = add_sum(builder, f"{name}.sum", wave.get_output_port(0), centre)
        return ReferenceSource(
            position=position, velocity=wave.get_output_port(1), acceleration=wave.get_output_port(2)
        )

    def table(self, duration: float) -> ReferenceTable:
        """Samples of the sine, about a thousand a second, which a cubic spline joins. There are at least two."""
        times = np.linspace(0.0, duration, int(duration * _RATE) + 2)
        return ReferenceTable(interpolation="cubic", times=times, values=self.values(times))


@dataclass(frozen=True)
class TrajectoryReference(ReferenceSignal):
    """A trajectory of Drake as a reference: it stands still before its start and after its end.

    Attributes:
        trajectory: the trajectory, of shape (n, 1).
    """

    trajectory: Trajectory

    @property
    def size(self) -> int:
        """Count of axes n."""
        return int(self.trajectory.rows())

    @property
    def span(self) -> tuple[float, float]:
        """Start and end of the trajectory [s]; infinite if it is a constant."""
        return self.trajectory.start_time(), self.trajectory.end_time()

    @property
    def oscillates(self) -> bool:
        """A trajectory stands still after its end."""
        return False

    @property
    def player_key(self) -> Hashable:
        """One source can play all trajectories."""
        return "trajectory"

    @property
    def corner_times(self) -> list[float]:
        """Times at which the position or the velocity jumps, without negative ones [s].

        Of a piecewise polynomial they are found among its breaks. Its start and its end count if it begins or ends with
        a velocity. Other trajectories are taken as smooth inside, and both their ends always count.
        """
        start, end = self.span
        if not np.isfinite([start, end]).all():
            return []
        trajectory = self.trajectory
        if not isinstance(trajectory, PiecewisePolynomial):
            return [time for time in (start, end) if time >= 0]

        # All breaks are compared at once, since a table may have thousands: values just before a break, which are those
        # of the piece before it, with the values at the break.
        breaks = np.array(trajectory.get_segment_times())
        just_before = breaks - 4 * np.spacing(np.maximum(np.abs(breaks), 1.0))
        position_jumps = np.abs(trajectory.vector_values(just_before) - trajectory.vector_values(breaks))
        derivative = trajectory.derivative()
        velocities_before = derivative.vector_values(just_before)
        velocities_after = derivative.vector_values(breaks)
        # The reference rests before the start and after the end.
        velocities_before[:, 0] = 0.0
        velocities_after[:, -1] = 0.0
        velocity_jumps = np.abs(velocities_before - velocities_after)
        largest_jumps = np.maximum(velocity_jumps, position_jumps).max(axis=0)
        corners: list[float] = breaks[(largest_jumps > _JUMP) & (breaks >= 0)].tolist()
        return corners

    def values(self, times: Vector, order: int = 0) -> Vector:
        """Compute the positions at times (m,) [s], shape (m, n) [rad or m], or their derivative of an order.

        Before the start the position is that at the start, and after the end that at the end.
        """
        inside = np.clip(times, *self.span)
        derivative = self.trajectory.MakeDerivative(order) if order else self.trajectory
        values = np.asarray(derivative.vector_values(inside.tolist())).T
        # Derivatives are zero before the start and after the end.
        return np.asarray(values * (inside == times)[:, np.newaxis]) if order else values

    def later(self, time: float) -> Trajectory:
        """Shift the trajectory so that `time` [s] becomes zero. The part before is kept, at negative times.

        If the trajectory is over by then, the result is a constant at its end. A trajectory that is no polynomial and
        no spline is sampled a thousand times a second.
        """
        if time >= self.trajectory.end_time():
            return hold(self.values(np.array([time]))[0])
        return _moved(self.trajectory, time)

    def as_sine(self) -> SineReference | None:
        """A sine without amplitude if the trajectory stands still. Returns None if it moves."""
        start, end = self.span
        position = self.values(np.array([start]))[0]
        if np.isfinite([start, end]).all():
            # A motion to and fro ends where it began, so the samples in between count, too.
            _, positions, velocities = hermite_samples(self.trajectory, start, end, _RATE)
            if max(np.abs(positions - position).max(initial=0.0), np.abs(velocities).max(initial=0.0)) > _JUMP:
                return None
        zero = np.zeros(len(position))
        return SineReference(centre=position, amplitude=zero, frequency=0.0, phase=zero)

    def as_polynomial(self) -> PiecewisePolynomial | None:
        """The trajectory itself if it is a piecewise polynomial, otherwise None."""
        return self.trajectory if isinstance(self.trajectory, PiecewisePolynomial) else None

    def add_source(self, builder: DiagramBuilder, name: str, derivatives: int) -> "ReferenceSource":
        """Add Drake's `TrajectorySource`. If it gives derivatives, a demultiplexer splits its output.

        The result has exactly the derivatives that are asked for, at most two.

        Raises:
            InvalidParameter: the trajectory is no column.
        """
        trajectory = self.trajectory
        if trajectory.cols() != 1:
            raise InvalidParameter(
                "trajectory",
                f"{trajectory.rows()} x {trajectory.cols()}",
                message("blocks.of_shape_n_1", "of shape (n, 1)"),
            )
        source = builder.AddNamedSystem(name, TrajectorySource(trajectory, derivatives))
        if not derivatives:
            return ReferenceSource(position=source.get_output_port(), player=source)
        sizes = [trajectory.rows()] * (1 + derivatives)
        split = builder.AddNamedSystem(f"{name}.derivatives", Demultiplexer(sizes))
        builder.Connect(source.get_output_port(), split.get_input_port())
        return ReferenceSource(
            position=split.get_output_port(0),
            velocity=split.get_output_port(1),
            acceleration=split.get_output_port(2) if derivatives > 1 else None,
            player=source,
        )

    def table(self, duration: float) -> ReferenceTable:
        """Positions and velocities of the trajectory, as far as a run follows it, which cubics join."""
        first, last = self.span
        start = max(first, 0.0)
        end = min(last, duration)
        if start >= end:
            # The trajectory begins after the run, or is over before it: the run only holds one of its ends.
            position = self.trajectory.value(float(np.clip(0.0, first, last)))[:, 0]
            sample = np.append(position, np.zeros_like(position))
            return ReferenceTable(
                interpolation="hermite", times=np.array([0.0, duration]), values=np.tile(sample, (2, 1))
            )
        times, positions, velocities = hermite_samples(self.trajectory, start, end, _RATE)
        return ReferenceTable(interpolation="hermite", times=times, values=np.hstack([positions, velocities]))


Reference: TypeAlias = Trajectory | ReferenceSignal
"""Desired joint positions over time: a trajectory (n, 1), which holds its ends, or a sine."""


def as_reference(reference: Reference) -> ReferenceSignal:
    """Return a reference with the questions of `ReferenceSignal`. A plain trajectory is wrapped."""
    return TrajectoryReference(reference) if isinstance(reference, Trajectory) else reference


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
    """Compute the positions of a reference at times (m,) [s], shape (m, n) [rad or m], or their derivative of an order.

    A trajectory rests at its start before it begins, and at its end after it is over.
    """
    return as_reference(reference).values(times, order)


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
        shapes = message(
            "blocks.times_and_positions",
            "{times} times, {positions} positions",
            times=breaks.shape,
            positions=samples.shape,
        )
        raise InvalidParameter("reference", shapes, message("blocks.of_shape_m_n", "(m,) and (m, n), m > 1"))
    if not (np.isfinite(breaks).all() and np.isfinite(samples).all()):
        row = int(np.flatnonzero(~(np.isfinite(breaks) & np.isfinite(samples).all(axis=1)))[0])
        raise InvalidParameter(
            "reference",
            message(
                "blocks.row_with",
                "row {row} with {time}, {positions}",
                row=row,
                time=breaks[row],
                positions=samples[row],
            ),
            "finite",
        )
    return _rising(breaks, message("blocks.reference_times", "reference times")), samples


def _rising(times: Vector, name: str) -> Vector:
    """Check that each time (m,) [s] is later than the one before, by more than rounding."""
    close = np.flatnonzero(~(np.diff(times) >= SHORTEST))
    if close.size:
        expected = message("blocks.rising_by", "rising by {shortest:g} s or more each [s]", shortest=SHORTEST)
        raise InvalidParameter(
            name, compound("{first:g}, {second:g}", first=times[close[0]], second=times[close[0] + 1]), expected
        )
    return times


def later(reference: Reference, time: float) -> Reference:
    """Shift a reference so that `time` [s] becomes zero. The part before is kept, at negative times.

    If a trajectory is over by then, the result is a constant at its end. A reference that is no polynomial, spline or
    sine is sampled a thousand times a second.
    """
    return as_reference(reference).later(time)


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


def corner_times(reference: Reference) -> list[float]:
    """Times at which the position or the velocity of a reference jumps, without negative ones [s].

    Of a piecewise polynomial, these are the breaks at which the position or the velocity jumps; at its ends, the jump
    is that from or to rest. Of other trajectories they are both ends, always. A sine has none.
    """
    return as_reference(reference).corner_times


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
    return as_reference(reference).add_source(builder, name, derivatives)


add_course = add_reference
"""Its former name."""
