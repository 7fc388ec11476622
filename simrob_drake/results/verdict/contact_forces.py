"""Whether the contact forces of a run are possible: those on bodies at rest, and friction on bodies that slide.

A run can end without an error while its contacts are wrong, as when a flat body touches at a single point that jumps.
Two laws show it, whatever the solver and the contact model:

* On a body at rest, the contacts press upward with its weight less the forces that are applied to it.
* Two bodies give each other at most the friction coefficient times the normal force along their surface.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from simrob_drake.frames import Vector, transform_from_xyz_quaternion
from simrob_drake.parts.couplings import Between
from simrob_drake.results.record.piece_contacts import Look
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.verdict.verdict import Measured

REST_SPEED = 1e-3
"""A body slower than this is at rest [m/s, and rad/s]."""

REST_TIME = 0.5
"""A body is at rest once it has been so slow for this time [s]."""

WINDOW = 0.2
"""Time over which momentum is balanced to find the friction on a piece [s]: some hundred steps of a solver, so that
what trembles averages out."""

LEAST_LOOKS = 3
"""Looks at the contacts that a window needs, to tell that nothing else touches the piece."""

LEAST_LOAD = 0.2
"""Friction is compared with normal forces of at least this share of a piece's weight."""

STEADY_NORMAL = np.cos(np.deg2rad(2.0))
"""The normals of several contacts agree if the cosine of their angles to the mean is at least this, or if the length of
their mean is."""


def measure_resting_force(run: RecordedRun) -> Measured | None:
    """Measure by which share of its weight the contact force on each resting piece is off, on average of a rest."""
    names, errors, times = [], [], []
    for piece in _judged_pieces(run):
        weight = _weight(run, piece)
        for first, last in _rests(run, piece):
            looks = [look for look in run.piece_contacts[piece] if first <= look.row <= last]
            direction = _judged_direction(run, looks)
            if direction is None:
                continue
            contact = np.mean([look.force for look in looks], axis=0)
            applied = _applied_force(run, piece)[first : last + 1].mean(axis=0)
            unbalanced = contact + applied - np.array([0.0, 0.0, weight])
            names.append(piece)
            errors.append(abs(float(unbalanced @ direction)) / weight)
            times.append(float(run.times[first]))
    return _worst_of_each(names, errors, times)


def _judged_direction(run: RecordedRun, looks: list[Look]) -> Vector | None:
    """Choose the unit vector (3,) along which the forces on a resting piece are compared.

    If all contacts have nearly the same normal, it is this normal: friction has no component along it. Otherwise, as
    for a piece between two fingers, it is the vertical, and friction counts.

    Returns:
        the direction. None if no contacts were looked at, or if friction counts and the scheme is cenic, whose
        friction forces are wrong.
    """
    if not looks:
        return None
    normal = np.mean([look.normal for look in looks], axis=0)
    length = float(np.linalg.norm(normal))
    # The mean of unit vectors is nearly 1 long only if they point in nearly the same direction.
    if length > STEADY_NORMAL:
        return np.asarray(normal / length)
    return None if run.config.solver.scheme == "cenic" else np.array([0.0, 0.0, 1.0])


def measure_friction_share(run: RecordedRun) -> Measured | None:
    """Measure the largest share of the possible friction that each piece got from the body it lay on.

    The force comes from the momentum balance, F = m (dv/dt - g) - applied, so that it is right under schemes whose
    contact forces along the surface are not.
    """
    names, shares, times = [], [], []
    for piece in _judged_pieces(run):
        for first, last, looks in _windows(run, piece):
            partner, normal, friction = _steady_contact(looks)
            if not partner or friction == 0.0:
                continue
            force = _mean_contact_force(run, piece, first, last)
            pressing = float(force @ normal)
            if pressing < LEAST_LOAD * _weight(run, piece):
                continue
            along = float(np.linalg.norm(force - pressing * normal))
            names.append(f"{piece} and {partner}")
            shares.append(along / (friction * pressing))
            times.append(float(run.times[first]))
    return _worst_of_each(names, shares, times)


def _worst_of_each(names: list[str], values: list[float], times: list[float]) -> Measured | None:
    """Keep the largest value of each name. Returns None if there are no values."""
    worst: dict[str, tuple[float, float]] = {}
    for name, value, time in zip(names, values, times, strict=True):
        worst[name] = max(worst.get(name, (value, time)), (value, time))
    if not worst:
        return None
    found = np.array([*worst.values()])
    return Measured([*worst], found[:, 0], found[:, 1])


def _judged_pieces(run: RecordedRun) -> list[str]:
    """List the free pieces on which gravity, contacts and known forces alone act: no coupling holds them."""
    if run.contacts_at is None or run.config.gravity <= 0:
        return []
    coupled = set[str]()
    for coupling in run.config.couplings.values():
        if isinstance(coupling, Between):
            coupled |= {coupling.body, coupling.other}
    return [piece for piece in run.plant.free_pieces if piece not in coupled]


def _weight(run: RecordedRun, piece: str) -> float:
    """Weight of a free piece [N]."""
    return float(run.plant.free_pieces[piece].default_mass() * run.config.gravity)


def _rests(run: RecordedRun, piece: str) -> Iterator[tuple[int, int]]:
    """Yield the first and the last sample of each time in which a piece rests, without its first 0.5 s."""
    slow = (np.abs(run.piece_velocity(piece)) < REST_SPEED).all(axis=1)
    changes = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]])))
    for begin, end in zip(changes[::2], changes[1::2], strict=True):
        settled = int(np.searchsorted(run.times, run.times[begin] + REST_TIME))
        if settled < end:
            yield settled, int(end) - 1


def _windows(run: RecordedRun, piece: str) -> Iterator[tuple[int, int, list[Look]]]:
    """Yield windows of samples, first and last, with the looks in each of them."""
    looks = run.piece_contacts[piece]
    if len(looks) < LEAST_LOOKS:
        return
    time_between = float(run.times[looks[1].row] - run.times[looks[0].row])
    window = max(WINDOW, (LEAST_LOOKS + 1) * time_between)
    bounds = np.searchsorted(run.times, np.arange(0.0, run.stop_time, window)).tolist()
    for first, last in pairwise(bounds):
        inside = [look for look in looks if first <= look.row <= last]
        if len(inside) >= LEAST_LOOKS:
            yield first, last, inside


def _steady_contact(looks: list[Look]) -> tuple[str, Vector, float]:
    """Find the one body that touches a piece at all looks, the normal and the friction coefficient.

    Returns an empty name if nothing touches it, if several bodies do, or if the normal changes.
    """
    nothing = "", np.zeros(3), 0.0
    partners = looks[0].partners
    if len(partners) != 1 or any(look.partners != partners for look in looks):
        return nothing
    mean = np.mean([look.normal for look in looks], axis=0)
    length = float(np.linalg.norm(mean))
    if length == 0.0 or any(look.normal @ mean < STEADY_NORMAL * length for look in looks):
        return nothing
    return next(iter(partners)), mean / length, min(look.friction for look in looks)


def _mean_contact_force(run: RecordedRun, piece: str, first: int, last: int) -> Vector:
    """Compute the mean contact force on a piece between two samples from its momentum, shape (3,) [N]."""
    mass = float(run.plant.free_pieces[piece].default_mass())
    velocity = _velocity_of_centre(run, piece)
    duration = run.times[last] - run.times[first]
    acceleration = (velocity[last] - velocity[first]) / duration
    gravity = np.array([0.0, 0.0, -run.config.gravity])
    applied = _applied_force(run, piece)[first:last].mean(axis=0)
    return np.asarray(mass * (acceleration - gravity) - applied)


def _velocity_of_centre(run: RecordedRun, piece: str) -> Vector:
    """Velocity of a piece's centre of mass, shape (m, 3) [m/s]: v + omega x r."""
    motion = run.piece_velocity(piece)
    com = run.plant.free_pieces[piece].default_com()
    if not com.any():
        return motion[:, :3]
    arms = np.array([transform_from_xyz_quaternion(pose).rotation() @ com for pose in run.piece_pose(piece)])
    return motion[:, :3] + np.cross(motion[:, 3:], arms)


def _applied_force(run: RecordedRun, piece: str) -> Vector:
    """Compute the sum of the station's forces on a piece at all m samples, in the world's axes, shape (m, 3) [N]."""
    total = np.zeros((len(run.times), 3))
    for name, force in run.config.forces.items():
        if force.at == piece:
            # Forces are recorded in the axes of what they act on.
            rotations = [transform_from_xyz_quaternion(pose).rotation().matrix() for pose in run.piece_pose(piece)]
            total += np.einsum("mij,mj->mi", np.array(rotations), run.vector(f"applied_force.{name}"))
    return total
