"""A station with the ports of manipulation's ``MakeHardwareStation``, for code that was written for that one.

A *driver* is the program of a real robot or gripper; its name begins the names of its ports. Every robot of the station
is a driver of its own name, such as ``iiwa``; the fingers of a robot are a second driver, called its *gripper* here.
The *arm* of a robot is its axes without the fingers.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer
from pydrake.multibody.parsing import Parser
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import PassThrough

from simrob_drake.base.arguments import drake_asserts
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import release
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import add_matrix_gain, add_multiplexer
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.plant import BuilderHook, ParserHook, PlantHooks, check_steps_plant
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.station import StationLike, add_station, config_of

_FINGERS = 2
"""Count of the fingers of a gripper whose opening is one number: each moves by half of it."""


class HardwareStation(Diagram):
    """A station as one box, with the ports of manipulation's ``MakeHardwareStation``.

    ``<robot>`` is the name of a robot in the station, with n axes but for its fingers; ``<gripper>`` is
    ``<robot>_gripper`` unless it is named otherwise.

    Ports:
        in  ``<robot>.position`` (n): desired positions [rad].
        in  ``<robot>.torque`` (n): torque that is added to the servos' [N·m]; it may be open.
        in  ``<gripper>.position`` (1): desired opening between the two fingers [m].
        out ``<robot>.position_commanded``, ``<robot>.position_measured`` (n) [rad].
        out ``<robot>.velocity_estimated`` (n) [rad/s], ``<robot>.state_estimated`` (2n): positions, then velocities.
        out ``<robot>.torque_commanded``, ``<robot>.torque_measured`` (n): torques of the motors, saturated [N·m].
        out ``<gripper>.state_measured`` (2): opening [m] and its speed [m/s]; ``<gripper>.force_measured`` (1) [N].
        in  ``applied_spatial_force``, ``applied_generalized_force``: of the plant, if the station does not feed them.
        out all outputs of the plant under their names, such as ``state``, ``body_poses``, ``contact_results``, and
        ``query_object`` of its scene graph.

    Attributes:
        ports: the ports of the station inside.
    """

    def __init__(
        self,
        station: StationLike,
        meshcat: Meshcat | None = None,
        *,
        overrides: Mapping[str, Any] | None = None,
        grippers: Mapping[str, str] | None = None,
        parser_preload: ParserHook | None = None,
        prefinalize: ParserHook | None = None,
        prebuild: BuilderHook | None = None,
    ) -> None:
        """Build the station; arguments and errors are those of :func:`build_hardware_station`."""
        super().__init__()
        config = config_of(station, overrides)
        check_steps_plant(config)
        # Manipulation's station has an input of torques, which are added to those of the servos.
        config = config.model_copy(
            update={"inputs": tuple(dict.fromkeys((*config.inputs, "feedforward")))}
        )
        robots = resolve(config).robots
        gripper_names = dict(grippers or {})  # by the name of the robot
        for robot in robots.values():
            if robot.model.fingers:
                # A name that the user gives comes before the usual one.
                gripper_names.setdefault(robot.name, f"{robot.name}_gripper")

        def finish(parser: Parser) -> None:
            """Name each robot's model instance as the robot, as in a scenario, and call the user's callback."""
            plant = parser.plant()
            for name, robot in robots.items():
                # The station names an instance by the robot in the station, then by the robot in its URDF.
                instance = plant.GetModelInstanceByName(
                    f"{name}::{robot.model.element.get('name')}"
                )
                plant.RenameModelInstance(instance, name)
            PlantHooks(prefinalize=prefinalize).finish(parser)

        builder = DiagramBuilder()
        self.ports = add_station(builder, config, parser_preload=parser_preload, prefinalize=finish)
        for robot in self.ports.plant.robots.values():
            _export_robot(builder, self.ports, robot, gripper_names.get(robot.name))
        _export_plant(builder, self.ports)
        if meshcat is not None:
            MeshcatVisualizer.AddToBuilder(builder, self.ports.plant.scene_graph, meshcat)
        if prebuild is not None:
            prebuild(builder)
        # Last, since no port can be exported from a diagram that is built.
        builder.BuildInto(self)
        release(builder, self)
        self.set_name("station")


@drake_asserts()
def build_hardware_station(
    station: StationLike,
    meshcat: Meshcat | None = None,
    *,
    overrides: Mapping[str, Any] | None = None,
    grippers: Mapping[str, str] | None = None,
    parser_preload: ParserHook | None = None,
    prefinalize: ParserHook | None = None,
    prebuild: BuilderHook | None = None,
) -> HardwareStation:
    """Build a station as one Diagram with the ports of manipulation's ``MakeHardwareStation``.

    Args:
        station: the station: its name, its file, its configuration, or a built one, whose configuration is taken.
        meshcat: shows the station; None to show nothing.
        overrides: new values of the station, as :func:`load_station` takes them.
        grippers: names of the drivers of grippers, by the name of the robot, such as ``{"iiwa": "wsg"}``.
        parser_preload: callback with a Parser of the plant, before the robots are added to it.
        prefinalize: callback with the same Parser, before the plant is finalized.
        prebuild: callback with the builder, before the diagram is built.

    Raises:
        SimrobError: there is no such station, it is kinematic or steps no plant of Drake, or a gripper has not two
            fingers.
    """
    return HardwareStation(
        station,
        meshcat,
        overrides=overrides,
        grippers=grippers,
        parser_preload=parser_preload,
        prefinalize=prefinalize,
        prebuild=prebuild,
    )


def _export_robot(
    builder: DiagramBuilder,
    ports: StationPorts,
    robot: StationRobot,
    gripper: str | None,
) -> None:
    """Export the ports of one robot, and of its gripper if it has one, and connect its inputs to those of the station.

    The ports are those of `HardwareStation`. Matrices select the axes of the arm or the fingers from all axes.

    Args:
        builder: builder of the diagram.
        ports: ports of the station.
        robot: the robot.
        gripper: name of the driver of its gripper; None if it has none.

    Raises:
        SimrobError: the gripper has not two fingers.
    """
    count = len(robot.axes)
    fingers = list(robot.model.fingers)  # indices of their axes
    arm = [axis for axis in range(count) if axis not in fingers]
    if gripper is not None and len(fingers) != _FINGERS:
        raise SimrobError(
            message(
                "stations.gripper_of_two_fingers",
                "{gripper} has {count} {count:finger|fingers}, but only a gripper with two fingers has an opening",
                gripper=gripper,
                count=len(fingers),
            )
        )
    # Rows of the identity: they select the axes of the arm, or of the fingers, from all axes.
    arm_rows = np.eye(count)[arm]
    finger_rows = np.eye(count)[fingers]

    def export(name: str, rows: Vector, source: OutputPort) -> None:
        """Export the product of a matrix and a port of the station as an output of this name."""
        port = add_matrix_gain(builder, f"hardware.{name}", rows, source)
        # An identity matrix adds no block. A PassThrough then gives the output a port of its own: one port of the
        # station, such as the torque, may serve two outputs.
        if port is source:
            block = builder.AddNamedSystem(f"hardware.{name}", PassThrough(source.size()))
            builder.Connect(source, block.get_input_port())
            port = block.get_output_port()
        builder.ExportOutput(port, name)

    outputs = {
        key: ports.outputs[f"{robot.prefix}{key}"]
        for key in ("reference", "position", "velocity", "torque")
    }
    export(f"{robot.name}.position_commanded", arm_rows, outputs["reference"])
    export(f"{robot.name}.position_measured", arm_rows, outputs["position"])
    export(f"{robot.name}.velocity_estimated", arm_rows, outputs["velocity"])
    # Both ports give what the motors apply: no sensor of torques is simulated between them.
    export(f"{robot.name}.torque_commanded", arm_rows, outputs["torque"])
    export(f"{robot.name}.torque_measured", arm_rows, outputs["torque"])
    state = add_multiplexer(
        builder, f"hardware.{robot.name}.state", outputs["position"], outputs["velocity"]
    )
    nothing = np.zeros_like(arm_rows)
    # The state has positions, then velocities, so the selection is done twice along the diagonal.
    export(
        f"{robot.name}.state_estimated", np.block([[arm_rows, nothing], [nothing, arm_rows]]), state
    )

    position = builder.AddNamedSystem(f"hardware.{robot.name}.position", PassThrough(len(arm)))
    torque = builder.AddNamedSystem(f"hardware.{robot.name}.torque", PassThrough(len(arm)))
    builder.ExportInput(position.get_input_port(), f"{robot.name}.position")
    builder.ExportInput(torque.get_input_port(), f"{robot.name}.torque")
    reference = position.get_output_port()
    # The matrix from the inputs to the reference of all n axes. Its columns for the arm are the transposed selection,
    # which puts a value for each axis of the arm in its place, and 0 for fingers.
    spread = arm_rows.T
    if gripper is not None:
        opening = builder.AddNamedSystem(f"hardware.{gripper}.position", PassThrough(1))
        builder.ExportInput(opening.get_input_port(), f"{gripper}.position")
        both = np.ones((1, len(fingers)))  # a row that adds the values of both fingers
        # A last column for the opening: each finger moves by half of it.
        spread = np.hstack([spread, finger_rows.T @ both.T / _FINGERS])
        reference = add_multiplexer(
            builder, f"hardware.{robot.name}.reference", reference, opening.get_output_port()
        )
        # The opening is the sum of the positions of both fingers.
        widths = both @ finger_rows
        no_width = np.zeros_like(widths)
        export(
            f"{gripper}.state_measured", np.block([[widths, no_width], [no_width, widths]]), state
        )
        # The mean force of the fingers. Closing moves a finger to smaller positions, hence the minus: the force is
        # positive where the fingers press what is between them.
        export(f"{gripper}.force_measured", -widths / _FINGERS, outputs["torque"])
    whole_reference = add_matrix_gain(
        builder, f"hardware.{robot.name}.whole_reference", spread, reference
    )
    builder.Connect(whole_reference, ports.inputs[f"{robot.prefix}reference"])
    feedforward = add_matrix_gain(
        builder, f"hardware.{robot.name}.feedforward", arm_rows.T, torque.get_output_port()
    )
    builder.Connect(feedforward, ports.inputs[f"{robot.prefix}feedforward"])


def _export_plant(builder: DiagramBuilder, ports: StationPorts) -> None:
    """Export the outputs of the plant, the query port of its scene graph, and all inputs that are still open.

    The open inputs are those for forces on the plant, and those of the station that `_export_robot` does not connect.
    """
    plant = ports.plant.plant
    for index in range(plant.num_output_ports()):
        output = plant.get_output_port(index)
        builder.ExportOutput(output, output.get_name())
    builder.ExportOutput(ports.plant.scene_graph.get_query_output_port(), "query_object")
    for port in (
        plant.get_applied_generalized_force_input_port(),
        plant.get_applied_spatial_force_input_port(),
    ):
        if not builder.IsConnectedOrExported(port):
            builder.ExportInput(port, port.get_name())
    for name, port in ports.inputs.items():
        if not builder.IsConnectedOrExported(port):
            builder.ExportInput(port, name)
