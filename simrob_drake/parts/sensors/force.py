r"""Contact force and moment on a body, as they are or as a sensor tells them: sampled, rounded, noisy and late.

A sample tells :math:`\hat f_k = \mathrm{round}(f_k + n_k)`, as many samples late as the delay lasts.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.geometry import GeometryId
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from simrob_drake.blocks.contacts import ContactReader, ForceSensor
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.sensors.momentum_balance import MomentumBalance
from simrob_drake.parts.sensors.sampled import normal, rounded
from simrob_drake.parts.sensors.sensor import ShapeSensor, axis_names, check_contact, sampled, sensor_label
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.parts.targets import check_body, check_frame, frame_of, shapes_of
from simrob_drake.sections import Integer, NotNegative
from simrob_drake.signals import Signal, sensor_panel

_CONTACTS = "contacts"

Tangential = Literal["contact", "momentum balance", "left out"]
"""Where a force along the surfaces comes from. The scheme ``cenic`` gives it wrongly: there it is found after the run
from the momentum of the model that the sensor sits on, if that stands free; of an arm, whose base holds it, and in a
loop it cannot be told."""


class Force(ShapeSensor):
    """Contact force [N] and moment [N·m] on a body."""

    kind: Literal["force"]
    other: str | None = None
    """What presses on the body: a robot, a link, a piece, a shape of a piece, or `floor`; everything unless given."""
    frame: str = "world"
    """In whose axes force and moment are given, and about whose origin the moment: `world`, a tool, link or piece."""
    resolution: NotNegative = 0.0
    """Step from one force that it tells to the next [N]; 0 for none."""
    moment_resolution: NotNegative = 0.0
    """Likewise [N·m]."""
    noise: NotNegative = 0.0
    """Standard deviation of a sample of each axis of the force [N]."""
    moment_noise: NotNegative = 0.0
    """Likewise [N·m]."""
    delay: NotNegative = 0.0
    """How late it tells them [s], to the nearest sample."""
    seed: Integer = Field(default=0, ge=0)
    """Of the noise: the same seed, the same figures."""

    @property
    def _errs(self) -> bool:
        errors = self.resolution, self.moment_resolution, self.noise, self.moment_noise, self.delay
        return any(errors)

    @model_validator(mode="after")
    def _samples_to_err(self) -> Force:
        if self._errs and self.rate is None:
            raise ValueError("a force sensor with noise, a resolution or a delay samples: it needs a rate")
        return self

    def check(self, key: str, station: Surroundings) -> None:
        """Check that its bodies and its frame exist, and that the station computes contacts."""
        check_body(station, f"{key}.body", self.body)
        if self.other is not None:
            check_body(station, f"{key}.other", self.other)
        if station.mode == "kinematic":
            expected = "in a dynamic station: a kinematic one computes no contacts (a distance sensor works there)"
            raise InvalidParameter(key, "a force sensor in a kinematic station", expected)
        check_frame(station, f"{key}.frame", self.frame)
        check_contact(key, "a force sensor", station)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``force.<sensor>`` (3) [N] and ``moment.<sensor>`` (3) [N·m]."""
        plant, frame = site.plant.plant, frame_of(site.plant, self.frame)
        body = shapes_of(site.plant, site.station, self.body)
        other = None if self.other is None else shapes_of(site.plant, site.station, self.other)
        block = ForceSensor(
            plant=plant, body=body, other=other, frame=frame, normal_only=site.station.scheme == "cenic"
        )
        poses = site.plant.stepped.get_body_poses_output_port()
        wrench = fed(builder, f"sensor.{name}", block, _contacts(builder, site), poses)
        site.draw(f"sensor.{name}", "sensor", sensor_label("Force sensor", name, self.rate))
        split = Demultiplexer([3, 3])
        fed(builder, f"sensor.{name}.split", split, self._reported(builder, f"sensor.{name}.hold", wrench))
        tangential = self._tangential(site, body[0])
        balance = MomentumBalance(site, frame, body, other) if tangential == "momentum balance" else None
        site.notes[name]["tangential"] = tangential
        across = "" if tangential == "contact" else f" (along the surface: {tangential})"
        names, moments = axis_names("force", name), axis_names("moment", name)
        felt = Signal(
            names,
            ("N",) * 3,
            "force",
            f"force.{name}",
            part=name,
            panel=sensor_panel(f"contact force '{name}'{across}", "force", names, ["N"]),
            adjust=None if balance is None else balance.with_friction,
        )
        site.add(f"force.{name}", split.get_output_port(0), felt)
        moment = Signal(moments, ("N·m",) * 3, "moment", f"moment.{name}", part=name)
        site.add(f"moment.{name}", split.get_output_port(1), moment)

    def _reported(self, builder: DiagramBuilder, name: str, wrench: OutputPort) -> OutputPort:
        """Return what the sensor tells of a wrench (6)."""
        if self.rate is None or not self._errs:
            return sampled(builder, name, wrench, self.rate)
        block = MeasuredWrench(
            period=1 / self.rate,
            delay=round(self.delay * self.rate),
            resolution=np.repeat([self.resolution, self.moment_resolution], 3),
            noise=np.repeat([self.noise, self.moment_noise], 3),
            seed=self.seed,
        )
        return fed(builder, name, block, wrench)

    def _tangential(self, site: Site, shape: GeometryId) -> Tangential:
        if site.station.scheme != "cenic":
            return "contact"
        plant, inspector = site.plant.plant, site.plant.scene_graph.model_inspector()
        instance = plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).model_instance()
        free = any(plant.get_body(index).is_floating_base_body() for index in plant.GetBodyIndices(instance))
        return "momentum balance" if free and self.rate is None else "left out"


class MeasuredWrench(SampledBlock):
    """Sample a force and a moment as a sensor tells them.

    Ports:
        in  ``wrench`` (6): force [N], then moment [N·m].
        out ``wrench`` (6), likewise.
    """

    def __init__(self, *, period: float, delay: int, resolution: Vector, noise: Vector, seed: int) -> None:
        """Make the block.

        Args:
            period: between samples [s].
            delay: by how many samples it tells them late.
            resolution: of each figure, shape (6,) [N and N·m]; 0 for none.
            noise: standard deviation of each, shape (6,), likewise.
            seed: of the noise.
        """
        memory = {"wrench": np.zeros(6), "count": np.zeros(1)}
        super().__init__(
            period=period, reads={"wrench": 6}, memory=memory, gives=("wrench",), delay=delay, at_once=True
        )
        self._resolution, self._noise, self.seed = resolution, noise, seed

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what the sensor tells now."""
        count = int(memory["count"].item())
        measured = rounded(read["wrench"] + self._noise * normal(self.seed, count, 6), self._resolution)
        return {"wrench": measured, "count": count + 1}


def _contacts(builder: DiagramBuilder, site: Site) -> OutputPort:
    """Return the port of the block that reads the plant's contacts for all sensors; the first one adds it."""
    if site.plant.engine is not None:
        return site.plant.engine.get_contact_results_output_port()
    if not builder.HasSubsystemNamed(_CONTACTS):
        fed(builder, _CONTACTS, ContactReader(), site.plant.stepped.get_contact_results_output_port())
        site.draw_nothing(_CONTACTS)
    return builder.GetSubsystemByName(_CONTACTS).get_output_port()
