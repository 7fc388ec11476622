"""Uneven ground: a field of boxes ahead of the world's origin. The same seed gives the same ground.

Within this module, x is along the field, y to the left, and z up from the floor. A tile is a square cell of the field.
"""

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

# Depth of the boxes below the lowest of their tops, and least thickness of a soft patch [m].
_BELOW = 0.05
# Least extent of the level ground around the field [m].
_AROUND = 1.0
MOST_BOXES = 1000
"""Largest count of boxes: contact detection looks at each of them."""
# Largest count of pixels of a picture of heights.
_MOST_PIXELS = 100_000
# Largest angle of a stone about the x and the y axis [rad].
_TILT = 0.25
# Rounding error of a count of tiles.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class TerrainBox:
    """A box of a terrain.

    Attributes:
        pose: pose of its middle in the frame of the floor.
        half: half of its sides, shape (3,) [m].
        modulus: hydroelastic modulus if the box is soft [Pa]; None if it is as hard as the floor.
    """

    pose: RigidTransform
    half: Vector
    modulus: float | None = None


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
    def _check_sizes(self) -> "Terrain":
        """Check that the keys fit the kind, and that there are not too many boxes."""
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
        """Depth of the floor's plane below the level ground around the field [m]."""
        lowest = self.heights().min() if self.kind == "grid" else -self.height
        return _BELOW + max(self.height, -float(lowest))

    def heights(self) -> Vector:
        """Read the heights of a grid [m], shape (rows ahead, columns from the right to the left).

        Raises:
            InvalidConfig: the file is no table of numbers, or no picture, or too large.
        """
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
                white = 65535.0 if "16" in picture.mode else 255.0  # largest value of a pixel
                values = np.asarray(picture.convert("F"))[::-1, ::-1]
                return np.asarray(self.height / white * values, dtype=float)
        except OSError as problem:
            raise InvalidConfig(
                self.file, "", message("parts.no_picture", "cannot be read as a picture ({problem})", problem=problem)
            ) from problem

    def blocks(self, floor: float) -> list[TerrainBox]:
        """Compute all boxes: those of the field, and those of the level ground around it.

        Args:
            floor: length of the floor's sides [m].
        """
        make_boxes = {
            "steps": self._steps,
            "slope": self._ridges,
            "bumps": self._bars,
            "rubble": self._stones,
            "stairs": self._stairs,
            "gaps": self._gaps,
            "grid": self._grid,
        }[self.kind]
        rows, columns = self._tile_counts()
        side = columns * self.size / 2  # half of the field's width
        row_numbers, column_numbers = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
        tiles = np.stack([row_numbers, column_numbers], axis=-1).reshape(-1, 2)
        middles = np.asarray((tiles + 0.5) * self.size + (self.start, -side))
        boxes = [*self._level_ground(floor, rows, side), *make_boxes(middles, side, np.random.default_rng(self.seed))]

        heading = RigidTransform(RollPitchYaw(0.0, 0.0, np.deg2rad(self.heading_deg)), np.zeros(3))
        return [TerrainBox(heading @ box.pose, box.half, box.modulus) for box in boxes]

    def _level_ground(self, floor: float, rows: int, side: float) -> list[TerrainBox]:
        """Compute the boxes around the field, the soft patch, and the ground under boxes that stand on it.

        Args:
            floor: length of the floor's sides [m].
            rows: count of tiles along the field.
            side: half of the field's width [m].
        """
        soft_length = 0.0 if self.soft is None else self.soft.length
        begin = self.start
        end = self.start + rows * self.size
        # The ground reaches to the edge of the floor, and far enough beyond the field.
        last = max(end, begin + self.length) + soft_length
        far = max(floor / 2, -begin + _AROUND, last + _AROUND, side + _AROUND)
        boxes = [
            self._slab((-far, begin), (-far, far)),
            self._slab((end + soft_length, far), (-far, far)),
            self._slab((begin, end + soft_length), (side, far)),
            self._slab((begin, end + soft_length), (-far, -side)),
        ]
        if self.soft is not None:
            soft_patch = self._slab((end, end + soft_length), (-side, side), modulus=self.soft.hydroelastic_modulus)
            boxes.append(soft_patch)
        if self.kind not in ("steps", "grid"):
            top = -self.height if self.kind == "gaps" else 0.0
            boxes.append(self._slab((begin, end), (-side, side), top))
        return boxes

    def _tile_counts(self) -> tuple[int, int]:
        """Counts of tiles along the field and across it."""
        if self.kind == "grid":
            rows, columns = self.heights().shape
            return rows, columns
        return int(self.length / self.size + _ROUNDING), int(self.width / self.size + _ROUNDING)

    def _slab(
        self, along: tuple[float, float], across: tuple[float, float], top: float = 0.0, modulus: float | None = None
    ) -> TerrainBox:
        """Make an upright box that begins below the floor.

        Args:
            along: its range of x [m].
            across: its range of y [m].
            top: height of its top [m].
            modulus: hydroelastic modulus if it is soft [Pa], or None.
        """
        low = np.array([along[0], across[0], -self.depth])
        high = np.array([along[1], across[1], top])
        return TerrainBox(RigidTransform((low + high) / 2), (high - low) / 2, modulus)

    # Each of the functions below makes the boxes of one kind of terrain, with the arguments:
    # middles: middles of all tiles, shape (tiles, 2) [m], row by row.
    # side: half of the field's width [m].
    # random: generator of random numbers.

    def _steps(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Make a box of random height on each tile."""
        tops = random.uniform(-self.height, self.height, len(middles))
        half = self.size / 2
        return [
            self._slab((x - half, x + half), (y - half, y + half), top)
            for (x, y), top in zip(middles, tops, strict=True)
        ]

    def _ridges(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Make inclined boxes across the field, up and down in turn."""
        angle = np.arctan2(self.height, self.size)
        thickness = self.height
        half = np.array([np.hypot(self.size, self.height) / 2, side, thickness / 2])
        rows = np.unique(middles[:, 0])
        even_count = len(rows) // 2 * 2  # each way up has a way down
        boxes = []
        for number, x in enumerate(rows[:even_count]):
            pitch = angle if number % 2 else -angle
            rotation = RollPitchYaw(0.0, pitch, 0.0).ToRotationMatrix()
            # The middle of the box's top is at half of the height.
            middle = np.array([x, 0.0, self.height / 2]) - rotation.col(2) * thickness / 2
            boxes.append(TerrainBox(RigidTransform(rotation, middle), half))
        return boxes

    def _bars(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Make a bar of random height across each row; it covers a quarter of the row."""
        rows = np.unique(middles[:, 0])
        tops = random.uniform(0.0, self.height, len(rows))
        half = self.size / 8
        return [self._slab((x - half, x + half), (-side, side), top) for x, top in zip(rows, tops, strict=True)]

    def _stones(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Make a box of random size, position and rotation on each tile."""
        boxes = []
        for x, y in middles:
            offset = self.size * random.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.0))
            position = np.array([x, y, 0.0]) + offset
            half = self.size * random.uniform((0.15, 0.15, 0.0), (0.4, 0.4, 0.0))
            top = random.uniform(0.0, self.height)
            roll_and_pitch = random.uniform(-_TILT, _TILT, 2)
            yaw = random.uniform(0.0, np.pi)
            rotation = RollPitchYaw(*roll_and_pitch, yaw).ToRotationMatrix()
            # The highest corner of the inclined box is at the height `top`.
            half[2] = self.height
            upward = abs(rotation.row(2))
            position[2] = top - upward[:2] @ half[:2] - upward[2] * half[2]
            boxes.append(TerrainBox(RigidTransform(rotation, position), half))
        return boxes

    def _stairs(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Make a step across each row, up to the middle of the field and down again."""
        rows = np.unique(middles[:, 0])
        half = self.size / 2
        upward = np.arange(1, len(rows) + 1)
        downward = np.arange(len(rows), 0, -1)
        steps = np.minimum(upward, downward)
        return [
            self._slab((x - half, x + half), (-side, side), step * self.height)
            for x, step in zip(rows, steps, strict=True)
        ]

    def _gaps(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Make the ground between gaps, of which one is in the middle of each row."""
        rows = np.unique(middles[:, 0])
        row_count, _ = self._tile_counts()
        begins = [self.start, *(x + self.gap / 2 for x in rows)]
        ends = [*(x - self.gap / 2 for x in rows), self.start + row_count * self.size]
        return [self._slab((begin, end), (-side, side)) for begin, end in zip(begins, ends, strict=True)]

    def _grid(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Make boxes of the heights in the file. Neighbours of equal height in a row are one box.

        Raises:
            InvalidConfig: there are too many boxes.
        """
        boxes = []
        for row, heights in enumerate(self.heights()):
            begin = self.start + row * self.size
            right = -side
            for top, equal_heights in groupby(heights.tolist()):
                left = right + len(list(equal_heights)) * self.size
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
