"""Bodies that are in each other when a run begins: one judgement for `simrob check` and for the run."""

from typing import NamedTuple

from pydrake.systems.framework import Context

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.targets import owner_and_robot
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solver_config import bound_value

PRESSED = 1e-4
"""Overlap that contact forces cause by themselves [m]."""

TOUCHING = 1e-3
"""Overlap up to which bodies count as touching at the start [m]."""

MISPLACED = 0.01
"""Overlap beyond which a run does not begin, unless the verdict allows more [m]. Contact forces would throw such bodies
apart, or a solver with error control would take steps of less than a microsecond."""


class StartOverlap(NamedTuple):
    """Two bodies that are in each other at the start.

    Attributes:
        first: name of a robot's link, a piece, or the floor.
        second: the same of the other body.
        depth: how deep they are in each other [m].
    """

    first: str
    second: str
    depth: float

    def __str__(self) -> str:
        """Describe the overlap."""
        return f"{self.first} and {self.second} are {self.depth * 1e3:.1f} mm deep in each other at the start"


def deepest_overlap(ports: StationPorts, root: Context, *, of_pieces: bool = False) -> StartOverlap | None:
    """Find the two bodies that can touch and are deepest in each other, in a context of the station's diagram.

    With ``of_pieces``, one of the two is a piece. Returns None if none are deeper in each other than contact forces
    press them.
    """
    if ports.plant.replaced_pairs:
        root = ports.plant.with_whole_shapes(root)
    pairs = ports.plant.query(root).ComputePointPairPenetration()
    overlaps = []
    for pair in pairs:
        first, second = sorted(owner_and_robot(ports.plant, shape)[0] for shape in (pair.id_A, pair.id_B))
        has_piece = first in ports.config.pieces or second in ports.config.pieces
        if pair.depth > PRESSED and (has_piece or not of_pieces):
            overlaps.append(StartOverlap(first=first, second=second, depth=float(pair.depth)))
    return max(overlaps, key=lambda overlap: overlap.depth, default=None)


def allowed_overlap(config: StationConfig) -> float:
    """Largest overlap at the start with which a run begins [m]: 10 mm, or more if the verdict allows more."""
    return max(MISPLACED, bound_value(config.verdict.penetration))


def check_start_overlap(config: StationConfig, ports: StationPorts, root: Context) -> None:
    """Check that no piece is so deep in another body at the start that a run would make no sense.

    A robot on its own feet may begin in the floor, as one that lies there: it pushes itself out.

    Raises:
        InvalidParameter: one is; with both names and what to change.
    """
    if config.mode == "kinematic" or config.contact is None:
        return
    overlap = deepest_overlap(ports, root, of_pieces=True)
    if overlap is None or overlap.depth <= allowed_overlap(config):
        return
    depth = f"{overlap.depth * 1e3:.1f} mm"
    expected = (
        f"at most {allowed_overlap(config) * 1e3:g} mm at the start: move one of them, or raise verdict.penetration"
    )
    raise InvalidParameter(f"the overlap of {overlap.first} and {overlap.second}", depth, expected)
