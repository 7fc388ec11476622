"""Contacts of the free pieces of a station, at evenly spaced samples of a run.

A *free piece* is a body that only contacts and gravity hold, such as a workpiece on a table. The samples of a run are
the times at which its signals are recorded. Contacts are evaluated at some of these samples only, since this is slow.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults

from simrob_drake.base.frames import Indices, Vector
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.parts.targets import owner_and_robot

EVALUATION_RATE = 50.0
"""How often contacts are evaluated, in simulated time [Hz]."""

MOST_EVALUATIONS = 500
"""Largest count of evaluations in a run: one takes up to a millisecond."""


class ContactSample(NamedTuple):
    """Contacts of one piece at one sample of a run.

    Attributes:
        sample: index of the sample.
        force: sum of all contact forces on the piece, in the world's axes, shape (3,) [N].
        partners: names of the bodies that touch the piece: pieces, links of robots, the floor.
        normal: mean of the unit vectors that point from the other bodies into the piece, normal to the touching
            surfaces, in the world's axes, shape (3,); zero if nothing touches the piece.
        friction: largest static friction coefficient of the touching pairs of shapes; 0 if nothing touches the piece.
    """

    sample: int
    force: Vector
    partners: frozenset[str]
    normal: Vector
    friction: float


def sample_piece_contacts(
    station: StationPlant, times: Vector, contacts_at: Callable[[Vector], Iterator[ContactResults]]
) -> dict[str, list[ContactSample]]:
    """Evaluate the contacts of each free piece at some of the samples of a run.

    Args:
        station: the plant of the run.
        times: times of all samples, shape (m,) [s].
        contacts_at: yields Drake's contact results at times (k,) [s] of the run.

    Returns:
        for each free piece, by its name, one entry for each evaluated sample, in the order of time; also for samples at
        which nothing touches the piece.
    """
    plant = station.plant
    # Contact results name shapes, not bodies: the shapes of each piece are looked up once, for all samples.
    shapes_of_pieces = {}
    for piece, body in station.free_pieces.items():
        shapes_of_pieces[piece] = set(plant.GetCollisionGeometriesForBody(body))

    found: dict[str, list[ContactSample]] = {piece: [] for piece in shapes_of_pieces}
    samples = _evaluated_samples(times)
    results_at_samples = contacts_at(times[samples])
    for sample, results in zip(samples.tolist(), results_at_samples, strict=True):
        # Point contacts and hydroelastic surfaces in one list, since both exert forces on a piece.
        contacts = Contacts.of(results)
        for piece, shapes in shapes_of_pieces.items():
            found[piece].append(_contact_sample(station, sample, contacts, shapes))
    return found


def _evaluated_samples(times: Vector) -> Indices:
    """Indices of the samples at which contacts are evaluated: every k-th sample, beginning with the first.

    The rate is at most EVALUATION_RATE, and the count at most MOST_EVALUATIONS.

    Args:
        times: times of all samples, shape (m,) [s].
    """
    duration = float(times[-1] - times[0])
    # Both bounds as counts of evaluations in the run; the smaller count satisfies both.
    evaluations = min(EVALUATION_RATE * duration, float(MOST_EVALUATIONS))
    # Rounded up, so that no bound is exceeded. A short run has one evaluation at least.
    step = int(np.ceil(len(times) / max(evaluations, 1.0)))
    return np.arange(0, len(times), max(step, 1))


def _contact_sample(
    station: StationPlant, sample: int, contacts: Contacts, own: set[GeometryId]
) -> ContactSample:
    """Select the contacts of one piece, and sum their forces.

    Args:
        station: the plant of the run.
        sample: index of the sample.
        contacts: all contacts at this sample.
        own: collision shapes of the piece.
    """
    nothing = np.zeros(3)
    touching = [index for index, pair in enumerate(contacts.pairs) if own.intersection(pair)]
    if not touching:  # the maximum and the mean of nothing are not defined
        return ContactSample(
            sample=sample, force=nothing, partners=frozenset(), normal=nothing, friction=0.0
        )
    # Forces and normals of a contact are those on the first shape of its pair; on the second they have the other sign.
    signs = []
    partners = set()
    frictions = []
    for index in touching:
        first, second = contacts.pairs[index]
        is_first = first in own
        signs.append(1.0 if is_first else -1.0)
        partner, _ = owner_and_robot(station, second if is_first else first)
        partners.add(partner)
        frictions.append(_friction(station, first, second))
    factors = np.array(signs)[:, np.newaxis]
    forces = factors * contacts.forces[touching]
    normals = factors * contacts.normals[touching]
    return ContactSample(
        sample=sample,
        force=forces.sum(axis=0),
        partners=frozenset(partners),
        normal=normals.mean(axis=0),
        # The largest coefficient, so that the verdict on friction errs on the side of the run.
        friction=max(frictions),
    )


def _friction(station: StationPlant, first: GeometryId, second: GeometryId) -> float:
    """Static friction coefficient between two collision shapes, which both have contact properties.

    Drake combines the coefficients of two surfaces as m = 2 m1 m2 / (m1 + m2), and takes 0 if both are 0.
    """
    inspector = station.scene_graph.model_inspector()
    coefficients = []
    for shape in (first, second):
        properties = inspector.GetProximityProperties(shape)
        friction = properties.GetProperty("material", "coulomb_friction")
        coefficients.append(float(friction.static_friction()))
    total = sum(coefficients)
    if total <= 0:
        return 0.0
    return 2 * coefficients[0] * coefficients[1] / total
