"""Work objects, tools and loads: rigid bodies with mass, tool centre point, colour and simple shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from simrob_drake.errors import UnknownName
from simrob_drake.paths import models_root
from simrob_drake.yaml_files import Number, Strict, read_yaml, validated

PIECE_FILE = "piece.yaml"

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
    name: str | None = None
    """What sensors call it, `<piece>.<name>`; its number unless given."""
    collides: bool = True
    """Whether it takes part in contact, or is only seen."""
    visible: bool = True

    @model_validator(mode="after")
    def _exactly_one(self) -> PieceShape:
        if sum(kind is not None for kind in (self.box, self.cylinder, self.sphere, self.mesh)) != 1:
            raise ValueError("a shape has exactly one of box, cylinder, sphere and mesh")
        return self


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

    @property
    def shape_names(self) -> list[str]:
        """The names of the shapes, in order: their own, or their numbers."""
        return [shape.name or str(index) for index, shape in enumerate(self.shapes)]

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
