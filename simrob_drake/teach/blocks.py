"""What a block of the block picture stands for: the keys of the station that make it, and the signals it shows.

A block's name says what it is, for whoever added it to the station named it so; ``Site.draw`` and ``place_of`` keep it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

_PARTS = {"sensor": "sensors", "monitor": "monitors", "force": "forces", "controller": "controllers"}

_SHARED: dict[str, tuple[str, ...]] = {
    "stops": ("joint_stops",),
    "scene_graph": ("floor", "contact", "pieces"),
    "piece_poses": ("pieces",),
}
_OF_A_ROBOT: dict[str, tuple[str, ...]] = {  # keys of the robot's own section
    "friction": ("drives",),
    "poses": ("base", "tcp", "tcp_offset"),
}
_SHOWN = {"poses": ("base_pose", "tcp_pose"), "stops": (), "scene_graph": (), "piece_poses": (), "friction": ()}
_OUTPUT, _SERVO = "output ", "servo."
_GIVEN = ("reference", "feedforward", "input ")  # blocks that ask something of a robot
_PLANT = ("plant", "inverse_dynamics", "geometry_poses")


@dataclass(frozen=True)
class Told:
    """What a block stands for.

    Attributes:
        keys: sections and keys of the station, dotted; all that stands below them belongs to it.
        signals: outputs of the station.
        axis: whose entry of them counts; empty where all do.
    """

    keys: tuple[str, ...]
    signals: tuple[str, ...]
    axis: str = ""

    def holds(self, key: str) -> bool:
        """Tell whether a key of the station makes this block."""
        return any(key == one or key.startswith(f"{one}.") for one in self.keys)


def told_by(block: str, content: Mapping[str, Any], signals: Sequence[str]) -> Told:
    """Return what a block stands for.

    Args:
        block: its key in the picture, such as ``joint_1.pd``, ``sensor.touch`` or ``output torque``.
        content: of the station's file, as :func:`simrob_drake.stations.load.station_yaml` writes it.
        signals: names of the station's outputs.
    """
    name = block.partition(" to ")[0]  # a bar that hands out a block's signals
    robots = content.get("robots", {})
    whose = next((robot for robot in robots if name.removeprefix(_OUTPUT).startswith(f"{robot}.")), "")
    local = name.replace(f"{whose}.", "", 1) if whose else name
    part = local.partition(".")[2].removesuffix(".source") if local.partition(".")[0] in _PARTS else ""
    axis = local.partition(".")[0] if "." in local and not (part or local.startswith((_OUTPUT, _SERVO))) else ""
    keys = _keys(local, f"robots.{whose}" if whose else "robot", content)
    if part:  # the outputs of a sensor, a force or a controller have its name in theirs
        return Told(keys, tuple(signal for signal in signals if part in signal.split(".")))
    if local in _PLANT:
        return Told(keys, tuple(signal for signal in signals if signal.split(".")[-1] == "position"))
    if local.startswith(_OUTPUT):
        shown: tuple[str, ...] = (name.removeprefix(_OUTPUT),)
    elif axis:
        shown = tuple(f"{whose}.{kind}".lstrip(".") for kind in ("position", "torque"))
    else:
        kinds = _SHOWN.get(local, ("reference",) if local.startswith(_GIVEN) else ("torque",))
        shown = tuple(f"{whose}.{kind}".lstrip(".") for kind in kinds)
    return Told(keys, tuple(signal for signal in signals if signal in shown), axis)


def _keys(local: str, section: str, content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the keys behind a block that is called so among the blocks of its robot."""
    kind, _, part = local.partition(".")
    keys: tuple[str, ...] = _SHARED.get(local, ())
    if part and kind in _PARTS:
        keys = (f"{_PARTS[kind]}.{part.removesuffix('.source')}",)
    elif local in _OF_A_ROBOT:
        keys = tuple(f"{section}.{key}" for key in _OF_A_ROBOT[local])
    elif local in _PLANT:
        robots = tuple(f"robots.{robot}" for robot in content.get("robots", ())) or ("robot",)
        keys = (*robots, "pieces", "gravity")
        keys += ("servo",) if content.get("servo", {}).get("realization") == "implicit" else ()
    elif not keys and not local.startswith(_OUTPUT):
        key = "reference" if local.startswith(_GIVEN) else "servo"
        robot, _, name = section.partition(".")
        whole = content.get(robot, {})
        keys = (f"{section}.{key}" if key in (whole.get(name, {}) if name else whole) else key,)
    return keys
