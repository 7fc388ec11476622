"""Signed distance between two things."""

from typing import Literal

from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.distance_sensor import DistanceSensor
from simrob_drake.blocks.wiring import fed
from simrob_drake.parts.sensors.sensor import ShapeSensor, check_contact, sampled, sensor_label
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.parts.targets import check_body, shapes_of
from simrob_drake.signals import Signal, sensor_panel


class Distance(ShapeSensor):
    """Signed distance between two things [m]; negative: how deep they are in each other."""

    kind: Literal["distance"]
    other: str = "floor"
    """A robot, a link, a piece, a shape of a piece, or `floor`."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that both things exist, and that the plant has shapes."""
        check_body(station, f"{key}.body", self.body)
        check_body(station, f"{key}.other", self.other)
        if station.mode == "dynamic":
            check_contact(key, "a distance sensor", station)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``distance.<sensor>`` (1) [m]."""
        body, other = (shapes_of(site.plant, site.station, target) for target in (self.body, self.other))
        scene_graph = site.plant.scene_graph
        block = DistanceSensor(body=body, other=other, inspector=scene_graph.model_inspector())
        distance = fed(builder, f"sensor.{name}", block, scene_graph.get_query_output_port())
        site.draw(f"sensor.{name}", "sensor", sensor_label("Distance sensor", name, self.rate))
        port, output = sampled(builder, f"sensor.{name}.hold", distance, self.rate), f"distance.{name}"
        panel = sensor_panel(f"distance '{name}'", "distance", [output], ["m"])
        site.add(output, port, Signal((output,), ("m",), "distance", output, part=name, panel=panel))
