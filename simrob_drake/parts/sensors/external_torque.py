"""Torque at the joints that the model does not explain."""

from typing import Literal

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.blocks.wiring import joined, mapped
from simrob_drake.parts.sensors.sensor import SampledSensor, axis_names
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.sections import Positive
from simrob_drake.signals import Signal, sensor_panel


class ExternalTorque(SampledSensor):
    """Torque at the joints that the model does not explain, and the force at the tool that would cause it.

    A momentum observer; see :mod:`simrob_drake.blocks.momentum_observer`.
    """

    kind: Literal["external_torque"]
    robot: str | None = None
    """Whose joints; the only robot's unless given."""
    gain: Positive = 50.0
    """How fast the estimate follows [1/s]; it lags by 1/gain."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot exists."""
        station.robot(self.robot, key)

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
            felt = joined(builder, f"{name}.torque_and_state", torque, site.state)
            torque = mapped(builder, f"{name}.motor_torque", every, felt)
        contents = {"external_torque": (robot.axes, robot.model.effort_units)}
        if robot.tcp:
            contents["external_force"] = (["x", "y", "z"], ["N"] * 3)
        signals = {}
        for port, (axes, units) in contents.items():
            names, force = axis_names(port, name, axes), port == "external_force"
            title = f"force at the tool, estimated by '{name}', in its axes" if force else f"external torque '{name}'"
            panel = sensor_panel(title, "force" if force else "torque", names, units)
            shown = panel if force or not robot.tcp else None
            signals[port] = Signal(names, tuple(units), "estimate", part=name, panel=shown)
        self._give(
            builder,
            site,
            name,
            block=observer,
            title="Momentum observer",
            inputs={"state": site.state, "torque": torque},
            signals=signals,
            robot=robot,
        )
