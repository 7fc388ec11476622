"""What parts can be fixed to: bodies, shapes and frames of a station, by the names that its file knows.

Collision shapes are told apart by their names, ``<owner>::<model>::<name>``: a piece's are called ``<piece>.<shape>``,
and their owner is the piece, or the robot that carries it. The floor has no owner.
"""

from collections.abc import Iterator

from pydrake.geometry import GeometryId, Role, SceneGraphInspector
from pydrake.multibody.tree import Frame, RigidBody

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD, Surroundings
from simrob_drake.parts.station_plant import StationPlant

FLOOR = "floor"  # the whole name of the floor's shape; boxes of its terrain are called `floor.<number>`


def own_name(inspector: SceneGraphInspector, shape: GeometryId) -> str:
    """Return the name that a shape has in its own file; those of pieces begin with the piece's name and a dot."""
    name: str = inspector.GetName(shape)
    return name.rsplit("::", 1)[-1]


def piece_of_shape(station: Surroundings, inspector: SceneGraphInspector, shape: GeometryId) -> str | None:
    """Return the piece that a shape belongs to; None for one of a robot's own, and the floor's."""
    scoped_owner = inspector.GetName(shape).partition("::")[0]
    if not scoped_owner.startswith(station.scope):
        return None  # it belongs to something else in a plant that the station shares
    owner = scoped_owner.removeprefix(station.scope)
    piece, dot, _ = own_name(inspector, shape).partition(".")
    found = station.pieces.get(piece) if dot else None
    return piece if found is not None and owner in (piece, found.carrier) else None


def owner_of_shape(plant: StationPlant, shape: GeometryId) -> str:
    """Return what a shape belongs to: a piece, a link of a robot, the floor, or a box of its terrain."""
    inspector = plant.scene_graph.model_inspector()
    model = inspector.GetName(shape).partition("::")[0].removeprefix(plant.scope)
    own = own_name(inspector, shape)
    robot, (piece, dot, _) = plant.robots.get(model), own.partition(".")
    if dot and (piece == model if robot is None else piece in robot.carried):
        return piece
    body = plant.plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
    return own if robot is None else f"{robot.prefix}{body.name()}"


def owner_and_robot(plant: StationPlant, shape: GeometryId) -> tuple[str, str]:
    """Return what a shape belongs to, all of the ground being the floor, and the robot that carries it, if any."""
    owner, frame = owner_of_shape(plant, shape), plant.scene_graph.model_inspector().GetFrameId(shape)
    model = plant.plant.GetBodyFromFrameId(frame).model_instance()
    robot = next((robot.name for robot in plant.robots.values() if robot.instance == model), "")
    return FLOOR if not robot and owner.partition(".")[0] == FLOOR else owner, robot


def body_names(station: Surroundings) -> list[str]:
    """Return what a force or a distance can be measured at: robots, links, pieces, shapes of pieces, the floor."""
    pieces = [
        name
        for piece in station.pieces.values()
        for name in (piece.name, *(f"{piece.name}.{shape}" for shape in piece.model.shape_names))
    ]
    return [*station.robots, *_link_names(station), *pieces, *([FLOOR] if station.ground.has_floor else [])]


def frame_names(station: Surroundings) -> list[str]:
    """Return in whose axes a vector can be given: the world, robots' links and tools, and pieces (their TCP)."""
    tools = [f"{robot.prefix}{tool}" for robot in station.robots.values() for tool in robot.model.tools]
    return [WORLD, *_link_names(station), *tools, *station.pieces]


def check_body(station: Surroundings, key: str, name: str) -> None:
    """Check that a body or shape of a sensor exists; raises UnknownName: with the nearest known name."""
    if name == FLOOR and not station.ground.has_floor:
        raise InvalidParameter(
            key, name, message("parts.no_floor", "something that the station has; it has no floor: section")
        )
    one_of(message("parts.body_or_shape_for", "body or shape for {key}", key=key), name, body_names(station))


def check_frame(station: Surroundings, key: str, name: str) -> None:
    """Check that a frame exists; raises UnknownName: with the nearest known name."""
    one_of(message("parts.frame_for", "frame for {key}", key=key), name, frame_names(station))


def shapes_of(plant: StationPlant, station: Surroundings, name: str) -> list[GeometryId]:
    """Return the collision shapes of a body; raises InvalidParameter: it has none."""
    found = list(_candidates(plant, station, name))
    if not found:
        raise InvalidParameter(
            "sensor",
            message("parts.at_body", "at {name}", name=name),
            message("parts.body_that_collides", "a body with shapes that collide"),
        )
    return found


def frame_of(plant: StationPlant, name: str) -> Frame:
    """Return a frame by one of :func:`frame_names`."""
    if name == WORLD:
        return plant.plant.world_frame()
    for robot in plant.robots.values():
        own = name.removeprefix(robot.prefix)
        if own in robot.tools and name.startswith(robot.prefix):
            return robot.tools[own]
        if name.startswith(robot.prefix) and plant.plant.HasFrameNamed(own, robot.instance):
            return plant.plant.GetFrameByName(own, robot.instance)
    return plant.piece_frame(name, f"{name}_tcp")


def _candidates(plant: StationPlant, station: Surroundings, name: str) -> Iterator[GeometryId]:
    inspector, piece = plant.scene_graph.model_inspector(), name.partition(".")[0]
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        if name == FLOOR:
            meant = inspector.GetName(shape).partition(".")[0] == FLOOR  # or a box of its terrain
        elif piece in station.pieces:
            own = own_name(inspector, shape)
            meant = piece_of_shape(station, inspector, shape) == piece and f"{own}.".startswith(f"{name}.")
        else:
            meant = _is_robots(plant, plant.plant.GetBodyFromFrameId(inspector.GetFrameId(shape)), name)
        if meant:
            yield shape


def _is_robots(plant: StationPlant, body: RigidBody, name: str) -> bool:
    """Tell whether a body is part of a robot, or of a link, or of what a link has been made part of, of that name."""
    robot = next((one for one in plant.robots.values() if one.instance == body.model_instance()), None)
    if robot is None or name == robot.name:
        return robot is not None
    own, link = plant.plant, name.removeprefix(robot.prefix)
    return own.HasFrameNamed(link, robot.instance) and own.GetFrameByName(link, robot.instance).body() is body


def _link_names(station: Surroundings) -> list[str]:
    return [
        f"{robot.prefix}{link.get('name')}"
        for robot in station.robots.values()
        for link in robot.model.element.iterfind("link")
    ]
