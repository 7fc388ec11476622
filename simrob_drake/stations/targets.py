"""What sensors can be fixed to: bodies, shapes and frames of a station, by the names that its file knows."""

from __future__ import annotations

from collections.abc import Iterator

from pydrake.geometry import GeometryId, Role
from pydrake.multibody.tree import Frame, ModelInstanceIndex, RigidBody

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.names import WORLD, piece_model, robot_model
from simrob_drake.stations.plant import StationPlant
from simrob_drake.stations.shapes import FLOOR, own_name, piece_of_shape


def body_names(config: StationConfig) -> list[str]:
    """Return what a force or a distance can be measured at: robots, links, pieces, shapes of pieces, the floor."""
    pieces = [
        name
        for piece in config.pieces
        for name in (piece, *(f"{piece}.{shape}" for shape in piece_model(config, piece).shape_names))
    ]
    return [*config.robots, *_link_names(config), *pieces, *([FLOOR] if config.floor else [])]


def frame_names(config: StationConfig) -> list[str]:
    """Return in whose axes a force can be given: the world, robots' links and tools, and pieces (their TCP)."""
    tools = [f"{config.prefix(robot)}{tool}" for robot in config.robots for tool in robot_model(config, robot).tools]
    return [WORLD, *_link_names(config), *tools, *config.pieces]


def check_body(config: StationConfig, key: str, name: str) -> None:
    """Check that a body or shape of a sensor exists.

    Raises:
        UnknownName: with the nearest known name.
    """
    if name == FLOOR and config.floor is None:
        raise InvalidParameter(key, name, "something that the station has; it has no floor: section")
    if name not in body_names(config):
        raise UnknownName(f"body or shape for {key}", name, body_names(config))


def shapes_of(station: StationPlant, config: StationConfig, name: str) -> list[GeometryId]:
    """Return the collision shapes of a body.

    Raises:
        InvalidParameter: it has none.
    """
    found = list(_candidates(station, config, name))
    if not found:
        raise InvalidParameter("sensor", f"at {name}", "a body with shapes that collide")
    return found


def frame_of(station: StationPlant, name: str) -> Frame:
    """Return a frame by one of :func:`frame_names`."""
    if name == WORLD:
        return station.plant.world_frame()
    for robot in station.robots.values():
        own = name.removeprefix(robot.prefix)
        if own in robot.tools and name.startswith(robot.prefix):
            return robot.tools[own]
        if name.startswith(robot.prefix) and station.plant.HasFrameNamed(own, robot.instance):
            return station.plant.GetFrameByName(own, robot.instance)
    return station.plant.GetFrameByName(f"{name}_tcp")


def _candidates(station: StationPlant, config: StationConfig, name: str) -> Iterator[GeometryId]:
    inspector, piece = station.scene_graph.model_inspector(), name.partition(".")[0]
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        if name == FLOOR:
            meant = inspector.GetName(shape) == FLOOR
        elif piece in config.pieces:
            own = own_name(inspector, shape)
            meant = piece_of_shape(config, inspector, shape) == piece and f"{own}.".startswith(f"{name}.")
        else:
            meant = _is_robots(station, station.plant.GetBodyFromFrameId(inspector.GetFrameId(shape)), name)
        if meant:
            yield shape


def _is_robots(station: StationPlant, body: RigidBody, name: str) -> bool:
    """Tell whether a body is part of the robot, or of the link of a robot, that is called ``name``."""
    for robot in station.robots.values():
        if body.model_instance() == robot.instance:
            return name == robot.name or _is_part(station, robot.instance, name.removeprefix(robot.prefix), body)
    return False


def _is_part(station: StationPlant, instance: ModelInstanceIndex, link: str, body: RigidBody) -> bool:
    """Tell whether a link is a body, or has been made part of it."""
    plant = station.plant
    return plant.HasFrameNamed(link, instance) and bool(
        plant.GetFrameByName(link, instance).body().index() == body.index()
    )


def _link_names(config: StationConfig) -> list[str]:
    return [
        f"{config.prefix(robot)}{link.get('name')}"
        for robot in config.robots
        for link in robot_model(config, robot).element.iterfind("link")
    ]
