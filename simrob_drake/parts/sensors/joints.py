"""What joints tell: encoders, torques that they hand on, and torques that the model does not explain."""

from typing import Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder, OutputPort

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, NotNegative, Positive
from simrob_drake.base.signals import QUANTITY_WORDS, Panel, Signal, sensor_panel
from simrob_drake.blocks.block import add_and_connect, add_matrix_gain, add_multiplexer
from simrob_drake.blocks.command_bus import round_to_resolution
from simrob_drake.blocks.joint_torque import JointTorqueSensor
from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import ResolvedRobot, Surroundings
from simrob_drake.parts.sensors.sensor import SampledSensor, Sensor, axis_names, normal, sensor_label
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot


class Encoders(SampledSensor):
    """Positions and speeds of a robot's axes as encoders tell them: sampled, rounded, noisy and late."""

    kind: Literal["encoders"]
    robot: str | None = None
    """Whose axes; the only robot's unless given."""
    resolution_deg: NotNegative | None = None
    """Step from one position that they tell to the next [deg, or m where an axis slides]; 0 for none. That of the
    motors unless given, and without these none."""
    noise_deg: NotNegative = 0.0
    """Standard deviation of a position [deg, or m]."""
    smoothing: NotNegative = 0.0
    """Time constant of the speeds' low-pass filter [s]."""
    seed: Integer = Field(default=0, ge=0)
    """Of the noise: the same seed, the same figures."""

    def resolution(self, robot: ResolvedRobot) -> Vector:
        """Return the resolution of each axis of its robot, (n,) [deg, or m]: its own, else that of the motors."""
        if self.resolution_deg is not None:
            return np.full(len(robot.axes), self.resolution_deg)
        return np.array([0.0 if motor is None else motor.resolution_deg or 0.0 for motor in robot.motors])

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``position.<sensor>`` and ``velocity.<sensor>`` (n) [rad and rad/s, or m and m/s]."""
        robot = site.robot(self.robot)
        block = JointEncoders(self, robot.model.user_units, self.resolution(robot))
        signals = {}
        for output, suffix in (("position", ""), ("velocity", "/s")):
            names = axis_names(output, name, robot.axes)
            units = tuple(f"{unit.si}{suffix}" for unit in robot.model.units)
            heading = message("parts.the_encoders", "the encoders '{name}'", name=name)
            quantity = QUANTITY_WORDS[output]
            panel = Panel(f"encoders_{name}", heading, quantity, quantity, names)
            signals[output] = Signal(names, units, "motion", part=name, panel=panel)
        inputs = {"position": site.port(builder, f"{robot.prefix}position")}
        self._give(
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
    r"""Sample joint positions, and take their differences as speeds.

    A sample tells positions rounded to the resolution, and as speed what incremental encoders give: their difference
    over a sample, smoothed with the time constant :math:`T_s`,

    .. math:: \hat q_k = \mathrm{round}(q_k + n_k), \qquad
        \hat v_k = \hat v_{k-1} + \frac{T}{T + T_s}\left( \frac{\hat q_k - \hat q_{k-1}}{T} - \hat v_{k-1} \right) .

    Ports:
        in  ``position`` (n) [rad].
        out ``position`` (n) [rad], ``velocity`` (n) [rad/s]; zero speed at the first sample.
    """

    def __init__(self, section: Encoders, units: Vector, resolution: Vector) -> None:
        """Make a section's block, for n axes of users' units (n,) in SI, and ``resolution`` (n,) in those."""
        size, period = len(units), 1 / section.rate
        memory = {"position": np.zeros(size), "velocity": np.zeros(size), "count": np.zeros(1)}
        super().__init__(
            period=period,
            reads={"position": size},
            memory=memory,
            gives=("position", "velocity"),
            delay=section.late_samples,
            at_once=True,
        )
        self._resolution, self._noise = units * resolution, units * section.noise_deg
        self._share, self.seed = period / (period + section.smoothing), section.seed

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what the encoders tell now."""
        count = int(memory["count"][0])
        noise = self._noise * normal(self.seed, count, len(self._noise))
        position = round_to_resolution(read["position"] + noise, self._resolution)
        difference = (position - memory["position"]) / self.period if count else np.zeros_like(position)
        velocity = memory["velocity"] + self._share * (difference - memory["velocity"])
        return {"position": position, "velocity": velocity, "count": count + 1}


class JointTorque(Sensor):
    """Torque that each joint hands on to its link, between gear and link [N·m]."""

    kind: Literal["joint_torque"]
    robot: str | None = None
    """Whose joints; the only robot's unless given."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the scheme tells reaction forces, too."""
        super().check(key, station)
        if not station.engine.reports_forces_of_joints:
            expected = message(
                "parts.no_joint_forces",
                "left out under {engine}, which tells no forces of joints; read the output torque",
                engine=station.engine.name,
            )
            raise InvalidParameter(key, message("parts.joint_torque_sensor", "a joint_torque sensor"), expected)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``joint_torque.<sensor>`` (n) [N·m or N]."""
        robot, output = site.robot(self.robot), f"joint_torque.{name}"
        names, units = axis_names("joint_torque", name, robot.axes), robot.model.effort_units
        panel = sensor_panel(message("parts.joint_torque_of", "joint torque '{name}'", name=name), "torque", names)
        port = _port(builder, site, name, robot)
        site.outputs.add(output, port, Signal(names, tuple(units), "effort", output, part=name, panel=panel))


def _port(builder: DiagramBuilder, site: Site, name: str, robot: StationRobot) -> OutputPort:
    if not site.station.engine.moves_by_forces:  # what inverse dynamics gives is what the joints hand on
        return site.outputs[f"{robot.prefix}torque"]
    block = JointTorqueSensor(joints=robot.joints, signs=robot.axis_map.signs)
    site.picture.draw(
        f"sensor.{name}", "sensor", sensor_label(message("parts.block_joint_torques", "Joint torques"), name), robot
    )
    return add_and_connect(builder, f"sensor.{name}", block, site.plant.plant.get_reaction_forces_output_port())


class ExternalTorque(SampledSensor):
    """Torque at the joints that the model does not explain, and the force at the tool that would cause it.

    A momentum observer; see :mod:`simrob_drake.blocks.momentum_observer`.
    """

    kind: Literal["external_torque"]
    robot: str | None = None
    """Whose joints; the only robot's unless given."""
    gain: Positive = 50.0
    """How fast the estimate follows [1/s]; it lags by 1/gain."""

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``external_torque.<sensor>`` (n) [N·m or N] and, with a tool, ``external_force.<sensor>`` (3) [N]."""
        robot = site.robot(self.robot)
        observer = MomentumObserver(
            plant=site.plant.plant,
            axes=robot.axis_map,
            gain=self.gain,
            period=1 / self.rate,
            tool=robot.tools.get(robot.tcp),
        )
        torque, damping = site.outputs[f"{robot.prefix}torque"], robot.gains.damping
        if damping.any():  # of the motors, which the plant has and the torques tell
            every = np.hstack([np.eye(len(damping)), np.diag(damping) @ robot.axis_map.state_matrix[len(damping) :]])
            felt = add_multiplexer(builder, f"{name}.torque_and_state", torque, site.state)
            torque = add_matrix_gain(builder, f"{name}.motor_torque", every, felt)
        contents = {"external_torque": (robot.axes, robot.model.effort_units)}
        if robot.tcp:
            contents["external_force"] = (["x", "y", "z"], ["N"] * 3)
        signals = {}
        for port, (axes, units) in contents.items():
            names, force = axis_names(port, name, axes), port == "external_force"
            title = message("parts.external_torque_of", "external torque '{name}'", name=name)
            if force:
                title = message(
                    "parts.estimated_force", "force at the tool, estimated by '{name}', in its axes", name=name
                )
            panel = sensor_panel(title, "force" if force else "torque", names)
            shown = panel if force or not robot.tcp else None
            signals[port] = Signal(names, tuple(units), "estimate", part=name, panel=shown)
        self._give(
            builder,
            site,
            name,
            block=observer,
            title=message("parts.block_momentum_observer", "Momentum observer"),
            inputs={"state": site.state, "torque": torque},
            signals=signals,
            robot=robot,
        )
