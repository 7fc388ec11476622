"""Contact force and moment on a body."""

from typing import Literal

from pydrake.geometry import GeometryId
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from simrob_drake.blocks.contacts import ContactReader, ForceSensor
from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.sensors.momentum_balance import Balance
from simrob_drake.parts.sensors.sensor import ShapeSensor, axis_names, check_contact, sampled, sensor_label
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.parts.targets import check_body, check_frame, frame_of, shapes_of
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
        poses = plant.get_body_poses_output_port()
        wrench = fed(builder, f"sensor.{name}", block, _contacts(builder, site), poses)
        site.draw(f"sensor.{name}", "sensor", sensor_label("Force sensor", name, self.rate))
        split = Demultiplexer([3, 3])
        fed(builder, f"sensor.{name}.split", split, sampled(builder, f"sensor.{name}.hold", wrench, self.rate))
        tangential = self._tangential(site, body[0])
        balance = Balance(site, frame, body, other) if tangential == "momentum balance" else None
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

    def _tangential(self, site: Site, shape: GeometryId) -> Tangential:
        if site.station.scheme != "cenic":
            return "contact"
        plant, inspector = site.plant.plant, site.plant.scene_graph.model_inspector()
        instance = plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).model_instance()
        free = any(plant.get_body(index).is_floating_base_body() for index in plant.GetBodyIndices(instance))
        return "momentum balance" if free and self.rate is None else "left out"


def _contacts(builder: DiagramBuilder, site: Site) -> OutputPort:
    """Return the port of the block that reads the plant's contacts for all sensors; the first one adds it."""
    if not builder.HasSubsystemNamed(_CONTACTS):
        fed(builder, _CONTACTS, ContactReader(), site.plant.plant.get_contact_results_output_port())
        site.draw_nothing(_CONTACTS)
    return builder.GetSubsystemByName(_CONTACTS).get_output_port()
