"""What a station shows to the diagram around it: its named ports."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import PassThrough

from simrob_drake.parts.site import Site, StationRobot
from simrob_drake.stations.config import StationConfig


@dataclass(frozen=True, kw_only=True, repr=False)
class StationPorts(Site):
    """The ports of a station; names carry the prefix ``<robot>.`` where there are several robots.

    Attributes of :class:`~simrob_drake.parts.site.Site`, and:
        config: the station's configuration.
        sources: what drives inputs from the start, by name: these need no block that hands them on.
    """

    config: StationConfig
    sources: Mapping[str, OutputPort] = field(default_factory=dict)

    def add_input(self, builder: DiagramBuilder, robot: StationRobot, name: str) -> OutputPort:
        """Add an input of one value an axis, as a block that any number of others can read."""
        if f"{robot.prefix}{name}" in self.sources:
            return self.sources[f"{robot.prefix}{name}"]
        block = builder.AddNamedSystem(f"{robot.prefix}{name}", PassThrough(len(robot.joints)))
        self.inputs[f"{robot.prefix}{name}"] = block.get_input_port()
        return block.get_output_port()
