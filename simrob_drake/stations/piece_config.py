"""What a station's file says of its pieces: each of them, and many of one at places of chance."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator
from pydrake.common import RandomGenerator
from pydrake.math import RigidTransform, RollPitchYaw, UniformlyRandomRotationMatrix

from simrob_drake.base.frames import Vector, pose_from_transform
from simrob_drake.base.messages import join_texts, message
from simrob_drake.base.sections import (
    ORIGIN,
    Boolean,
    Colour,
    Inertia,
    Integer,
    NotNegative,
    Number,
    Place,
    Pose,
    Positive,
    Strict,
)
from simrob_drake.robots.pieces import (
    FORMS,
    FrameSeries,
    PieceShape,
)
from simrob_drake.stations.solver_config import PieceContact

_TRIES, _ATTEMPTS = 300, 50  # places that are drawn for one piece, and how often all are drawn anew
_MOST = 200


class Scatter(Strict):
    """Where pieces begin: at places and turns that are drawn evenly, the same ones for the same seed."""

    count: Annotated[Integer, Field(ge=1, le=_MOST)]
    """How many there are, `<name>_1` and so on."""
    within: tuple[Place, Place]
    """Two opposite corners of the box in which their frames are, in the world [m]."""
    apart: NotNegative = 0.0
    """How far their frames are from each other at least [m]."""
    turn_deg: tuple[Number, Number] = (-180.0, 180.0)
    """By which angles they are turned about the world's z."""
    tumbled: Boolean = False
    """Turned in any way instead."""
    seed: Annotated[Integer, Field(ge=0)] = 0
    """Of what is drawn."""

    @model_validator(mode="after")
    def _in_order(self) -> "Scatter":
        if any(low > high for low, high in (*zip(*self.within, strict=True), self.turn_deg)):
            raise ValueError(message("stations.lower_values_first", "within and turn_deg have the lower values first"))
        return self

    def poses(self) -> list[Pose]:
        """Return where they begin, in the world; raises ValueError: there is no room for so many."""
        random, drake_random = np.random.default_rng(self.seed), RandomGenerator(self.seed)
        attempts = [self._places(random)]
        while len(attempts[-1]) < self.count and len(attempts) < _ATTEMPTS:
            attempts.append(self._places(random))
        places = attempts[-1]
        if len(places) < self.count:
            most = max(map(len, attempts))
            raise ValueError(
                message(
                    "stations.room_for_some",
                    "room for {most} of {count}: give it a larger box, or less apart",
                    most=most,
                    count=self.count,
                )
            )
        turns = [
            UniformlyRandomRotationMatrix(drake_random)
            if self.tumbled
            else RollPitchYaw(0.0, 0.0, random.uniform(*np.deg2rad(self.turn_deg))).ToRotationMatrix()
            for _ in places
        ]
        poses = [RigidTransform(turn, place) for turn, place in zip(turns, places, strict=True)]
        return [tuple(pose_from_transform(pose).tolist()) for pose in poses]

    def _places(self, random: np.random.Generator) -> list[Vector]:
        """Return places as far apart as they must be; fewer where those before leave no room."""
        places = list[Vector]()
        for _ in range(self.count):
            drawn = (random.uniform(*self.within) for _ in range(_TRIES))
            free = (place for place in drawn if all(np.linalg.norm(place - other) >= self.apart for other in places))
            if (place := next(free, None)) is None:
                break
            places.append(place)
        return places


class PieceConfig(Strict):
    """A piece of the station; every figure that is given replaces the one of the piece's own file."""

    model: str | None = None
    """A piece's name, of `simrob list`, or the path of a `piece.yaml`; the key's own name unless given."""
    mesh: Path | None = None
    """A mesh file instead of a model: STL, OBJ, DAE or GLB; relative paths start at the station's file."""
    scale: Positive | None = None
    """Of the mesh; 0.001 for one in millimetres."""
    box: tuple[Positive, Positive, Positive] | None = None
    """A box instead of a model: its sides [m]."""
    cylinder: tuple[Positive, Positive] | None = None
    """A cylinder instead of a model: radius and length [m], along z."""
    sphere: Positive | None = None
    """A sphere instead of a model: its radius [m]."""
    shapes: Annotated[tuple[PieceShape, ...], Field(min_length=1)] | None = None
    """Several boxes, cylinders and spheres as one piece, instead of a model."""
    parent: str | None = None
    """What it hangs on: `world`, a robot (its first tool), or another piece (its TCP); needed unless it is free."""
    frame: str | None = None
    """A frame of the piece that it hangs on, instead of its TCP; or a tool or link of the robot, instead of its first
    tool, or of the root where that is a foot."""
    pose: Pose = ORIGIN
    """Pose in the parent's frame, [x y z Rz Ry Rx]."""
    density: Positive | None = None
    """Density of the material [kg/m³], instead of a mass: mass, centre of mass and inertia follow from the shapes."""
    mass: NotNegative | None = None
    """Mass [kg]; without an inertia of its own, a piece with shapes is taken to be evenly filled."""
    com: Place | None = None
    """Centre of mass in the piece's frame [m]."""
    inertia: Inertia | None = None
    """Moments of inertia Ixx Iyy Izz about the centre of mass [kg m²], and the products Ixy Ixz Iyz if not zero."""
    tcp: Pose | None = None
    """Pose of the tool centre point in the piece's frame, [x y z Rz Ry Rx]."""
    frames: dict[str, Pose | FrameSeries] | None = None
    """Further frames by name, instead of the piece's own: poses in its frame, or series of them."""
    colour: Colour | None = None
    """Red, green, blue, opacity."""
    free: Boolean = False
    """Moved by gravity and contact alone; its pose is that at the start, in the world."""
    contact: PieceContact | None = None
    """What its surface is made of and how it meets others, in place of the station's `contact`."""
    scatter: Scatter | None = None
    """Makes free pieces `<name>_1`, `<name>_2` ... of it, at places of chance."""

    @property
    def sources(self) -> list[str]:
        """Which keys tell what it is."""
        return [key for key in ("model", "mesh", *FORMS, "shapes") if getattr(self, key) is not None]

    @model_validator(mode="after")
    def _free_of_parents(self) -> "PieceConfig":
        if self.scatter is not None and {"parent", "pose"} & self.model_fields_set:
            raise ValueError(
                message(
                    "stations.scattered_pieces_are_free",
                    "scattered pieces are free, and their poses are drawn: leave parent and pose out",
                )
            )
        if self.free and self.parent not in (None, "world"):
            raise ValueError(
                message(
                    "stations.free_piece_hangs_on_nothing",
                    "a free piece hangs on nothing, so its parent is world and not {parent}",
                    parent=self.parent,
                )
            )
        return self

    @model_validator(mode="after")
    def _one_source(self) -> "PieceConfig":
        if len(self.sources) > 1:
            raise ValueError(
                message(
                    "stations.one_of_sources",
                    "a piece has one of {sources}, not several",
                    sources=join_texts(self.sources, message("base.and", " and ")),
                )
            )
        if any(shape.mesh for shape in self.shapes or ()):
            raise ValueError(
                message(
                    "stations.shapes_and_mesh",
                    "shapes are boxes, cylinders and spheres; a mesh stands in mesh, or in a piece.yaml",
                )
            )
        if self.scale is not None and self.mesh is None:
            raise ValueError(message("stations.scale_goes_with_mesh", "a scale goes with a mesh"))
        if self.density is not None and self.mass is not None:
            raise ValueError(message("stations.mass_or_density", "a piece has either a mass or a density"))
        return self


def scattered(entries: Mapping[str, PieceConfig]) -> dict[str, PieceConfig]:
    """Return pieces with each that is scattered as its many; raises ValueError: no room, or a name that is taken."""
    found = dict[str, PieceConfig]()
    for name, entry in entries.items():
        try:
            poses = entry.scatter.poses() if entry.scatter else []
        except ValueError as problem:
            raise ValueError(
                message("stations.scatter_has", "{name}.scatter has {problem}", name=name, problem=problem)
            ) from problem
        own = {"scatter": None, "free": True} | ({} if entry.sources else {"model": name})
        many = {f"{name}_{n}": entry.model_copy(update={**own, "pose": pose}) for n, pose in enumerate(poses, 1)}
        if twice := {*many} & {*entries}:
            raise ValueError(
                message(
                    "stations.scattered_name_taken",
                    "{twice} stands there, and would be one of the scattered {name}",
                    twice=min(twice),
                    name=name,
                )
            )
        found |= many or {name: entry}
    return found
