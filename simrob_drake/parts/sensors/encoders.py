r"""Encoders of joints: what a controller knows of the axes, with resolution, noise and delay.

A sample tells positions rounded to the resolution, and as speed what incremental encoders give: their difference over
a sample, smoothed with the time constant :math:`T_s`,

.. math:: \hat q_k = \mathrm{round}(q_k + n_k), \qquad
    \hat v_k = \hat v_{k-1} + \frac{T}{T + T_s}\left( \frac{\hat q_k - \hat q_{k-1}}{T} - \hat v_{k-1} \right) .
"""

from typing import Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.frames import Vector
from simrob_drake.parts.sensors.sensor import SampledSensor, axis_names, normal, rounded
from simrob_drake.parts.site import ResolvedRobot, Site, Surroundings
from simrob_drake.sections import Integer, NotNegative
from simrob_drake.signals import Panel, Signal


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

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot exists."""
        station.robot(self.robot, key)

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
            label = f"{output} [{', '.join(dict.fromkeys(units))}]"
            panel = Panel(f"encoders_{name}", f"the encoders '{name}'", output, label, names)
            signals[output] = Signal(names, units, "motion", part=name, panel=panel)
        inputs = {"position": site.port(builder, f"{robot.prefix}position")}
        self._give(builder, site, name, block=block, title="Encoders", inputs=inputs, signals=signals, robot=robot)
        site.notes[name] = {"kind": self.kind}


class JointEncoders(SampledBlock):
    """Sample joint positions, and take their differences as speeds.

    Ports:
        in  ``position`` (n) [rad].
        out ``position`` (n) [rad], ``velocity`` (n) [rad/s]; zero speed at the first sample.
    """

    def __init__(self, section: Encoders, units: Vector, resolution: Vector) -> None:
        """Make the block of a section, for n axes whose users' units are so large in SI, shape (n,).

        ``resolution`` (n,) is in these units.
        """
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
        position = rounded(read["position"] + noise, self._resolution)
        difference = (position - memory["position"]) / self.period if count else np.zeros_like(position)
        velocity = memory["velocity"] + self._share * (difference - memory["velocity"])
        return {"position": position, "velocity": velocity, "count": count + 1}
