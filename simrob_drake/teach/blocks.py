"""What a block of the block picture stands for: the keys of the station that make it, and the signals it shows.

A block's name says what it is, for whoever added it to the station named it so; ``Site.draw`` and ``place_of`` keep it.
"""

import re
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
_OUTPUT = "output "
_GIVEN = ("reference", "feedforward", "input ")  # blocks that ask something of a robot
_PLANT = ("plant", "inverse_dynamics", "geometry_poses")

_COLUMNS = {  # what the columns of a station's outputs begin with
    "reference": "q_ref",
    "position": "q",
    "velocity": "v",
    "torque": "tau",
    "base_pose": "base",
    "piece_pose": "piece",
    "piece_velocity": "piece",
    "tcp_pose": "tcp",
}


@dataclass(frozen=True)
class Told:
    """What a block stands for.

    Attributes:
        keys: sections and keys of the station, dotted; all that stands below them belongs to it.
        signals: columns of the result.
    """

    keys: tuple[str, ...]
    signals: tuple[str, ...]

    def holds(self, key: str) -> bool:
        """Tell whether a key of the station makes this block."""
        return any(key == one or key.startswith(f"{one}.") for one in self.keys)


def told_by(block: str, content: Mapping[str, Any], signals: Sequence[str]) -> Told:
    """Return what a block stands for.

    Args:
        block: its key in the picture, such as ``joint_1.pd``, ``sensor.touch`` or ``output torque``.
        content: of the station's file, as :func:`simrob_drake.stations.load.station_yaml` writes it.
        signals: names of the station's columns.
    """
    name = block.partition(" to ")[0]  # a bar that hands out a block's signals
    robots = content.get("robots", {})
    whose = next((robot for robot in robots if name.removeprefix(_OUTPUT).startswith(f"{robot}.")), "")
    local = name.replace(f"{whose}.", "", 1) if whose else name
    part = local.partition(".")[2].removesuffix(".source") if local.partition(".")[0] in _PARTS else ""
    keys = _keys(local, f"robots.{whose}" if whose else "robot", content)
    return Told(keys, _part_signals(part, signals) if part else _signals(local, f"{whose}." if whose else "", signals))


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


def _signals(local: str, prefix: str, signals: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a block of a robot whose columns begin so."""
    axis = local.partition(".")[0]
    stems: tuple[str, ...]
    if local.startswith(_OUTPUT):
        output, _, part = local.removeprefix(_OUTPUT).partition(".")
        stem = ".".join(filter(None, (f"{prefix}{_COLUMNS.get(output, output)}", part)))
        stems = (stem,) if stem in signals else (f"{stem}.",)
    elif f"{prefix}q.{axis}" in signals:
        return tuple(f"{prefix}{column}.{axis}" for column in ("q_ref", "q", "tau"))
    elif local in _PLANT:
        return tuple(signal for signal in signals if re.search(r"(^|\.)q\.", signal))
    elif local == "poses":
        stems = (f"{prefix}base.", f"{prefix}tcp.")
    else:
        silent = local in _SHARED or local in _OF_A_ROBOT
        stems = () if silent else (f"{prefix}q_ref." if local.startswith(_GIVEN) else f"{prefix}tau.",)
    return tuple(signal for signal in signals if signal.startswith(stems))


def _part_signals(part: str, signals: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a sensor, monitor, force or controller: those that have its name in theirs."""
    return tuple(signal for signal in signals if part in signal.split("."))
