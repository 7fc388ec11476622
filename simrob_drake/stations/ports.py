"""The named ports of a station, and the labels of its plant, servos and joint stops in the block picture.

The *block picture* shows the diagram of a station. To *draw* a system means to give it a labelled box in the picture;
systems that are drawn with the same key share a box, and ``draw_nothing`` makes a system a part of the arrows. Servos
that are made of blocks are drawn as *rows*: one for each joint, named after its axis, or one row ``servo`` for all
joints. A *group* is a list of indices of the axes that a box is about. The names of a robot's systems begin with its
*prefix*, which is empty for the only robot. A *passive* axis has no motor.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import PassThrough

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message, translate
from simrob_drake.parts.captions import MANY, fits_line, shown_limits, shown_values, wrap_label
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.config import Feedforward, StationConfig


@dataclass(frozen=True, kw_only=True, repr=False)
class StationPorts(Site):
    """The ports of a station, as :func:`add_station` returns them and a built station has them as ``ports``.

    With several robots, the names of a robot's ports begin with ``<robot>.``. For example::

        builder.Connect(source.get_output_port(), ports.inputs["reference"])
        builder.Connect(ports.outputs["tcp_pose"], planner.get_input_port())
        body = ports.plant.plant.GetBodyByName("link_6")

    Attributes:
        inputs: input ports by name, a mapping: ``reference`` (n), and the inputs that the station lists under
            ``inputs``, such as ``feedforward``. All are open: connect or export each.
        outputs: output ports by name, a mapping: ``position``, ``velocity``, ``torque`` (n), ``tcp_pose`` (7), and
            those of pieces and sensors, such as ``force.<sensor>`` (3).
        plant: the plant of the station: ``plant.plant`` is the MultibodyPlant, ``plant.scene_graph`` the SceneGraph,
            ``plant.robots`` the robots by name.
        state: output port with the positions and velocities of the whole plant, size nq + nv.
        config: the station's configuration.
        station: the robots, pieces and parts of the station.
        blocks: controllers and other blocks of the user's own, by name.
        picture: the labels of the block picture.
        edges: times at which a run must end a step, such as the start of a push [s].
        spatial_forces: output ports whose forces on bodies act on the plant.
        generalized_forces: output ports whose forces on joints act on the plant, in addition to the motors.
        sources: output ports that drive inputs from the start, by the name of the input. Such an input needs no block.
        name: name of the station in a diagram of the user's own: the prefix of its systems' names, with a dot between
            them; empty if they have none.
    """

    config: StationConfig
    sources: Mapping[str, OutputPort] = field(default_factory=dict)
    name: str = ""

    def add_input(
        self,
        builder: DiagramBuilder,
        robot: StationRobot,
        name: str,
    ) -> OutputPort:
        """Add an input with one value for each axis. Returns the port that blocks of the station read.

        If the station has a source for this input already, nothing is added, and the port of the source is returned.

        Args:
            builder: builder of the diagram.
            robot: the robot.
            name: name of the input without the prefix of the robot.
        """
        # An input whose source exists already needs no block: the station reads the source.
        if f"{robot.prefix}{name}" in self.sources:
            return self.sources[f"{robot.prefix}{name}"]
        # Drake's inputs cannot be read: the output of a block that passes values on can.
        block = builder.AddNamedSystem(f"{robot.prefix}{name}", PassThrough(len(robot.joints)))
        self.inputs[f"{robot.prefix}{name}"] = block.get_input_port()
        return block.get_output_port()


_MOTOR = "drives", "drive", "stall", "brakes", "brake"
"""Last parts of the names of a motor's blocks: slope times speed is added, the sum is limited to the torque at rest
(``stall``), and slope times speed is subtracted again."""
_FEEDFORWARDS: dict[Feedforward, str] = {
    "none": "",
    "gravity": message("stations.block_gravity", "gravity"),
    "inverse_dynamics": message("stations.block_dynamics", "inverse dynamics"),
}
"""Torques that a feedforward compensates, as the block picture names them."""
_PARTS = (
    "pd",
    "position_loop",
    "speed_limit",
    "velocity_loop",
    "saturation",
    "integrator",
    "integral_clip",
    *_MOTOR,
)
"""Parts of a servo: the last parts of the names of its blocks."""


def draw_plant(ports: StationPorts) -> None:
    """Draw the plant with its robots and pieces, the joint stops and the scene graph.

    A kinematic station has no plant in its diagram: its block of inverse dynamics is drawn instead.
    """
    config = ports.config
    robots = list(ports.plant.robots.values())
    robot_texts = [_robot_text(robot) for robot in robots]
    if not config.engine.moves_by_forces:
        title = message("stations.block_inverse_dynamics", "Inverse dynamics")
        ports.picture.draw("inverse_dynamics", "robot", join_texts([title, *robot_texts], "\n"))
        label = message("stations.block_geometry_poses", "Geometry poses")
        ports.picture.draw("geometry_poses", "robot", label)
    else:
        pieces = list[str]()
        if config.pieces:
            names = message("stations.block_with", "with {pieces}", pieces=", ".join(config.pieces))
            pieces.append(wrap_label(translate(names)))
        title = message("stations.block_plant", "Plant")
        ports.picture.draw("plant", "robot", join_texts([title, *robot_texts, *pieces], "\n"))
        # A solver that holds joint limits by itself needs no block for the stops.
        if robots and not config.engine.holds_joint_limits:
            # Stiffnesses of all robots, then their dampings; each is shown as one text.
            stops = zip(*(robot.stops for robot in robots), strict=True)
            stiffness, damping = (shown_values(np.concatenate(values)) for values in stops)
            units = list(dict.fromkeys(unit for robot in robots for unit in robot.model.units))
            springs = ", ".join(f"{unit.effort}/{unit.si}" for unit in units)
            dampers = ", ".join(f"{unit.effort}·s/{unit.si}" for unit in units)
            label = message(
                "stations.block_stops",
                "Joint stops\n{stiffness} {springs}\n{damping} {dampers}",
                stiffness=stiffness,
                springs=springs,
                damping=damping,
                dampers=dampers,
            )
            ports.picture.draw("stops", "force", label)
    label = message("stations.block_scene_graph", "Scene graph\nall geometry")
    ports.picture.draw("scene_graph", "scene", label)


def draw_servos(ports: StationPorts, robot: StationRobot, *, per_joint: bool) -> None:
    """Draw servos that are made of blocks: a row for each joint, or one row for all joints.

    Of many joints, only the first and the last have a row. Those between share a single block.

    Args:
        ports: ports of the station.
        robot: the robot.
        per_joint: whether each joint has a row.
    """
    axes = robot.axes
    prefix = robot.prefix
    # With some engines the actuators limit the torques. One block then computes the limited torques of all joints.
    if ports.config.engine.limits_torques_in_actuators:
        _draw_saturation(ports, f"{prefix}torque", list(range(len(axes))), robot)
        _draw_motors(ports, f"{prefix}motors", list(range(len(axes))), robot)
    if not per_joint:
        title = message("stations.block_joints", "{count} joints", count=len(axes))
        _draw_servo(ports, robot, "servo", list(range(len(axes))), title)
        return
    # A row for each of many joints would make the picture unreadable.
    between = axes[1:-1] if len(axes) > MANY else []
    for index, axis in enumerate(axes):
        if axis in between:
            label = message(
                "stations.block_joints_between",
                "⋮\n{count} joints,\n{first} to {last}",
                count=len(between),
                first=between[0],
                last=between[-1],
            )
            for part in _PARTS:
                # Blocks with the same key share one box in the picture.
                ports.picture.draw(
                    f"{prefix}{axis}.{part}", "servo", label, robot, key=f"{prefix}more"
                )
        else:
            _draw_servo(ports, robot, axis, [index], axis)


def draw_actuator_servos(ports: StationPorts, robot: StationRobot) -> None:
    """Draw the servos that the plant computes in its actuators, as a block of their own next to the plant."""
    driven = _axes_with_motor(robot, list(range(len(robot.axes))))  # indices
    label = compound(
        "{joints}{passive}",
        joints=message(
            "stations.block_actuators", "{count} joints,\nin the actuators", count=len(driven)
        ),
        passive=_passive_text(robot),
    )
    units = [robot.model.effort_units[axis] for axis in driven]
    limit = wrap_label(shown_limits(robot.gains.torque_limit[driven], units))
    kp = f"kp {shown_values(robot.gains.kp[driven])}"
    kd = f"kd {shown_values(robot.gains.kd[driven])}"
    law = (
        f"PD\n{kp}, {kd}" if fits_line(f"{kp}, {kd}") else f"PD\n{wrap_label(kp)}\n{wrap_label(kd)}"
    )
    ports.picture.draw_nothing(f"{robot.prefix}applied_and_state", f"{robot.prefix}applied_torque")
    # Which of the two blocks exists depends on the gains; both are drawn as the same box.
    for part in ("desired_state", "actuation"):
        ports.picture.draw(
            f"{robot.prefix}{part}",
            "servo",
            label,
            robot,
            key=f"{robot.prefix}servo",
            inside=(law, message("stations.block_saturation", "Saturation\n{limit}", limit=limit)),
            within="plant",
        )


def draw_feedforward(ports: StationPorts, robots: list[str]) -> None:
    """Draw the block that predicts the torques of a desired motion: one block for all robots with a feedforward.

    Args:
        ports: ports of the station.
        robots: names of these robots.
    """
    # What the feedforwards compensate, each text once.
    kinds = dict.fromkeys(
        _FEEDFORWARDS[ports.config.servo_of(robot).feedforward] for robot in robots
    )
    # With one robot it is clear whose motion is meant, with several the label names the robots.
    whose = message("stations.block_of_reference", "of the reference")
    if len(ports.plant.robots) > 1:
        whose = message("stations.block_of_robots", "of {robots}", robots=", ".join(robots))
    label = message(
        "stations.block_feedforward",
        "Feedforward: {kinds}\n{whose}",
        kinds=join_texts(kinds),
        whose=wrap_label(translate(whose)),
    )
    ports.picture.draw("model_feedforward", "servo", label)


def draw_computed_torque(ports: StationPorts, robot: StationRobot) -> None:
    """Draw the block of computed torque, and the blocks that saturate its torques."""
    # The gains are per inertia, hence their units.
    label = message(
        "stations.block_computed_torque",
        "Computed torque\nkp {kp} 1/s²\nkd {kd} 1/s",
        kp=shown_values(robot.gains.kp),
        kd=shown_values(robot.gains.kd),
    )
    ports.picture.draw(f"{robot.prefix}computed_torque", "servo", label, robot)
    _draw_saturation(ports, f"{robot.prefix}torque", list(range(len(robot.axes))), robot)
    _draw_motors(ports, f"{robot.prefix}motors", list(range(len(robot.axes))), robot)


def draw_integral(
    ports: StationPorts,
    robot: StationRobot,
    row: str,
    group: list[int],
    title: str,
) -> None:
    """Draw the integral parts of a group of joints, as one box.

    Args:
        ports: ports of the station.
        robot: the robot.
        row: name of the servo's row without the prefix: that of an axis, or ``servo`` for all joints.
        group: indices of the axes.
        title: start of the label: the name of the axis, or the count of joints.
    """
    gains = robot.gains
    units = [robot.model.effort_units[index] for index in group]
    limit = shown_limits(gains.integral_limit[group], units)
    label = f"{translate(title)}: I\nki {shown_values(gains.ki[group])}, {limit}"
    for part in ("integrator", "integral_clip"):
        ports.picture.draw(
            f"{robot.prefix}{row}.{part}",
            "servo",
            label,
            robot,
            key=f"{robot.prefix}{row}.integral",
        )


def _axes_with_motor(robot: StationRobot, group: list[int]) -> list[int]:
    """Indices of those axes of a group that have a motor."""
    return [axis for axis in group if not robot.gains.passive[axis]]


def _passive_text(robot: StationRobot) -> str:
    """Line of a label that names the axes without a motor; empty if all axes have one."""
    names = [robot.axes[axis] for axis in np.flatnonzero(robot.gains.passive)]
    if not names:
        return ""
    text = wrap_label(
        translate(
            message("stations.block_without_motor", "no motor: {axes}", axes=", ".join(names))
        )
    )
    return f"\n{text}"


def _draw_servo(
    ports: StationPorts,
    robot: StationRobot,
    row: str,
    group: list[int],
    title: str,
) -> None:
    """Draw the servo of a group of joints: its loops, its saturation, its motors and its integral part.

    Passive joints have no servo. If all joints of the group are passive, a single box is labelled "no motor".

    Args:
        ports: ports of the station.
        robot: the robot.
        row: name of the servo's row without the prefix: that of an axis, or ``servo`` for all joints.
        group: indices of the axes.
        title: start of the label: the name of the axis, or the count of joints.
    """
    gains = robot.gains
    name = f"{robot.prefix}{row}"
    driven = _axes_with_motor(robot, group)
    if not driven:
        label = message("stations.block_no_motor", "{axes}: no motor", axes=title)
        for part in ("pd", "saturation"):
            ports.picture.draw(f"{name}.{part}", "servo", label, robot, key=f"{name}.passive")
        return
    without_motor = ""  # a further line of the label
    # The label of a group counts the axes with motors, and names those without.
    if len(driven) < len(group):
        several = message("stations.block_joints", "{count} joints", count=len(driven))
        title = robot.axes[driven[0]] if len(driven) == 1 else several
        without_motor = _passive_text(robot)
        group = driven
    units = [robot.model.units[index].si for index in group]
    kp = gains.kp[group]
    kd = gains.kd[group]
    # A cascade: the position loop is a P controller kp / kd [1/s] for the speed.
    if gains.speed_limit is not None:
        limit = shown_limits(gains.speed_limit[group], [f"{unit}/s" for unit in units])
        position_label = compound("{axes}: P\n{gain} 1/s", axes=title, gain=shown_values(kp / kd))
        ports.picture.draw(f"{name}.position_loop", "servo", position_label, robot)
        speed_label = message("stations.block_speed", "Speed\n{limit}", limit=limit)
        ports.picture.draw(f"{name}.speed_limit", "servo", speed_label, robot)
        label = message(
            "stations.block_velocity", "{axes}: velocity\n{gain}", axes=title, gain=shown_values(kd)
        )
        ports.picture.draw(f"{name}.velocity_loop", "servo", label, robot)
        ports.picture.draw_nothing(f"{name}.speed")
    # A label has an effect only if the diagram has a system of this name: a cascade has none called `pd`.
    ports.picture.draw(f"{name}.pd", "servo", _pd_label(title, kp, kd) + without_motor, robot)
    _draw_saturation(ports, f"{name}.saturation", group, robot)
    _draw_motors(ports, name, group, robot)
    if (gains.ki[group] > 0).any():
        draw_integral(ports, robot, row, group, title)


def _pd_label(title: str, kp: Vector, kd: Vector) -> str:
    """Label of the block of a PD servo, with the gains of its axes, shape (n,) each."""
    return f"{translate(title)}: PD\nkp {shown_values(kp)}, kd {shown_values(kd)}"


def _draw_motors(
    ports: StationPorts,
    name: str,
    group: list[int],
    robot: StationRobot,
) -> None:
    """Draw the block of motors whose torque falls with their speed, if a group of joints has any.

    Args:
        ports: ports of the station.
        name: name of the motors' systems, without their last part.
        group: indices of the axes.
        robot: the robot.
    """
    line = robot.gains.line
    if line is None or not line.slope[group].any():
        return
    units = [robot.model.effort_units[index] for index in group]
    limit = shown_limits(line.stall[group], units)
    label = message("stations.block_motor", "Motor\n{limit} at rest", limit=wrap_label(limit))
    ports.picture.draw(f"{name}.stall", "servo", label, robot)
    # The blocks that add and subtract the slope times the speed would only repeat the motor.
    for part in (*_MOTOR, "commands", "driven"):
        if part != "stall":
            ports.picture.draw_nothing(f"{name}.{part}")


def _draw_saturation(
    ports: StationPorts,
    name: str,
    group: list[int],
    robot: StationRobot,
) -> None:
    """Draw the block that limits the torques of a group of joints, with the limits of those that have a motor.

    Args:
        ports: ports of the station.
        name: name of the block.
        group: indices of the axes.
        robot: the robot.
    """
    # If none has a motor, the limits of all are shown: they are 0.
    group = _axes_with_motor(robot, group) or group
    units = [robot.model.effort_units[index] for index in group]
    limit = shown_limits(robot.gains.torque_limit[group], units)
    label = message("stations.block_saturation", "Saturation\n{limit}", limit=wrap_label(limit))
    ports.picture.draw(name, "servo", label, robot)


def _robot_text(robot: StationRobot) -> str:
    """Describe a robot in the block of the plant: what it is, and its count of axes.

    The text has several lines if it does not fit one.

    The name of the robot is left out if the station has no other robot.
    """
    # The first part of a description names the robot, what follows it are details.
    kind = robot.model.description.split(",")[0]
    kind = kind if fits_line(kind) else robot.model.name
    title = f"{robot.name}: {kind}" if robot.prefix else kind
    axes = message("stations.block_axes", "{count} {count:axis|axes}", count=len(robot.axes))
    whole = translate(compound("{title}, {axes}", title=title, axes=axes))
    return (
        whole
        if fits_line(whole)
        else compound("{title},\n{axes}", title=wrap_label(title), axes=axes)
    )
