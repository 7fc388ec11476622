"""References: desired positions of axes as functions of time, and the blocks that play them in a diagram.

A reference is a trajectory of Drake or a sine. The functions of this module make trajectories from samples or targets,
and answer questions about references of both kinds. Trajectories have the shape (n, 1) for n axes; positions are in
rad, or in m for axes that slide. Times that differ by less than `SHORTEST` [s] count as one time.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.math import BsplineBasis
from pydrake.polynomial import Polynomial
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, Sine, TrajectorySource
from pydrake.trajectories import (
    BsplineTrajectory,
    CompositeTrajectory,
    PiecewisePolynomial,
    Trajectory,
)

from simrob_drake.base.arguments import SHORTEST, seconds
from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector, numbers
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of
from simrob_drake.blocks.block import add_and_connect, add_sum

BLEND = (10.0, -15.0, 6.0)
"""Factors of :math:`s^3, s^4, s^5` in the polynomial from 0 to 1 with zero velocity and acceleration at both ends."""
PEAK = 1.875
"""Largest speed of this polynomial over its mean speed."""
# Largest change of a position [rad or m] or velocity [rad/s or m/s] that counts as rounding.
_JUMP = 1e-9
# Sampling rate of sines, and of trajectories that are not made of cubics [Hz].
_RATE = 1000.0
# Order of cubic splines: the count of coefficients of a cubic polynomial.
_CUBIC_ORDER = 4


Samples = tuple[npt.ArrayLike, npt.ArrayLike]
"""Times (m,) [s] and positions (m, n) [rad or m]."""


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
        """Whether the motion repeats for ever, so that samples of a time span do not describe it."""

    @property
    @abstractmethod
    def player_key(self) -> Hashable:
        """Key of the source that plays the reference in a diagram.

        The source can play another reference instead if the keys of both references are equal.
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
        """Shift the reference in time, so that `time` [s] becomes zero."""

    @abstractmethod
    def as_sine(self) -> "SineReference | None":
        """The reference as a sine, without amplitude if it stands still. Returns None if it is another motion."""

    @abstractmethod
    def as_polynomial(self) -> PiecewisePolynomial | None:
        """The reference as a piecewise polynomial. Returns None if it is no such function."""

    @abstractmethod
    def add_source(
        self,
        builder: DiagramBuilder,
        name: str,
        derivatives: int,
    ) -> "ReferenceSource":
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
        centre: q_c, shape (n,) [rad or m].
        amplitude: a, shape (n,) [rad or m].
        frequency: f [Hz].
        phase: the angle at the start, shape (n,) [rad].
    """

    centre: Vector
    amplitude: Vector
    frequency: float
    phase: Vector

    def values(self, times: Vector, order: int = 0) -> Vector:
        """Compute the positions at times (m,) [s], shape (m, n) [rad or m], or their derivative of an order."""
        rate = 2 * np.pi * self.frequency
        # Each derivative multiplies the amplitude by the rate, and shifts the phase by a quarter of a turn.
        angle = rate * times[:, np.newaxis] + self.phase + order * np.pi / 2
        swing = self.amplitude * rate**order * np.sin(angle)
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
        """Key that is equal for sines of equal parameters only, as a source cannot play another sine."""
        parameters = [self.centre, self.amplitude, self.phase]
        # Arrays and lists have no hash, tuples do.
        entries = [tuple(np.asarray(values).tolist()) for values in parameters]
        return ("sine", self.frequency, *entries)

    @property
    def corner_times(self) -> list[float]:
        """A sine has no corners."""
        return []

    def later(self, time: float) -> "SineReference":
        """Shift the sine in time, so that `time` [s] becomes zero."""
        # sin(w (t + T) + phi) = sin(w t + (phi + w T)): a shift in time is one of the phase.
        return replace(self, phase=self.phase + 2 * np.pi * self.frequency * time)

    def as_sine(self) -> "SineReference":
        """The sine itself."""
        return self

    def as_polynomial(self) -> None:
        """A sine is no polynomial."""

    def add_source(
        self,
        builder: DiagramBuilder,
        name: str,
        derivatives: int,
    ) -> "ReferenceSource":
        """Add Drake's `Sine` and a constant for the centre, and sum them.

        Args:
            builder: builder of the diagram.
            name: name of the sine, and prefix of the names of the other blocks.
            derivatives: without effect: the result always has both derivatives.
        """
        # omega = 2 pi f [rad/s], equal for all axes.
        angular_frequency = np.full(len(self.centre), 2 * np.pi * self.frequency)
        wave = builder.AddNamedSystem(name, Sine(self.amplitude, angular_frequency, self.phase))
        centre = add_and_connect(builder, f"{name}.centre", ConstantVectorSource(self.centre))
        position = add_sum(builder, f"{name}.sum", wave.get_output_port(0), centre)
        return ReferenceSource(
            position=position,
            velocity=wave.get_output_port(1),
            acceleration=wave.get_output_port(2),
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
        # Only a constant has infinite ends, and it has no corners.
        if not np.isfinite([start, end]).all():
            return []
        trajectory = self.trajectory
        if not isinstance(trajectory, PiecewisePolynomial):
            return [time for time in (start, end) if time >= 0]

        # All breaks are compared at once, since a table may have thousands: values just before a break, which are those
        # of the piece before it, with the values at the break.
        breaks = np.array(trajectory.get_segment_times())
        # Four steps of rounding before each break; at least those of 1 s, as a break may be at 0.
        just_before = breaks - 4 * np.spacing(np.maximum(np.abs(breaks), 1.0))
        position_jumps = np.abs(
            trajectory.vector_values(just_before) - trajectory.vector_values(breaks)
        )
        derivative = trajectory.derivative()
        velocities_before = derivative.vector_values(just_before)
        velocities_after = derivative.vector_values(breaks)
        # The reference rests before the start and after the end.
        velocities_before[:, 0] = 0.0
        velocities_after[:, -1] = 0.0
        velocity_jumps = np.abs(velocities_before - velocities_after)
        largest_jumps = np.maximum(velocity_jumps, position_jumps).max(axis=0)
        is_corner = (largest_jumps > _JUMP) & (breaks >= 0)
        corners: list[float] = breaks[is_corner].tolist()
        return corners

    def values(self, times: Vector, order: int = 0) -> Vector:
        """Compute the positions at times (m,) [s], shape (m, n) [rad or m], or their derivative of an order.

        Before the start the position is that at the start, and after the end that at the end.
        """
        start, end = self.span
        inside = np.clip(times, start, end)
        derivative = self.trajectory.MakeDerivative(order) if order else self.trajectory
        values = np.asarray(derivative.vector_values(inside.tolist())).T
        if order == 0:
            return values
        # Derivatives are zero before the start and after the end.
        is_inside = inside == times
        return np.asarray(values * is_inside[:, np.newaxis])

    def later(self, time: float) -> Trajectory:
        """Shift the trajectory so that `time` [s] becomes zero. The part before is kept, at negative times.

        If the trajectory is over by then, the result is a constant at its end. A trajectory that is no polynomial and
        no spline is sampled a thousand times a second.
        """
        if time >= self.trajectory.end_time():
            return hold(self.values(np.array([time]))[0])
        return _shift(self.trajectory, time)

    def as_sine(self) -> SineReference | None:
        """A sine without amplitude if the trajectory stands still. Returns None if it moves."""
        start, end = self.span
        # A constant has infinite ends, and the same position there.
        position = self.values(np.array([start]))[0]
        if np.isfinite([start, end]).all():
            # A motion that returns ends where it began, so the samples in between are compared, too.
            samples = hermite_samples(self.trajectory, start, end, _RATE)
            largest_distance = np.abs(samples.positions - position).max(initial=0.0)
            largest_speed = np.abs(samples.velocities).max(initial=0.0)
            if max(largest_distance, largest_speed) > _JUMP:
                return None
        zero = np.zeros(len(position))
        return SineReference(centre=position, amplitude=zero, frequency=0.0, phase=zero)

    def as_polynomial(self) -> PiecewisePolynomial | None:
        """The trajectory itself if it is a piecewise polynomial, otherwise None."""
        return self.trajectory if isinstance(self.trajectory, PiecewisePolynomial) else None

    def add_source(
        self,
        builder: DiagramBuilder,
        name: str,
        derivatives: int,
    ) -> "ReferenceSource":
        """Add Drake's `TrajectorySource`. If it gives derivatives, a demultiplexer splits its output.

        Args:
            builder: builder of the diagram.
            name: name of the source, and prefix of the name of the demultiplexer.
            derivatives: count of derivatives, 0 to 2. The result has exactly these.

        Raises:
            InvalidParameter: the trajectory is no column.
        """
        trajectory = self.trajectory
        if trajectory.cols() != 1:
            shape = f"{trajectory.rows()} x {trajectory.cols()}"
            raise InvalidParameter(
                "trajectory", shape, message("blocks.of_shape_n_1", "of shape (n, 1)")
            )
        source = builder.AddNamedSystem(name, TrajectorySource(trajectory, derivatives))
        if not derivatives:
            return ReferenceSource(position=source.get_output_port(), player=source)
        sizes = [trajectory.rows()] * (1 + derivatives)
        # Drake stacks positions, velocities and accelerations in one port.
        split = builder.AddNamedSystem(f"{name}.derivatives", Demultiplexer(sizes))
        builder.Connect(source.get_output_port(), split.get_input_port())
        return ReferenceSource(
            position=split.get_output_port(0),
            velocity=split.get_output_port(1),
            acceleration=split.get_output_port(2) if derivatives > 1 else None,
            player=source,
        )

    def table(self, duration: float) -> ReferenceTable:
        """Positions and velocities of the trajectory, as far as a run follows it, which cubics join.

        Args:
            duration: duration of the run [s], up to which the reference is needed.
        """
        first, last = self.span
        start = max(first, 0.0)
        end = min(last, duration)
        if start >= end:
            # The trajectory begins after the run, or is over before it: the run only holds one of its ends. The time 0
            # is clipped to its start in the first case, and to its end in the second.
            position = self.trajectory.value(float(np.clip(0.0, first, last)))[:, 0]
            at_rest = np.append(position, np.zeros_like(position))
            return ReferenceTable(
                interpolation="hermite",
                times=np.array([0.0, duration]),
                values=np.tile(at_rest, (2, 1)),
            )
        samples = hermite_samples(self.trajectory, start, end, _RATE)
        values = np.hstack([samples.positions, samples.velocities])
        return ReferenceTable(interpolation="hermite", times=samples.times, values=values)


Reference: TypeAlias = Trajectory | ReferenceSignal
"""Desired joint positions over time: a trajectory (n, 1), which holds its ends, or a sine."""


def as_reference(reference: Reference) -> ReferenceSignal:
    """Return the reference as a `ReferenceSignal`. A trajectory of Drake is wrapped."""
    return TrajectoryReference(reference) if isinstance(reference, Trajectory) else reference


@dataclass(frozen=True)
class ReferenceSource:
    """A reference in a diagram.

    Attributes:
        position: port of size n [rad or m].
        velocity: port of size n [rad/s], or None if the derivative was not asked for.
        acceleration: port of size n [rad/s²], or None if the derivative was not asked for.
        player: the block that plays a trajectory, or None for a sine.
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
    """Compute :math:`10 s^3 - 15 s^4 + 6 s^5`: the part of a path, gone from rest to rest, at a part s of its time."""
    return np.asarray(part**3 * (BLEND[0] + BLEND[1] * part + BLEND[2] * part**2))


def hold(position: npt.ArrayLike) -> Trajectory:
    """Trajectory that stays at a position, shape (n,) [rad or m]."""
    return PiecewisePolynomial(np.asarray(position, dtype=float)[:, np.newaxis])


def ramp(
    start: npt.ArrayLike,
    target: npt.ArrayLike,
    *,
    duration: float,
    start_time: float = 0.0,
    blend: float = 0.0,
) -> Trajectory:
    """Trajectory at constant speed from a start to a target.

    Args:
        start: positions at the start, shape (n,) [rad or m].
        target: positions at the end, shape (n,) [rad or m].
        duration: duration of the motion [s], the blends included.
        start_time: time at which the motion starts [s].
        blend: time in which the speed grows evenly at the start, and falls at the end [s]. It must be less than half of
            the duration. If it is 0, the speed jumps.

    Raises:
        InvalidParameter: the duration is not positive, the blend is negative or too long, or a position is not finite.
    """
    ends = np.array([start, target], dtype=float)
    if not blend:
        return interpolate_samples([start_time, start_time + duration], ends, linear=True)
    # Over a blend the mean speed is half of v, so the distance is v (duration - blend).
    speed = (ends[1] - ends[0]) / (duration - blend)
    # The cubic between such ends is a parabola, a line, and a parabola: constant acceleration in a blend.
    blend_distance = speed * blend / 2
    rest = np.zeros_like(speed)
    times = start_time + np.array([0.0, blend, duration - blend, duration])
    positions = [ends[0], ends[0] + blend_distance, ends[1] - blend_distance, ends[1]]
    return hermite(times, positions, velocities=[rest, speed, speed, rest])


def move(
    start: npt.ArrayLike,
    target: npt.ArrayLike,
    *,
    duration: float,
    start_time: float = 0.0,
) -> Trajectory:
    """Trajectory from a start to a target, from rest to rest with continuous acceleration.

    Args:
        start: positions at the start, shape (n,) [rad or m].
        target: positions at the end, shape (n,) [rad or m].
        duration: duration of the motion [s].
        start_time: time at which the motion starts [s].

    Raises:
        InvalidParameter: the duration is no number, shorter than SHORTEST, or longer than LONGEST.
    """
    arrival = start_time + seconds(duration)
    return sequence(start, [arrival], [target], start_time=start_time)


def sequence(
    start: npt.ArrayLike,
    times: Sequence[float],
    targets: Sequence[npt.ArrayLike],
    *,
    start_time: float = 0.0,
) -> Trajectory:
    """Trajectory through targets that rests at each of them.

    Between two targets it follows the polynomial of :func:`smooth`.

    Args:
        start: positions at the start, shape (n,) [rad or m].
        times: times of arrival at the targets, one for each [s].
        targets: the targets, shape (n,) each [rad or m].
        start_time: time at which the motion starts [s].

    Raises:
        InvalidParameter: the times do not rise.
    """
    breaks = _check_rising(np.array([start_time, *times], dtype=float), "times")
    points = [np.asarray(point, dtype=float) for point in (start, *targets)]
    # One segment between each two successive points.
    segments = []
    for (begin, end), (low, high) in zip(pairwise(breaks), pairwise(points), strict=False):
        # With s = t / T, the factor of s^k becomes that of t^k over T^k.
        shape = BLEND / (end - begin) ** np.array([3, 4, 5])
        polynomials = []
        for position, distance in zip(low, high - low, strict=True):
            polynomials.append([Polynomial([position, 0.0, 0.0, *(shape * distance)])])
        segments.append(np.array(polynomials))
    return PiecewisePolynomial(segments, breaks)


def interpolate_samples(
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    *,
    linear: bool = False,
) -> Trajectory:
    """Trajectory through samples, as a cubic spline or as straight lines.

    Args:
        times: shape (m,) [s].
        positions: shape (m, n) [rad or m].
        linear: whether straight lines join the samples. Only two samples are always joined by a straight line.

    Raises:
        InvalidParameter: there are fewer than two samples, the times do not rise, values are not finite, or the shapes
            do not fit.
    """
    breaks, samples = _check_samples(times, positions)
    # A spline with continuous second derivatives needs three samples.
    if linear or len(breaks) < 3:
        return PiecewisePolynomial.FirstOrderHold(breaks, samples.T)
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(breaks, samples.T)


def hermite(
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    velocities: npt.ArrayLike,
) -> Trajectory:
    """Trajectory through samples with given velocities, as a cubic between each two samples.

    It is a spline with double knots: a piecewise polynomial of Drake takes thirty times the memory.

    Args:
        times: shape (m,) [s].
        positions: shape (m, n) [rad or m].
        velocities: shape (m, n) [rad/s or m/s].

    Raises:
        InvalidParameter: there are fewer than two samples, the times do not rise, values are not finite, or the shapes
            do not fit the times.
    """
    breaks, samples = _check_samples(times, positions)
    _, rates = _check_samples(times, velocities)
    # The control points of a cubic over the time T, in Bézier form: q0, q0 + v0 T/3, q1 - v1 T/3, q1. The spline has
    # the two inner ones of each cubic, and the two ends of the whole: two points for each sample.
    thirds = np.diff(breaks)[:, np.newaxis] / 3
    points = np.repeat(samples, 2, axis=0)
    # Of the two points of a sample, the second one (odd index) belongs to the cubic after it, and the first one (even
    # index) to the cubic before it. The first and the last point are the ends themselves.
    points[1:-1:2] += thirds * rates[:-1]
    points[2::2] -= thirds * rates[1:]
    # A knot that occurs twice keeps the velocity continuous; those at the ends have to occur four times.
    knots = np.concatenate([breaks[[0, 0]], np.repeat(breaks, 2), breaks[[-1, -1]]])
    return BsplineTrajectory(
        BsplineBasis(_CUBIC_ORDER, knots.tolist()), list(points[:, :, np.newaxis])
    )


class HermiteSamples(NamedTuple):
    """Samples of a trajectory from which cubics reconstruct it.

    Attributes:
        times: shape (m,) [s].
        positions: shape (m, n) [rad or m].
        velocities: shape (m, n) [rad/s or m/s].
    """

    times: Vector
    positions: Vector
    velocities: Vector


def hermite_samples(
    trajectory: Trajectory,
    start: float,
    end: float,
    rate: float,
) -> HermiteSamples:
    """Sample a trajectory so that :func:`hermite` reconstructs it.

    The result is exact if the trajectory is made of cubics with continuous velocity: then its breaks are sampled. Other
    trajectories are also sampled between their breaks.

    Args:
        trajectory: the trajectory.
        start: time of the first sample [s].
        end: time of the last sample [s].
        rate: sampling rate between the breaks [Hz].

    Returns:
        the samples. Their times rise from start to end.
    """
    pieces = _find_pieces(trajectory)
    # Between the breaks of smooth cubics there is nothing to sample: the two ends are enough.
    count = 2 if pieces.are_smooth_cubics else max(int((end - start) * rate), 1) + 1
    grid = np.linspace(start, end, count)
    breaks = pieces.breaks
    inner = breaks[(breaks > start + SHORTEST) & (breaks < end - SHORTEST)]
    # Samples of the grid that are too close to a break are left out: times of samples must rise.
    distances = np.abs(np.subtract.outer(grid, inner)).min(axis=1, initial=np.inf)
    times = np.union1d(grid[distances > SHORTEST], inner)
    return HermiteSamples(
        times=times,
        positions=trajectory.vector_values(times).T,
        velocities=trajectory.MakeDerivative().vector_values(times).T,
    )


class _Pieces(NamedTuple):
    """Pieces of a trajectory.

    Attributes:
        breaks: times at which the pieces meet, with both ends [s]; empty if the trajectory has no pieces.
        are_smooth_cubics: whether the pieces are cubics, or simpler, and join with continuous velocity.
    """

    breaks: Vector
    are_smooth_cubics: bool


def _find_pieces(trajectory: Trajectory) -> _Pieces:
    """Find the pieces of a trajectory.

    A B-spline that is no smooth cubic, and a trajectory of a kind that is not known here, count as having no pieces.
    """
    if isinstance(trajectory, BsplineTrajectory):
        knots, repetitions = np.unique(trajectory.basis().knots(), return_counts=True)
        order = trajectory.basis().order()
        # A spline of order k is k - 1 - r times continuously differentiable at a knot that occurs r times, and the
        # velocity must be continuous.
        is_smooth = (repetitions[1:-1] <= order - 2).all()
        if order <= _CUBIC_ORDER and is_smooth:
            return _Pieces(breaks=knots, are_smooth_cubics=True)
    if isinstance(trajectory, CompositeTrajectory):
        # Its segments may be of any kind, so they are sampled between the breaks, too.
        return _Pieces(breaks=np.array(trajectory.get_segment_times()), are_smooth_cubics=False)
    if not isinstance(trajectory, PiecewisePolynomial):
        return _Pieces(breaks=np.zeros(0), are_smooth_cubics=False)

    largest_degree = max(
        trajectory.getSegmentPolynomialDegree(piece, row)
        for piece in range(trajectory.get_number_of_segments())
        for row in range(trajectory.rows())
    )
    # `corner_times` has the ends, too. There the jump is that from or to rest, which samples with velocities reproduce.
    inner_corners = set(corner_times(trajectory)) - {trajectory.start_time(), trajectory.end_time()}
    return _Pieces(
        breaks=np.array(trajectory.get_segment_times()),
        # A polynomial of degree 3 has the order 4.
        are_smooth_cubics=largest_degree <= _CUBIC_ORDER - 1 and not inner_corners,
    )


def _check_samples(times: npt.ArrayLike, values: npt.ArrayLike) -> tuple[Vector, Vector]:
    """Check samples of a reference, and convert them to arrays: times (m,) and values (m, n).

    Raises:
        InvalidParameter: the shapes do not fit, there are fewer than two samples, the times do not rise, or values are
            not finite.
    """
    breaks = numbers(times)
    samples = numbers(values)
    has_dimensions = breaks.ndim == 1 and samples.ndim == 2
    # `and` asks for lengths only if the dimensions fit: a single number has no length.
    if not (has_dimensions and len(breaks) == len(samples) and len(breaks) >= 2):
        shapes = message(
            "blocks.times_and_positions",
            "{times} times, {positions} positions",
            times=breaks.shape,
            positions=samples.shape,
        )
        raise InvalidParameter(
            "reference", shapes, message("blocks.of_shape_m_n", "of shapes (m,) and (m, n), m > 1")
        )
    is_finite = np.isfinite(breaks) & np.isfinite(samples).all(axis=1)
    if not is_finite.all():
        row = int(np.flatnonzero(~is_finite)[0])
        raise InvalidParameter(
            message("blocks.row_of_reference", "row {row} of the reference", row=row),
            f"{breaks[row]}, {samples[row]}",
            message("blocks.finite", "finite"),
        )
    return _check_rising(breaks, message("blocks.reference_times", "reference times")), samples


def _check_rising(times: Vector, name: str) -> Vector:
    """Check that each time (m,) [s] is later than the one before, by more than rounding, and return the times.

    Raises:
        Unsuitable: a time is not later. It is reported under `name`.
    """
    # A negation, so that it also finds NaN.
    too_close = np.flatnonzero(~(np.diff(times) >= SHORTEST))
    if too_close.size:
        first = too_close[0]
        problem = message(
            "blocks.time_after",
            "{second:g} s follows {first:g} s",
            first=times[first],
            second=times[first + 1],
        )
        remedy = message(
            "blocks.rising_by", "increase each time by {shortest:g} s or more", shortest=SHORTEST
        )
        raise Unsuitable(name, problem, remedy)
    return times


def later(reference: Reference, time: float) -> Reference:
    """Shift a reference so that `time` [s] becomes zero. The part before is kept, at negative times.

    If a trajectory is over by then, the result is a constant at its end. A reference that is no polynomial, spline or
    sine is sampled a thousand times a second.
    """
    return as_reference(reference).later(time)


def _shift(trajectory: Trajectory, time: float) -> Trajectory:
    """Return a trajectory that has at the time zero what the given one, which is not changed, has at `time` [s].

    A trajectory of a kind that is not known here is sampled.
    """
    if isinstance(trajectory, PiecewisePolynomial):
        # `shiftRight` changes the trajectory itself, which others may use: a copy is shifted.
        shifted = trajectory.Clone()
        shifted.shiftRight(-time)
        return shifted
    if isinstance(trajectory, BsplineTrajectory):
        basis = trajectory.basis()
        # A spline's control points do not depend on time, so only its knots move.
        knots = [knot - time for knot in basis.knots()]
        return BsplineTrajectory(BsplineBasis(basis.order(), knots), trajectory.control_points())
    if isinstance(trajectory, CompositeTrajectory):
        segments = range(trajectory.get_number_of_segments())
        return CompositeTrajectory(
            [_shift(trajectory.segment(number), time) for number in segments]
        )
    samples = hermite_samples(trajectory, trajectory.start_time(), trajectory.end_time(), _RATE)
    return hermite(samples.times - time, samples.positions, samples.velocities)


def corner_times(reference: Reference) -> list[float]:
    """Times at which the position or the velocity of a reference jumps, without negative ones [s].

    Of a piecewise polynomial, these are the breaks at which the position or the velocity jumps; at its ends, the jump
    is that from or to rest. Of other trajectories they are both ends, always. A sine has none.
    """
    return as_reference(reference).corner_times


def add_reference(
    builder: DiagramBuilder,
    reference: Reference,
    *,
    name: str = "reference_source",
    derivatives: int = 0,
) -> ReferenceSource:
    """Add the source that plays a reference. A trajectory is held at both its ends.

    Steps of the simulation must end at the reference's :func:`corner_times`: error control assumes that signals are
    smooth over a step, and a scheme that holds its inputs constant over a step misses changes within it.

    Args:
        builder: builder of the diagram.
        reference: the reference.
        name: name of the source.
        derivatives: count of derivatives that are needed, 0 to 2. A sine gives both in any case.

    Raises:
        InvalidParameter: a trajectory is no column.
    """
    return as_reference(reference).add_source(builder, name, derivatives)


if not TYPE_CHECKING:
    __getattr__ = former_names_of(
        __name__, {"add_course": "add_reference", "table": "interpolate_samples"}
    )
