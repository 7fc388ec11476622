"""What blocks of a station's picture say, and how figures and positions are told in words."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message, translate, with_decimal_sign
from simrob_drake.robots.axis_map import AxisValues, with_units
from simrob_drake.robots.catalog import RobotModel

MANY = 8  # how many joints, or figures, are told each for itself

_WIDTH = 26

BlockRole = Literal["reference", "loop", "own", "servo", "force", "robot", "scene", "sensor"]
"""What a block is for, in the order of the signal flow; it makes the column and the colour in the picture."""


Shape = Literal["block", "mux", "bus", "port", "sum"]
"""Of them two are thin bars: a mux brings signals together, a bus hands them out."""


@dataclass(frozen=True)
class InnerBlock:
    """A block of a net that is one system."""

    label: str  # its lines
    sources: tuple[str, ...]  # the blocks of the net that it reads
    reads: tuple[str, ...]  # outputs of the station that it reads


@dataclass(frozen=True)
class Drawn:
    """A block of the picture."""

    key: str  # systems of one key share the block
    role: BlockRole  # what it is for
    label: str  # its lines
    robot: str = ""  # whose it is; empty for what the robots share, and where there is one only
    inside: tuple[str, ...] = ()  # what happens in it, one after the other
    # the key of the block whose system does its work, as the plant's does that of servos in its actuators
    within: str = ""
    # blocks that are drawn in its place, by name, in the order of the outputs of its Demultiplexer
    net: Mapping[str, InnerBlock] = field(default_factory=dict)
    shape: Shape = "block"  # how it looks


def wrapped(text: str) -> str:
    """Break a text, in the language of the output, into lines that fit a block."""
    return "\n".join(textwrap.wrap(translate(text), _WIDTH, break_long_words=False))


def short(text: str) -> bool:
    """Tell whether a text fits a line of a block."""
    return 0 < len(text) <= _WIDTH


def shown_values(values: Vector) -> str:
    """Write values (n,) in the language of the output: their common value, each of them if they are few, or a range."""
    shown = [with_decimal_sign(f"{value:.4g}") for value in values]
    if len(set(shown)) == 1:
        return shown[0]
    if len(shown) <= MANY:
        # Numbers with a decimal comma are separated by semicolons.
        return ("; " if any("," in value for value in shown) else ", ").join(shown)
    return translate(message("parts.range", "{least:.4g} to {most:.4g}", least=values.min(), most=values.max()))


def shown_limits(limits: Vector, units: list[str]) -> str:
    """Return limits (n,) to both sides with their units: "±150 N·m"."""
    return with_units(limits, units, lambda values: f"±{shown_values(values)}")


def shown_positions(values: AxisValues, model: RobotModel) -> str:
    """Return positions as they are written in a station, with their units."""
    if isinstance(values, dict):
        if len(values) > MANY:
            return message("parts.given_angles", "given angles of {count} axes", count=len(values))
        pairs = np.array([f"{axis} {with_decimal_sign(f'{position:g}')}" for axis, position in values.items()])
        return with_units(pairs, [model.unit_names[model.axis_index(axis)] for axis in values], ", ".join)
    return with_units(model.axis_vector(values, "reference"), model.unit_names, shown_values)
