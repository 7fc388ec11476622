"""What touches the free pieces of a station, and with what force, at evenly spaced samples of a run."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationPlant
from simrob_drake.parts.targets import owner_and_robot

LOOK_RATE = 50.0
"""How often contacts are evaluated [Hz]."""

MOST_LOOKS = 500
"""Most evaluations of contacts in a run: one takes up to a millisecond."""


class Look(NamedTuple):
    """What touches a piece at one moment.

    Attributes:
        row: the place of the moment among the samples of the run.
        force: sum of all contact forces on the piece, in the world's axes, shape (3,) [N].
        partners: the owners of the shapes that press on it.
        normal: mean direction in which they push it, shape (3,); zero if nothing touches it.
        friction: largest static friction coefficient of the touching pairs; 0 if nothing touches it.
    """

    row: int
    force: Vector
    partners: frozenset[str]
    normal: Vector
    friction: float


def looks_at_pieces(
    station: StationPlant, times: Vector, contacts_at: Callable[[Vector], Iterator[ContactResults]]
) -> dict[str, list[Look]]:
    """Evaluate the contacts of each free piece at some of the samples of a run.

    Args:
        station: the plant of the run.
        times: of the samples, shape (m,) [s].
        contacts_at: yields contact results at times (k,) of the run.
    """
    shapes = {
        piece: set(station.plant.GetCollisionGeometriesForBody(body)) for piece, body in station.free_pieces.items()
    }
    looks: dict[str, list[Look]] = {piece: [] for piece in shapes}
    rows = _rows(times)
    for row, results in zip(rows.tolist(), contacts_at(times[rows]), strict=True):
        contacts = Contacts.of(results)
        for piece, own in shapes.items():
            looks[piece].append(_look(station, row, contacts, own))
    return looks


def _rows(times: Vector) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Select samples that are evenly spaced: LOOK_RATE a second, MOST_LOOKS in all."""
    looks = min(LOOK_RATE * float(times[-1]), float(MOST_LOOKS))
    step = max(int(np.ceil(len(times) / max(looks, 1.0))), 1)
    return np.arange(0, len(times), step)


def _look(station: StationPlant, row: int, contacts: Contacts, own: set[GeometryId]) -> Look:
    """Collect the contacts of one piece, of which ``own`` are the shapes."""
    nothing = np.zeros(3)
    touching = [place for place, pair in enumerate(contacts.pairs) if own.intersection(pair)]
    if not touching:
        return Look(row=row, force=nothing, partners=frozenset(), normal=nothing, friction=0.0)
    senses = np.array([1.0 if contacts.pairs[place][0] in own else -1.0 for place in touching])
    forces = senses[:, np.newaxis] * contacts.forces[touching]
    normals = senses[:, np.newaxis] * contacts.normals[touching]
    partners = set()
    frictions = []
    for place in touching:
        first, second = contacts.pairs[place]
        other = second if first in own else first
        partners.add(owner_and_robot(station, other)[0])
        frictions.append(_friction(station, first, second))
    return Look(
        row=row,
        force=forces.sum(axis=0),
        partners=frozenset(partners),
        normal=normals.mean(axis=0),
        friction=max(frictions),
    )


def _friction(station: StationPlant, first: GeometryId, second: GeometryId) -> float:
    """Static friction coefficient between two shapes, 2 m1 m2 / (m1 + m2) as in Drake."""
    inspector = station.scene_graph.model_inspector()
    coefficients = []
    for shape in (first, second):
        properties = inspector.GetProximityProperties(shape)
        coefficients.append(float(properties.GetProperty("material", "coulomb_friction").static_friction()))
    total = sum(coefficients)
    return 2 * coefficients[0] * coefficients[1] / total if total > 0 else 0.0
