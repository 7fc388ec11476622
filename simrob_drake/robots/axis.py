"""One axis of a robot: a joint of its URDF, its sense, and the names by which users call it."""

from typing import Any, Literal

from simrob_drake.base.sections import Strict


class Axis(Strict):
    """One axis of a robot: a joint of its URDF and the sense that counts as positive."""

    joint: str
    """The joint's name in the URDF."""
    sign: Literal[-1, 1] = 1
    """-1 where the axis is positive in the other sense than its joint."""
    aliases: tuple[str, ...] = ()
    """Other names by which users may call it."""


def axes_by_name(axes: Any) -> Any:
    """Spread a plain list of joints, which are called as themselves, into axes by name."""
    plain = isinstance(axes, list) and all(isinstance(name, str) for name in axes)
    return {name: {"joint": name} for name in axes} if plain else axes
