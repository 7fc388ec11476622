"""The section ``pieces`` of a station: single pieces, and many copies of a piece at random poses.

A *pose* is x y z [m] and three angles Rz Ry Rx [rad], with the rotation R = Rz(rz) Ry(ry) Rx(rx). A *free* piece is
moved by gravity and contact only; other pieces are mounted on a *parent*.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

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

_DRAWS = 300
"""Count of positions that are drawn for one piece before the others are in its way."""

_ATTEMPTS = 50
"""Largest count of attempts to draw all positions; an attempt fails if some piece finds no room."""

_LARGEST_COUNT = 200


class Scatter(Strict):
    """Initial poses of several copies of a piece, drawn from a uniform distribution; equal seeds give equal poses."""

    count: Annotated[Integer, Field(ge=1, le=_LARGEST_COUNT)]
    """Count of the copies, which are named `<name>_1` and so on."""
    within: tuple[Place, Place]
    """Two opposite corners of the box in which the copies' frames are, in the world, lower values first [m]."""
    apart: NotNegative = 0.0
    """Smallest distance between the frames of two copies [m]."""
    turn_deg: tuple[Number, Number] = (-180.0, 180.0)
    """Range of the angles by which the copies are turned about the world's z axis."""
    tumbled: Boolean = False
    """Whether the copies are turned about any axis instead, all orientations being equally likely."""
    seed: Annotated[Integer, Field(ge=0)] = 0
    """Seed of the random numbers."""

    @model_validator(mode="after")
    def _in_order(self) -> "Scatter":
        """Check that in each range the lower value comes first.

        Raises:
            ValueError: a lower value is larger than its upper value.
        """
        # Two corners become a pair (lower, upper) for each of x, y and z.
        ranges = [*zip(*self.within, strict=True), self.turn_deg]
        if any(lower > upper for lower, upper in ranges):
            raise ValueError(
                message(
                    "stations.lower_values_first",
                    "in within and turn_deg, the lower values come first",
                )
            )
        return self

    def poses(self) -> list[Pose]:
        """Draw the initial pose of each copy in the world, [x y z Rz Ry Rx].

        Raises:
            ValueError: there is no room for so many copies.
        """
        # Two generators, as Drake's uniform rotations need one of Drake. The same seed gives the
        # same poses.
        random = np.random.default_rng(self.seed)
        drake_random = RandomGenerator(self.seed)
        attempts = [self._draw_positions(random)]  # lists of positions; the last one is used
        # Pieces that are placed badly may leave no room for the last one, though there is enough in
        # all.
        while len(attempts[-1]) < self.count and len(attempts) < _ATTEMPTS:
            attempts.append(self._draw_positions(random))
        positions = attempts[-1]
        if len(positions) < self.count:
            most = max(map(len, attempts))
            raise ValueError(
                message(
                    "stations.room_for_some",
                    "room for only {most} of {count} pieces; enlarge within, or reduce apart",
                    most=most,
                    count=self.count,
                )
            )
        poses = []
        for position in positions:
            if self.tumbled:
                rotation = UniformlyRandomRotationMatrix(drake_random)
            else:
                # R = Rz(angle): the piece stays upright.
                angle = random.uniform(*np.deg2rad(self.turn_deg))
                rotation = RollPitchYaw(0.0, 0.0, angle).ToRotationMatrix()
            pose = RigidTransform(rotation, position)
            poses.append(tuple(pose_from_transform(pose).tolist()))
        return poses

    def _draw_positions(self, random: np.random.Generator) -> list[Vector]:
        """Draw positions (3,) [m] that keep the smallest distance; fewer than ``count`` if no room is found for one."""
        positions = list[Vector]()
        for _ in range(self.count):
            position = self._draw_free_position(random, positions)
            if position is None:
                break
            positions.append(position)
        return positions

    def _draw_free_position(
        self,
        random: np.random.Generator,
        others: list[Vector],
    ) -> Vector | None:
        """Draw a position (3,) [m] that keeps the smallest distance from others. Returns None if _DRAWS draws fail."""
        # Rejection sampling: positions stay uniformly distributed over the free room.
        for _ in range(_DRAWS):
            position = random.uniform(*self.within)
            if all(np.linalg.norm(position - other) >= self.apart for other in others):
                return position
        return None


class PieceConfig(Strict):
    """A piece of the station. A value that is given here replaces the value in the piece's own file."""

    model: str | None = None
    """Name of a piece (`simrob list` shows them) or path of a `piece.yaml`. By default the name of the section."""
    mesh: Path | None = None
    """A mesh file instead of a model: STL, OBJ, DAE or GLB; relative paths start at the station's file."""
    scale: Positive | None = None
    """Scale of the mesh: 0.001 if the mesh is in millimetres."""
    box: tuple[Positive, Positive, Positive] | None = None
    """A box instead of a model: its sides [m]."""
    cylinder: tuple[Positive, Positive] | None = None
    """A cylinder instead of a model: radius and length [m], along z."""
    sphere: Positive | None = None
    """A sphere instead of a model: its radius [m]."""
    shapes: Annotated[tuple[PieceShape, ...], Field(min_length=1)] | None = None
    """Several boxes, cylinders and spheres as one piece, instead of a model."""
    parent: str | None = None
    """Parent on which the piece is mounted: `world`, a robot (on its first tool) or another piece (at its TCP). A piece
    that is not free needs a parent."""
    frame: str | None = None
    """Frame of the parent on which the piece is mounted. Of a piece: one of its frames, by default its TCP. Of a robot:
    a tool or a link, by default the first tool, or the root link if the first tool is a foot."""
    pose: Pose = ORIGIN
    """Pose in the parent's frame, [x y z Rz Ry Rx]."""
    density: Positive | None = None
    """Density of the material [kg/m³], instead of a mass: mass, centre of mass and inertia follow from the shapes."""
    mass: NotNegative | None = None
    """Mass [kg]. A piece with shapes and without an inertia of its own has a uniform density."""
    com: Place | None = None
    """Centre of mass in the piece's frame [m]."""
    inertia: Inertia | None = None
    """Moments of inertia Ixx Iyy Izz about the centre of mass [kg m²], and the products Ixy Ixz Iyz if not zero."""
    tcp: Pose | None = None
    """Pose of the tool centre point in the piece's frame, [x y z Rz Ry Rx]."""
    frames: dict[str, Pose | FrameSeries] | None = None
    """Further frames by name, instead of the piece's own: poses in the frame of the piece, or series of poses."""
    colour: Colour | None = None
    """Red, green, blue, opacity."""
    free: Boolean = False
    """Whether only gravity and contact move the piece; its pose is then that at the start, in the world."""
    contact: PieceContact | None = None
    """Material of the surface, and contact of the piece with others, in place of the station's `contact`."""
    scatter: Scatter | None = None
    """Makes several free copies of the piece, `<name>_1`, `<name>_2` ..., at random poses."""

    @property
    def sources(self) -> list[str]:
        """The given keys that describe the piece's shape: at most one is allowed."""
        return [
            key for key in ("model", "mesh", *FORMS, "shapes") if getattr(self, key) is not None
        ]

    @model_validator(mode="after")
    def _free_of_parents(self) -> "PieceConfig":
        """Check that a free piece has no parent but the world, and a scattered piece neither a parent nor a pose.

        Raises:
            ValueError: such a key is given.
        """
        # `model_fields_set` has the keys that the user gave, even with their default values.
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
                    "a free piece has the parent world, not {parent}",
                    parent=self.parent,
                )
            )
        return self

    @model_validator(mode="after")
    def _one_source(self) -> "PieceConfig":
        """Check that the keys for the shape and the mass of the piece do not contradict each other.

        Raises:
            ValueError: there are several keys for the shape, a mesh among ``shapes``, a scale without a mesh, or both a
                mass and a density.
        """
        if len(self.sources) > 1:
            raise ValueError(
                message(
                    "stations.one_of_sources",
                    "a piece has only one of {sources}",
                    sources=join_texts(self.sources, message("base.and", " and ")),
                )
            )
        if any(shape.mesh for shape in self.shapes or ()):
            raise ValueError(
                message(
                    "stations.shapes_and_mesh",
                    "shapes contains boxes, cylinders and spheres; give a mesh under the key mesh, or in a piece.yaml",
                )
            )
        if self.scale is not None and self.mesh is None:
            raise ValueError(message("stations.scale_goes_with_mesh", "scale needs the key mesh"))
        if self.density is not None and self.mass is not None:
            raise ValueError(
                message("stations.mass_or_density", "a piece has either mass or density, not both")
            )
        return self


def with_scattered_copies(entries: Mapping[str, PieceConfig]) -> dict[str, PieceConfig]:
    """Replace each piece that has a section ``scatter`` by its copies, named `<name>_1` and so on.

    Args:
        entries: the pieces, by name.

    Raises:
        ValueError: there is no room for the copies, or the name of a copy is taken.
    """
    found = dict[str, PieceConfig]()
    for name, entry in entries.items():
        if entry.scatter is None:
            found[name] = entry
            continue
        try:
            poses = entry.scatter.poses()
        except ValueError as problem:
            raise ValueError(
                message(
                    "stations.scatter_has",
                    "{name}.scatter has {problem}",
                    name=name,
                    problem=problem,
                )
            ) from problem
        # Copies without the section, or loading a saved station would scatter each copy again.
        changes: dict[str, Any] = {"scatter": None, "free": True}
        if not entry.sources:
            # The name of a piece without a source is its model, but that of a copy is not.
            changes["model"] = name
        copies = {
            f"{name}_{number}": entry.model_copy(update={**changes, "pose": pose})
            for number, pose in enumerate(poses, start=1)
        }
        # A copy would replace a piece of the user without a word.
        taken = copies.keys() & entries.keys()
        if taken:
            raise ValueError(
                message(
                    "stations.scattered_name_taken",
                    "the piece {twice} exists already, and a copy of {name} has the same name; rename one of them",
                    twice=min(taken),
                    name=name,
                )
            )
        found.update(copies)
    return found
