"""The colours of all pictures: told apart by people with any of the three kinds of colour blindness.

``tests/results/test_colours.py`` simulates these and measures how far the colours lie apart.
"""

from itertools import cycle, islice

COLOURS = ("#1f6fb4", "#e79931", "#973e55", "#0fc3ab", "#9e9eff", "#d35b53", "#4d6214", "#757e84")
"""Of curves that share a frame, on white or on black; the first four lie farthest apart."""

RED = "#b2182b"
"""Of notes, of limits, and of a run's stop and its reason."""

GOOD, BAD = "#0f9d8a", RED
"""What can be done or was proven, and what not."""

PATHS = COLOURS[2], COLOURS[3], COLOURS[6]  # the ways of the tools of one robot and the next, in recordings and views
SEARCH = COLOURS[7]  # what a search for such a way tried
FORCE, SUM_OF_FORCES = COLOURS[1], COLOURS[4]  # contact forces there, and their sum on a body
AXES = "#ff0000", "#00ff00", "#0000ff"
"""The world's x, y and z, as Meshcat draws them."""

_GROUP = 4  # curves that colours alone tell apart; more have lines of other kinds, too
_ORDERS = ("-", "--", "-.", ":"), ("--", "-", ":", "-.")  # of the kinds of line: the first time through, and the second
_LOOKS = tuple(
    (COLOURS[_GROUP * (number % 2) + place], line)
    for order in _ORDERS
    for number, line in enumerate(order)
    for place in range(_GROUP)
)


def looks(count: int) -> list[tuple[str, str]]:
    """Return a colour and matplotlib's kind of line for each curve of a frame; 32 of them differ."""
    return list(islice(cycle(_LOOKS), count))


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of a colour "#rrggbb", 0 to 1."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red / 255, green / 255, blue / 255
