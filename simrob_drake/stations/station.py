"""Compose a station: plant, servos, poses, sensors, monitors."""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

from pydrake.systems.framework import Diagram, DiagramBuilder

from simrob_drake.errors import InvalidParameter, shortened
from simrob_drake.lifetime import release
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.dynamic import add_dynamic_robots
from simrob_drake.stations.free_pieces import add_free_pieces
from simrob_drake.stations.kinematic import add_kinematic_robots
from simrob_drake.stations.load import load_station
from simrob_drake.stations.monitoring import add_monitors
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.poses import add_poses
from simrob_drake.stations.sensors import add_sensors

StationLike: TypeAlias = "str | Path | StationConfig | Station"
"""What users mean a station by: a name, a YAML file, a configuration, or a built station."""


def config_of(station: StationLike) -> StationConfig:
    """Return the configuration that a user means by a station.

    Raises:
        SimrobError: as :func:`load_station`.
        InvalidParameter: something that is no station.
    """
    if isinstance(station, Station):
        return station.config
    if isinstance(station, StationConfig):
        return station
    if isinstance(station, (str, Path)):
        return load_station(station)
    known = "a name of `simrob list`, a YAML file, what load_station() gives, or a built station"
    raise InvalidParameter("station", shortened(repr(station)), known)


def add_station(builder: DiagramBuilder, config: StationConfig | str | Path) -> StationPorts:
    """Add a station's systems to a diagram under construction, flat, with the plant named ``plant``.

    This is the primitive, as ``AddMultibodyPlantSceneGraph`` is: it leaves the inputs open, so the caller connects or
    exports each of them. The scheme ``cenic`` needs the plant to be a direct child of the root diagram, so a station
    that uses it is added to the root's builder.

    Args:
        builder: the diagram under construction.
        config: what :func:`load_station` gave, or what it takes.

    Returns:
        the station's ports, with its plant.
    """
    config = config_of(config)
    plant = add_plant(builder, config)
    ports = (
        add_kinematic_robots(builder, plant, config)
        if config.mode == "kinematic"
        else add_dynamic_robots(builder, plant, config)
    )
    add_poses(builder, ports)
    add_free_pieces(builder, ports)
    add_sensors(builder, ports)
    add_monitors(builder, ports)
    return ports


class Station(Diagram):
    """A station as one box: the systems of :func:`add_station` with every port exported under its name.

    Attributes:
        config: the station's configuration.
        ports: the ports inside; the box exports each under the same name.
    """

    def __init__(self, config: StationConfig | str | Path) -> None:
        """Build the box."""
        super().__init__()
        self.config = config_of(config)
        builder = DiagramBuilder()
        self.ports = add_station(builder, self.config)
        for name, port in self.ports.inputs.items():
            builder.ExportInput(port, name)
        for name, output in self.ports.outputs.items():
            builder.ExportOutput(output, name)
        builder.BuildInto(self)
        release(builder, self)
        self.set_name(self.config.name)


def build_station(config: StationConfig | str | Path) -> Station:
    """Return a station as one Diagram, its ports exported by name."""
    return Station(config)
