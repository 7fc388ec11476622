r"""How a frame stands and moves as another sees it: Simscape Multibody's Transform Sensor.

From the origin of the base B to that of the frame F, in the axes E of the world, the base or the frame itself,

.. math:: p = R_E^\top (p_F - p_B), \qquad
    v = R_E^\top \bigl(v_F - v_B - \Omega \times (p_F - p_B)\bigr), \qquad
    \omega = R_E^\top (\omega_F - \omega_B),

where :math:`\Omega` is how fast these axes turn, or zero for a velocity as the world sees it. The orientation is that
of the frame in the base.
"""

import weakref
from typing import Literal

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder

from simrob_drake.blocks.block import Block
from simrob_drake.blocks.wiring import fed
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector, transform_from_pose, xyz_quaternion_from_transform
from simrob_drake.lifetime import weakly
from simrob_drake.parts.sensors.sensor import Sensor, axis_names, sensor_label
from simrob_drake.parts.site import WORLD, Site, Surroundings
from simrob_drake.parts.targets import check_frame, frame_of
from simrob_drake.sections import ORIGIN, Boolean, Pose
from simrob_drake.signals import Panel, Signal

Axes = Literal["world", "base", "frame"]
_PARTS = {
    "pose": (XYZ_QUATERNION_NAMES, ("m",) * 3 + ("1",) * 4, "position [m]"),
    "velocity": (("vx", "vy", "vz", "wx", "wy", "wz"), ("m/s",) * 3 + ("rad/s",) * 3, "velocity [m/s]"),
}


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
        fed(builder, f"sensor.{name}", block, site.state)
        site.draw(f"sensor.{name}", "sensor", sensor_label("Transform sensor", name))
        for part, (columns, units, quantity) in _PARTS.items():
            names, output = axis_names("frame", name, columns), f"frame_{part}.{name}"
            panel = Panel(f"frame_{name}", f"'{self.frame}' from '{self.base}'", part, quantity, names[:3])
            signal = Signal(names, units, "pose" if part == "pose" else "motion", output, part=name, panel=panel)
            site.add(output, block.GetOutputPort(part), signal)
        site.notes[name] = {"kind": self.kind, "frame": self.frame, "base": self.base}


class RelativeMotion(Block):
    """Tell how a frame stands and moves as another sees it, from the state of their plant.

    Ports:
        in  ``state`` (nq + nv): positions and velocities of the whole plant.
        out ``pose`` (7): x y z [m] qw qx qy qz; ``velocity`` (6): linear, then angular [m/s, rad/s].
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

        Args:
            plant: that the frames are of.
            ends: the base and the frame, each with the pose in it of what is meant.
            axes: in which position and velocities are told.
            turning: whether the velocity is that which those axes see.
        """
        super().__init__()
        self._plant = weakref.proxy(plant)
        self._scratch = plant.CreateDefaultContext()  # nothing is remembered in it: every evaluation sets it anew
        self._ends = [(frame.index(), pose) for frame, pose in ends]
        self._axes, self._turning = axes, turning
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        for name, calc, (columns, *_) in zip(_PARTS, (self._pose, self._velocity), _PARTS.values(), strict=True):
            self.DeclareVectorOutputPort(name, len(columns), weakly(calc))

    def _seen(self, context: Context) -> tuple[list[RigidTransform], list[Vector], list[Vector], int | None]:
        """Return poses, velocities and turning rates of both ends in the world, and which end's axes are asked."""
        self._plant.SetPositionsAndVelocities(self._scratch, self._state.Eval(context))
        poses, speeds, rates = [], [], []
        for index, offset in self._ends:
            frame = self._plant.get_frame(index)
            pose, motion = frame.CalcPoseInWorld(self._scratch), frame.CalcSpatialVelocityInWorld(self._scratch)
            arm = pose.rotation() @ offset.translation()
            poses.append(pose @ offset)
            speeds.append(motion.translational() + np.cross(motion.rotational(), arm))
            rates.append(motion.rotational())
        return poses, speeds, rates, {"world": None, "base": 0, "frame": 1}[self._axes]

    def _pose(self, context: Context, output: BasicVector) -> None:
        (base, frame), _, _, axes = self._seen(context)
        place, turn = frame.translation() - base.translation(), base.rotation().inverse() @ frame.rotation()
        if axes is not None:
            place = (base, frame)[axes].rotation().inverse() @ place
        output.SetFromVector(xyz_quaternion_from_transform(RigidTransform(turn, place)))

    def _velocity(self, context: Context, output: BasicVector) -> None:
        poses, speeds, rates, axes = self._seen(context)
        speed, rate = speeds[1] - speeds[0], rates[1] - rates[0]
        if axes is not None:
            if self._turning:
                speed = speed - np.cross(rates[axes], poses[1].translation() - poses[0].translation())
            back = poses[axes].rotation().inverse()
            speed, rate = back @ speed, back @ rate
        output.SetFromVector(np.concatenate([speed, rate]))
