"""Bodies, shapes and frames of a station that parts such as sensors can name.

The name of a collision shape in Drake's scene graph is ``<owner>::<name>``, with the owner's model between the two for
some. A shape of a piece has the name ``<piece>.<shape>``; its owner is the piece or, if a robot carries the piece, that
robot. The floor's shapes have no owner. If the station shares a plant with others, owners begin with the *scope* of the
station, such as ``left.``. The *prefix* of a robot begins the names of its links and tools in a station of several
robots; in a station of one robot it is empty.

Links and carried pieces that are fixed to each other are one body of the plant. So the shapes of a link are those of
all links and carried pieces that are fixed to it.
"""

from collections.abc import Iterator

from pydrake.geometry import GeometryId, Role, SceneGraphInspector
from pydrake.multibody.tree import Frame, RigidBody

from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.messages import message
from simrob_drake.parts.resolved import WORLD, StationContents
from simrob_drake.parts.station_plant import StationPlant

FLOOR = "floor"
"""Name of the floor's shape. Boxes of its terrain are named ``floor.<number>``."""


def own_name(inspector: SceneGraphInspector, shape: GeometryId) -> str:
    """Name of a shape without its owner. Names of pieces' shapes begin with the name of the piece and a dot."""
    name: str = inspector.GetName(shape)
    return name.rsplit("::", 1)[-1]


def piece_of_shape(
    station: StationContents, inspector: SceneGraphInspector, shape: GeometryId
) -> str | None:
    """Find the piece to which a shape belongs, by its name.

    Returns None for a robot's own shapes, those of the floor, and those of other stations in a plant that is shared.
    """
    # The name is <scope><owner>::...::<piece>.<shape> for a piece. The scope separates stations that share one plant.
    scoped_owner = inspector.GetName(shape).partition("::")[0]
    if not scoped_owner.startswith(station.scope):
        return None  # it belongs to something else in a plant that the station shares
    owner = scoped_owner.removeprefix(station.scope)
    name = own_name(inspector, shape)
    piece = name.partition(".")[0]
    if "." not in name or piece not in station.pieces:
        return None
    # A link of a robot may have a shape with a dot in its name: the owner decides.
    owners = (piece, station.pieces[piece].carrier)
    return piece if owner in owners else None


def owner_of_shape(plant: StationPlant, shape: GeometryId) -> str:
    """Name of the piece, link, floor or box of a terrain to which a shape belongs. Links have their robot's prefix.

    Of links that are fixed to each other, it is the one after which their common body is named.

    A shape of others in a plant that the station shares has its own name.
    """
    inspector = plant.scene_graph.model_inspector()
    # A shape of the floor has no owner: its name has no "::", so that its own name stands here, which is no robot's.
    owner = inspector.GetName(shape).partition("::")[0].removeprefix(plant.scope)
    name = own_name(inspector, shape)
    has_dot = "." in name
    piece = name.partition(".")[0]
    robot = plant.robots.get(owner)
    if robot is None:
        # A piece that no robot carries is its own owner. Other shapes are those of the ground, or of others in a shared
        # plant.
        is_of_piece = has_dot and piece == owner
        return piece if is_of_piece else name
    if has_dot and piece in robot.carried:
        return piece
    # A shape of a link: the link has the body that the shape moves with.
    body = plant.plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
    return f"{robot.prefix}{body.name()}"


def owner_and_robot(plant: StationPlant, shape: GeometryId) -> tuple[str, str]:
    """Find to what a shape belongs, and which robot moves it.

    Returns:
        The name of the piece or link, or ``floor`` for all shapes of the ground; and the name of the robot of which it
        is a part or that carries it, or an empty text.
    """
    owner = owner_of_shape(plant, shape)
    frame = plant.scene_graph.model_inspector().GetFrameId(shape)
    instance = plant.plant.GetBodyFromFrameId(frame).model_instance()
    # All bodies of a robot, and of the pieces that it carries, are in the robot's model instance.
    robot = next((robot.name for robot in plant.robots.values() if robot.instance == instance), "")
    # Boxes of a terrain are named ``floor.<number>``.
    is_ground = not robot and owner.partition(".")[0] == FLOOR
    return FLOOR if is_ground else owner, robot


def body_names(station: StationContents) -> list[str]:
    """Names of all bodies at which forces and distances can be measured.

    They are robots, links, pieces, shapes of pieces and, if there is one, the floor.
    """
    names = [*station.robots, *_link_names(station)]
    for piece in station.pieces.values():
        names.append(piece.name)
        names += [f"{piece.name}.{shape}" for shape in piece.model.shape_names]
    if station.ground.has_floor:
        names.append(FLOOR)
    return names


def frame_names(station: StationContents) -> list[str]:
    """Names of all frames at which forces and sensors can be, and in whose axes vectors can be given.

    These are the world, links, tools, and pieces (at their TCP).

    A tool centre point at an offset from the tool in use has no name among them.
    """
    # Links and tools have the prefix of their robot, pieces are unique in the station.
    tools = [
        f"{robot.prefix}{tool}" for robot in station.robots.values() for tool in robot.model.tools
    ]
    return [WORLD, *_link_names(station), *tools, *station.pieces]


def check_body(station: StationContents, key: str, name: str) -> None:
    """Check that a body or shape exists.

    Args:
        station: the station.
        key: key of the station that names it, for errors.
        name: one of :func:`body_names`.

    Raises:
        UnknownName: there is no such body; proposes the nearest name.
        Unsuitable: it is the floor, and the station has no floor.
    """
    # Without a floor, the list of names does not contain `floor`. The word is a correct name all the same, so the error
    # says how to add a floor instead of "unknown name".
    if name == FLOOR and not station.ground.has_floor:
        raise Unsuitable(
            key,
            message("parts.no_floor", "the station has no floor"),
            message("parts.add_floor", "add a section floor, or name another body"),
        )
    one_of(
        message("parts.body_or_shape_for", "body or shape for {key}", key=key),
        name,
        body_names(station),
    )


def check_frame(station: StationContents, key: str, name: str) -> None:
    """Check that a frame exists: one of :func:`frame_names`.

    Args:
        station: the station.
        key: key of the station that names the frame, for errors.
        name: name of the frame.

    Raises:
        UnknownName: there is no such frame; proposes the nearest name.
    """
    one_of(message("parts.frame_for", "frame for {key}", key=key), name, frame_names(station))


def shapes_of(plant: StationPlant, station: StationContents, name: str) -> list[GeometryId]:
    """Find the collision shapes of a body: one of :func:`body_names`.

    Those of a robot include the shapes of the pieces that it carries, those of a link the shapes of all links and
    carried pieces that are fixed to it.

    Raises:
        InvalidParameter: the body has no collision shapes.
    """
    found = list(_find_shapes(plant, station, name))
    if not found:
        raise InvalidParameter(
            message("parts.body_of_sensor", "the body of a sensor"),
            name,
            message("parts.body_that_collides", "a body with collision shapes"),
        )
    return found


def frame_of(plant: StationPlant, name: str) -> Frame:
    """Find a frame by its name: one of :func:`frame_names`, which the caller has checked.

    The frame of a piece is the one at its tool centre point.
    """
    if name == WORLD:
        return plant.plant.world_frame()
    # A tool, or a carried piece by its tool centre point, comes before a link of the same name. The prefix of the only
    # robot is empty, so every name begins with it.
    for robot in plant.robots.values():
        if not name.startswith(robot.prefix):
            continue
        own = name.removeprefix(robot.prefix)
        if own in robot.tools:
            return robot.tools[own]
        if plant.plant.HasFrameNamed(own, robot.instance):
            return plant.plant.GetFrameByName(own, robot.instance)
    # What is left is a piece that no robot carries. Its frame is the one at its tool centre point.
    return plant.piece_frame(name, f"{name}_tcp")


def _find_shapes(plant: StationPlant, station: StationContents, name: str) -> Iterator[GeometryId]:
    """Yield the collision shapes of a body, as :func:`shapes_of` returns them; none if it has no shapes."""
    inspector = plant.scene_graph.model_inspector()
    piece = name.partition(".")[0]
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        if name == FLOOR:
            # The name of a box of the terrain goes on with a dot and a number.
            belongs = inspector.GetName(shape).partition(".")[0] == FLOOR
        elif piece in station.pieces:
            # The name of the piece, "box", finds all shapes "box.<shape>". The name of a shape, "box.lid", finds this
            # one. The dots at the ends keep "box.lid" from finding "box.lid2".
            shape_name = own_name(inspector, shape)
            is_named = f"{shape_name}.".startswith(f"{name}.")
            belongs = is_named and piece_of_shape(station, inspector, shape) == piece
        else:
            body = plant.plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
            belongs = _belongs_to_name(plant, body, name)
        if belongs:
            yield shape


def _belongs_to_name(plant: StationPlant, body: RigidBody, name: str) -> bool:
    """Check whether a body belongs to the robot or to the link that has a name.

    The pieces that a robot carries belong to it. Links and carried pieces that are fixed to each other have one common
    body, which belongs to each of these links.

    Args:
        plant: plant of the station.
        body: the body.
        name: name of a robot, or of a link with the prefix of its robot.
    """
    robot = next(
        (owner for owner in plant.robots.values() if owner.instance == body.model_instance()), None
    )
    # A free piece, or the ground.
    if robot is None:
        return False
    if name == robot.name:
        return True
    link = name.removeprefix(robot.prefix)
    has_link = plant.plant.HasFrameNamed(link, robot.instance)
    return has_link and plant.plant.GetFrameByName(link, robot.instance).body() is body


def _link_names(station: StationContents) -> list[str]:
    """Names of the links of all robots, with the robots' prefixes."""
    return [
        f"{robot.prefix}{link.get('name')}"
        for robot in station.robots.values()
        for link in robot.model.element.iterfind("link")
    ]
