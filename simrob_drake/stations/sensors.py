"""Make and wire the sensors that a station's configuration names.

Force and distance are computed when somebody asks: a monitor at each step, a loop at its samples, or the signals after
the run. A sensor that nothing reads costs nothing while stepping.
"""

from __future__ import annotations

from typing import Literal

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer, ZeroOrderHold

from simrob_drake.blocks.contacts import ContactReader
from simrob_drake.blocks.distance_sensor import DistanceSensor
from simrob_drake.blocks.force_sensor import ForceSensor
from simrob_drake.blocks.joint_torque_sensor import JointTorqueSensor
from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.monitor_config import Contact, ForceLimit
from simrob_drake.stations.plant import StationPlant
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.sensor_checks import watched_sensor
from simrob_drake.stations.sensor_config import Distance, ExternalTorque, Force, JointTorque, SensorConfig
from simrob_drake.stations.targets import frame_of, shapes_of

_CONTACTS = "contacts"


def add_sensors(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Add every sensor with its outputs.

    They are ``force.<sensor>`` (3) [N] and ``moment.<sensor>`` (3) [N·m], ``distance.<sensor>`` (1) [m],
    ``joint_torque.<sensor>`` (n) [N·m], ``external_torque.<sensor>`` (n) [N·m] and ``external_force.<sensor>`` (3) [N].
    """
    for name, sensor in ports.config.sensors.items():
        match sensor:
            case Force():
                _add_force(builder, ports, name, sensor)
            case Distance():
                _add_distance(builder, ports, name, sensor)
            case JointTorque():
                ports.outputs[f"joint_torque.{name}"] = _joint_torque(builder, ports, name, sensor)
            case ExternalTorque():
                _add_observer(builder, ports, name, sensor)


def with_sensors_in_loop(config: StationConfig) -> StationConfig:
    """Return a station with those of its sensors alone that something reads while it is stepped.

    A block that nothing reads still costs a solver time at every look at the diagram, the more the shorter its steps.
    """
    watched = {
        watched_sensor(config, name, monitor)
        for name, monitor in config.monitors.items()
        if isinstance(monitor, Contact | ForceLimit)
    }
    kept = {name: sensor for name, sensor in config.sensors.items() if name in watched or _is_sampled(sensor)}
    return config.model_copy(update={"sensors": kept})


def _is_sampled(sensor: SensorConfig) -> bool:
    """Tell whether a sensor takes samples while the station is stepped."""
    match sensor:
        case ExternalTorque():
            return sensor.in_loop
        case Force() | Distance():
            return sensor.rate is not None
        case _:
            return False


def tangential_source(
    station: StationPlant, config: StationConfig, sensor: Force
) -> Literal["contact", "momentum balance", "left out"]:
    """Return where a sensor's force along the surfaces comes from.

    The scheme ``cenic`` gives it wrongly. There it is found after the run from the momentum of the model that the
    sensor sits on, if that stands free; of an arm, whose base holds it, and in a loop it cannot be told.
    """
    if config.solver.scheme != "cenic" or config.mode == "kinematic":
        return "contact"
    inspector = station.scene_graph.model_inspector()
    shape = shapes_of(station, config, sensor.body)[0]
    instance = station.plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).model_instance()
    bodies = [station.plant.get_body(index) for index in station.plant.GetBodyIndices(instance)]
    free = any(body.is_floating_base_body() for body in bodies)
    return "momentum balance" if free and sensor.rate is None else "left out"


def _add_force(builder: DiagramBuilder, ports: StationPorts, name: str, sensor: Force) -> None:
    station, config = ports.plant, ports.config
    plant = station.plant
    block = ForceSensor(
        plant=plant,
        body=shapes_of(station, config, sensor.body),
        other=None if sensor.other is None else shapes_of(station, config, sensor.other),
        frame=frame_of(station, sensor.frame),
        normal_only=config.solver.scheme == "cenic",
    )
    builder.AddNamedSystem(f"sensor.{name}", block)
    builder.Connect(_contacts(builder, plant), block.GetInputPort("contacts"))
    builder.Connect(plant.get_body_poses_output_port(), block.GetInputPort("body_poses"))
    wrench = _sampled(builder, f"sensor.{name}.hold", block.get_output_port(), sensor.rate)
    split = builder.AddNamedSystem(f"sensor.{name}.split", Demultiplexer([3, 3]))
    builder.Connect(wrench, split.get_input_port())
    ports.outputs[f"force.{name}"], ports.outputs[f"moment.{name}"] = (split.get_output_port(k) for k in (0, 1))


def _contacts(builder: DiagramBuilder, plant: MultibodyPlant) -> OutputPort:
    """Return the port of the block that reads the plant's contacts for all sensors; the first one adds it."""
    if not builder.HasSubsystemNamed(_CONTACTS):
        reader = builder.AddNamedSystem(_CONTACTS, ContactReader())
        builder.Connect(plant.get_contact_results_output_port(), reader.get_input_port())
    return builder.GetSubsystemByName(_CONTACTS).get_output_port()


def _add_distance(builder: DiagramBuilder, ports: StationPorts, name: str, sensor: Distance) -> None:
    shapes = {"body": sensor.body, "other": sensor.other}
    found = {key: shapes_of(ports.plant, ports.config, target) for key, target in shapes.items()}
    scene_graph = ports.plant.scene_graph
    block = DistanceSensor(**found, inspector=scene_graph.model_inspector())
    builder.AddNamedSystem(f"sensor.{name}", block)
    builder.Connect(scene_graph.get_query_output_port(), block.get_input_port())
    port = _sampled(builder, f"sensor.{name}.hold", block.get_output_port(), sensor.rate)
    ports.outputs[f"distance.{name}"] = port


def _sampled(builder: DiagramBuilder, name: str, port: OutputPort, rate: float | None) -> OutputPort:
    if rate is None:
        return port
    hold = builder.AddNamedSystem(name, ZeroOrderHold(1 / rate, port.size()))
    builder.Connect(port, hold.get_input_port())
    return hold.get_output_port()


def _joint_torque(builder: DiagramBuilder, ports: StationPorts, name: str, sensor: JointTorque) -> OutputPort:
    robot = ports.plant.robots[sensor.robot or str(ports.config.only_robot)]
    if ports.config.mode == "kinematic":  # what inverse dynamics gives is what the joints hand on
        return ports.outputs[f"{robot.prefix}torque"]
    block = builder.AddNamedSystem(f"sensor.{name}", JointTorqueSensor(joints=robot.joints, signs=robot.signs))
    builder.Connect(ports.plant.plant.get_reaction_forces_output_port(), block.get_input_port())
    return block.get_output_port()


def _add_observer(builder: DiagramBuilder, ports: StationPorts, name: str, sensor: ExternalTorque) -> None:
    robot = ports.plant.robots[sensor.robot or str(ports.config.only_robot)]
    observer = MomentumObserver(
        plant=ports.plant.plant,
        joints=robot.joints,
        signs=robot.signs,
        gain=sensor.gain,
        period=1 / sensor.rate,
        tool=robot.tools.get(robot.tcp),
        sampled=sensor.in_loop,
    )
    ports.observers[name] = observer
    if not sensor.in_loop:
        return
    builder.AddNamedSystem(f"sensor.{name}", observer)
    builder.Connect(ports.state, observer.GetInputPort("state"))
    builder.Connect(ports.outputs[f"{robot.prefix}torque"], observer.GetInputPort("torque"))
    ports.outputs[f"external_torque.{name}"] = observer.GetOutputPort("external_torque")
    if robot.tcp:
        ports.outputs[f"external_force.{name}"] = observer.GetOutputPort("external_force")
