"""Uneven ground: a field of boxes on the way from the world's origin, the same for the same seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.math import RigidTransform, RollPitchYaw

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
