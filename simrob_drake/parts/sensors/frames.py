"""Sensors at frames: an inertial measurement unit, and the Transform Sensor of Simscape Multibody.

A class with the key ``kind`` is a section of ``sensors`` in a station file; the class of its block follows it.
"""

import weakref
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, FrameIndex
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder

from simrob_drake.base.frames import (
    transform_from_pose,
    transform_from_xyz_quaternion,
    xyz_quaternion_from_transform,
)
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.base.sections import ORIGIN, Boolean, Integer, NotNegative, Pose
from simrob_drake.base.signals import POSE, QUANTITY_WORDS, VELOCITY, Panel, Role, Signal
from simrob_drake.blocks.block import Block, add_and_connect
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import WORLD, StationContents
from simrob_drake.parts.sensors.sensor import (
    SampledSensor,
    Sensor,
    axis_names,
    normal_noise,
    sensor_label,
)
from simrob_drake.parts.site import Site
from simrob_drake.parts.targets import check_frame, frame_of


class _Output(NamedTuple):
    """Output of an inertial measurement unit.

    Attributes:
        components: names of its components.
        unit: unit of each component.
    """

    components: tuple[str, ...]
    unit: str


_INERTIAL = {
    "specific_force": _Output(("x", "y", "z"), "m/s²"),
    "angular_velocity": _Output(("x", "y", "z"), "rad/s"),
    "orientation": _Output(("qw", "qx", "qy", "qz"), "1"),
}
"""Outputs of an inertial measurement unit, by name."""


class Imu(SampledSensor):
    """Inertial measurement unit: specific force, angular velocity and orientation of a frame, in the frame's axes.

    The specific force is a mean over a sample: 9.80665 m/s² upward at rest, and zero in free fall.
    """

    kind: Literal["imu"]
    frame: str | None = None
    """A link or a tool of a robot, or a piece (its TCP); the root link of the only robot if it is left out."""
    seed: Integer = Field(default=0, ge=0)
    """Seed of noise and biases: the same seed gives the same values."""
    accelerometer_noise: NotNegative = 0.0
    """Standard deviation of a sample of each axis [m/s²]."""
    gyroscope_noise: NotNegative = 0.0
    """Standard deviation of a sample of each axis [rad/s]."""
    accelerometer_bias: NotNegative = 0.0
    """Standard deviation of the constant error of each axis, drawn from the seed [m/s²]."""
    gyroscope_bias: NotNegative = 0.0
    """Standard deviation of the constant error of each axis, drawn from the seed [rad/s]."""

    def check(self, key: str, station: StationContents) -> None:
        """Check that the frame exists.

        Args:
            key: key of the sensor in the station, such as ``sensors.foot``, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the frame does not exist, or no frame is given and the station does not have exactly one robot.
        """
        check_frame(station, f"{key}.frame", self._frame_name(station, key))

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add the block of the sensor, and declare its outputs.

        They are ``specific_force.<sensor>`` (3) [m/s²], ``angular_velocity.<sensor>`` (3) [rad/s] and
        ``orientation.<sensor>`` (4): qw qx qy qz.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
        """
        frame = self._frame_name(site.station, f"sensors.{name}")
        block = InertialUnit(self, site.plant.plant, frame_of(site.plant, frame))
        # One plot panel for each output, all in one figure: their units differ.
        signals = {}
        heading = message("parts.the_imu", "the IMU '{name}'", name=name)
        for part, output in _INERTIAL.items():
            columns = axis_names(part, name, output.components)
            units = (output.unit,) * len(columns)
            quantity = QUANTITY_WORDS[part]
            panel = Panel(f"imu_{name}", heading, title=quantity, label=quantity, columns=columns)
            signals[part] = Signal(columns, units, "inertial", part=name, panel=panel)
        self._add_block(
            builder,
            site,
            name,
            block=block,
            title=message("parts.block_imu", "IMU"),
            inputs={"state": site.state},
            signals=signals,
        )
        site.outputs.notes[name] = {"kind": self.kind, "frame": frame}

    def _frame_name(self, station: StationContents, key: str) -> str:
        """Name of the frame in the station; without a name in the section, the root link of the only robot.

        Args:
            station: contents of the station.
            key: key of the sensor in the station.

        Raises:
            InvalidParameter: no frame is given, and the station does not have exactly one robot.
        """
        if self.frame is not None:
            return self.frame
        robot = station.robot(None, f"{key}.frame")
        return f"{robot.prefix}{robot.model.root}"


class InertialUnit(SampledBlock):
    r"""Sample the measurements of an inertial measurement unit at a frame.

    The accelerometer gives the mean specific force over a sampling period T,

    .. math:: f_k = \bar R^\top \left( \frac{v_k - v_{k-1}}{T} - g \right) + b_a + n_k ,

    with the velocity v of the frame's origin, the orientation :math:`\bar R` midway between the two samples, a constant
    bias :math:`b_a` and noise :math:`n_k`. So it needs no accelerations, which depend on a solver's scheme, and it
    contains the effect of an impact within a sample. The gyroscope gives :math:`R_k^\top \omega_k + b_g + n_k`, and the
    orientation is the true one. At the first sample the velocity is taken as constant.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``specific_force`` (3) [m/s²], ``angular_velocity`` (3) [rad/s], both in the frame's axes;
        ``orientation`` (4): of the frame in the world, qw qx qy qz.
    """

    def __init__(self, section: Imu, plant: MultibodyPlant, frame: Frame) -> None:
        """Create the block.

        Args:
            section: section of the sensor.
            plant: the finalized plant, which need not be part of the diagram.
            frame: the frame.
        """
        super().__init__(
            period=1 / section.rate,
            reads={"state": plant.num_multibody_states()},
            memory={
                "specific_force": np.zeros(3),
                "angular_velocity": np.zeros(3),
                "orientation": np.array([1.0, 0, 0, 0]),
                "velocity": np.zeros(3),  # of the origin, in the world
                "count": np.zeros(1),
            },
            gives=list(_INERTIAL),
            delay=section.delay_samples,
            # A loop reads the sensor in its own first sample, when zeros would be far from the robot's motion.
            at_once=True,
        )
        # A weak reference, and an index instead of a frame: the block must not keep the plant in memory.
        self._plant = weakref.proxy(plant)
        self._frame = frame.index()
        self._gravity = plant.gravity_field().gravity_vector()
        # Work space: every evaluation sets its state anew.
        self._scratch = plant.CreateDefaultContext()
        self.seed = section.seed
        # One value for each of the three components of the force, then of the angular velocity.
        self._noise = np.repeat([section.accelerometer_noise, section.gyroscope_noise], 3)
        self._bias = np.repeat([section.accelerometer_bias, section.gyroscope_bias], 3)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the measurements from the motion since the last sample.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.
        """
        # Number of this sample, from 0: it selects the noise, and 0 is the first sample.
        count = int(memory["count"][0])
        plant = self._plant
        plant.SetPositionsAndVelocities(self._scratch, read["state"])
        frame = plant.get_frame(self._frame)
        pose = frame.CalcPoseInWorld(self._scratch)
        motion = frame.CalcSpatialVelocityInWorld(self._scratch)
        velocity = motion.translational()
        orientation = xyz_quaternion_from_transform(pose)[3:]

        # At the first sample there is no motion since the last one.
        is_first = count == 0
        last_orientation = orientation if is_first else memory["orientation"]
        last_velocity = velocity if is_first else memory["velocity"]
        # The sum of two quaternions of the same sign is the rotation midway between them. A quaternion and its negative
        # are the same rotation.
        same_sign = np.copysign(1.0, last_orientation @ orientation)
        middle = last_orientation + same_sign * orientation
        to_frame = transform_from_xyz_quaternion([0, 0, 0, *middle]).rotation().inverse()
        # f = R' ((v_k - v_(k-1)) / T - g)
        force = to_frame @ ((velocity - last_velocity) / self.period - self._gravity)
        angular_velocity = pose.rotation().inverse() @ motion.rotational()

        # The bias is the first draw of the seed; the noise of each sample has a draw of its own.
        bias = self._bias * normal_noise(self.seed, 0, 6)
        noise = self._noise * normal_noise(self.seed, count + 1, 6)
        measured = np.concatenate([force, angular_velocity]) + (bias + noise)
        return {
            "specific_force": measured[:3],
            "angular_velocity": measured[3:],
            "orientation": orientation,
            "velocity": velocity,
            "count": count + 1,
        }


Axes = Literal["world", "base", "frame"]
"""Axes of the frame sensor's values: the world's, those of the base, or those of the measured frame."""
_RELATIVE = {"pose": POSE, "velocity": VELOCITY}
"""Columns, their units, and the plotted quantity of the outputs of a frame sensor."""


class FrameSensor(Sensor):
    """Pose and velocity of a frame relative to another frame, the base."""

    kind: Literal["frame"]
    frame: str
    """A link or a tool of a robot, a piece (its TCP), or `world`."""
    offset: Pose = ORIGIN
    """Pose in that frame of the point and axes that are measured, [x y z Rz Ry Rx]."""
    base: str = WORLD
    """The frame from which it is measured: a link or a tool of a robot, a piece (its TCP), or `world`."""
    base_offset: Pose = ORIGIN
    """Pose in the frame `base` of the point and axes from which it is measured, [x y z Rz Ry Rx]."""
    axes: Axes = "base"
    """Axes in which position and velocities are given: those of `world`, `base` or `frame`."""
    turning: Boolean = True
    """Whether the velocity is relative to these axes as they turn; otherwise, to axes that do not turn."""

    def check(self, key: str, station: StationContents) -> None:
        """Check that both frames exist.

        Args:
            key: key of the sensor in the station, such as ``sensors.foot``, for errors.
            station: contents of the station.

        Raises:
            UnknownName: a frame does not exist.
        """
        check_frame(station, f"{key}.frame", self.frame)
        check_frame(station, f"{key}.base", self.base)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``frame_pose.<sensor>`` (7): x y z [m] and a quaternion, and ``frame_velocity.<sensor>`` (6).

        The velocity is the linear one [m/s], then the angular one [rad/s].

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
        """
        base = AttachedFrame(frame_of(site.plant, self.base), transform_from_pose(self.base_offset))
        frame = AttachedFrame(frame_of(site.plant, self.frame), transform_from_pose(self.offset))
        block = RelativeMotion(
            plant=site.plant.plant, base=base, frame=frame, axes=self.axes, turning=self.turning
        )
        add_and_connect(builder, f"sensor.{name}", block, site.state)
        label = sensor_label(message("parts.block_transform_sensor", "Transform sensor"), name)
        site.picture.draw(f"sensor.{name}", "sensor", label)
        heading = message(
            "parts.frame_from", "'{frame}' relative to '{base}'", frame=self.frame, base=self.base
        )
        for part, (components, units, quantity) in _RELATIVE.items():
            columns = axis_names("frame", name, components)
            output = f"frame_{part}.{name}"
            # Only the linear components are plotted: a panel has one unit.
            panel = Panel(
                figure=f"frame_{name}",
                heading=heading,
                title=QUANTITY_WORDS[part],
                label=quantity,
                columns=columns[:3],
            )
            role: Role = "pose" if part == "pose" else "motion"
            signal = Signal(columns, units, role, output, part=name, panel=panel)
            site.outputs.add(output, block.GetOutputPort(part), signal)
        site.outputs.notes[name] = {"kind": self.kind, "frame": self.frame, "base": self.base}


class AttachedFrame(NamedTuple):
    """A frame that is fixed at a pose in a frame of the plant.

    Attributes:
        parent: the frame of the plant.
        pose: pose in the parent.
    """

    parent: Frame
    pose: RigidTransform


class _FrameMotion(NamedTuple):
    """Motion of a frame in the world.

    Attributes:
        pose: pose of the frame.
        velocity: velocity of the frame at its origin.
    """

    pose: RigidTransform
    velocity: SpatialVelocity


class RelativeMotion(Block):
    r"""Compute the pose and the velocity of a frame relative to another frame, the base, from the state of their plant.

    From the origin of the base B to that of the frame F, in the axes E of the world, the base or the frame itself,

    .. math:: p = R_E^\top (p_F - p_B), \qquad
        v = R_E^\top \bigl(v_F - v_B - \Omega \times (p_F - p_B)\bigr), \qquad
        \omega = R_E^\top (\omega_F - \omega_B),

    where :math:`\Omega` is the angular velocity of these axes, or zero for a velocity relative to axes that do not
    turn. The orientation is that of the frame in the base.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``pose`` (7): x y z [m] qw qx qy qz; ``velocity`` (6): linear, then angular [m/s, rad/s]; ``motion`` (13):
        both.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        base: AttachedFrame,
        frame: AttachedFrame,
        axes: Axes = "base",
        turning: bool = True,
    ) -> None:
        """Create the block.

        Args:
            plant: the finalized plant, which need not be part of the diagram.
            base: the base.
            frame: the frame that is measured.
            axes: axes E in which position and velocities are given.
            turning: whether the velocity is relative to the turning axes.
        """
        super().__init__()
        self._plant = weakref.proxy(plant)
        # Work space: every evaluation sets its state anew.
        self._scratch = plant.CreateDefaultContext()
        # Indices instead of frames: a frame would keep the plant in memory.
        self._base_index = base.parent.index()
        self._base_offset = base.pose
        self._frame_index = frame.parent.index()
        self._frame_offset = frame.pose
        self._axes = axes
        self._turning = turning
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("pose", 7, weakly(self._calc_pose))
        self.DeclareVectorOutputPort("velocity", 6, weakly(self._calc_velocity))
        self._motion = self.DeclareVectorOutputPort("motion", 13, weakly(self._calc_motion))

    # The next two methods read the port `motion`, whose value Drake caches, so that it is computed once for both.

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._motion.Eval(context)[:7])

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._motion.Eval(context)[7:])

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        """Compute the pose, then the velocity, by the equations of the class, and write both to `output` (13)."""
        self._plant.SetPositionsAndVelocities(self._scratch, self._state.Eval(context))
        base = self._motion_in_world(self._base_index, self._base_offset)
        frame = self._motion_in_world(self._frame_index, self._frame_offset)
        frame_in_base = base.pose.inverse().multiply(frame.pose)
        arm = frame.pose.translation() - base.pose.translation()

        # The term with Omega. `Shift` gives the velocity of the same body at another point, by the vector to it. With
        # turning axes of the base, the base's velocity is taken where the frame's origin is: v_B + Omega x arm. With
        # those of the frame, the frame's velocity is taken where the base's origin is: v_F - Omega x arm.
        base_velocity = base.velocity
        frame_velocity = frame.velocity
        if self._turning and self._axes == "base":
            base_velocity = base_velocity.Shift(arm)
        elif self._turning and self._axes == "frame":
            frame_velocity = frame_velocity.Shift(-arm)
        velocity = frame_velocity - base_velocity

        match self._axes:
            case "world":
                position = arm
            case "base":
                position = frame_in_base.translation()
                velocity = velocity.Rotate(base.pose.rotation().inverse())
            case "frame":
                # From the base's axes to the frame's: the rotation of the frame in the base, inverted.
                position = frame_in_base.rotation().inverse().multiply(frame_in_base.translation())
                velocity = velocity.Rotate(frame.pose.rotation().inverse())
        orientation = frame_in_base.rotation().ToQuaternion().wxyz()
        # Drake gives the angular velocity first.
        coefficients = velocity.get_coeffs()
        linear = coefficients[3:]
        angular = coefficients[:3]
        output.SetFromVector(np.concatenate([position, orientation, linear, angular]))

    def _motion_in_world(self, index: FrameIndex, offset: RigidTransform) -> _FrameMotion:
        """Compute the motion in the world of a frame that is fixed in a frame of the plant.

        Args:
            index: index of the frame of the plant, whose state is that of the work space.
            offset: pose of the frame in that frame.
        """
        parent = self._plant.get_frame(index)
        pose = parent.CalcPoseInWorld(self._scratch)
        velocity = parent.CalcSpatialVelocityInWorld(self._scratch)
        # v_point = v + omega x r, with the vector r from the frame's origin to the point, in the world's axes.
        to_offset = pose.rotation().multiply(offset.translation())
        return _FrameMotion(pose=pose.multiply(offset), velocity=velocity.Shift(to_offset))
