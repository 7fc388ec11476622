"""Uneven ground: a rectangular field of boxes on the floor. Equal seeds give equal ground.

The field's own frame has its origin at that of the world. Its x axis, *along* the field, is turned from the world's x
axis by the heading; its y axis is *across* the field, to the left. Level ground surrounds the field, and a soft patch
may follow it: these are boxes as well. The field is divided into square tiles, in rows across and columns along.
"""

from dataclasses import dataclass, replace
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from PIL import Image
from pydantic import Field, model_validator
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.files import content_of, read_matrix
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, Number, Positive, Strict

# Depth of the boxes' bottoms below the lowest of their tops, and smallest thickness of the soft patch [m].
_BELOW = 0.05
# Smallest width of the level ground around the field [m].
_AROUND = 1.0

MOST_BOXES = 1000
"""Largest count of boxes: contact is computed for each."""

# Largest count of pixels of a picture of heights.
_MOST_PIXELS = 100_000
# Largest roll and pitch of a stone [rad].
_LARGEST_TILT = 0.25
# Tolerance of the count of tiles, so that 0.6 m hold three tiles of 0.2 m.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class TerrainBox:
    """A box of a terrain.

    Attributes:
        pose: pose of its middle in the frame of the floor.
        half: half of its sides, shape (3,) [m].
        modulus: hydroelastic modulus of a soft box [Pa], or None if it is as hard as the floor.
    """

    pose: RigidTransform
    half: Vector
    modulus: float | None = None


class _Tiles(NamedTuple):
    """The square tiles of a field.

    Attributes:
        rows: count of tiles along the field.
        columns: count of tiles across the field.
    """

    rows: int
    columns: int


class SoftPatch(Strict):
    """A level, soft patch after the field, as wide as the field. It needs hydroelastic contact."""

    length: Positive = 0.6
    """Length along the field [m]."""
    hydroelastic_modulus: Positive = 1e6
    """Pressure of the surface if it is pressed in to the bottom, which is height + 0.05 m deep [Pa]."""


class Terrain(Strict):
    """A field of uneven ground on the floor, with level ground around it.

    Steps: square tiles whose tops are within ± height. Slope: ridges, up to the height and down again. Bumps: bars
    across the field, up to the height. Rubble: stones at random poses, up to about the height. Stairs: steps of the
    height, up to the middle of the field and down again. Gaps: trenches across the field, as deep as the height. Grid:
    tiles whose count and heights are given by a file.
    """

    kind: Literal["steps", "slope", "bumps", "rubble", "stairs", "gaps", "grid"]
    height: Positive = 0.02
    """Largest height or depth [m]. For stairs the height of each step, for a picture that of white pixels."""
    size: Positive = 0.2
    """Side of a tile or a stone, length of one side of a ridge, distance between bars, steps or gaps [m]."""
    gap: Positive = 0.06
    """Width of a gap [m]."""
    file: Path | None = None
    """File of a grid: a CSV file of heights [m] with a line for each row across the field, from left to right, the
    nearest row first; or a PNG with the far end of the field at its upper edge, black 0 and white the height. Relative
    paths start at the station's file."""
    start: Number = 0.4
    """Begin of the field along its x axis [m]; negative if it is behind the world's origin."""
    length: Positive = 3.0
    """Length along the field [m]. As many whole sizes as fit are made."""
    width: Positive = 1.6
    """Width across the field [m]."""
    heading_deg: Number = 0.0
    """Direction of the field, counterclockwise from the world's x axis [deg]."""
    seed: Integer = Field(default=0, ge=0)
    """Seed of the random numbers."""
    soft: SoftPatch | None = None
    """A soft patch after the field; none by default."""

    @model_validator(mode="after")
    def _check_sizes(self) -> "Terrain":
        """Check that the keys fit the kind, and that the field has at least one tile and not too many boxes.

        Raises:
            ValueError: a grid has no file, another kind has one, a gap is as wide as the size or wider, or the size
                gives no tile or more than `MOST_BOXES` of them.
        """
        if self.kind == "grid" and self.file is None:
            raise ValueError(
                message(
                    "parts.grid_without_file",
                    "kind: grid needs a file with the heights of its tiles",
                )
            )
        if self.kind != "grid" and self.file is not None:
            raise ValueError(
                message(
                    "parts.file_of_grid_only",
                    "file is for kind: grid only, not for kind: {kind}",
                    kind=self.kind,
                )
            )
        if self.kind == "gaps" and self.gap >= self.size:
            raise ValueError(
                message(
                    "parts.gap_leaves_nothing",
                    "gap is {gap:g} m; it must be less than size, {size:g} m, the distance from gap to gap",
                    gap=self.gap,
                    size=self.size,
                )
            )
        # The tiles of a grid are counted when its file is read.
        if self.kind == "grid":
            return self
        along = self.length / self.size
        across = self.width / self.size
        if along < 1 or across < 1:
            raise ValueError(
                message(
                    "parts.size_not_below",
                    "size is {size:g} m; it must not exceed length or width",
                    size=self.size,
                )
            )
        if along * across > MOST_BOXES:
            # With the size s, the field has length width / s² tiles.
            least = np.sqrt(self.length * self.width / MOST_BOXES)
            raise ValueError(
                message(
                    "parts.too_many_boxes",
                    "a size of {size:g} m needs more than {most} boxes; choose {least:.2g} m or more",
                    size=self.size,
                    most=MOST_BOXES,
                    least=least,
                )
            )
        return self

    @property
    def depth(self) -> float:
        """Depth of the boxes' bottoms below the floor's plane [m], the level ground around the field.

        All boxes with vertical sides, see `_slab`, end at this depth. It is larger than the depth of the lowest top, so
        that each box has a height. The plates of ridges and the stones, which are tilted, end elsewhere.
        """
        # The boxes of a grid may be lower than the ground around them, as far as its file says.
        lowest = self.heights().min() if self.kind == "grid" else -self.height
        return _BELOW + max(self.height, -float(lowest))

    def heights(self) -> Vector:
        """Read the heights of a grid from its file.

        Returns:
            The heights, the nearest row first and each row from right to left, shape (rows, columns) [m].

        Raises:
            InvalidConfig: the file cannot be read as a table or picture, or the picture has too many pixels.
        """
        assert self.file is not None  # a grid has one
        if self.file.suffix.lower() != ".png":
            # Lines of the file go from left to right, rows of heights along the y axis, which points to the left.
            return read_matrix(self.file)[:, ::-1]
        try:
            with Image.open(BytesIO(content_of(self.file))) as picture:
                if picture.width * picture.height > _MOST_PIXELS:
                    problem = message(
                        "parts.too_many_pixels",
                        "has {width} x {height} pixels, more than {most}; use a smaller image",
                        width=picture.width,
                        height=picture.height,
                        most=_MOST_PIXELS,
                    )
                    raise InvalidConfig(self.file, "", problem)
                # Value of a white pixel: the name of a mode with 16 bits contains that number, such as "I;16".
                white = 65535.0 if "16" in picture.mode else 255.0
                # Mode "F" keeps the numbers of the pixels. The first pixel is far and left, the first height near and
                # right.
                pixels = np.asarray(picture.convert("F"))[::-1, ::-1]
                return np.asarray(self.height / white * pixels, dtype=float)
        except OSError as error:
            problem = message(
                "parts.no_picture", "cannot be read as an image ({problem})", problem=error
            )
            raise InvalidConfig(self.file, "", problem) from error

    def blocks(self, floor: float) -> list[TerrainBox]:
        """Create the boxes of the field, of the soft patch and of the level ground around them.

        Args:
            floor: side of the square floor [m].

        Returns:
            The boxes, with poses in the frame of the floor.

        Raises:
            InvalidConfig: the file of a grid cannot be read, or gives too many boxes.
        """
        tiles = self._tiles()
        # Half of the field's width, and the end of the field along its x axis [m].
        side = tiles.columns * self.size / 2
        end = self.start + tiles.rows * self.size
        # Row and column of each tile, row after row, then the middles of the tiles, shape (m, 2) [m].
        grid = np.meshgrid(np.arange(tiles.rows), np.arange(tiles.columns), indexing="ij")
        indices = np.stack(grid, axis=-1).reshape(-1, 2)
        corner = (self.start, -side)  # near and right
        middles = np.asarray((indices + 0.5) * self.size + corner)
        # One generator for the whole field: the order of the draws is a part of the ground.
        random = np.random.default_rng(self.seed)
        makers = {
            "steps": self._steps,
            "slope": self._ridges,
            "bumps": self._bars,
            "rubble": self._stones,
            "stairs": self._stairs,
            "gaps": self._gaps,
            "grid": self._grid,
        }
        make_field = makers[self.kind]
        boxes = [*self._boxes_around(floor, end, side), *make_field(middles, side, random)]
        # From the frame of the field to that of the floor.
        heading = RigidTransform(RollPitchYaw(0.0, 0.0, np.deg2rad(self.heading_deg)), np.zeros(3))
        return [replace(box, pose=heading @ box.pose) for box in boxes]

    def _boxes_around(self, floor: float, end: float, side: float) -> list[TerrainBox]:
        """Create the level ground around the field, the soft patch, and the ground of the field under its other boxes.

        Steps and grids have no ground under their tiles, which cover the field.

        Args:
            floor: side of the square floor [m].
            end: end of the field along its x axis [m].
            side: half of the field's width [m].

        Returns:
            The boxes, with poses in the frame of the field.
        """
        begin = self.start
        soft_length = 0.0 if self.soft is None else self.soft.length
        soft_end = end + soft_length
        # The level ground covers the floor, and goes on around a field that is larger. The floor's edge is at least at
        # the length that the file gives, also where fewer tiles fit.
        farthest_end = max(end, begin + self.length) + soft_length
        far = max(floor / 2, -begin + _AROUND, farthest_end + _AROUND, side + _AROUND)
        boxes = [
            self._slab((-far, begin), (-far, far)),  # before the field
            self._slab((soft_end, far), (-far, far)),  # after it
            self._slab((begin, soft_end), (side, far)),  # to its left
            self._slab((begin, soft_end), (-far, -side)),  # to its right
        ]
        if self.soft is not None:
            modulus = self.soft.hydroelastic_modulus
            boxes.append(self._slab((end, soft_end), (-side, side), modulus=modulus))
        # Tiles of steps and grids cover the field; the boxes of the other kinds leave ground between them.
        if self.kind not in ("steps", "grid"):
            ground_height = -self.height if self.kind == "gaps" else 0.0
            boxes.append(self._slab((begin, end), (-side, side), ground_height))
        return boxes

    def _tiles(self) -> _Tiles:
        """Count the tiles along and across the field: by the file of a grid, otherwise as many as fit."""
        if self.kind == "grid":
            rows, columns = self.heights().shape
            return _Tiles(rows, columns)
        return _Tiles(
            int(self.length / self.size + _ROUNDING), int(self.width / self.size + _ROUNDING)
        )

    def _slab(
        self,
        along: tuple[float, float],
        across: tuple[float, float],
        top: float = 0.0,
        modulus: float | None = None,
    ) -> TerrainBox:
        """Create a box with vertical sides, from `depth` below the floor's plane up to a height.

        Args:
            along: lower and upper bound along the field [m].
            across: lower and upper bound across the field [m].
            top: height of its top above the level ground around the field [m].
            modulus: hydroelastic modulus of a soft box [Pa].
        """
        lower = np.array([along[0], across[0], -self.depth])
        upper = np.array([along[1], across[1], top])
        return TerrainBox(RigidTransform((lower + upper) / 2), (upper - lower) / 2, modulus)

    # The functions below create the boxes of one kind of field each. Their arguments are the middles of all tiles in
    # the frame of the field, shape (m, 2) [m], half of the field's width [m], and the random numbers.

    def _steps(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Create a tile of random height at each middle."""
        tops = random.uniform(-self.height, self.height, len(middles))
        half = self.size / 2
        return [
            self._slab((x - half, x + half), (y - half, y + half), top)
            for (x, y), top in zip(middles, tops, strict=True)
        ]

    def _ridges(
        self, middles: Vector, side: float, random: np.random.Generator
    ) -> list[TerrainBox]:
        """Create plates across the field that rise and fall in turn."""
        # A plate spans a size along the field and the height up or down.
        angle = np.arctan2(self.height, self.size)
        thickness = self.height
        half = np.array([np.hypot(self.size, self.height) / 2, side, thickness / 2])
        # Middle of each row of tiles along the field.
        positions = np.unique(middles[:, 0])
        # A ridge needs two rows, one up and one down: an odd row at the end stays level.
        whole_ridges = len(positions) // 2
        boxes = []
        for index, x in enumerate(positions[: 2 * whole_ridges]):
            falls = index % 2 == 1
            # A positive pitch lowers the far end.
            pitch = angle if falls else -angle
            rotation = RollPitchYaw(0.0, pitch, 0.0).ToRotationMatrix()
            # The middle of the upper face is at half of the height.
            middle_of_face = np.array([x, 0.0, self.height / 2])
            middle = middle_of_face - rotation.col(2) * thickness / 2
            boxes.append(TerrainBox(RigidTransform(rotation, middle), half))
        return boxes

    def _bars(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Create bars of random height across the field, a quarter of a size long."""
        # Middle of each row of tiles along the field.
        positions = np.unique(middles[:, 0])
        tops = random.uniform(0.0, self.height, len(positions))
        half = self.size / 8
        return [
            self._slab((x - half, x + half), (-side, side), top)
            for x, top in zip(positions, tops, strict=True)
        ]

    def _stones(
        self, middles: Vector, side: float, random: np.random.Generator
    ) -> list[TerrainBox]:
        """Create a stone near each middle: a tilted box of random sides, orientation and height of its highest corner.

        Its thickness is not random: it is twice the key ``height``.
        """
        boxes = []
        for x, y in middles:
            # The order and the count of the draws determine the ground of a seed, so vectors with a z entry that is
            # not used are drawn, too.
            shift = self.size * random.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.0))
            half = self.size * random.uniform((0.15, 0.15, 0.0), (0.4, 0.4, 0.0))
            top = random.uniform(0.0, self.height)
            roll, pitch = random.uniform(-_LARGEST_TILT, _LARGEST_TILT, 2)
            yaw = random.uniform(0.0, np.pi)

            middle = np.array([x, y, 0.0]) + shift
            half[2] = self.height
            rotation = RollPitchYaw(roll, pitch, yaw).ToRotationMatrix()
            # The highest corner is to be at the height `top`. It is above the middle by the half sides, projected on
            # the vertical.
            vertical = rotation.row(2)
            from_sides = abs(vertical[:2]) @ half[:2]
            middle[2] = top - from_sides - abs(vertical[2]) * half[2]
            boxes.append(TerrainBox(RigidTransform(rotation, middle), half))
        return boxes

    def _stairs(
        self, middles: Vector, side: float, random: np.random.Generator
    ) -> list[TerrainBox]:
        """Create the steps of stairs that rise up to the middle of the field, and fall again."""
        # Middle of each row of tiles along the field.
        positions = np.unique(middles[:, 0])
        half = self.size / 2
        # Count of steps below each tread: 1, 2, ... up to the middle of the field, then down to 1.
        count = len(positions)
        rising = np.arange(1, count + 1)
        falling = np.arange(count, 0, -1)
        levels = np.minimum(rising, falling)
        return [
            self._slab((x - half, x + half), (-side, side), level * self.height)
            for x, level in zip(positions, levels, strict=True)
        ]

    def _gaps(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Create the level ground before, between and after the gaps, each of which is at the middle of a row."""
        # Along the field: its begin, the begin and the end of each gap, and the end of the field.
        edges = [self.start]
        for x in np.unique(middles[:, 0]):
            edges += [x - self.gap / 2, x + self.gap / 2]
        edges.append(self.start + self._tiles().rows * self.size)
        # Pairs of edges are the begin and the end of level ground.
        return [
            self._slab((edges[index], edges[index + 1]), (-side, side))
            for index in range(0, len(edges), 2)
        ]

    def _grid(self, middles: Vector, side: float, random: np.random.Generator) -> list[TerrainBox]:
        """Create the tiles of a grid. Neighbours of equal height in a row are one box.

        Args:
            middles: not used: the heights are given by row and column.
            side: half of the field's width [m].
            random: not used: the heights are given.

        Raises:
            InvalidConfig: the file cannot be read, or gives too many boxes.
        """
        # Fewer boxes make contact faster, and bodies slide over no edges within a level part of a row.
        boxes = []
        for row, heights in enumerate(self.heights()):
            begin = self.start + row * self.size
            # The heights of a row go from right to left. The y axis points to the left, so the row begins at -side.
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
                    "needs {count} boxes, more than {most}; use a coarser grid",
                    count=len(boxes),
                    most=MOST_BOXES,
                ),
            )
        return boxes
