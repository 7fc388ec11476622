"""What robots stand on: a floor, level or inclined, and boxes: of its terrain, and of pieces fixed in the world.

A terrain is a field of boxes on the way from the world's origin, the same for the same seed.
Everything that asks how high something is over the ground, or which way is up from it, asks here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from simrob_drake.frames import Vector
from simrob_drake.sections import Integer, NotNegative, Number, Positive, Strict

_BELOW = 0.05
"""How far the boxes reach below the lowest of their tops, and how thick what is soft is at least [m]."""
_AROUND = 1.0  # level ground behind the field at least [m]
_MOST = 1000  # boxes: contact looks at each
_TILT = 0.25  # of rubble, at most [rad]


@dataclass(frozen=True)
class TerrainBox:
    """A box of a terrain.

    Attributes:
        pose: of its middle, in the frame of the floor.
        half: of its sides, shape (3,) [m].
        modulus: hydroelastic modulus of what is soft [Pa]; None where it is as hard as the floor.
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
    across the way, up to the height. Rubble: stones that lie about, turned at random, up to about the height.
    """

    kind: Literal["steps", "slope", "bumps", "rubble"]
    height: Positive = 0.02
    """How high or deep it goes [m]."""
    size: Positive = 0.2
    """Side of a tile or a stone, way up a ridge, from one bar to the next [m]."""
    start: NotNegative = 0.4
    """Where it begins, from the world's origin [m]."""
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
    def _fits(self) -> Terrain:
        along, across = self.length / self.size, self.width / self.size
        if along < 1 or across < 1:
            raise ValueError(f"size ({self.size:g} m) is not more than length and width")
        if along * across > _MOST:
            least = np.sqrt(self.length * self.width / _MOST)
            raise ValueError(f"a size of {self.size:g} m makes more than {_MOST} boxes; take {least:.2g} m or more")
        return self

    @property
    def depth(self) -> float:
        """How far the plane of the floor lies below the level around the field [m]."""
        return self.height + _BELOW

    def blocks(self, floor: float) -> list[TerrainBox]:
        """Return the boxes, those of the level ground around the field included; ``floor`` is its side [m]."""
        soft = 0.0 if self.soft is None else self.soft.length
        far = max(floor / 2, self.start + self.length + soft + _AROUND)
        rows, columns = int(self.length / self.size + 1e-9), int(self.width / self.size + 1e-9)
        side = columns * self.size / 2
        begin, end = self.start, self.start + rows * self.size
        around = [
            self._slab((-far, begin), (-far, far)),
            self._slab((end + soft, far), (-far, far)),
            self._slab((begin, end + soft), (side, far)),
            self._slab((begin, end + soft), (-far, -side)),
        ]
        if self.soft is not None:
            around.append(self._slab((end, end + soft), (-side, side), modulus=self.soft.hydroelastic_modulus))
        if self.kind != "steps":
            around.append(self._slab((begin, end), (-side, side)))
        grid = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
        middles = np.asarray((np.stack(grid, axis=-1).reshape(-1, 2) + 0.5) * self.size + (begin, -side))
        random = np.random.default_rng(self.seed)
        made = {"steps": self._steps, "slope": self._ridges, "bumps": self._bars, "rubble": self._stones}[self.kind]
        turn = RigidTransform(RollPitchYaw(0.0, 0.0, np.deg2rad(self.heading_deg)), np.zeros(3))
        boxes = (*around, *made(middles, side, random))
        return [TerrainBox(turn @ each.pose, each.half, each.modulus) for each in boxes]

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


_PRESSED_IN = 5e-3  # a point that lies so little below a surface is on it: contacts give way [m]
_UPRIGHT = 1e-12
_TOGETHER = 500  # points that are looked at in one go


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground of a station; without a floor it is the plane z = 0, which carries nothing.

    Attributes:
        incline: angle of the floor, a plane through the world's origin [rad].
        heading: which way it rises, counterclockwise from the world's x [rad].
        has_floor: whether there is a floor.
        depth: how far below the origin the plane lies that all else of the floor lies on [m].
        boxes: further bodies to stand on: pose in the world, and half of the sides, shape (3,) [m].
    """

    incline: float = 0.0
    heading: float = 0.0
    has_floor: bool = True
    depth: float = 0.0
    boxes: tuple[tuple[RigidTransform, Vector], ...] = field(default=())

    @property
    def plain(self) -> bool:
        """Whether it is the plane z = 0 and no more."""
        return not (self.incline or self.boxes)

    @cached_property
    def tilt(self) -> RigidTransform:
        """Pose of the floor in the world: its z axis is the normal."""
        about = np.array([np.sin(self.heading), -np.cos(self.heading), 0.0])
        return RigidTransform(RotationMatrix(AngleAxis(self.incline, about)), np.zeros(3))

    def floor_heights(self, points: Vector) -> Vector:
        """Return the level heights of the floor over or under points (m, 3), shape (m,) [m]."""
        normal = self.tilt.rotation().col(2)
        return np.asarray(-(points[:, :2] @ normal[:2]) / normal[2])

    def beneath(self, points: Vector) -> Vector:
        """Return the height of the ground beneath each of some points (m, 3): the highest there is, shape (m,) [m]."""
        parts = np.array_split(points, 1 + len(points) // _TOGETHER)
        return np.concatenate([self._beneath(part) for part in parts])

    def _beneath(self, points: Vector) -> Vector:
        lowest = self.floor_heights(points) - self.depth / self.tilt.rotation().matrix()[2, 2]
        tops = self._tops(points)
        beneath = np.where(tops <= points[:, 2] + _PRESSED_IN, tops, -np.inf)
        return np.asarray(np.maximum(lowest, beneath.max(axis=0, initial=-np.inf)))

    def height(self, pose: Vector) -> float:
        """Return how high a pose (7,) or a point (3,) is over the ground beneath [m]: quickly, for every step."""
        return float(pose[2]) if self.plain else float(pose[2] - self.beneath(pose[np.newaxis, :3])[0])

    def carries(self, points: Vector, within: float) -> bool:
        """Tell whether there is something to stand on ``within`` a distance [m] beneath each of some points (m, 3)."""
        if self.has_floor:
            return True
        tops = self._tops(points)
        near = (tops <= points[:, 2] + _PRESSED_IN) & (tops >= points[:, 2] - within)
        return bool(near.size and near.any(axis=0).all())

    @cached_property
    def _stacked(self) -> tuple[Vector, Vector, Vector]:
        """The boxes' rotations (k, 3, 3), middles (k, 1, 3) and halves (k, 1, 3)."""
        turns = np.array([pose.rotation().matrix() for pose, _ in self.boxes]).reshape(-1, 3, 3)
        middles = np.array([pose.translation() for pose, _ in self.boxes]).reshape(-1, 1, 3)
        return turns, middles, np.array([half for _, half in self.boxes]).reshape(-1, 1, 3)

    def _tops(self, points: Vector) -> Vector:
        """Return the heights at which vertical lines through points (m, 3) leave each of k boxes, (k, m) [m].

        -inf where they miss it.
        """
        turns, middles, half = self._stacked
        up = turns[:, 2:]  # in the boxes
        along = np.where(np.abs(up) < _UPRIGHT, _UPRIGHT, up)
        foot = (points * [1.0, 1.0, 0.0] - middles) @ turns
        ends = np.sort(np.stack([(-half - foot) / along, (half - foot) / along]), axis=0)
        enter, leave = ends[0].max(axis=2), ends[1].min(axis=2)
        return np.asarray(np.where(enter <= leave, leave, -np.inf))
