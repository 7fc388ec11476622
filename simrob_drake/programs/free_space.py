"""Postures in which robots touch nothing, neither themselves nor what stands around, and what they touch elsewhere."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from pydrake.geometry import GeometryId, Role

from simrob_drake.frames import Vector
from simrob_drake.parts.targets import owner_and_robot
from simrob_drake.programs.errors import StartInCollision
from simrob_drake.programs.model import StationModel
from simrob_drake.programs.plan import TOUCH
from simrob_drake.stations.clearance import TOUCH as ROUGH

Bodies = tuple[str, str]
Hit = tuple[float, Bodies]  # how deep what lies in what [m]
_AT_ALL = 1e-9
SEARCHED = 0.5  # the part of what is allowed that a search keeps to, so that the way that is made of it keeps to all


@dataclass(eq=False)
class FreeSpace:
    """What stands in the way of robots that move together, with what they carry; other robots stand where they are.

    Shapes of different owners may be 1 mm in each other, links of one robot 5 mm: meshes count as convex hulls, which
    are rough. Links that are made so may lie in each other, and what does at the start may be so much deeper.
    """

    model: StationModel  # of the station with the shapes of all links, its robots where they stand
    start: Mapping[str, Vector]  # where the robots that move begin, (n,) each, by name
    met: Counter[str] = field(default_factory=Counter)  # how often each thing was in the way
    _pairs: dict[tuple[GeometryId, GeometryId], tuple[Bodies, float]] = field(default_factory=dict)
    _begun: Mapping[Bodies, float] = field(default_factory=dict)
    _owners: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Allow what touches at the start; raises StartInCollision: a robot that begins deep in something else."""
        self._ends = np.cumsum([len(posture) for posture in self.start.values()])[:-1]
        self._begun = {bodies: depth for depth, bodies in reversed(self.hits(self.posture, _AT_ALL))}
        deep = [(depth, bodies) for bodies, depth in self._begun.items() if depth > ROUGH and not self._of_one(bodies)]
        if deep:
            raise StartInCollision(*max(deep))

    @property
    def posture(self) -> Vector:
        """Where all that move begin, one after the other, shape (n,) [rad or m]."""
        return np.concatenate(list(self.start.values()))

    def parts(self, rows: Vector) -> dict[str, Vector]:
        """Return postures (..., n) of all that move by robot."""
        return dict(zip(self.start, np.split(rows, self._ends, axis=-1), strict=True))

    def hits(self, posture: Vector, part: float = 1.0) -> list[Hit]:
        """Return what lies in what in a posture (n,) deeper than a part of what is allowed, the deepest first."""
        self.model.place_robots(self.parts(posture))
        found = list[Hit]()
        for pair in self.model.query().ComputePointPairPenetration():
            shapes = pair.id_A, pair.id_B
            bodies, allowed = self._pairs.get(shapes) or self._known(shapes)
            if pair.depth > self._begun.get(bodies, 0.0) + part * allowed:
                found.append((float(pair.depth), bodies))
        return sorted(found, reverse=True)

    def free(self, posture: Vector) -> bool:
        """Tell whether a posture (n,) is free by more than rounding, and count what is in the way otherwise."""
        found = self.hits(posture, SEARCHED)
        self.met.update(found[0][1] if found else ())
        return not found

    def first_hit(self, rows: Iterable[Vector]) -> Hit | None:
        """Return the deepest hit of the first of postures (n,) that is not free; None if all are."""
        return next((found[0] for row in rows if (found := self.hits(row))), None)

    def obstacles(self, most: int = 3) -> list[str]:
        """Return what was in the way most often, beside the robots that move."""
        return [body for body, _ in self.met.most_common() if self._owners[body] not in self.start][:most]

    def carried(self, robot: str) -> Vector:
        """Return the corners of boxes around what a robot carries, where they are at the start, shape (k, 3) [m]."""
        self.model.place_robots(self.start)
        query, corners = self.model.query(), np.array([*product((-1.0, 1.0), repeat=3)])
        found = [np.zeros((0, 3))]
        for shape in query.inspector().GetAllGeometryIds(Role.kProximity):
            owner, own = self._owner(shape)
            box = query.inspector().GetObbInGeometryFrame(shape)
            if own == robot and box is not None and owner in {*self.model.robots[robot].held, *self.model.holders}:
                pose = query.GetPoseInWorld(shape) @ box.pose()
                found.append((pose.rotation().matrix() @ (corners * box.half_width()).T).T + pose.translation())
        return np.vstack(found)

    def _owner(self, shape: GeometryId) -> tuple[str, str]:
        """Return what a shape belongs to, and the robot that carries or holds it, if any."""
        owner, robot = owner_and_robot(self.model.station, shape)
        return owner, self.model.holders.get(owner, robot)

    def _known(self, shapes: tuple[GeometryId, GeometryId]) -> tuple[Bodies, float]:
        """Return whose two shapes are, and how deep they may be in each other."""
        (first, one), (second, other) = sorted(map(self._owner, shapes))
        self._owners |= {first: one, second: other}
        still, made_so = not {one, other} & {*self.start}, (first, second) in self.model.made_so
        allowed = np.inf if still or made_so else ROUGH if one == other else TOUCH
        bodies = (first, second) if one in self.start else (second, first)
        return self._pairs.setdefault(shapes, (bodies, allowed))

    def _of_one(self, bodies: Bodies) -> bool:
        """Tell whether two bodies are of the same robot."""
        return self._owners[bodies[0]] == self._owners[bodies[1]]
