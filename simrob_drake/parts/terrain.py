"""Uneven ground: a field of boxes on the way from the world's origin, the same for the same seed."""

from dataclasses import dataclass
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image
from pydantic import Field, model_validator
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.files import content_of, read_matrix
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, Number, Positive, Strict

_BELOW = 0.05  # how far the boxes reach below the lowest of their tops, and how thick what is soft is at least [m]
_AROUND = 1.0  # level ground behind the field at least [m]
MOST_BOXES = 1000  # contact looks at each
_MOST_PIXELS = 100_000  # of a picture of heights
_TILT = 0.25  # of rubble, at most [rad]


@dataclass(frozen=True)
class TerrainBox:
    """A box of a terrain."""

    pose: RigidTransform  # of its middle, in the frame of the floor
    half: Vector  # of its sides, shape (3,) [m]
    modulus: float | None = None  # hydroelastic modulus of what is soft [Pa]; None where it is as hard as the floor


class SoftPatch(Strict):
    """A level patch behind the field, as wide as it, that gives way. It needs hydroelastic contact."""

    length: Positive = 0.6
    """Along the way [m]."""
    hydroelastic_modulus: Positive = 1e6
    """Pressure of its surface pressed in to the bottom, which lies height + 0.05 m deep [Pa]."""


class Terrain(Strict):
    """A field of uneven ground on a floor, level around it.

    Steps: square tiles whose tops lie within ± height. Slope: ridges, up to the height and down again. Bumps: bars
    across the way, up to the height. Rubble: stones that lie about, turned at random, up to about the height. Stairs:
    each step so much higher than the last up to the middle of the way, and down again. Gaps: trenches across the way,
    so deep. Grid: tiles whose heights stand in a file, which says how many there are, too.
    """

    kind: Literal["steps", "slope", "bumps", "rubble", "stairs", "gaps", "grid"]
    height: Positive = 0.02
    """How high or deep it goes [m]; of stairs each step; what is white in a picture."""
    size: Positive = 0.2
    """Side of a tile or a stone, way up a ridge, from one bar, step or gap to the next [m]."""
    gap: Positive = 0.06
    """Width of a gap [m]."""
    file: Path | None = None
    """Of a grid: a CSV file of heights [m], a line for each row across the way, from the left, in the order of the way;
    or a PNG whose upper edge is far ahead, black 0 and white the height. Relative paths start at the station's file."""
    start: Number = 0.4
    """Where it begins, from the world's origin [m]; behind it where negative."""
    length: Positive = 3.0
    """Along the way [m]; whole sizes fit in."""
    width: Positive = 1.6
    """Across it [m]."""
    heading_deg: Number = 0.0
    """Which way it lies, counterclockwise from the world's x [deg]."""
    seed: Integer = Field(default=0, ge=0)
    """Of what is random: the same seed, the same ground."""
    soft: SoftPatch | None = None
    """What comes behind it; none unless given."""

    @model_validator(mode="after")
    def _fits(self) -> "Terrain":
        if self.kind == "grid" and self.file is None:
            raise ValueError(message("parts.grid_without_file", "file is missing, which has the heights of a grid"))
        if self.kind != "grid" and self.file is not None:
            raise ValueError(
                message("parts.file_of_grid_only", "file goes with kind grid alone, not with {kind}", kind=self.kind)
            )
        if self.kind == "gaps" and self.gap >= self.size:
            raise ValueError(
                message(
                    "parts.gap_leaves_nothing",
                    "gap ({gap:g} m) leaves nothing to stand on between gaps every {size:g} m (size)",
                    gap=self.gap,
                    size=self.size,
                )
            )
        if self.kind == "grid":
            return self
        along, across = self.length / self.size, self.width / self.size
        if along < 1 or across < 1:
            raise ValueError(
                message("parts.size_not_below", "size ({size:g} m) is not more than length and width", size=self.size)
            )
        if along * across > MOST_BOXES:
            least = np.sqrt(self.length * self.width / MOST_BOXES)
            raise ValueError(
                message(
                    "parts.too_many_boxes",
                    "a size of {size:g} m makes more than {most} boxes; take {least:.2g} m or more",
                    size=self.size,
                    most=MOST_BOXES,
                    least=least,
                )
            )
        return self

    @property
    def depth(self) -> float:
        """How far the plane of the floor lies below the level around the field [m]."""
        lowest = self.heights().min() if self.kind == "grid" else -self.height
        return _BELOW + max(self.height, -float(lowest))

    def heights(self) -> Vector:
        """Return a grid's heights (ahead, from the right) [m]; raises InvalidConfig: no table, no picture."""
        assert self.file is not None  # a grid has one
        if self.file.suffix.lower() != ".png":
            return read_matrix(self.file)[:, ::-1]
        try:
            with Image.open(BytesIO(content_of(self.file))) as picture:
                if picture.width * picture.height > _MOST_PIXELS:
                    pixels = message(
                        "parts.too_many_pixels",
                        "has {width} x {height} pixels, more than {most}; make it smaller",
                        width=picture.width,
                        height=picture.height,
                        most=_MOST_PIXELS,
                    )
                    raise InvalidConfig(self.file, "", pixels)
                white = 65535.0 if "16" in picture.mode else 255.0
                return np.asarray(self.height / white * np.asarray(picture.convert("F"))[::-1, ::-1], dtype=float)
        except OSError as problem:
            raise InvalidConfig(
                self.file, "", message("parts.no_picture", "cannot be read as a picture ({problem})", problem=problem)
            ) from problem

    def blocks(self, floor: float) -> list[TerrainBox]:
        """Return the boxes, those of the level ground around the field included; ``floor`` is its side [m]."""
        soft = 0.0 if self.soft is None else self.soft.length
        rows, columns = self._tiles()
        side = columns * self.size / 2
        begin, end = self.start, self.start + rows * self.size
        far = max(floor / 2, *(reach + _AROUND for reach in (-begin, max(end, begin + self.length) + soft, side)))
        around = [
            self._slab((-far, begin), (-far, far)),
            self._slab((end + soft, far), (-far, far)),
            self._slab((begin, end + soft), (side, far)),
            self._slab((begin, end + soft), (-far, -side)),
        ]
        if self.soft is not None:
            around.append(self._slab((end, end + soft), (-side, side), modulus=self.soft.hydroelastic_modulus))
        if self.kind not in ("steps", "grid"):
            around.append(self._slab((begin, end), (-side, side), -self.height if self.kind == "gaps" else 0.0))
        grid = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
        middles = np.asarray((np.stack(grid, axis=-1).reshape(-1, 2) + 0.5) * self.size + (begin, -side))
        random = np.random.default_rng(self.seed)
        makers = {"steps": self._steps, "slope": self._ridges, "bumps": self._bars, "rubble": self._stones}
        made = {**makers, "stairs": self._stairs, "gaps": self._gaps, "grid": self._grid}[self.kind]
        turn = RigidTransform(RollPitchYaw(0.0, 0.0, np.deg2rad(self.heading_deg)), np.zeros(3))
        boxes = (*around, *made(middles, side, random))
        return [TerrainBox(turn @ each.pose, each.half, each.modulus) for each in boxes]

    def _tiles(self) -> tuple[int, int]:
        """Return how many there are along and across the way."""
        if self.kind == "grid":
            rows, columns = self.heights().shape
            return rows, columns
        return int(self.length / self.size + 1e-9), int(self.width / self.size + 1e-9)

    def _slab(
        self, along: tuple[float, float], across: tuple[float, float], top: float = 0.0, modulus: float | None = None
    ) -> TerrainBox:
        """Return an upright box from below the floor to a height [m]."""
        low, high = np.array([along[0], across[0], -self.depth]), np.array([along[1], across[1], top])
        return TerrainBox(RigidTransform((low + high) / 2), (high - low) / 2, modulus)

    def _steps(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        tops, half = random.uniform(-self.height, self.height, len(middles)), self.size / 2
        return [
            self._slab((x - half, x + half), (y - half, y + half), top)
            for (x, y), top in zip(middles, tops, strict=True)
        ]

    def _ridges(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        angle, thick = np.arctan2(self.height, self.size), self.height
        half = np.array([np.hypot(self.size, self.height) / 2, side, thick / 2])
        ways = np.unique(middles[:, 0])
        ways = ways[: len(ways) // 2 * 2]  # what goes up comes down
        blocks = []
        for number, x in enumerate(ways):
            turn = RollPitchYaw(0.0, angle if number % 2 else -angle, 0.0).ToRotationMatrix()
            middle = np.array([x, 0.0, self.height / 2]) - turn.col(2) * thick / 2
            blocks.append(TerrainBox(RigidTransform(turn, middle), half))
        return blocks

    def _bars(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        ways = np.unique(middles[:, 0])
        tops, half = random.uniform(0.0, self.height, len(ways)), self.size / 8
        return [self._slab((x - half, x + half), (-side, side), top) for x, top in zip(ways, tops, strict=True)]

    def _stones(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        blocks = []
        for x, y in middles:
            at = np.array([x, y, 0.0]) + self.size * random.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.0))
            half = self.size * random.uniform((0.15, 0.15, 0.0), (0.4, 0.4, 0.0))
            top = random.uniform(0.0, self.height)
            turn = RollPitchYaw(*random.uniform(-_TILT, _TILT, 2), random.uniform(0.0, np.pi)).ToRotationMatrix()
            reach = abs(turn.row(2)[:2]) @ half[:2]
            half[2] = self.height
            at[2] = top - reach - abs(turn.row(2)[2]) * half[2]
            blocks.append(TerrainBox(RigidTransform(turn, at), half))
        return blocks

    def _stairs(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        ways, half = np.unique(middles[:, 0]), self.size / 2
        steps = np.minimum(np.arange(1, len(ways) + 1), np.arange(len(ways), 0, -1))
        return [
            self._slab((x - half, x + half), (-side, side), step * self.height)
            for x, step in zip(ways, steps, strict=True)
        ]

    def _gaps(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        ends = [self.start, *(x + sign * self.gap / 2 for x in np.unique(middles[:, 0]) for sign in (-1, 1))]
        ends.append(self.start + self._tiles()[0] * self.size)
        return [self._slab((ends[n], ends[n + 1]), (-side, side)) for n in range(0, len(ends), 2)]

    def _grid(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        boxes = []
        for row, heights in enumerate(self.heights()):
            begin, right = self.start + row * self.size, -side
            for top, alike in groupby(heights.tolist()):
                left = right + len(list(alike)) * self.size
                boxes.append(self._slab((begin, begin + self.size), (right, left), top))
                right = left
        if len(boxes) > MOST_BOXES:
            assert self.file is not None  # a grid has one
            raise InvalidConfig(
                self.file,
                "",
                message(
                    "parts.grid_of_too_many_boxes",
                    "makes {count} boxes, and at most {most} can be; thin it out",
                    count=len(boxes),
                    most=MOST_BOXES,
                ),
            )
        return boxes
