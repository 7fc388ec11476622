"""Blocks of a station's picture, and values and positions in words for their labels."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message, translate, with_decimal_sign
from simrob_drake.robots.axis_map import AxisValues, with_units
from simrob_drake.robots.catalog import RobotModel

MANY = 8
"""Largest count of joints or values that are listed one by one."""

_WIDTH = 26
"""Characters in a line of a block."""

BlockRole = Literal["reference", "loop", "own", "servo", "force", "robot", "scene", "sensor"]
"""Role of a block, in the order of the signal flow. It determines the column and the colour in the picture."""


Shape = Literal["block", "mux", "bus", "port", "sum"]
"""Shape of a block. Two are thin bars: a mux joins signals, a bus distributes them."""


@dataclass(frozen=True)
class InnerBlock:
    """A block of a net that Drake has as a single system.

    Attributes:
        label: lines of its label.
        sources: names of the blocks of the net that it reads.
        reads: names of the station's outputs that it reads.
    """

    label: str
    sources: tuple[str, ...]
    reads: tuple[str, ...]


@dataclass(frozen=True)
class Drawn:
    """A block of the picture.

    Attributes:
        key: key of the block. Systems with the same key share one block.
        role: role in the signal flow.
        label: lines of its label.
        robot: name of its robot; empty if it belongs to all robots, or if the station has only one.
        inside: steps of its computation, in their order.
        within: key of the block whose system does its work, such as the plant for servos in its actuators.
        net: blocks that are drawn in its place, by name, in the order of the outputs of its Demultiplexer.
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


def wrapped(text: str) -> str:
    """Break a text, in the language of the output, into lines that fit a block."""
    return "\n".join(textwrap.wrap(translate(text), _WIDTH, break_long_words=False))


def short(text: str) -> bool:
    """Whether a text fits a line of a block."""
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
    """Write symmetric limits (n,) with their units, such as "±150 N·m"."""
    return with_units(limits, units, lambda values: f"±{shown_values(values)}")


def shown_positions(values: AxisValues, model: RobotModel) -> str:
    """Write positions per axis with their units, in the form in which the station gives them."""
    if isinstance(values, dict):
        if len(values) > MANY:
            return message("parts.given_angles", "given angles of {count} axes", count=len(values))
        pairs = np.array([f"{axis} {with_decimal_sign(f'{position:g}')}" for axis, position in values.items()])
        return with_units(pairs, [model.unit_names[model.axis_index(axis)] for axis in values], ", ".join)
    return with_units(model.axis_vector(values, "reference"), model.unit_names, shown_values)
