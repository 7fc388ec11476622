"""Work objects, tools and loads: rigid bodies with mass, tool centre point, colour and simple shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator
from pydrake.geometry import Box, Cylinder, Mesh, Shape, Sphere
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    ModelInstanceIndex,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
)

from simrob_drake.errors import UnknownName
from simrob_drake.frames import transform_from_pose
from simrob_drake.paths import models_root
from simrob_drake.yaml_files import Number, Strict, read_yaml, validated

PIECE_FILE = "piece.yaml"
_FRICTION = CoulombFriction(1.0, 0.9)  # the library's contacts: static 1, dynamic 0.9

Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Triple = tuple[Number, Number, Number]
Pose = tuple[Number, Number, Number, Number, Number, Number]
Colour = tuple[Fraction, Fraction, Fraction, Fraction]
ORIGIN: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class PieceShape(Strict):
    """One shape of a piece: exactly one of box, cylinder, sphere and mesh."""

    box: tuple[Positive, Positive, Positive] | None = None
    cylinder: tuple[Positive, Positive] | None = None
    sphere: Positive | None = None
    mesh: str | None = None
    pose: Pose = ORIGIN
    colour: Colour | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> PieceShape:
        if sum(kind is not None for kind in (self.box, self.cylinder, self.sphere, self.mesh)) != 1:
            raise ValueError("a shape has exactly one of box, cylinder, sphere and mesh")
        return self

    def geometry(self, folder: Path) -> Shape:
        """Return Drake's shape [m]; a mesh is read from ``folder``."""
        if self.box is not None:
            return Box(*self.box)
        if self.cylinder is not None:
            return Cylinder(*self.cylinder)
        if self.sphere is not None:
            return Sphere(self.sphere)
        return Mesh(str(folder / str(self.mesh)), 1.0)


class PieceModel(Strict):
    """A piece as its ``piece.yaml`` describes it; a station may change any of the figures."""

    folder: Path
    description: str = ""
    mass: NotNegative = 0.0
    com: Triple = (0.0, 0.0, 0.0)
    inertia: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    tcp: Pose = ORIGIN
    colour: Colour = (0.6, 0.6, 0.65, 1.0)
    shapes: tuple[PieceShape, ...] = ()

    @field_validator("inertia")
    @classmethod
    def _triangle_inequality(cls, moments: Triple) -> Triple:
        small, middle, large = sorted(moments)
        if small + middle < large * (1 - 1e-9):
            raise ValueError("no body has these moments of inertia: the largest exceeds the sum of the others")
        return moments


def piece_names() -> list[str]:
    """Return the names of the pieces that come with the package."""
    return sorted(file.parent.name for file in (models_root() / "pieces").glob(f"*/{PIECE_FILE}"))


def load_piece(name: str) -> PieceModel:
    """Return a piece of the package by its name.

    Raises:
        UnknownName: no such piece.
        InvalidConfig: its file has a wrong entry.
    """
    if name not in piece_names():
        raise UnknownName("piece", name, piece_names())
    folder = models_root() / "pieces" / name
    file = folder / PIECE_FILE
    return validated(PieceModel, {"folder": folder, **read_yaml(file)}, file)


def add_piece(
    plant: MultibodyPlant,
    *,
    name: str,
    piece: PieceModel,
    parent: Frame,
    pose: Pose,
    instance: ModelInstanceIndex,
    collision: bool,
) -> Frame:
    """Weld a piece to a frame, with its inertia, visuals and, where asked, its collision geometry.

    Args:
        plant: the plant, not finalized and registered with a scene graph.
        name: name of the new body; its tool centre point is the frame ``<name>_tcp``.
        piece: what to add.
        parent: the frame that it is welded to.
        pose: of the piece in the parent frame, [x y z Rz Ry Rx].
        instance: the model instance that the body joins.
        collision: whether other geometry can touch it.

    Returns:
        the frame of its tool centre point.
    """
    body = plant.AddRigidBody(name, instance, _spatial_inertia(piece))
    plant.WeldFrames(parent, body.body_frame(), transform_from_pose(pose))
    for index, shape in enumerate(piece.shapes):
        _register(plant, body, f"{name}_{index}", shape, piece, collision)
    return plant.AddFrame(FixedOffsetFrame(f"{name}_tcp", body.body_frame(), transform_from_pose(piece.tcp)))


def _spatial_inertia(piece: PieceModel) -> SpatialInertia:
    about_com = RotationalInertia(*piece.inertia)
    if piece.mass == 0:
        return SpatialInertia(0.0, np.zeros(3), UnitInertia(0.0, 0.0, 0.0))
    return SpatialInertia.MakeFromCentralInertia(piece.mass, np.array(piece.com), about_com)


def _register(
    plant: MultibodyPlant, body: RigidBody, name: str, shape: PieceShape, piece: PieceModel, collision: bool
) -> None:
    pose, geometry = transform_from_pose(shape.pose), shape.geometry(piece.folder)
    plant.RegisterVisualGeometry(body, pose, geometry, name, np.array(shape.colour or piece.colour))
    if collision:
        plant.RegisterCollisionGeometry(body, pose, geometry, name, _FRICTION)
