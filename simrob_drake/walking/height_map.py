"""How high the ground is where feet are to land, and which places near there are even enough for them."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from simrob_drake.base.frames import Vector

Places = npt.NDArray[np.complex128]
"""In the plane: x ahead, y to the left, as complex numbers [m]."""
CELL = 0.01
"""Of the map [m]."""
_REACH = 6  # cells: how far at most a foothold is shifted, ahead and to the side
_BLOCK = 32  # cells: what is asked of the ground in one go
_ROUGH = 3.0  # what a metre of height under a foot costs, in metres that the foothold is shifted
_EVEN = 2e-3  # heights under a foot that differ by so little are none [m]
_STAYS = 0.3  # what leaving the foothold that was chosen last costs, likewise, squared
_ABOVE = 100.0  # from where the map looks down [m]

_SIDE = np.arange(-_REACH, _REACH + 1)
_SHIFTS = np.array([[complex(ahead, left) for left in CELL * _SIDE] for ahead in CELL * _SIDE])  # in the world


class HeightMap:
    """Heights of the ground as seen from above; the map is made where it is asked about, and kept.

    Places are complex numbers: x ahead, y to the left of the world [m].
    """

    def __init__(self, beneath: Callable[[Vector], Vector], foot: float) -> None:
        """Prepare.

        Args:
            beneath: gives the height of the ground beneath points (m, 3), shape (m,) [m].
            foot: half of the side of a square about the middle of a foot that has to be even [m].
        """
        self._beneath, self._foot = beneath, max(round(foot / CELL), 1)
        self._blocks = dict[tuple[int, int], tuple[Vector, Vector]]()

    def heights(self, places: Sequence[complex]) -> list[float]:
        """Return how high the ground is at some places [m]."""
        found = []
        for place in places:
            (heights, _), row, column = self._near(place)
            found.append(float(heights[row + _REACH, column + _REACH]))
        return found

    def shift(
        self,
        feet: Sequence[complex],
        chosen: complex,
        allowed: Callable[[Places], npt.NDArray[np.bool_]],
        level: float,
        rise: float,
    ) -> complex:
        r"""Return by how much feet that land together are best shifted to stand on even ground [m].

        It is the shift d, within 60 mm to each side, with the least
        :math:`|d|^2 + \sum (3 h)^2 + \sum (3 s)^2 + 0.3 |d - d'|^2`, where h is by how much the heights under a foot
        differ, and s by how much it would step up or down too far.

        Args:
            feet: where they are to land.
            chosen: d', the shift that was best before.
            allowed: tells which of some shifts, complex, may be; where none may, there is none.
            level: height from which they step [m].
            rise: how far they step up or down [m].
        """
        rough, size = np.zeros(_SHIFTS.shape), len(_SIDE)
        for place in feet:
            (heights, unevenness), row, column = self._near(place)
            window = slice(row, row + size), slice(column, column + size)
            too_far = np.maximum(np.abs(heights[window] - level) - rise, 0.0)
            rough += unevenness[window] + (_ROUGH * too_far) ** 2
        if not rough[_REACH, _REACH]:
            return 0j
        ways: Vector = np.abs(_SHIFTS) ** 2 + _STAYS * np.abs(_SHIFTS - chosen) ** 2
        may = allowed(_SHIFTS)
        return complex(_SHIFTS.flat[int(np.where(may, rough + ways, np.inf).argmin())]) if may.any() else 0j

    def _near(self, place: complex) -> tuple[tuple[Vector, Vector], int, int]:
        """Return the block in which a place lies, and where in it the places around begin."""
        x, y = round(place.real / CELL), round(place.imag / CELL)
        key = x // _BLOCK, y // _BLOCK
        if key not in self._blocks:
            self._blocks[key] = self._made(*key)
        return self._blocks[key], x - key[0] * _BLOCK, y - key[1] * _BLOCK

    def _made(self, row: int, column: int) -> tuple[Vector, Vector]:
        """Return heights [m], and what their differences under a foot cost [m²], of a block and the places around."""
        margin, foot = _REACH + self._foot, 2 * self._foot + 1
        cells = np.arange(-margin, _BLOCK + margin)
        grid = np.meshgrid(CELL * (row * _BLOCK + cells), CELL * (column * _BLOCK + cells), indexing="ij")
        points = np.stack([*grid, np.full(grid[0].shape, _ABOVE)], axis=-1).reshape(-1, 3)
        heights = self._beneath(points).reshape(grid[0].shape)
        under = np.lib.stride_tricks.sliding_window_view(heights, (foot, foot))
        range_ = under.max(axis=(2, 3)) - under.min(axis=(2, 3))
        own = slice(self._foot, -self._foot)
        return heights[own, own], np.where(range_ > _EVEN, (_ROUGH * range_) ** 2, 0.0)
