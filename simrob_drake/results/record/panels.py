"""The panels of a run's plots, until the parts declare them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from simrob_drake.signals import Panel
from simrob_drake.stations.names import named
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.sensor_config import Distance, ExternalTorque, Force
from simrob_drake.stations.sensors import tangential_source


def panels_of(ports: StationPorts, names: Sequence[str]) -> Iterator[Panel]:
    """Yield the panels of free pieces and sensors whose columns are among the names of a run's signals."""
    for piece in ports.config.free_pieces:
        about, own = (f"piece_{piece}", f"the piece '{piece}' in the world"), f"piece.{piece}"
        yield Panel(*about, "position", "position [m]", tuple(f"{own}.{axis}" for axis in "xyz"))
        yield Panel(*about, "velocity", "velocity [m/s]", tuple(f"{own}.v{axis}" for axis in "xyz"))
    for name, sensor in ports.config.sensors.items():
        match sensor:
            case Force():
                source = tangential_source(ports.plant, ports.config, sensor)
                across = "" if source == "contact" else f" (along the surface: {source})"
                title, label = f"contact force '{name}'{across}", "force [N]"
                columns = tuple(f"force.{name}.{axis}" for axis in "xyz")
            case Distance():
                title, label, columns = f"distance '{name}'", "distance [m]", (f"distance.{name}",)
            case ExternalTorque() if f"external_force.{name}.x" in names:
                title, label = f"force at the tool, estimated by '{name}', in its axes", "force [N]"
                columns = tuple(f"external_force.{name}.{axis}" for axis in "xyz")
            case _:
                robot = named(getattr(sensor, "robot", None), list(ports.plant.robots))
                units = dict.fromkeys(ports.plant.robots[robot].model.effort_units)
                title, label = f"{sensor.kind.replace('_', ' ')} '{name}'", f"torque [{', '.join(units)}]"
                columns = tuple(column for column in names if column.startswith(f"{sensor.kind}.{name}."))
        yield Panel("sensors", "sensors", title, label, columns)
