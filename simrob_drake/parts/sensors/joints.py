"""Sensors at joints: encoders, torques that joints transmit, and external torques that the model does not explain.

A class with the key ``kind`` is a section of ``sensors`` in a station file; the class of its block follows it.
"""

from typing import Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, NotNegative, Positive
from simrob_drake.base.signals import QUANTITY_WORDS, Panel, Signal, sensor_panel
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer
from simrob_drake.blocks.command_bus import round_to_resolution
from simrob_drake.blocks.joint_torque import JointTorqueSensor
from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import ResolvedRobot, StationContents
from simrob_drake.parts.sensors.sensor import (
    SampledSensor,
    Sensor,
    axis_names,
    normal_noise,
    sensor_label,
)
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot


class Encoders(SampledSensor):
    """Positions and speeds of a robot's axes as encoders measure them: sampled, rounded, noisy and late."""

    kind: Literal["encoders"]
    robot: str | None = None
    """Robot whose axes are measured; the only robot if it is left out."""
    resolution_deg: NotNegative | None = None
    """Step between two positions that can be measured [deg, or m for a prismatic axis]; 0 rounds nothing. If it is
    left out, the motors' resolution is used, and without motors nothing is rounded."""
    noise_deg: NotNegative = 0.0
    """Standard deviation of a position [deg, or m]."""
    smoothing: NotNegative = 0.0
    """Time constant of the speeds' low-pass filter [s]."""
    seed: Integer = Field(default=0, ge=0)
    """Seed of the noise: the same seed gives the same values."""

    def resolution(self, robot: ResolvedRobot) -> Vector:
        """Resolution of each axis, shape (n,) [deg, or m for a prismatic axis]. It is 0 if the axis is not rounded."""
        if self.resolution_deg is not None:
            return np.full(len(robot.axes), self.resolution_deg)
        # An axis without a motor, or whose motor's encoder is not described, is not rounded.
        resolutions = np.zeros(len(robot.axes))
        for index, motor in enumerate(robot.motors):
            if motor is not None and motor.resolution_deg is not None:
                resolutions[index] = motor.resolution_deg
        return resolutions

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``position.<sensor>`` and ``velocity.<sensor>`` (n) [rad and rad/s, or m and m/s].

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
        """
        robot = site.robot(self.robot)
        block = JointEncoders(self, robot.model.user_units, self.resolution(robot))
        signals = {}
        heading = message("parts.the_encoders", "the encoders '{name}'", name=name)
        for output, per_time in (("position", ""), ("velocity", "/s")):
            names = axis_names(output, name, robot.axes)
            units = tuple(f"{unit.si}{per_time}" for unit in robot.model.units)
            quantity = QUANTITY_WORDS[output]
            panel = Panel(f"encoders_{name}", heading, quantity, quantity, names)
            signals[output] = Signal(names, units, "motion", part=name, panel=panel)
        # Encoders measure positions alone: the block computes speeds from them.
        inputs = {"position": site.port(builder, f"{robot.prefix}position")}
        self._add_block(
            builder,
            site,
            name,
            block=block,
            title=message("parts.block_encoders", "Encoders"),
            inputs=inputs,
            signals=signals,
            robot=robot,
        )
        site.outputs.notes[name] = {"kind": self.kind}


class JointEncoders(SampledBlock):
    r"""Sample joint positions, and compute speeds from their differences.

    Positions q with a noise n are rounded to the resolution. Speeds are what incremental encoders give: the difference
    of the positions over the sampling period T, smoothed with the time constant :math:`T_s`,

    .. math:: \hat q_k = \mathrm{round}(q_k + n_k), \qquad
        \hat v_k = \hat v_{k-1} + \frac{T}{T + T_s}\left( \frac{\hat q_k - \hat q_{k-1}}{T} - \hat v_{k-1} \right) .

    Ports:
        in  ``position`` (n) [rad].
        out ``position`` (n) [rad]; ``velocity`` (n) [rad/s], which is zero at the first sample.
    """

    def __init__(self, section: Encoders, units: Vector, resolution: Vector) -> None:
        """Create the block.

        Args:
            section: section of the sensor.
            units: the user's unit of each axis, in SI units, shape (n,): pi/180 for an axis in degrees.
            resolution: resolution of each axis, shape (n,), in the user's units.
        """
        size = len(units)
        period = 1 / section.rate
        super().__init__(
            period=period,
            reads={"position": size},
            memory={"position": np.zeros(size), "velocity": np.zeros(size), "count": np.zeros(1)},
            gives=("position", "velocity"),
            delay=section.delay_samples,
            # A loop reads the encoders in its own first sample, when zeros would be far from the robot's posture.
            at_once=True,
        )
        self._resolution = units * resolution
        # Noise and resolution are in the user's units: degrees, or metres for axes that slide.
        self._noise = units * section.noise_deg
        self._filter_share = period / (period + section.smoothing)  # T / (T + T_s)
        self.seed = section.seed

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the measured positions and speeds at this sample, by the equations of the class.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.
        """
        # Number of this sample, from 0: it selects the noise.
        count = int(memory["count"][0])
        noise = self._noise * normal_noise(self.seed, count, len(self._noise))
        position = round_to_resolution(read["position"] + noise, self._resolution)
        # At the first sample there is no position before, and the speed is zero.
        is_first = count == 0
        difference = (
            np.zeros_like(position) if is_first else (position - memory["position"]) / self.period
        )
        last_velocity = memory["velocity"]
        velocity = last_velocity + self._filter_share * (difference - last_velocity)
        return {"position": position, "velocity": velocity, "count": count + 1}


class JointTorque(Sensor):
    """Torque that each joint transmits to its link, between gear and link [N·m or N]."""

    kind: Literal["joint_torque"]
    robot: str | None = None
    """Robot whose joints are measured; the only robot if it is left out."""

    def check(self, key: str, station: StationContents) -> None:
        """Check that the robot exists, and that the solver reports reaction forces of joints.

        Args:
            key: key of the sensor in the station, such as ``sensors.foot``, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the robot does not exist, or the solver does not report these forces.
        """
        super().check(key, station)
        # The block reads Drake's output of reaction forces, which some engines do not compute.
        if not station.engine.reports_forces_of_joints:
            raise Unsuitable(
                key,
                message(
                    "parts.no_joint_forces",
                    "{engine} does not compute the reaction forces of joints",
                    engine=station.engine.name,
                ),
                message("parts.read_torque", "read the output torque instead"),
            )

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``joint_torque.<sensor>`` (n) [N·m or N].

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
        """
        robot = site.robot(self.robot)
        output = f"joint_torque.{name}"
        columns = axis_names("joint_torque", name, robot.axes)
        title = message("parts.joint_torque_of", "joint torque '{name}'", name=name)
        signal = Signal(
            columns,
            tuple(robot.model.effort_units),
            "effort",
            output,
            part=name,
            panel=sensor_panel(title, "torque", columns),
        )
        site.outputs.add(output, _add_joint_torque(builder, site, name, robot), signal)


def _add_joint_torque(
    builder: DiagramBuilder, site: Site, name: str, robot: StationRobot
) -> OutputPort:
    """Add the block of a joint torque sensor, and return its port, size n [N·m or N].

    A kinematic station gets no block: the port is that of the robot's torques.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        name: name of the sensor.
        robot: robot whose joints are measured.
    """
    if not site.station.engine.moves_by_forces:
        # The torques of a kinematic station come from inverse dynamics: they are what the joints transmit.
        return site.outputs[f"{robot.prefix}torque"]
    block = JointTorqueSensor(joints=robot.joints, signs=robot.axis_map.signs)
    label = sensor_label(message("parts.block_joint_torques", "Joint torques"), name)
    site.picture.draw(f"sensor.{name}", "sensor", label, robot)
    return add_and_connect(
        builder, f"sensor.{name}", block, site.plant.plant.get_reaction_forces_output_port()
    )


class ExternalTorque(SampledSensor):
    """Torque at the joints that the model does not explain, and the force at the tool that would cause it.

    A momentum observer; see :mod:`simrob_drake.blocks.momentum_observer`.
    """

    kind: Literal["external_torque"]
    robot: str | None = None
    """Robot whose joints are measured; the only robot if it is left out."""
    gain: Positive = 50.0
    """Gain of the observer [1/s]: the estimate lags behind by 1/gain."""

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Declare ``external_torque.<sensor>`` (n) [N·m or N] and, with a tool, ``external_force.<sensor>`` (3) [N].

        The force is given along the axes of the tool in use. They are ports of the station only if it needs the sensor
        while it is stepped; otherwise they are computed after the run.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
        """
        robot = site.robot(self.robot)
        # The tool in use, if there is one, gives the point and the axes of the estimated force.
        observer = MomentumObserver(
            plant=site.plant.plant,
            axes=robot.axis_map,
            gain=self.gain,
            period=1 / self.rate,
            tool=robot.tools.get(robot.tcp),
        )
        title = message("parts.external_torque_of", "external torque '{name}'", name=name)
        panel = sensor_panel(title, "torque", axis_names("external_torque", name, robot.axes))
        signals = {
            "external_torque": Signal(
                axis_names("external_torque", name, robot.axes),
                tuple(robot.model.effort_units),
                "estimate",
                part=name,
                # With a tool, the estimated force is plotted instead.
                panel=None if robot.tcp else panel,
            )
        }
        if robot.tcp:
            columns = axis_names("external_force", name)
            title = message(
                "parts.estimated_force",
                "force at the tool, estimated by '{name}', in the tool's axes",
                name=name,
            )
            panel = sensor_panel(title, "force", columns)
            signals["external_force"] = Signal(
                columns, ("N",) * 3, "estimate", part=name, panel=panel
            )
        self._add_block(
            builder,
            site,
            name,
            block=observer,
            title=message("parts.block_momentum_observer", "Momentum observer"),
            inputs={"state": site.state, "torque": _add_motor_torque(builder, site, name, robot)},
            signals=signals,
            robot=robot,
        )


def _add_motor_torque(
    builder: DiagramBuilder, site: Site, name: str, robot: StationRobot
) -> OutputPort:
    """Find the torques of a robot's motors before the plant's dampers reduce them: tau + D v.

    A damper of a joint represents how the torque of its motor falls with the speed. The station's output ``torque`` is
    tau, the torque after this fall. The observer knows the dampers from the plant, so their part D v is added back.

    Args:
        builder: builder of the diagram, to which blocks are added if there are such dampers.
        site: the station under construction.
        name: prefix of the names of the blocks.
        robot: the robot.

    Returns:
        The port, size n [N·m or N].
    """
    torque = site.outputs[f"{robot.prefix}torque"]
    damping = robot.gains.damping
    if not damping.any():
        return torque
    # tau_motor = tau + D v, as a product of the matrix [1, D V] with the vector (tau, state). The rows V of the robot's
    # state matrix give the velocities of its axes from the plant's state.
    count = len(damping)
    velocity_rows = robot.axis_map.state_matrix[count:]
    matrix = np.hstack([np.eye(count), np.diag(damping) @ velocity_rows])
    torque_and_state = add_multiplexer(builder, f"{name}.torque_and_state", torque, site.state)
    return add_matrix_gain(builder, f"{name}.motor_torque", matrix, torque_and_state)
