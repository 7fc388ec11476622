"""Colours of all pictures. People with any of the three forms of colour blindness can distinguish them.

``tests/results/test_colours.py`` simulates colour blindness, and measures how different the colours are.
"""

from itertools import cycle, islice
from typing import NamedTuple

COLOURS = ("#1f6fb4", "#e79931", "#973e55", "#0fc3ab", "#9e9eff", "#d35b53", "#4d6214", "#757e84")
"""Colours of curves that share a frame, on white or on black. The first four differ most."""

RED = "#b2182b"
"""Colour of notes, of limits, and of a run's stop and its reason."""

GOOD = "#0f9d8a"
"""Colour of what is possible, or proven."""

BAD = RED
"""Colour of what is impossible, or disproven."""

PATHS = (COLOURS[2], COLOURS[3], COLOURS[6])
"""Colours of the paths of tools in recordings and views, by the index of the robot."""

SEARCH = COLOURS[7]
"""Colour of the paths that a search for a motion has tried."""

FORCE = COLOURS[1]
"""Colour of contact forces."""

SUM_OF_FORCES = COLOURS[4]
"""Colour of the sum of the contact forces on a body."""

AXES = ("#ff0000", "#00ff00", "#0000ff")
"""Colours of the world's x, y and z axes, as Meshcat draws them."""

_GROUP_SIZE = 4
"""Count of curves that differ by colour alone. Further curves differ by the style of line, too."""

_LINE_STYLES = ("-", "--", "-.", ":")
_SHIFTED_LINE_STYLES = ("--", "-", ":", "-.")
"""Matplotlib's styles of line, for the first 16 curves and for the next 16."""


class Look(NamedTuple):
    """Colour of a curve, and its style of line in Matplotlib."""

    colour: str
    line: str


def _all_looks() -> list[Look]:
    """Combine the colours with styles of line.

    Each group of curves has a style. The groups use the first and the second half of the colours by turns, and the
    second pass over the styles exchanges them, so that no combination occurs twice.
    """
    found = []
    for styles in (_LINE_STYLES, _SHIFTED_LINE_STYLES):
        for number, line in enumerate(styles):
            first = _GROUP_SIZE * (number % 2)
            found += [Look(colour, line) for colour in COLOURS[first : first + _GROUP_SIZE]]
    return found


# Computed once: every frame of every plot takes its looks from here.
_LOOKS = _all_looks()


def looks(count: int) -> list[Look]:
    """Colour and style of line of each curve of a frame. After 32 curves, they are repeated."""
    return list(islice(cycle(_LOOKS), count))


def rgb(colour: str) -> tuple[float, float, float]:
    """Red, green and blue of a colour "#rrggbb", from 0 to 1."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red / 255, green / 255, blue / 255
