"""What a block says in a picture: its kind and its figures, read from the block itself wherever it tells them."""

from __future__ import annotations

import textwrap

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuatorIndex
from pydrake.systems.framework import LeafSystem, System
from pydrake.systems.primitives import LinearSystem, MatrixGain

from simrob_drake.frames import Vector
from simrob_drake.robots.catalog import AxisValues, RobotModel
from simrob_drake.robots.units import with_units
from simrob_drake.stations.config import JointStops, StationConfig
from simrob_drake.stations.force_config import ExternalForce, SineForce
from simrob_drake.stations.reference_config import Hold, Move, Ramp, ReferenceConfig, Sequence, SineWave, Table
from simrob_drake.stations.robots import StationRobot

MANY = 8
"""How many joints are drawn, or listed, each for itself."""

_WIDTH = 26
_FAR = 1e9
"""An input that is beyond any limit of a Saturation, which does not tell its limits otherwise."""


def figures(values: Vector) -> str:
    """Return the common value of ``values`` (n,), all of them where there are few, or their range."""
    shown = [f"{value:.4g}" for value in values]
    if len(set(shown)) == 1:
        return shown[0]
    return ", ".join(shown) if len(shown) <= MANY else f"{values.min():.4g} to {values.max():.4g}"


def limits(saturation: System) -> tuple[Vector, Vector]:
    """Return the lower and upper limit of a Saturation of n values, each (n,), by trying it."""
    context, port = saturation.CreateDefaultContext(), saturation.get_input_port()
    ends = []
    for far in (-_FAR, _FAR):
        port.FixValue(context, np.full(port.size(), far))
        ends.append(saturation.get_output_port().Eval(context).copy())
    return ends[0], ends[1]


def range_text(saturation: System, units: list[str]) -> str:
    """Return the range of a Saturation whose values have units: "±150 N·m"."""

    def told(ends: Vector) -> str:
        lower, upper = ends.T
        symmetric = np.array_equal(-lower, upper)
        return f"±{figures(upper)}" if symmetric else f"{figures(lower)} to {figures(upper)}"

    return with_units(np.column_stack(limits(saturation)), units, told)


def is_mapping(gain: MatrixGain) -> bool:
    """Tell whether a gain only hands values on: from one order of axes to another, with their signs."""
    return bool(np.isin(np.asarray(gain.D()), (-1.0, 0.0, 1.0)).all())


def pd_text(gain: MatrixGain, count: int) -> str:
    """Return the gains of a PD block of ``count`` joints, whose first columns are those of q_ref, q and v."""
    matrix = np.asarray(gain.D())
    return f"kp {figures(np.diag(matrix[:, :count]))}, kd {figures(-np.diag(matrix[:, 2 * count : 3 * count]))}"


def integral_text(integrator: LinearSystem, count: int) -> str:
    """Return the gain of an integrator of ``count`` joints, whose first columns are those of q_ref."""
    return f"ki {figures(np.diag(np.asarray(integrator.B())[:, :count]))}"


def reference_text(wanted: ReferenceConfig, model: RobotModel) -> str:
    """Return what a robot is asked to do, in words."""
    match wanted:
        case Hold():
            text = "hold the start" if wanted.target_deg is None else f"hold {_positions(wanted.target_deg, model)}"
        case Ramp() | Move():
            late = f", from {wanted.start:g} s" if wanted.start else ""
            text = f"{wanted.kind} to {_positions(wanted.target_deg, model)} in {wanted.duration:g} s{late}"
        case Sequence():
            text = f"sequence of {len(wanted.targets)} postures in {wanted.targets[-1].time:g} s"
        case SineWave():
            text = f"sine ±{_positions(wanted.amplitude_deg, model)}, {wanted.frequency:g} Hz"
        case Table():
            text = f"table {wanted.file.name}"
    return wrapped(text)


def force_text(wanted: ExternalForce | None) -> str:
    """Return which force is applied to a tool, in words."""
    if isinstance(wanted, SineForce):
        size = float(np.linalg.norm(wanted.amplitude))
        return f"Force\nsine ±{size:g} N, {wanted.frequency:.3g} Hz"
    return "Force" if wanted is None else f"Force\n{len(wanted.pushes)} pushes"


def stops_text(stops: JointStops, robots: list[StationRobot]) -> str:
    """Return the figures of joint stops, in the units of the axes that they hold."""
    units = list(dict.fromkeys(unit for robot in robots for unit in robot.model.units))
    springs = ", ".join(f"{unit.effort}/{unit.si}" for unit in units)
    dampers = ", ".join(f"{unit.effort}·s/{unit.si}" for unit in units)
    return f"Joint stops\n{stops.stiffness:g} {springs}\n{stops.damping:g} {dampers}"


def robot_text(robot: StationRobot) -> str:
    """Return a robot's name, where there are several, its kind, and its size."""
    kind = robot.model.description.split(",")[0]
    kind = kind if 0 < len(kind) <= _WIDTH else robot.model.name
    title = f"{robot.name}: {kind}" if robot.prefix else kind
    return wrapped(f"{title}, {len(robot.axes)} axes")


def actuators_text(plant: MultibodyPlant, robot: StationRobot) -> list[str]:
    """Return a line for each actuator of a robot that holds a servo of its own; of many the first and the last."""
    efforts = zip(robot.axes, robot.model.effort_units, strict=True)
    axis_of = {joint.index(): axis for joint, axis in zip(robot.joints, efforts, strict=True)}
    lines = {}
    for index in range(plant.num_actuators()):
        actuator = plant.get_joint_actuator(JointActuatorIndex(index))
        axis, unit = axis_of.get(actuator.joint().index(), ("", ""))
        if axis and actuator.has_controller():
            gains, limit = actuator.get_controller_gains(), actuator.effort_limit()
            lines[axis] = f"{robot.prefix}{axis}: kp {gains.p:.4g}, kd {gains.d:.4g}, ±{limit:.4g} {unit}"
    ordered = [lines[axis] for axis in robot.axes if axis in lines]
    return ordered if len(ordered) <= MANY else [ordered[0], "⋮", ordered[-1]]


def plant_text(plant: MultibodyPlant, config: StationConfig, robots: list[StationRobot]) -> str:
    """Return what stands in the plant's block: its robots, pieces, and the servos inside of its actuators."""
    text = ["Plant", *(robot_text(robot) for robot in robots)]
    if config.pieces:
        text.append(wrapped(f"with {', '.join(config.pieces)}"))
    servos = [line for robot in robots for line in actuators_text(plant, robot)]
    return "\n".join(text + (["", "PD in its actuators:", *servos] if servos else []))


def plain_text(name: str, system: System) -> str:
    """Return the name and type of a block that has no caption of its own."""
    kind = type(system).__name__ if type(system) is not LeafSystem else system.GetSystemType().split("::")[-1]
    return f"{wrapped(name)}\n{kind}"


def wrapped(text: str) -> str:
    """Break a text into lines that fit a block."""
    return "\n".join(textwrap.wrap(text, _WIDTH, break_long_words=False))


def _positions(values: AxisValues, model: RobotModel) -> str:
    """Return positions as they are written in a station, with their units."""
    if isinstance(values, dict):
        if len(values) > MANY:
            return f"given angles of {len(values)} axes"
        pairs = np.array([f"{axis} {position:g}" for axis, position in values.items()])
        return with_units(pairs, [model.unit_names[model.axis_index(axis)] for axis in values], ", ".join)
    return with_units(model.axis_vector(values, "reference"), model.unit_names, figures)
