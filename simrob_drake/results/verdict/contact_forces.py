"""Measures of a run's verdict that show whether its contact forces are possible.

A run can end without an error while its contacts are wrong, for instance if a flat body touches at a single point that
jumps from corner to corner. Two laws show it, whatever the solver and the contact model. Both are checked for the *free
pieces* of a station, the bodies that only contacts and gravity hold:

* On a piece at rest, the contact forces and the applied forces balance the weight.
* Two bodies exert on each other, along their surface, at most the friction coefficient times the normal force.

The signals of a run are recorded at its *samples*. Contacts are evaluated at some of them only: see `ContactSample`.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from simrob_drake.base.frames import Vector, transform_from_xyz_quaternion
from simrob_drake.base.messages import join_texts, message
from simrob_drake.parts.couplings import Between
from simrob_drake.results.record.piece_contacts import ContactSample
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.results.verdict.verdict import Measured

REST_SPEED = 1e-3
"""A body is slow if each component of its velocity is below this [m/s, and rad/s]."""

REST_TIME = 0.5
"""A body is at rest after it has been slow for this time [s]."""

WINDOW = 0.2
"""Time over which momentum is balanced to find the friction on a piece [s]: some hundred steps of a solver, so that
a force that trembles averages out."""

LEAST_CONTACT_SAMPLES = 3
"""Count of contact samples that a window needs, so that no other body touches the piece between them unnoticed."""

LEAST_LOAD = 0.2
"""Friction is judged only if the normal force is at least this share of the piece's weight."""

STEADY_NORMAL = np.cos(np.deg2rad(2.0))
"""Several unit vectors count as parallel if their mean has at least this length, or if the cosine of each angle between
a vector and the mean is at least this."""


class SampleRange(NamedTuple):
    """A part of a run, by indices of samples.

    Attributes:
        first: index of the first sample.
        last: index of the last sample, which belongs to the range.
    """

    first: int
    last: int


class ContactWindow(NamedTuple):
    """A short part of a run with enough contact samples of a piece.

    Attributes:
        first: index of the first sample of the run.
        last: index of its last sample.
        contacts: the contact samples between the two.
    """

    first: int
    last: int
    contacts: list[ContactSample]


class SteadyContact(NamedTuple):
    """A contact between a piece and one other body that does not change during a window.

    Attributes:
        partner: name of the other body.
        normal: unit vector from the other body into the piece, in the world's axes, shape (3,).
        friction: static friction coefficient.
    """

    partner: str
    normal: Vector
    friction: float


class Observation(NamedTuple):
    """A measured value in a part of a run.

    Attributes:
        subject: name of the piece, or of the pair of bodies, that the value belongs to.
        value: the value.
        time: start of the part [s].
    """

    subject: str
    value: float
    time: float


def measure_resting_force(run: RecordedRun) -> Measured | None:
    """Measure the error of the contact force on each free piece at rest, as a share of the piece's weight.

    The forces are averaged over each rest. Their sum, contact + applied + weight, is zero if they are right; the error
    is its component along one direction, see :func:`_judged_direction`. The largest error of each piece counts.

    Returns:
        the errors, one for each piece that was at rest in contact and has a judged direction; None if there is none.
    """
    observations = []
    for piece in _judged_pieces(run):
        weight = _weight(run, piece)
        for rest in _rests(run, piece):
            contacts = [
                contact
                for contact in run.piece_contacts[piece]
                if rest.first <= contact.sample <= rest.last
            ]
            direction = _judged_direction(run, contacts)
            if direction is None:
                continue
            # Means over the whole rest: forces of single steps tremble about the balance.
            contact_force = np.mean([contact.force for contact in contacts], axis=0)
            applied_force = _applied_force(run, piece)[rest.first : rest.last + 1].mean(axis=0)
            unbalanced = contact_force + applied_force - np.array([0.0, 0.0, weight])
            error = abs(float(unbalanced @ direction)) / weight
            observations.append(Observation(piece, error, time=float(run.times[rest.first])))
    return _largest_of_each(observations)


def _judged_direction(run: RecordedRun, contacts: list[ContactSample]) -> Vector | None:
    """Choose the unit vector (3,) along which the forces on a resting piece are compared.

    If all contacts have nearly the same normal, it is this normal: friction has no component along it. Otherwise, as
    for a piece between two fingers, it is the vertical, and friction counts.

    Args:
        run: the run.
        contacts: contact samples of the piece during its rest; perhaps none.

    Returns:
        the direction. None if there are no contact samples, or if friction counts and the engine, such as cenic,
        reports wrong friction forces.
    """
    if not contacts:
        return None
    mean_normal = np.mean([contact.normal for contact in contacts], axis=0)
    length = float(np.linalg.norm(mean_normal))
    # The mean of unit vectors is nearly 1 long only if they point in nearly the same direction.
    if length > STEADY_NORMAL:
        return np.asarray(mean_normal / length)
    if not run.config.engine.reports_friction_of_contacts:
        return None
    return np.array([0.0, 0.0, 1.0])


def measure_friction_share(run: RecordedRun) -> Measured | None:
    """Measure the largest friction between each piece and a body it touches, as a share of the largest possible one.

    The contact force F follows from the piece's momentum, not from the contact results, since some solvers report wrong
    friction forces. With the normal n and the friction coefficient mu, the normal force is N = F n, and the share is
    |F - N n| / (mu N).

    Returns:
        the shares, one for each pair of a piece and a body that alone touches it during a window, with friction and
        with a large enough normal force. None if there is no such pair.
    """
    observations = []
    for piece in _judged_pieces(run):
        least_normal_force = LEAST_LOAD * _weight(run, piece)
        for window in _windows(run, piece):
            contact = _steady_contact(window.contacts)
            # Without friction there is no share: any force along the surface would be infinitely too large.
            if contact is None or contact.friction == 0.0:
                continue
            force = _mean_contact_force(run, piece, window)
            normal_force = float(force @ contact.normal)
            # A small normal force is a difference of large numbers, and dividing by it would show their errors
            # only.
            if normal_force < least_normal_force:
                continue
            friction_force = float(np.linalg.norm(force - normal_force * contact.normal))
            share = friction_force / (contact.friction * normal_force)
            subject = join_texts([piece, contact.partner], message("base.and", " and "))
            observations.append(Observation(subject, share, time=float(run.times[window.first])))
    return _largest_of_each(observations)


def _largest_of_each(observations: list[Observation]) -> Measured | None:
    """Keep the observation with the largest value of each subject, as the result of a criterion.

    Returns None if there are no observations.
    """
    largest: dict[str, Observation] = {}
    for new in observations:
        known = largest.get(new.subject)
        # Of equal values, the latest is kept.
        if known is None or (new.value, new.time) > (known.value, known.time):
            largest[new.subject] = new
    if not largest:
        return None
    values = np.array([observation.value for observation in largest.values()])
    times = np.array([observation.time for observation in largest.values()])
    return Measured(list(largest), values, times)


def _judged_pieces(run: RecordedRun) -> list[str]:
    """Names of the free pieces on which only gravity, contacts and the station's forces act.

    Pieces that a coupling holds, such as a spring, are left out: its force is not known. The list is empty if the run
    has no contact results, as without contact forces, or if no gravity pulls down.
    """
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


def _rests(run: RecordedRun, piece: str) -> Iterator[SampleRange]:
    """Yield each part of the run in which a piece rests.

    A piece rests after it has been slow for 0.5 s (REST_TIME). These 0.5 s do not belong to the part.
    """
    is_slow = (np.abs(run.piece_velocity(piece)) < REST_SPEED).all(axis=1)
    # Indices at which the piece becomes slow, and at which it becomes fast again, in turn. The False at both ends lets
    # a part begin at the first sample, and end at the last one.
    with_ends = np.concatenate([[False], is_slow, [False]])
    changes = np.flatnonzero(np.diff(with_ends))
    for begin, end in zip(changes[::2], changes[1::2], strict=True):
        settled = int(np.searchsorted(run.times, run.times[begin] + REST_TIME))
        if settled < end:
            yield SampleRange(first=settled, last=int(end) - 1)


def _windows(run: RecordedRun, piece: str) -> Iterator[ContactWindow]:
    """Cut a run into windows of equal length, and yield those with enough contact samples of a piece.

    The end of the run, after the begin of the last window, is left out.
    """
    contacts = run.piece_contacts[piece]
    if len(contacts) < LEAST_CONTACT_SAMPLES:
        return
    # In a long run contacts are evaluated rarely: then windows are longer, to contain enough contact samples.
    interval = float(run.times[contacts[1].sample] - run.times[contacts[0].sample])
    duration = max(WINDOW, (LEAST_CONTACT_SAMPLES + 1) * interval)
    begins = np.arange(run.start_time, run.stop_time, duration)
    bounds = np.searchsorted(run.times, begins).tolist()  # the first sample of each window
    for first, last in pairwise(bounds):
        inside = [contact for contact in contacts if first <= contact.sample <= last]
        if len(inside) >= LEAST_CONTACT_SAMPLES:
            yield ContactWindow(first, last, inside)


def _steady_contact(contacts: list[ContactSample]) -> SteadyContact | None:
    """Find the one body that touches a piece during a window.

    Its friction coefficient is the smallest of the samples. Returns None if nothing or several bodies touch the piece,
    if the body changes, or if the normal does.

    Args:
        contacts: the contact samples of the window, at least one.
    """
    partners = contacts[0].partners
    # With a second body, the momentum would give the sum of both forces, which cannot be divided between the
    # two.
    is_same_body = all(contact.partners == partners for contact in contacts)
    if len(partners) != 1 or not is_same_body:
        return None
    mean_normal = np.mean([contact.normal for contact in contacts], axis=0)
    length = float(np.linalg.norm(mean_normal))
    if length == 0.0:  # normals that are opposite, as of a piece in a slot
        return None
    # The normal n of a sample is a mean of unit vectors, at most 1 long. With n m >= cos(2 deg) |m|, its angle to the
    # mean m is therefore 2 deg at most.
    if any(contact.normal @ mean_normal < STEADY_NORMAL * length for contact in contacts):
        return None
    (partner,) = partners
    return SteadyContact(
        partner, mean_normal / length, friction=min(contact.friction for contact in contacts)
    )


def _mean_contact_force(run: RecordedRun, piece: str, window: ContactWindow) -> Vector:
    """Mean contact force on a free piece during a window, in the world's axes, shape (3,) [N].

    The momentum of the piece changes by all forces on it: m dv/dt = F + m g + applied. So the contact force is
    F = m (dv/dt - g) - applied.
    """
    mass = float(run.plant.free_pieces[piece].default_mass())
    velocity = _velocity_of_centre(run, piece)
    duration = run.times[window.last] - run.times[window.first]
    acceleration = (velocity[window.last] - velocity[window.first]) / duration
    gravity = np.array([0.0, 0.0, -run.config.gravity])
    # Without the force at the last sample: it acts after the window.
    applied_force = _applied_force(run, piece)[window.first : window.last].mean(axis=0)
    return np.asarray(mass * (acceleration - gravity) - applied_force)


def _velocity_of_centre(run: RecordedRun, piece: str) -> Vector:
    """Velocity of a piece's centre of mass at all m samples, in the world's axes, shape (m, 3) [m/s].

    It is v + omega x r, with the velocity v of the piece's origin and the vector r from the origin to the centre of
    mass.
    """
    motion = run.piece_velocity(piece)
    velocity = motion[:, :3]
    angular_velocity = motion[:, 3:]
    centre = run.plant.free_pieces[piece].default_com()  # in the axes of the piece
    # Origin and centre are the same point: no pose has to be converted.
    if not centre.any():
        return velocity
    arms = [
        transform_from_xyz_quaternion(pose).rotation() @ centre for pose in run.piece_pose(piece)
    ]
    return velocity + np.cross(angular_velocity, np.array(arms))


def _applied_force(run: RecordedRun, piece: str) -> Vector:
    """Sum of the forces in the station's section ``forces`` that act on a free piece; 0 if no force acts on the piece.

    Returns:
        the sum at all m samples, in the world's axes, shape (m, 3) [N].
    """
    total = np.zeros((len(run.times), 3))
    for name, force in run.config.forces.items():
        if force.at != piece:
            continue
        # The recorded components are in the axes of the piece, so each is rotated by the piece's pose.
        poses = run.piece_pose(piece)
        rotations = np.array(
            [transform_from_xyz_quaternion(pose).rotation().matrix() for pose in poses]
        )
        recorded = run.vector(f"applied_force.{name}")
        total += np.einsum("mij,mj->mi", rotations, recorded)
    return total
