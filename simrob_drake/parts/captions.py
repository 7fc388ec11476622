"""Content of the blocks of a station's picture, and texts for their labels.

The *picture* of a station is a block diagram that is drawn from Drake's diagram. Several systems of Drake may share one
block of it, and one system, such as the net of a signal flow, may be drawn as several blocks.
"""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message, translate, with_decimal_sign
from simrob_drake.base.renaming import former_names_of
from simrob_drake.robots.axis_map import AxisValues, with_units
from simrob_drake.robots.catalog import RobotModel

MANY = 8
"""Largest count of joints or values that are listed one by one."""

# Largest count of characters in a line of a block.
_LINE_WIDTH = 26

BlockRole = Literal["reference", "loop", "own", "servo", "force", "robot", "scene", "sensor"]
"""Role of a block, in the order of the signal flow. It determines the column and the colour in the picture."""

Shape = Literal["block", "mux", "bus", "port", "sum"]
"""Shape of a block in the picture. Two are thin bars: a mux joins signals, a bus distributes them."""


@dataclass(frozen=True)
class InnerBlock:
    """One of the small blocks that Drake's diagram has together as a single system, the net of a signal flow.

    Attributes:
        label: text of its label, with line feeds between the lines.
        sources: names of the blocks of the same net that it reads.
        reads: names of the station's outputs that it reads.
    """

    label: str
    sources: tuple[str, ...]
    reads: tuple[str, ...]


@dataclass(frozen=True)
class Drawn:
    """A block of the picture.

    Attributes:
        key: key of the block. Systems of Drake with the same key share one block.
        role: role in the signal flow.
        label: text of its label, with line feeds between the lines.
        robot: name of its robot; empty if it belongs to all robots, or if the station has only one.
        inside: steps of its computation in their order, which the block lists.
        within: key of the block whose system does its work, such as the plant for servos in its actuators; empty if its
            own system does.
        net: small blocks that are drawn in its place, by name, in the order of the outputs of its Demultiplexer; empty
            if the block itself is drawn.
        shape: how the block is drawn.
    """

    key: str
    role: BlockRole
    label: str
    robot: str = ""
    inside: tuple[str, ...] = ()
    within: str = ""
    net: Mapping[str, InnerBlock] = field(default_factory=dict)
    shape: Shape = "block"


def wrap_label(text: str) -> str:
    """Translate a text to the language of the output, and break it into lines that fit a block."""
    # A long name may be wider than the block: broken in two, it would be no name of the station.
    return "\n".join(textwrap.wrap(translate(text), _LINE_WIDTH, break_long_words=False))


def fits_line(text: str) -> bool:
    """Whether a text is not empty and fits a line of a block."""
    return 0 < len(text) <= _LINE_WIDTH


def shown_values(values: Vector) -> str:
    """Write values for a label, with the decimal sign of the output's language.

    Args:
        values: the values, shape (n,).

    Returns:
        Their common value if they look equal, such as "100"; otherwise all of them if they are at most `MANY`, such as
        "80, 100"; otherwise their range, such as "5 to 100".
    """
    # Compared as texts: values that differ beyond the fourth digit alone look equal, and are shown once.
    texts = [with_decimal_sign(f"{value:.4g}") for value in values]
    if len(set(texts)) == 1:
        return texts[0]
    if len(texts) <= MANY:
        # Numbers with a decimal comma are separated by semicolons.
        has_decimal_comma = any("," in text for text in texts)
        separator = "; " if has_decimal_comma else ", "
        return separator.join(texts)
    return translate(
        message("parts.range", "{least:.4g} to {most:.4g}", least=values.min(), most=values.max())
    )


def shown_limits(limits: Vector, units: list[str]) -> str:
    """Write symmetric limits for a label, such as "±150 N·m".

    Args:
        limits: upper limits, shape (n,); the lower ones are their negatives.
        units: unit of each limit. Limits of one unit are written together, in front of the unit.
    """

    def shown_of_unit(own_limits: Vector) -> str:
        """Write the limits of one unit, shape (k,), without the unit, which `with_units` appends."""
        return f"±{shown_values(own_limits)}"

    return with_units(limits, units, shown_of_unit)


def shown_positions(values: AxisValues, model: RobotModel) -> str:
    """Write positions of axes for a label, such as "joint_1 30, joint_2 -45 deg".

    Args:
        values: positions as a station's file gives them: one number for all axes, a list in the order of the axes, or
            a mapping by name.
        model: the robot.

    Returns:
        The names with their positions if a mapping gives them, or only their count if they are more than `MANY`;
        otherwise the positions, as `shown_values` writes them. Positions of one unit are written together.

    Raises:
        SimrobError: a list has a wrong length, or a mapping of at most `MANY` axes names one that the robot does not
            have.
    """
    if not isinstance(values, dict):
        positions = model.axis_vector(values, "reference")
        return with_units(positions, model.unit_names, shown_values)
    # A block has room for a few lines only.
    if len(values) > MANY:
        return message("parts.given_angles", "positions of {count} axes", count=len(values))
    # `with_units` sorts the texts "axis position" by the units of their axes, and joins those of one unit by commas.
    pairs = [f"{axis} {with_decimal_sign(f'{position:g}')}" for axis, position in values.items()]
    units = [model.unit_names[model.axis_index(axis)] for axis in values]
    return with_units(np.array(pairs), units, ", ".join)


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"wrapped": "wrap_label", "short": "fits_line"})
