r"""An inertial measurement unit: accelerometer, gyroscope and attitude, at a frame of a station.

The accelerometer gives the mean specific force over a sample time T,

.. math:: f_k = \bar R^\top \left( \frac{v_k - v_{k-1}}{T} - g \right) + b_a + n_k ,

with the velocity v of the frame's origin and the orientation :math:`\bar R` midway between the two samples. So it needs
no accelerations, which depend on a solver's scheme, and holds what an impact does within a sample. The gyroscope gives
:math:`R_k^\top \omega_k + b_g + n_k`, the attitude the true orientation.
"""

import weakref
from typing import Literal

import numpy as np
from pydantic import Field
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.frames import transform_from_xyz_quaternion, xyz_quaternion_from_transform
from simrob_drake.parts.sensors.sensor import SampledSensor, axis_names, normal
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.parts.targets import check_frame, frame_of
from simrob_drake.sections import Integer, NotNegative
from simrob_drake.signals import Panel, Signal

_PARTS = {
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
        for part, (axes, unit) in _PARTS.items():
            names, quantity = axis_names(part, name, axes), part.replace("_", " ")
            panel = Panel(f"imu_{name}", f"the IMU '{name}'", quantity, f"{quantity} [{unit}]", names)
            signals[part] = Signal(names, (unit,) * len(names), "inertial", part=name, panel=panel)
        self._give(builder, site, name, block=block, title="IMU", inputs={"state": site.state}, signals=signals)
        site.notes[name] = {"kind": self.kind, "frame": frame}

    def _frame_name(self, station: Surroundings, key: str) -> str:
        if self.frame is not None:
            return self.frame
        robot = station.robot(None, f"{key}.frame")
        return f"{robot.prefix}{robot.model.root}"


class InertialUnit(SampledBlock):
    """Sample what an inertial measurement unit at a frame tells.

    The first sample has none before it, and takes the velocity as constant.

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
            gives=list(_PARTS),
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
