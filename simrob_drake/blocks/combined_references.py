"""Linear combinations of references: exact for polynomials and for sines, by samples if one is of another kind.

A reference gives the desired positions of axes as a function of time: a trajectory of Drake, or a sine (its centre,
amplitude, frequency and phase for each axis). A trajectory stands still before its start and after its end, and a
constant has infinite ends. Axes that a coupling ties together, such as those of a gear, need a combination of the
references of other axes.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from simrob_drake.base.arguments import SHORTEST
from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import (
    Reference,
    ReferenceSignal,
    SineReference,
    as_reference,
    hermite,
)

# Sampling rate of references that are neither polynomials nor sines [Hz].
_RATE = 1000.0
# Imaginary part that is due to rounding, as a fraction of the complex amplitude.
_IMAGINARY_ROUNDING = 1e-9


def combine_references(
    references: Sequence[Reference],
    matrix: Vector,
    offset: Vector,
) -> Reference:
    r"""Combine references linearly: the result is :math:`M q(t) + d`, where :math:`q` are the stacked positions.

    The combination of piecewise polynomials is a piecewise polynomial, and the combination of sines of one frequency is
    a sine, both exact up to rounding; references that rest may be among the sines. If there is no sine, and at least
    one reference is of another kind, such as a spline, all of them are sampled, at 1 kHz, and cubics join the samples.

    Args:
        references: references with n positions in all.
        matrix: M, shape (k, n).
        offset: d, shape (k,) [rad or m].

    Returns:
        a reference with k positions.

    Raises:
        InvalidParameter: a sine is combined with a sine of another frequency, or with a trajectory that moves.
    """
    signals = [as_reference(reference) for reference in references]
    if any(signal.oscillates for signal in signals):
        return _combined_sines(signals, matrix, offset)
    # `as_polynomial` returns None for a trajectory of another kind, such as a spline.
    polynomials = [signal.as_polynomial() for signal in signals]
    known_polynomials = [polynomial for polynomial in polynomials if polynomial is not None]
    if len(known_polynomials) == len(signals):
        return _combined_polynomials(known_polynomials, matrix, offset)
    return _combined_samples(signals, matrix, offset)


def _combined_samples(
    references: Sequence[ReferenceSignal],
    matrix: Vector,
    offset: Vector,
) -> Trajectory:
    """Combine references of any kind but sines by samples, which cubic polynomials join.

    Args:
        references: references with n positions in all, of which at least one is no constant.
        matrix: shape (k, n).
        offset: shape (k,) [rad or m].
    """
    # From the first start to the last end. A constant has infinite ends, and needs no samples of its own.
    ends = [time for reference in references for time in reference.span if np.isfinite(time)]
    start = min(ends)
    end = max(ends)
    # At least one interval, also for references that last less than a millisecond.
    interval_count = max(int((end - start) * _RATE), 1)
    times = np.linspace(start, end, interval_count + 1)

    # Samples of all n positions, shape (times, n). A reference stands still before its own start and after its end.
    # `hermite` joins samples by the cubics that have their velocities.
    positions = np.hstack([reference.values(times) for reference in references])
    velocities = np.hstack([reference.values(times, order=1) for reference in references])
    return hermite(times, positions @ matrix.T + offset, velocities @ matrix.T)


def _combined_sines(
    references: Sequence[ReferenceSignal],
    matrix: Vector,
    offset: Vector,
) -> SineReference:
    r"""Combine sines of one frequency, and trajectories that stand still, by adding their complex amplitudes.

    The sine :math:`a \sin(\omega t + \varphi)` has the complex amplitude :math:`a e^{i \varphi}`.

    Args:
        references: references with n positions in all, at least one of them a sine.
        matrix: shape (k, n).
        offset: shape (k,) [rad or m].

    Raises:
        Unsuitable: the sines have different frequencies, or a trajectory moves.
    """
    remedy = message(
        "blocks.of_one_frequency", "give all of these axes sines of one frequency, or hold them"
    )
    sines = []
    frequencies = set[float]()
    for reference in references:
        # A trajectory at rest is a sine without amplitude. One that moves is none: `as_sine` returns None.
        sine = reference.as_sine()
        if sine is not None and reference.oscillates:
            frequencies.add(sine.frequency)
        sines.append(sine)
    if len(frequencies) > 1:
        listed = ", ".join(f"{frequency:g}" for frequency in sorted(frequencies))
        problem = message(
            "blocks.sines_of",
            "a coupling joins axes with sines of different frequencies, {frequencies} Hz",
            frequencies=listed,
        )
        raise Unsuitable("reference", problem, remedy)

    centres = []
    amplitudes = []
    for sine in sines:
        if sine is None:
            problem = message(
                "blocks.sine_and_other_motion",
                "a coupling joins an axis with a sine and an axis with another motion",
            )
            raise Unsuitable("reference", problem, remedy)
        centres.append(sine.centre)
        amplitudes.append(sine.amplitude * np.exp(1j * sine.phase))
    amplitude = matrix @ np.concatenate(amplitudes)
    # A real amplitude keeps its sign, with phase 0: a negative one would otherwise become positive with phase pi.
    is_real = np.abs(amplitude.imag) <= _IMAGINARY_ROUNDING * np.abs(amplitude)
    return SineReference(
        centre=matrix @ np.concatenate(centres) + offset,
        amplitude=np.where(is_real, amplitude.real, np.abs(amplitude)),
        frequency=frequencies.pop(),
        phase=np.where(is_real, 0.0, np.angle(amplitude)),
    )


def _combined_polynomials(
    references: Sequence[PiecewisePolynomial], matrix: Vector, offset: Vector
) -> PiecewisePolynomial:
    """Combine piecewise polynomials exactly, with a piece between any two successive breaks of all references.

    If there are fewer than two breaks, all references stand still, and the result is a constant.

    Args:
        references: references with n positions in all.
        matrix: shape (k, n).
        offset: shape (k,) [rad or m].
    """
    breaks = np.unique(np.concatenate([reference.get_segment_times() for reference in references]))
    # The breaks of a reference that stands still are infinite; no piece begins there.
    finite_breaks = breaks[np.isfinite(breaks)]
    # Of breaks that are closer than the shortest piece, the last one is kept. If there are no breaks, the mask [True]
    # is cut to no entries.
    is_kept = np.append(np.diff(finite_breaks) >= SHORTEST, True)[: len(finite_breaks)]
    piece_breaks = finite_breaks[is_kept]
    if len(piece_breaks) < 2:
        positions = np.concatenate([reference.value(0.0)[:, 0] for reference in references])
        return PiecewisePolynomial((matrix @ positions + offset)[:, np.newaxis])
    pieces = []
    for start, end in pairwise(piece_breaks.tolist()):
        middle = (start + end) / 2
        polynomials = []
        for reference in references:
            # The middle is inside of a piece of each reference, while a break belongs to two.
            polynomials += _coefficients(reference, start, middle)
        # One row of coefficients for each position, filled up with zeros to the highest degree.
        size = max(len(polynomial) for polynomial in polynomials)
        rows = [np.pad(polynomial, (0, size - len(polynomial))) for polynomial in polynomials]
        combination = matrix @ np.array(rows)
        # A constant only changes the coefficient of the power 0.
        combination[:, 0] += offset
        pieces.append(np.array([[Polynomial(coefficients)] for coefficients in combination]))
    return PiecewisePolynomial(pieces, piece_breaks)


def _coefficients(
    reference: PiecewisePolynomial,
    start: float,
    inside: float,
) -> list[Vector]:
    """Coefficients of a reference's polynomials around a time, as functions of the time since ``start``.

    They are those of the piece that contains the time ``inside``, or constants before the first piece and after the
    last one, where a reference stands still.

    Args:
        reference: the reference.
        start: time from which the polynomials count [s].
        inside: the time, which is no break of the reference [s].

    Returns:
        coefficients for each position of the reference, in ascending powers.
    """
    begins = reference.start_time()
    ends = reference.end_time()
    if not begins < inside < ends:
        positions = reference.value(float(np.clip(inside, begins, ends)))
        return [positions[index] for index in range(reference.rows())]
    piece = reference.get_segment_index(inside)
    piece_start = reference.start_time(piece)
    # Drake's polynomials count time from the start of their piece. A piece that starts at minus infinity is constant.
    elapsed = start - piece_start if np.isfinite(piece_start) else 0.0
    # With p(t) in Drake's time t, the result is p(elapsed + s) in the time s since `start`.
    shifted_time = np.polynomial.Polynomial([elapsed, 1.0])
    found = list[Vector]()
    for index in range(reference.rows()):
        coefficients = reference.getPolynomial(piece, index, 0).GetCoefficients()
        if elapsed != 0:
            coefficients = np.polynomial.Polynomial(coefficients)(shifted_time).coef
        found.append(np.asarray(coefficients, dtype=float))
    return found
