"""Torque at the joints that the model does not explain."""

from __future__ import annotations

from functools import partial
from typing import Literal

from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.momentum_observer import MomentumObserver
from simrob_drake.lifetime import release_with
from simrob_drake.parts.sensors.sensor import Sensor, axis_names, replayed, sensor_label
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.quantities import Positive
from simrob_drake.signals import Signal, sensor_panel


class ExternalTorque(Sensor):
    """Torque at the joints that the model does not explain, and the force at the tool that would cause it.

    A momentum observer; see :mod:`simrob_drake.blocks.momentum_observer`.
    """

    kind: Literal["external_torque"]
    robot: str | None = None
    """Whose joints; the only robot's unless given."""
    gain: Positive = 50.0
    """How fast the estimate follows [1/s]; it lags by 1/gain."""
    rate: Positive = 200.0
    """Samples a second [Hz]."""
    in_loop: bool = False
    """Sample while stepping, so that blocks can read it; otherwise it is computed after the run and costs nothing."""

    @property
    def stepped(self) -> bool:
        """Whether it samples while stepping."""
        return self.in_loop

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
        inputs = {"state": site.state, "torque": site.outputs[f"{robot.prefix}torque"]}
        if self.in_loop:
            builder.AddNamedSystem(f"sensor.{name}", observer)
            site.draw(f"sensor.{name}", "sensor", sensor_label("Momentum observer", name), robot)
            for port, source in inputs.items():
                builder.Connect(source, observer.GetInputPort(port))
        else:
            release_with(site.plant.plant, observer)
        contents = {"external_torque": (robot.axes, robot.model.effort_units)}
        if robot.tcp:
            contents["external_force"] = (["x", "y", "z"], ["N"] * 3)
        for port, (axes, units) in contents.items():
            names, output = axis_names(port, name, axes), f"{port}.{name}"
            force = port == "external_force"
            title = f"force at the tool, estimated by '{name}', in its axes" if force else f"external torque '{name}'"
            panel = sensor_panel(title, "force" if force else "torque", names, units)
            signal = Signal(
                names,
                tuple(units),
                "estimate",
                output if self.in_loop else "",
                compute=None if self.in_loop else partial(replayed, block=observer, inputs=inputs, output=port),
                part=name,
                panel=panel if force or not robot.tcp else None,
            )
            if self.in_loop:
                site.add(output, observer.GetOutputPort(port), signal)
            else:
                site.signals.append(signal)
