"""Bodies that overlap when a run begins: the same judgement for ``simrob check`` and for the run.

A *body* is a robot's link, a piece or the floor. The *overlap* of two bodies is the depth to which their collision
shapes penetrate each other.
"""

from typing import NamedTuple

from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import compound, message
from simrob_drake.parts.targets import owner_and_robot
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solver_config import bound_value

PRESSED = 1e-4
"""Contact forces alone cause overlaps up to this depth, so they are not reported [m]."""

TOUCHING = 1e-3
"""Bodies with an overlap up to this depth count as touching at the start [m]."""

MISPLACED = 0.01
"""A run does not begin with a larger overlap, unless the verdict allows more [m]. Contact forces would throw such
bodies apart, or a solver with error control would take steps of less than a microsecond."""


class StartOverlap(NamedTuple):
    """Two bodies that overlap at the start.

    Attributes:
        first: name of one body: a robot's link, a piece, or the floor.
        second: name of the other body.
        depth: depth of the overlap [m].
    """

    first: str
    second: str
    depth: float

    def __str__(self) -> str:
        """Describe the overlap in a sentence."""
        return message(
            "stations.deep_at_start",
            "{first} and {second} overlap by {depth:.1f} mm at the start",
            first=self.first,
            second=self.second,
            depth=self.depth * 1e3,
        )


def deepest_overlap(
    ports: StationPorts,
    root: Context,
    *,
    of_pieces: bool = False,
) -> StartOverlap | None:
    """Find the deepest overlap of two bodies that can touch.

    Args:
        ports: the built station, with its plant.
        root: a context of the station's diagram, which has the positions of all bodies. It is not changed.
        of_pieces: whether only overlaps of a piece with any other body count.

    Returns:
        the overlap, or None if there is none that is deeper than contact forces cause by themselves.
    """
    if ports.plant.replaced_pairs:
        # Small balls at the corners of flat bodies touch in place of the shapes themselves, but do not show how deep
        # the shapes overlap. In this clone of the context the shapes touch again.
        root = ports.plant.with_whole_shapes(root)
    pieces = ports.config.pieces
    deepest = None
    # Penetration of the shapes, whatever the contact model: hydroelastic contact reports no depth.
    for pair in ports.plant.query(root).ComputePointPairPenetration():
        names = []
        for shape in (pair.id_A, pair.id_B):
            name, _ = owner_and_robot(ports.plant, shape)
            names.append(name)
        # In alphabetical order, as Drake's order of a pair may change with the shapes.
        first, second = sorted(names)
        if of_pieces and first not in pieces and second not in pieces:
            continue
        largest_so_far = PRESSED if deepest is None else deepest.depth
        if pair.depth > largest_so_far:
            deepest = StartOverlap(first=first, second=second, depth=float(pair.depth))
    return deepest


def allowed_overlap(config: StationConfig) -> float:
    """Largest overlap at the start with which a run begins [m]: 10 mm, or more if the verdict allows more."""
    return max(MISPLACED, bound_value(config.verdict.penetration))


def check_start_overlap(config: StationConfig, ports: StationPorts, root: Context) -> None:
    """Check that no piece overlaps another body so deeply at the start that a run would make no sense.

    Only pieces are checked. A robot with a free base may begin inside the floor, such as one that lies there: contact
    pushes it out.

    Args:
        config: configuration of the station.
        ports: the built station, with its plant.
        root: a context of the station's diagram at the start.

    Raises:
        InvalidParameter: a piece overlaps too deeply; the message names both bodies and what to change.
    """
    # Without contact forces nothing is thrown apart.
    if not config.engine.moves_by_forces or config.contact is None:
        return
    overlap = deepest_overlap(ports, root, of_pieces=True)
    allowed = allowed_overlap(config)
    if overlap is None or overlap.depth <= allowed:
        return
    depth = compound("{depth:.1f} mm", depth=overlap.depth * 1e3)
    expected = message(
        "stations.allowed_overlap",
        "at most {allowed:g} mm at the start; move one of the two, or raise verdict.penetration",
        allowed=allowed * 1e3,
    )
    subject = message(
        "stations.overlap_of",
        "the overlap of {first} and {second}",
        first=overlap.first,
        second=overlap.second,
    )
    raise InvalidParameter(subject, depth, expected)
