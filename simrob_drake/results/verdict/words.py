"""Values and counts as users read them: with units, and as the words of a sentence."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simrob_drake.base.messages import Message, compound, message
from simrob_drake.base.renaming import former_names_of

_COUNT_WORDS = {
    2: message("results.two", "Two"),
    3: message("results.three", "Three"),
    4: message("results.four", "Four"),
    5: message("results.five", "Five"),
    6: message("results.six", "Six"),
    7: message("results.seven", "Seven"),
    8: message("results.eight", "Eight"),
    9: message("results.nine", "Nine"),
}
"""Counts with which a sentence begins. Larger ones are written as digits."""

_LEAST_SHARE = 5e-4
"""A smaller share is written as 0 %: its digits would only show the rounding of the computer."""


def count_in_words(count: int) -> Message:
    """Count of at least two things, for the begin of a sentence: a word up to nine, and digits from ten on."""
    return _COUNT_WORDS.get(count) or compound("{count}", count=count)


def in_words(value: float, unit: str) -> Message:
    """Write a value: angles in degrees, lengths in millimetres (from 1 m on in metres), shares in per cent.

    Args:
        value: the value, in its SI unit or as a share.
        unit: ``rad``, ``m``, or ``1`` for a share.
    """
    if unit == "rad":
        number = float(np.rad2deg(value))
        name = "deg"
    elif unit == "m" and abs(value) >= 1:
        number = value
        name = "m"
    elif unit == "m":
        number = 1e3 * value
        name = "mm"
    else:
        number = 100.0 * value
        name = "%"
    # adding 0.0 turns -0.0 into 0.0
    return compound("{number:.3g} {unit}", number=number + 0.0, unit=name)


def rounded_in_words(value: float, unit: str) -> Message:
    """Write a value for a table: shares in whole per cent (a tiny share as 0 %), others as :func:`in_words` does.

    Args:
        value: the value, in its SI unit or as a share.
        unit: ``rad``, ``m``, or ``1`` for a share.
    """
    if unit == "1":
        share = value if abs(value) >= _LEAST_SHARE else 0.0
        return compound("{number:.0f} %", number=100.0 * share)
    return in_words(value, unit)


class Amount(NamedTuple):
    """An amount as users read it.

    Attributes:
        number: the amount, rounded to three significant digits. It is to be written with the format ``.6g``, so that
            1220 is not written as 1.22e+03.
        unit: its unit.
    """

    number: float
    unit: str


def amount_for_users(value: float, unit: str) -> Amount:
    """Convert an amount to the units of users: rad/s to deg/s, since users read angles in degrees. Others stay.

    Args:
        value: the amount.
        unit: its unit, such as ``N·m`` or ``rad/s``.
    """
    if unit == "rad/s":
        # Only speeds of turning joints: torques, forces and speeds in m/s are the same for users.
        value = float(np.rad2deg(value))
        unit = "deg/s"
    return Amount(float(f"{value:.3g}"), unit)


def amount_in_words(share: float, limit: float, unit: str) -> Message:
    """Write a share of a limit as an amount in the units of users, such as ``37.2 N·m``.

    Args:
        share: the share; 1 is the whole limit.
        limit: what the value is a share of, in the unit.
        unit: the unit; ``rad/s`` is written as ``deg/s``.
    """
    amount = amount_for_users(share * limit, unit)
    return compound("{number:.6g} {unit}", number=amount.number, unit=amount.unit)


def text_table(rows: Sequence[Sequence[str]], width: int = 80) -> list[str]:
    """Write rows of cells as lines of text with aligned columns. A line that is too long is cut.

    Args:
        rows: the headings, then the other rows, with equally many cells.
        width: largest length of a line.
    """
    # zip(*rows) turns rows into columns: each column is as wide as its longest cell.
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        # The last column is padded as well; rstrip() removes its spaces.
        cells = [cell.ljust(size) for cell, size in zip(row, widths, strict=True)]
        lines.append("  ".join(cells).rstrip()[:width])
    return lines


def capitalize(text: str) -> str:
    """Begin a text with a capital letter. A message does so in each language. An empty text stays empty."""
    if isinstance(text, Message):
        return text.as_sentence()
    # str.capitalize() would make all other letters small, also those of units and names.
    return text[:1].upper() + text[1:]


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"capitalised": "capitalize"})
