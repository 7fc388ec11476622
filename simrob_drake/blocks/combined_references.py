"""Linear combinations of references: of polynomials and of sines exactly, of others by samples."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake.arguments import SHORTEST
from simrob_drake.blocks.references import Reference, SineReference, hermite, reference_values
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector

_RATE = 1000.0  # samples a second of what is no polynomial [Hz]
_REAL = 1e-9  # share of an amplitude below which its imaginary part is rounding


def combine_references(references: Sequence[Reference], matrix: Vector, offset: Vector) -> Reference:
    r"""Combine references linearly: the result is :math:`M q(t) + d` of their positions :math:`q`, one below the other.

    Polynomials give polynomials, and sines of one frequency a sine, to rounding. Other references are sampled a
    thousand times a second, and joined by cubics.

    Args:
        references: of n positions in all.
        matrix: M, shape (k, n).
        offset: d, shape (k,).

    Raises:
        InvalidParameter: a sine together with another frequency, or with something that moves otherwise.
    """
    if any(isinstance(reference, SineReference) for reference in references):
        return _combined_sines(references, matrix, offset)
    if all(isinstance(reference, PiecewisePolynomial) for reference in references):
        return _combined_polynomials(references, matrix, offset)
    trajectories = [reference for reference in references if not isinstance(reference, SineReference)]
    start = min(reference.start_time() for reference in trajectories)
    end = max(reference.end_time() for reference in trajectories)
    times = np.linspace(start, end, max(int((end - start) * _RATE), 1) + 1)
    values, rates = (
        np.hstack([reference_values(reference, times, order) for reference in references]) for order in (0, 1)
    )
    return hermite(times, values @ matrix.T + offset, rates @ matrix.T)


def _combined_sines(references: Sequence[Reference], matrix: Vector, offset: Vector) -> SineReference:
    """Combine sines of one frequency, and constants, by their complex amplitudes.

    Raises:
        InvalidParameter: there are two frequencies, or a trajectory that moves.
    """
    frequencies = {reference.frequency for reference in references if isinstance(reference, SineReference)}
    expected = "of one frequency, or at rest: a coupling ties their axes together"
    if len(frequencies) > 1:
        raise InvalidParameter("reference", f"sines of {sorted(frequencies)} Hz", expected)
    centres, amplitudes = [], []
    for reference in references:
        if isinstance(reference, SineReference):
            centres.append(reference.centre)
            amplitudes.append(reference.amplitude * np.exp(1j * reference.phase))
            continue
        ends = reference_values(reference, np.array([reference.start_time(), reference.end_time()]))
        if np.ptp(ends, axis=0).any():
            raise InvalidParameter("reference", "a sine and another motion", expected)
        centres.append(ends[0])
        amplitudes.append(np.zeros(len(ends[0]), dtype=complex))
    whole = matrix @ np.concatenate(amplitudes)
    # Sines without a phase stay so, and keep the sign of their amplitude.
    is_real = np.abs(whole.imag) <= _REAL * np.abs(whole)
    return SineReference(
        centre=matrix @ np.concatenate(centres) + offset,
        amplitude=np.where(is_real, whole.real, np.abs(whole)),
        frequency=frequencies.pop(),
        phase=np.where(is_real, 0.0, np.angle(whole)),
    )


def _combined_polynomials(
    references: Sequence[PiecewisePolynomial], matrix: Vector, offset: Vector
) -> PiecewisePolynomial:
    """Combine piecewise polynomials, piece by piece between all of their breaks."""
    breaks = np.unique(np.concatenate([reference.get_segment_times() for reference in references]))
    breaks = breaks[np.isfinite(breaks)]  # a reference that stands still has no others
    breaks = breaks[np.append(np.diff(breaks) >= SHORTEST, True)[: len(breaks)]]
    if len(breaks) < 2:
        positions = np.concatenate([reference.value(0.0)[:, 0] for reference in references])
        return PiecewisePolynomial((matrix @ positions + offset)[:, np.newaxis])
    pieces = []
    for start, end in pairwise(breaks.tolist()):
        own = [
            polynomial for reference in references for polynomial in _polynomials(reference, start, (start + end) / 2)
        ]
        size = max(len(polynomial) for polynomial in own)
        coefficients = np.array([np.pad(polynomial, (0, size - len(polynomial))) for polynomial in own])
        combination = matrix @ coefficients
        combination[:, 0] += offset
        pieces.append(np.array([[Polynomial(row)] for row in combination]))
    return PiecewisePolynomial(pieces, breaks)


def _polynomials(reference: PiecewisePolynomial, start: float, inside: float) -> list[Vector]:
    """Coefficients of the polynomials of a reference in the time since ``start`` [s], one array for each position.

    They are those of the piece at the time ``inside`` [s]; before its first piece and after its last one a reference
    stands still.
    """
    rows = range(reference.rows())
    if not reference.start_time() < inside < reference.end_time():
        still = reference.value(float(np.clip(inside, reference.start_time(), reference.end_time())))
        return [still[row] for row in rows]
    piece = reference.get_segment_index(inside)
    begin = reference.start_time(piece)
    passed = start - begin if np.isfinite(begin) else 0.0
    shift = np.polynomial.Polynomial([passed, 1.0])
    found = list[Vector]()
    for row in rows:
        own = reference.getPolynomial(piece, row, 0).GetCoefficients()
        found.append(np.asarray(own if passed == 0 else np.polynomial.Polynomial(own)(shift).coef, dtype=float))
    return found
