"""Height map: heights of the ground where feet are to land, and the places nearby that are even enough for them.

Positions are complex numbers [m]: the real part is the world's x, the imaginary part the world's y.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from simrob_drake.base.frames import Vector

Places = npt.NDArray[np.complex128]
"""Positions, or distances, in the plane: the real part is x, the imaginary part y [m]."""
CELL = 0.01
"""Side of a cell of the map [m]."""

# Largest shift of a foothold, in the direction of x and of y [cells].
_REACH = 6
# Side of a block: the heights of so many cells are computed at once [cells].
_BLOCK = 32
# Cost of a height difference under a foot, or of a step that is too far up or down by this height, over that of an
# equal shift of the foothold [1].
_HEIGHT_WEIGHT = 3.0
# Largest height difference under a foot that has no cost [m].
_EVEN = 2e-3
# Cost of leaving the last shift over that of an equal shift [1]. It keeps the foothold from jumping.
_CHANGE_WEIGHT = 0.3
# Height from which the map looks down on the ground, above all terrain [m].
_VIEW_HEIGHT = 100.0

# All shifts that are compared, shape (13, 13): x by row, y by column [m].
_DISTANCES = CELL * np.arange(-_REACH, _REACH + 1)
_SHIFTS = np.array([[complex(x, y) for y in _DISTANCES] for x in _DISTANCES])


class _Block(NamedTuple):
    """A square part of the map, with a margin of `_REACH` cells on each side.

    Attributes:
        heights: height of each cell [m].
        roughness: cost of the height differences under a foot in the middle of each cell [m²].
    """

    heights: Vector
    roughness: Vector


class _Window(NamedTuple):
    """A position's surroundings in a block: 2 `_REACH` + 1 cells along x and along y, with the position in the middle.

    Attributes:
        block: the block that contains the position.
        row: index of the first cell along x in the arrays of the block. The position's cell is `_REACH` further.
        column: index of the first cell along y. The position's cell is `_REACH` further.
    """

    block: _Block
    row: int
    column: int


class HeightMap:
    """Heights of the ground as seen from above. Each block is computed when it is first needed, and kept."""

    def __init__(self, beneath: Callable[[Vector], Vector], foot: float) -> None:
        """Create the map of a ground.

        Args:
            beneath: function that gives the height of the ground beneath points of shape (m, 3), shape (m,) [m].
            foot: half the side of a square around the middle of a foot that has to be even [m].
        """
        self._beneath = beneath
        self._foot = max(round(foot / CELL), 1)  # cells; less than one would compare no heights
        self._blocks = dict[tuple[int, int], _Block]()

    def heights(self, places: Sequence[complex]) -> list[float]:
        """Look up the heights of the ground [m] at positions in the world [m]. Blocks that are new are computed."""
        found = []
        for place in places:
            block, row, column = self._window_around(place)
            found.append(float(block.heights[row + _REACH, column + _REACH]))
        return found

    def shift(
        self,
        feet: Sequence[complex],
        chosen: complex,
        allowed: Callable[[Places], npt.NDArray[np.bool_]],
        level: float,
        rise: float,
    ) -> complex:
        r"""Find the best common shift of feet that land at the same time, so that they stand on even ground [m].

        It is the shift d, within 60 mm in x and in y, with the least cost

        .. math:: |d|^2 + \sum (3 h)^2 + \sum (3 s)^2 + 0.3 |d - d'|^2

        with the height difference h under each foot (0 up to 2 mm), the height s by which each foot steps too far up or
        down, and the last shift d'.

        Args:
            feet: positions in the world where the feet are to land.
            chosen: the last shift d' [m].
            allowed: function of an array of shifts [m] that returns an array of the same shape: True for each shift
                that the legs can reach.
            level: height of the ground under the stance foot [m].
            rise: largest step up or down [m].

        Returns:
            The shift. It is zero if the ground at the planned places is even and not too high or low, or if no shift is
            allowed.
        """
        # Cost of the ground for each shift: the two sums.
        ground_cost = np.zeros(_SHIFTS.shape)
        size = len(_DISTANCES)
        for place in feet:
            # The window has one cell for each shift: its middle is the cell of the planned place.
            block, row, column = self._window_around(place)
            window = (slice(row, row + size), slice(column, column + size))
            excess = np.maximum(np.abs(block.heights[window] - level) - rise, 0.0)
            ground_cost += block.roughness[window] + (_HEIGHT_WEIGHT * excess) ** 2
        # Most ground is even, and the foothold then stays as planned.
        if not ground_cost[_REACH, _REACH]:
            return 0j

        distance: Vector = np.abs(_SHIFTS) ** 2 + _CHANGE_WEIGHT * np.abs(_SHIFTS - chosen) ** 2
        is_allowed = allowed(_SHIFTS)
        if not is_allowed.any():
            return 0j
        cost = np.where(is_allowed, ground_cost + distance, np.inf)
        return complex(_SHIFTS.flat[int(cost.argmin())])

    def _window_around(self, place: complex) -> _Window:
        """Find the surroundings of a position in the world [m], and compute its block if that is new."""
        # Cell and block that contain the position. The middle of cell i is at i CELL.
        x = round(place.real / CELL)
        y = round(place.imag / CELL)
        key = (x // _BLOCK, y // _BLOCK)
        # A walk needs few blocks of the ground, so each is computed when the robot comes near it.
        if key not in self._blocks:
            self._blocks[key] = self._compute_block(*key)
        # The arrays of a block begin `_REACH` cells before the block, so the cell's index in the block is the index of
        # the window's first cell in the arrays.
        return _Window(self._blocks[key], x - key[0] * _BLOCK, y - key[1] * _BLOCK)

    def _compute_block(self, block_x: int, block_y: int) -> _Block:
        """Compute the heights and the roughness of a block.

        Args:
            block_x: index of the block along x. Block 0 begins at x = 0.
            block_y: index of the block along y.
        """
        # The heights go further than the block by the reach of the shifts and by half a foot.
        margin = _REACH + self._foot
        cells = np.arange(-margin, _BLOCK + margin)
        x = CELL * (block_x * _BLOCK + cells)
        y = CELL * (block_y * _BLOCK + cells)
        grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
        grid_z = np.full(grid_x.shape, _VIEW_HEIGHT)
        points = np.stack([grid_x, grid_y, grid_z], axis=-1).reshape(-1, 3)
        heights = self._beneath(points).reshape(grid_x.shape)

        # Roughness by the difference of the highest and the lowest cell under a square foot.
        side = 2 * self._foot + 1
        under_foot = np.lib.stride_tricks.sliding_window_view(heights, (side, side))
        difference = under_foot.max(axis=(2, 3)) - under_foot.min(axis=(2, 3))
        roughness = np.where(difference > _EVEN, (_HEIGHT_WEIGHT * difference) ** 2, 0.0)
        # The windows of `side` cells have taken half a foot off each border; the same is cut off the heights.
        inner = slice(self._foot, -self._foot)
        return _Block(heights[inner, inner], roughness)
