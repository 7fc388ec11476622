"""What frames tell: an inertial measurement unit, and Simscape Multibody's Transform Sensor."""

import weakref
from typing import Literal

import numpy as np
from pydantic import Field
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, FrameIndex
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder

from simrob_drake.base.frames import transform_from_pose, transform_from_xyz_quaternion, xyz_quaternion_from_transform
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.base.sections import ORIGIN, Boolean, Integer, NotNegative, Pose
from simrob_drake.base.signals import POSE, QUANTITY_WORDS, VELOCITY, Panel, Signal
from simrob_drake.blocks.block import Block, add_and_connect
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import WORLD, Surroundings
from simrob_drake.parts.sensors.sensor import SampledSensor, Sensor, axis_names, normal, sensor_label
from simrob_drake.parts.site import Site
from simrob_drake.parts.targets import check_frame, frame_of

_INERTIAL = {
    "specific_force": (("x", "y", "z"), "m/s²"),
    "angular_velocity": (("x", "y", "z"), "rad/s"),
    "orientation": (("qw", "qx", "qy", "qz"), "1"),
}


class Imu(SampledSensor):
    """Specific force, angular velocity and orientation of a frame, in its axes, as an inertial measurement unit tells.

    At rest the specific force is 9.80665 m/s² upward, in free fall zero: the mean over a sample.
    """

    kind: Literal["imu"]
    frame: str | None = None
    """A link or a tool of a robot, or a piece (its TCP); the root link of the only robot unless given."""
    seed: Integer = Field(default=0, ge=0)
    """Of noise and biases: the same seed, the same figures."""
    accelerometer_noise: NotNegative = 0.0
    """Standard deviation of a sample of each axis [m/s²]."""
    gyroscope_noise: NotNegative = 0.0
    """Likewise [rad/s]."""
    accelerometer_bias: NotNegative = 0.0
    """Standard deviation of the constant error of each axis, drawn from the seed [m/s²]."""
    gyroscope_bias: NotNegative = 0.0
    """Likewise [rad/s]."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the frame exists."""
        check_frame(station, f"{key}.frame", self._frame_name(station, key))

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``specific_force.<sensor>`` (3) [m/s²], ``angular_velocity`` (3) [rad/s] and ``orientation`` (4)."""
        frame = self._frame_name(site.station, f"sensors.{name}")
        block = InertialUnit(self, site.plant.plant, frame_of(site.plant, frame))
        signals = {}
        for part, (axes, unit) in _INERTIAL.items():
            names = axis_names(part, name, axes)
            heading = message("parts.the_imu", "the IMU '{name}'", name=name)
            panel = Panel(f"imu_{name}", heading, QUANTITY_WORDS[part], QUANTITY_WORDS[part], names)
            signals[part] = Signal(names, (unit,) * len(names), "inertial", part=name, panel=panel)
        self._give(
            builder,
            site,
            name,
            block=block,
            title=message("parts.block_imu", "IMU"),
            inputs={"state": site.state},
            signals=signals,
        )
        site.outputs.notes[name] = {"kind": self.kind, "frame": frame}

    def _frame_name(self, station: Surroundings, key: str) -> str:
        if self.frame is not None:
            return self.frame
        robot = station.robot(None, f"{key}.frame")
        return f"{robot.prefix}{robot.model.root}"


class InertialUnit(SampledBlock):
    r"""Sample what an inertial measurement unit at a frame tells.

    The accelerometer gives the mean specific force over a sample time T,

    .. math:: f_k = \bar R^\top \left( \frac{v_k - v_{k-1}}{T} - g \right) + b_a + n_k ,

    with the velocity v of the frame's origin and the orientation :math:`\bar R` midway between the two samples. So it
    needs no accelerations, which depend on a solver's scheme, and holds what an impact does within a sample. The
    gyroscope gives :math:`R_k^\top \omega_k + b_g + n_k`, the attitude the true orientation. The first sample has none
    before it, and takes the velocity as constant.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``specific_force`` (3) [m/s²], ``angular_velocity`` (3) [rad/s], both in the frame's axes;
        ``orientation`` (4): of the frame in the world, qw qx qy qz.
    """

    def __init__(self, section: Imu, plant: MultibodyPlant, frame: Frame) -> None:
        """Make the block of a section, for a frame of a finalized plant, which need not be part of the diagram."""
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
            delay=section.late_samples,
            at_once=True,
        )
        self._plant, self._frame = weakref.proxy(plant), frame.index()
        self._gravity = plant.gravity_field().gravity_vector()
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self.seed = section.seed
        self._noise = np.repeat([section.accelerometer_noise, section.gyroscope_noise], 3)
        self._bias = np.repeat([section.accelerometer_bias, section.gyroscope_bias], 3)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return force and rates by the motion since the last sample."""
        plant, scratch, count = self._plant, self._scratch, int(memory["count"][0])
        plant.SetPositionsAndVelocities(scratch, read["state"])
        frame = plant.get_frame(self._frame)
        pose, motion = frame.CalcPoseInWorld(scratch), frame.CalcSpatialVelocityInWorld(scratch)
        velocity, orientation = motion.translational(), xyz_quaternion_from_transform(pose)[3:]
        before, last = (memory["orientation"], memory["velocity"]) if count else (orientation, velocity)
        middle = before + np.copysign(1.0, before @ orientation) * orientation
        to_frame = transform_from_xyz_quaternion([0, 0, 0, *middle]).rotation().inverse()
        force = to_frame @ ((velocity - last) / self.period - self._gravity)
        rates = pose.rotation().inverse() @ motion.rotational()
        wrong = self._bias * normal(self.seed, 0, 6) + self._noise * normal(self.seed, count + 1, 6)
        measured = np.concatenate([force, rates]) + wrong
        outputs = {"specific_force": measured[:3], "angular_velocity": measured[3:], "orientation": orientation}
        return {**outputs, "velocity": velocity, "count": count + 1}


Axes = Literal["world", "base", "frame"]
_RELATIVE = {"pose": POSE, "velocity": VELOCITY}


class FrameSensor(Sensor):
    """Where a frame is as another sees it, and how it moves there."""

    kind: Literal["frame"]
    frame: str
    """A link or a tool of a robot, a piece (its TCP), or `world`."""
    offset: Pose = ORIGIN
    """Pose of what is measured in that frame, [x y z Rz Ry Rx]."""
    base: str = WORLD
    """The frame that it is seen from, likewise."""
    base_offset: Pose = ORIGIN
    """Pose of that in its frame."""
    axes: Axes = "base"
    """In whose axes position and velocities are told: `world`, `base` or `frame`."""
    turning: Boolean = True
    """Whether the velocity is that which one sees who turns with these axes; else that which the world sees."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the frames exist."""
        check_frame(station, f"{key}.frame", self.frame)
        check_frame(station, f"{key}.base", self.base)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``frame_pose.<sensor>`` (7) [m], and ``frame_velocity.<sensor>`` (6): linear, then angular."""
        ends = (
            (frame_of(site.plant, self.base), transform_from_pose(self.base_offset)),
            (frame_of(site.plant, self.frame), transform_from_pose(self.offset)),
        )
        block = RelativeMotion(plant=site.plant.plant, ends=ends, axes=self.axes, turning=self.turning)
        add_and_connect(builder, f"sensor.{name}", block, site.state)
        site.picture.draw(
            f"sensor.{name}", "sensor", sensor_label(message("parts.block_transform_sensor", "Transform sensor"), name)
        )
        for part, (columns, units, quantity) in _RELATIVE.items():
            names, output = axis_names("frame", name, columns), f"frame_{part}.{name}"
            heading = message("parts.frame_from", "'{frame}' from '{base}'", frame=self.frame, base=self.base)
            panel = Panel(f"frame_{name}", heading, QUANTITY_WORDS[part], quantity, names[:3])
            signal = Signal(names, units, "pose" if part == "pose" else "motion", output, part=name, panel=panel)
            site.outputs.add(output, block.GetOutputPort(part), signal)
        site.outputs.notes[name] = {"kind": self.kind, "frame": self.frame, "base": self.base}


class RelativeMotion(Block):
    r"""Tell how a frame stands and moves as another sees it, from the state of their plant.

    From the origin of the base B to that of the frame F, in the axes E of the world, the base or the frame itself,

    .. math:: p = R_E^\top (p_F - p_B), \qquad
        v = R_E^\top \bigl(v_F - v_B - \Omega \times (p_F - p_B)\bigr), \qquad
        \omega = R_E^\top (\omega_F - \omega_B),

    where :math:`\Omega` is how fast these axes turn, or zero for a velocity as the world sees it. The orientation is
    that of the frame in the base.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``pose`` (7): x y z [m] qw qx qy qz; ``velocity`` (6): linear, then angular [m/s, rad/s]; ``motion`` (13):
        both.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        ends: tuple[tuple[Frame, RigidTransform], tuple[Frame, RigidTransform]],
        axes: Axes = "base",
        turning: bool = True,
    ) -> None:
        """Make the block for a finalized plant, which need not be part of the diagram.

        ``ends`` are base and frame, each with the pose in it of what is meant; ``axes`` those in which position and
        velocities are told; ``turning``: the velocity is that which those axes see.
        """
        super().__init__()
        self._plant = weakref.proxy(plant)
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._ends = [(frame.index(), pose) for frame, pose in ends]
        self._axes, self._turning = axes, turning
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("pose", 7, weakly(self._pose))
        self.DeclareVectorOutputPort("velocity", 6, weakly(self._velocity))
        self._motion = self.DeclareVectorOutputPort("motion", 13, weakly(self._move))

    def _pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._motion.Eval(context)[:7])

    def _velocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._motion.Eval(context)[7:])

    def _move(self, context: Context, output: BasicVector) -> None:
        self._plant.SetPositionsAndVelocities(self._scratch, self._state.Eval(context))
        (base, slow), (frame, fast) = (self._seen(index, offset) for index, offset in self._ends)
        seen = base.inverse().multiply(frame)
        arm = frame.translation() - base.translation()
        if self._turning and self._axes != "world":  # one of them as if it were fixed to the axes where the other is
            slow, fast = (slow.Shift(arm), fast) if self._axes == "base" else (slow, fast.Shift(-arm))
        speed, place = fast - slow, seen.translation()
        if self._axes == "world":
            place = arm
        else:
            speed = speed.Rotate((base if self._axes == "base" else frame).rotation().inverse())
        if self._axes == "frame":
            place = seen.rotation().inverse().multiply(place)
        motion, turn = speed.get_coeffs(), seen.rotation().ToQuaternion().wxyz()
        output.SetFromVector(np.concatenate([place, turn, motion[3:], motion[:3]]))

    def _seen(self, index: FrameIndex, offset: RigidTransform) -> tuple[RigidTransform, SpatialVelocity]:
        """Return pose and velocity in the world of what is at an offset in a frame."""
        frame = self._plant.get_frame(index)
        pose, velocity = frame.CalcPoseInWorld(self._scratch), frame.CalcSpatialVelocityInWorld(self._scratch)
        return pose.multiply(offset), velocity.Shift(pose.rotation().multiply(offset.translation()))
