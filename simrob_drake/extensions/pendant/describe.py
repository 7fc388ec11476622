"""What the pendant is told of a station: robots, bodies, signals; and what a block of its picture stands for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from simrob_drake.extensions.pendant.push_sides import push_sides
from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import frame_names
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.walk import GoMove
from simrob_drake.programs.stages import SEQUENCE
from simrob_drake.results.block_diagram.graph import FOLDED
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.values_in_force import values_in_force
from simrob_drake.walking.parameters import load_walking


def description(cell: Workcell) -> dict[str, Any]:
    """Return what a station is, as plain data."""
    config, station = cell.config, resolve(cell.config)
    bodies = [name for name in (*config.robots, *frame_names(station)) if name != "world"]
    # which the first run has built then
    shown = cell.runner_of(config).ports(watched=True).outputs.signals
    return {
        "station": config.name,
        "mode": config.mode,
        "robots": {name: _robot(cell, config, name) for name in config.robots},
        "pieces": list(config.pieces),
        "in_force": {
            key: {"value": entry.value, "origin": entry.origin}
            for key, entry in values_in_force(config).items()
        },
        "bodies": bodies,
        "push_sides": push_sides(cell, bodies),
        "loops": list(loops_of(config.controllers)),
        "monitors": list(config.monitors),
        "signals": [
            {
                "name": signal.output,
                "unit": signal.units[0],
                "title": signal.panel.title
                if signal.panel
                else signal.output.replace("_", " ").replace(".", ": "),
                "columns": list(signal.names),
            }
            for signal in shown
            if signal.output and signal.compute is None and signal.entries is None
        ],
    }


def kind_of(robot: StationRobot) -> str:
    """Return what a robot is taught as: legs, arm, or other."""
    if robot.model.feet is not None:
        return "legs"
    return "arm" if robot.model.is_arm else "other"


def _robot(cell: Workcell, config: StationConfig, name: str) -> dict[str, Any]:
    robot = cell.robot(name)
    model = robot.model
    lower, upper = (limit / model.user_units for limit in model.axis_limits)
    now = cell.position(name) / model.user_units
    # The motion of a kinematic station is its input, so that its axes need no motors.
    passive = robot.gains.passive & config.engine.moves_by_forces
    columns = (
        model.axes,
        model.unit_names,
        lower.tolist(),
        upper.tolist(),
        now.tolist(),
        passive.tolist(),
    )
    axes = [
        {
            "name": axis,
            "aliases": list(model.axes[axis].aliases),
            "unit": unit,
            "low": low,
            "high": high,
            "now": at,
            "passive": is_passive,
            "is_finger": index in model.fingers,
        }
        for index, (axis, unit, low, high, at, is_passive) in enumerate(zip(*columns, strict=True))
    ]
    legged = model.feet is not None
    moves = _possible_moves(config, name, model)
    return {
        "model": model.name,
        "kind": kind_of(robot),
        "axes": axes,
        "tools": list(model.tools),
        "tcp": robot.tcp,
        "gaits": list(gaits_of(model, steps=True)) if legged else [],
        "acts": [act for act in gaits_of(model, steps=False) if act != SEQUENCE] if legged else [],
        "pieces": [piece for piece, one in resolve(config).pieces.items() if one.carrier == name],
        "moves": moves,
        "drives": _drives(model) if legged and GoMove.key in moves else None,
    }


def _possible_moves(config: StationConfig, name: str, model: RobotModel) -> dict[str, list[str]]:
    """Find the kinds of moves that a robot can do, by their key, each with the keys that it can be given.

    Args:
        config: the station.
        name: name of the robot in the station.
        model: model of the robot.
    """
    found: dict[str, list[str]] = {}
    for key, kind in KINDS.items():
        suits = kind.of_arms if model.feet is None else kind.of_legs
        keys = kind.possible_keys(config, name, model) if suits else None
        if keys is not None:
            found[key] = sorted(keys)
    return found


def _drives(model: RobotModel) -> dict[str, float]:
    """Largest speeds of a robot that walks by commands [m/s, deg/s], and the direction in which it looks [deg]."""
    return {
        **load_walking(model).max_speed.model_dump(),
        "facing_deg": gaits_file(model).facing_deg,
    }


_PARTS = {
    "sensor": "sensors",
    "monitor": "monitors",
    "force": "forces",
    "controller": "controllers",
}

_RULES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "stops": (("joint_stops",), ()),
    "scene_graph": (("floor", "contact", "pieces"), ()),
    "piece_poses": (("pieces",), ()),
    "layers": (("controllers",), ("reference",)),
    "friction": ((".drives",), ()),
    "poses": ((".base", ".tcp", ".tcp_offset"), ("base_pose", "tcp_pose")),
}
"""By block the keys that make it, with a dot before those of the robot's own section, and the outputs that show it."""
_OUTPUT, _SERVO = "output ", "servo."
_INPUTS = ("reference", "feedforward", "input ")  # blocks that ask something of a robot
_PLANT = ("plant", "inverse_dynamics", "geometry_poses")

ALL_AXES = "*"
"""Axis of a block that stands for several joints."""


@dataclass(frozen=True)
class BlockMeaning:
    """What a block stands for."""

    # sections and keys of the station, dotted; all that stands below them belongs to it
    keys: tuple[str, ...]
    signals: tuple[str, ...]  # outputs of the station
    axis: str = (
        ""  # whose entry of them counts; empty where all do, ``*`` of the joints of a subsystem
    )
    robot: str = ""  # name of the robot to which it belongs, in a station with several robots

    def holds(self, key: str) -> bool:
        """Tell whether a key of the station makes this block."""
        return any(key == one or key.startswith(f"{one}.") for one in self.keys)


def block_meaning(block: str, content: Mapping[str, Any], signals: Sequence[str]) -> BlockMeaning:
    """Return what a block of the picture stands for, by its key: ``joint_1.pd``, ``sensor.touch``, ``output torque``.

    ``content`` is that of the station's file, see :func:`simrob_drake.stations.load.station_content`; ``signals`` are
    its outputs.
    """
    if block.startswith(FOLDED):  # it stands for more than the axis of the one in its name
        one = block_meaning(block.removeprefix(FOLDED), content, signals)
        return replace(one, axis=one.axis and ALL_AXES)
    robots = content.get("robots", {})
    whose = next(
        (robot for robot in robots if block.removeprefix(_OUTPUT).startswith(f"{robot}.")), ""
    )
    local = block.replace(f"{whose}.", "", 1) if whose else block
    part = (
        local.partition(".")[2].removesuffix(".source") if local.partition(".")[0] in _PARTS else ""
    )
    axis = (
        local.partition(".")[0]
        if "." in local and not (part or local.startswith((_OUTPUT, _SERVO)))
        else ""
    )
    keys = _keys(local, f"robots.{whose}" if whose else "robot", content)
    if part:  # the outputs of a sensor, a force or a controller have its name in theirs
        whole = part.partition(".")[0]
        shown = (
            (part,)
            if part in signals
            else tuple(signal for signal in signals if whole in signal.split("."))
        )
        return BlockMeaning(keys, shown)
    if local in _PLANT:
        return BlockMeaning(
            keys, tuple(signal for signal in signals if signal.split(".")[-1] == "position")
        )
    if local.startswith(_OUTPUT):
        shown = (block.removeprefix(_OUTPUT),)
    elif axis:
        shown = tuple(f"{whose}.{kind}".lstrip(".") for kind in ("position", "torque"))
    else:
        _, kinds = _RULES.get(
            local, ((), ("reference",) if local.startswith(_INPUTS) else ("torque",))
        )
        shown = tuple(f"{whose}.{kind}".lstrip(".") for kind in kinds)
    return BlockMeaning(
        keys, tuple(signal for signal in signals if signal in shown), robot=whose, axis=axis
    )


def axis_setting(
    meaning: BlockMeaning, key: str, value: float, content: Mapping[str, Any], axes: Sequence[str]
) -> tuple[str, Any]:
    """Find the setting that gives one joint its own value of a key that holds for all joints, such as ``servo.kp``.

    Args:
        meaning: the block of the joint.
        key: dotted key of the station; a section of its own or, as ``servo``, one that several robots share.
        value: the new value of the joint.
        content: content of the station's file.
        axes: names of the axes of the block's robot, in order.

    Returns:
        the dotted key to set, and its value. Of a section that robots share, the robot gets a copy with the new value,
        since the others keep theirs.
    """
    section, _, name = key.rpartition(".")
    present = value_of(content, key)
    if meaning.robot and not section.startswith("robots."):
        own = dict(content.get(section, {}))
        values = {axis: axis_value(present, axis, axes) for axis in axes}
        own[name] = {**values, meaning.axis: value}
        return f"robots.{meaning.robot}.{section}", own
    place = (
        str(list(axes).index(meaning.axis)) if isinstance(present, (list, tuple)) else meaning.axis
    )
    return f"{key}.{place}", value


def axis_value(value: Any, axis: str, axes: Sequence[str]) -> float | None:
    """Find the value of one axis in a value for all axes: a number, a list in their order, or a mapping by axis.

    Returns None if the axis has no value there, and so that of its robot's own file.
    """
    if isinstance(value, Mapping):
        found = value.get(axis)
    elif isinstance(value, (list, tuple)):
        found = value[list(axes).index(axis)] if axis in axes else None
    else:
        found = value
    return float(found) if isinstance(found, (int, float)) and not isinstance(found, bool) else None


def value_of(content: Mapping[str, Any], key: str) -> Any:
    """Look up a dotted key in the content of a station's file. Returns None if the content has no such key."""
    node: Any = content
    for part in key.split("."):
        node = node.get(part) if isinstance(node, Mapping) else None
    return node


def wire_meaning(
    source: str, targets: Sequence[str], content: Mapping[str, Any], signals: Sequence[str]
) -> BlockMeaning:
    """Return what goes along a wire from a block to others; parameters as of :func:`block_meaning`."""
    shown = tuple(
        name
        for target in targets
        if (name := target.removeprefix(_OUTPUT)) != target and name in signals
    )
    if shown:
        return BlockMeaning((), shown)
    begin, end = (block_meaning(block, content, signals) for block in (source, targets[0]))
    if begin.axis or end.axis:  # what a joint is asked for goes in, and its torque comes out
        whose, kind = (begin, "torque") if begin.axis else (end, "position")
        own = tuple(signal for signal in whose.signals if signal.rpartition(".")[2] == kind)
        return BlockMeaning((), own, robot=whose.robot, axis=whose.axis)
    return BlockMeaning((), begin.signals or end.signals)


def _keys(local: str, section: str, content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the keys behind a block that is called so among the blocks of its robot."""
    kind, _, part = local.partition(".")
    robot, _, name = section.partition(".")
    if part and kind in _PARTS:
        return (f"{_PARTS[kind]}.{part.partition('.')[0]}",)
    if local in _RULES:
        return tuple(f"{section}{key}" if key.startswith(".") else key for key in _RULES[local][0])
    if local in _PLANT:
        robots = tuple(f"robots.{robot}" for robot in content.get("robots", ())) or ("robot",)
        return (*robots, "pieces", "gravity")
    if local.startswith(_OUTPUT):
        return ()
    key = "reference" if local.startswith(_INPUTS) else "servo"
    own = content.get(robot, {}).get(name, {}) if name else content.get(robot, {})
    return (f"{section}.{key}" if key in own else key,)
