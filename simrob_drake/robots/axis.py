"""One axis of a robot: a joint of its URDF, its sense, and the names by which users call it."""

from typing import Any, Literal

from simrob_drake.base.sections import Strict


class Axis(Strict):
    """One axis of a robot: a joint of its URDF and the sense that counts as positive."""

    joint: str
    """The joint's name in the URDF."""
    sign: Literal[-1, 1] = 1
    """1 if the axis is positive in the direction of its joint, -1 if it is positive in the opposite direction."""
    aliases: tuple[str, ...] = ()
    """Other names by which users may call the axis."""


def axes_by_name(axes: Any) -> Any:
    """Convert a plain list of joints to axes by name, each called as its joint. Other values are returned unchanged."""
    # Values of another form get their errors from pydantic, which names the key.
    is_plain = isinstance(axes, list) and all(isinstance(name, str) for name in axes)
    return {name: {"joint": name} for name in axes} if is_plain else axes
