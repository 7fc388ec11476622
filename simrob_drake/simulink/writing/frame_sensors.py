"""The Transform Sensors of a model as frame sensors of a station."""

from dataclasses import dataclass
from typing import Any

from pydrake.math import RigidTransform

from simrob_drake.frames import Vector
from simrob_drake.parts.site import WORLD
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.signals.forms import Term
from simrob_drake.simulink.signals.frame_sensing import PARTS, SENSOR
from simrob_drake.simulink.simulink_model import SimulinkModel
from simrob_drake.simulink.writing.contact_sections import StationFiles
from simrob_drake.simulink.writing.names import UniqueNames
from simrob_drake.simulink.writing.pieces import pose_list

_AXES = {"World": "world", "Base": "base", "Follower": "frame"}
_VECTORS = (0, 7, 10)
"""Where position, velocity and turning rate begin among the parts."""


@dataclass
class FrameSensors:
    """What is written of them.

    Attributes:
        sections: by name.
        measured: what their terms are in the station, as sums of signals.
    """

    sections: dict[str, dict[str, Any]]
    measured: dict[Term, dict[str, float]]


def frame_sensors(model: SimulinkModel, files: StationFiles, turn: RigidTransform, names: UniqueNames) -> FrameSensors:
    """Return a model's Transform Sensors; ``turn`` places its world in ours."""
    found = FrameSensors({}, {})
    sensing = {push.node for push in model.pushes if push.senses}
    for node in model.expanded.nodes:
        if (node.kind == SENSOR or node in sensing) and node.block.commented == "off":
            _take(node, found, model, files, turn, names)
    return found


def _take(
    node: Node, found: FrameSensors, model: SimulinkModel, files: StationFiles, turn: RigidTransform, names: UniqueNames
) -> None:
    poses = []
    for side in ("rconn", "lconn") if node.kind == SENSOR else ("rconn",):
        place = model.network.net(node, side)
        body = model.bodies.by_place[place]
        named = files.named(body, turn)
        if named is None:
            end = "follower" if side == "rconn" else "base"
            model.report.add("dropped", node.path, f"{node.kind}: its {end} is on no robot or piece")
            return
        poses.append((named[0], pose_list(named[1] @ body.frames[place])))
    (frame, offset), (base, base_offset) = *poses, *([] if len(poses) > 1 else [(WORLD, pose_list(turn))])
    name, observer = names.give(node.path), node.text("MeasurementFrame", "World")
    axes = _AXES.get(observer.removeprefix("NonRotating"), "world")
    ends = {"frame": frame, "offset": offset, "base": base, "base_offset": base_offset}
    section: dict[str, Any] = {"kind": "frame", **ends}
    section |= {"axes": axes, **({"turning": False} if observer.startswith("NonRotating") else {})}
    found.sections[name] = {key: value for key, value in section.items() if value != [0.0] * 6}
    rotation = turn.rotation().matrix() if axes == "world" else RigidTransform().rotation().matrix()
    for index in range(len(PARTS)):
        found.measured[Term("sensed", node, index)] = _part(name, index, rotation)
    model.report.add("read", node.path, f"{node.kind}: the sensor {name}, with the signals frame.{name}.*")


def _part(name: str, index: int, rotation: Vector) -> dict[str, float]:
    """Return one part of a sensor as the model's own axes tell it."""
    first = next((first for first in _VECTORS if first <= index < first + 3), None)
    if first is None:
        return {f"frame.{name}.{PARTS[index]}": 1.0}
    column = rotation[:, index - first]
    return {f"frame.{name}.{PARTS[first + k]}": float(column[k]) for k in range(3) if abs(column[k]) > 1e-12}
