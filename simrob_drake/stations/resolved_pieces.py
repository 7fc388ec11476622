"""The pieces of a station: their models, the robots that carry them, and the frames on which they are mounted.

A piece is mounted on its *parent*: the world, a robot or another piece. Its *carrier* is the robot at the end of this
chain of parents, or the world.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable, one_of
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.parts.resolved import WORLD, ResolvedPiece
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.pieces import (
    FORMS,
    TCP,
    PieceModel,
    PieceShape,
    described_piece,
    mesh_sides,
    piece_file,
    with_changes,
)
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.piece_config import PieceConfig

_FOOT = "foot"
"""End of the names of tools on feet, after their side."""


def resolved_pieces(
    config: StationConfig, robots: Mapping[str, RobotModel]
) -> Iterator[ResolvedPiece]:
    """Yield the station's pieces, each after its parent.

    Args:
        config: configuration of the station.
        robots: models of the station's robots, by name, for the frames on which pieces are mounted.

    Raises:
        SimrobError: a piece has a defect, or a parent or a frame that does not exist.
    """
    models = dict[str, PieceModel]()
    for piece, carrier in carriers_of(config).items():
        entry = config.pieces[piece]
        parent = _parent(config, piece)
        model = piece_of(entry, piece)
        # Recorded before the next piece, which may be mounted on this one.
        models[piece] = model
        # Newton's law has no solution for a body without mass or inertia.
        if entry.free and not (model.mass > 0 and min(model.inertia[:3]) > 0):
            expected = message(
                "stations.piece_with_inertia",
                "false, or the piece must have mass and inertia, since gravity and contact move it",
            )
            raise InvalidParameter(f"pieces.{piece}.free", True, expected)
        yield ResolvedPiece(
            name=piece,
            model=model,
            parent=parent,
            carrier=carrier,
            mount=_mount(f"pieces.{piece}.frame", entry.frame, parent, robots, models),
            pose=transform_from_pose(entry.pose),
            free=entry.free,
        )


_OWN_KEYS = {"density", "mass", "com", "inertia", "tcp", "frames", "colour"}
"""Keys of a piece's section that replace values of the piece's own file."""

_SMALLEST_MESH = 1e-4
_LARGEST_MESH = 50.0
"""Range of the longest side of a piece from a mesh [m]. Meshes outside of it are in another unit."""

_SIZE_WITH_UNIT = 1.0
"""A mesh whose longest side exceeds this [m] needs its unit to be given: it may be in millimetres."""


def piece_of(entry: PieceConfig, name: str) -> PieceModel:
    """Create the piece that the section ``pieces.<name>`` of a station describes.

    If the section has no source of its own, the piece is the one of the package with this name.

    Args:
        entry: the section.
        name: name of the piece in the station.

    Raises:
        UnknownName: there is no such piece.
        InvalidConfig: a value is not possible.
        InvalidModel: a mesh cannot be read, or has no volume although a density is given.
        InvalidParameter: a mesh is far too large or small, for instance in millimetres; or neither mass nor density is
            given for a piece of the station's own shapes that is free, or mounted on a robot or another piece.
        OutputError: the cache of converted meshes cannot be written.
    """
    # Values of the section that replace those of the piece's own file.
    changes = {
        key: value for key, value in entry.model_dump(exclude_none=True).items() if key in _OWN_KEYS
    }
    # Name or file of the piece, if the section has no shapes and no mesh.
    model = entry.model or name
    # A single form, such as `box:`, is a shape by itself; `shapes:` lists several.
    form = entry.model_dump(include={*FORMS}, exclude_none=True)
    shapes = entry.shapes or ()
    if form and not shapes:
        shapes = (PieceShape(**form),)
    if entry.mesh is not None:
        piece = _mesh_piece(entry, entry.mesh, f"pieces.{name}")
    elif shapes:
        piece = PieceModel(folder=Path(), shapes=shapes)
    else:
        piece = piece_of_file(model)
    has_own_shapes = entry.mesh is not None or bool(shapes)
    has_mass = entry.mass is not None or entry.density is not None
    # A piece that is mounted on the world itself does not move, so its mass has no effect. A piece on another one may
    # move with a robot.
    needs_mass = entry.free or entry.parent != WORLD
    if has_own_shapes and needs_mass and not has_mass:
        seen = (
            ""
            if entry.free
            else message("stations.zero_if_seen", ", 0 if the piece is only visible")
        )
        expected = message(
            "stations.mass_or_give_density",
            "a mass [kg]{seen}; or give a density [kg/m³]",
            seen=seen,
        )
        raise InvalidParameter(f"pieces.{name}.mass", None, expected)
    return with_changes(piece, changes, f"pieces.{name}")


def piece_of_file(model: str) -> PieceModel:
    """Read a piece as its file describes it.

    Args:
        model: name of a piece of the package, or the name of a YAML file.

    Raises:
        UnknownName: there is no such piece.
        InvalidConfig: a value of the file is not possible.
    """
    return described_piece(Path(model) if is_yaml_name(model) else piece_file(model))


def _mesh_piece(entry: PieceConfig, file: Path, where: str) -> PieceModel:
    """Create a piece from a mesh file.

    Args:
        entry: the piece's section.
        file: the mesh file.
        where: key of the section, for errors.

    Raises:
        InvalidModel: the mesh cannot be read.
        InvalidParameter: the size of the mesh is not that of a piece, or its unit is uncertain.
        OutputError: the cache of converted meshes cannot be written.
    """
    # Few stations need the modules that read meshes.
    from simrob_drake.importer.meshes.checks import FORMATS_WITHOUT_UNIT
    from simrob_drake.importer.meshes.library import drake_mesh

    mesh = drake_mesh(file)
    scale = entry.scale or 1.0
    # The longest side is compared: a sheet may be very thin.
    size = max(mesh_sides(mesh, scale))
    if not _SMALLEST_MESH <= size <= _LARGEST_MESH:
        expected = message(
            "stations.scale_of_mesh",
            "such that the mesh, now {size:.3g} m long, has the size of a piece, for example 0.001 for "
            "millimetres",
            size=size,
        )
        raise InvalidParameter(f"{where}.scale", scale, expected)
    if (
        entry.scale is None
        and size > _SIZE_WITH_UNIT
        and file.suffix.lower() in FORMATS_WITHOUT_UNIT
    ):
        expected = message(
            "stations.scale_for_millimetres",
            "0.001 for millimetres, or 1 if the mesh is {size:.3g} m long",
            size=size,
        )
        raise InvalidParameter(f"{where}.scale", None, expected)
    return PieceModel(folder=mesh.parent, shapes=(PieceShape(mesh=mesh.name, scale=scale),))


def carriers_of(config: StationConfig) -> dict[str, str]:
    """Find the carrier of each piece: the robot on which it is mounted directly or through other pieces, or ``world``.

    Returns:
        the name of the carrier by the name of the piece, each piece after its parent.

    Raises:
        UnknownName: a parent is neither a robot nor a piece nor the world.
        InvalidParameter: a parent is missing, or pieces are mounted on each other in a circle.
    """
    parents = {piece: _parent(config, piece) for piece in config.pieces}
    carriers: dict[str, str] = {}
    for piece in _outward(config, parents):
        # The carrier of the parent, if that is a piece; otherwise the parent itself is the carrier.
        carriers[piece] = carriers.get(parents[piece], parents[piece])
    return carriers


def _parent(config: StationConfig, piece: str) -> str:
    """Parent of a piece: ``world``, the name of a robot, or the name of another piece.

    A free piece may leave the parent out, which is then ``world``.

    Raises:
        InvalidParameter: the parent is left out, though the piece is not free.
    """
    entry = config.pieces[piece]
    if entry.parent is None and not entry.free:
        other_pieces = [other for other in config.pieces if other != piece]
        choices = ", ".join([WORLD, *config.robots, *other_pieces])
        expected = message(
            "stations.what_it_hangs_on",
            "the parent of the piece, one of {choices}, or the piece must have free: true",
            choices=choices,
        )
        raise InvalidParameter(
            f"pieces.{piece}.parent", message("stations.left_out", "left out"), expected
        )
    return entry.parent or WORLD


def _outward(config: StationConfig, parents: Mapping[str, str]) -> list[str]:
    """Sort the names of the pieces so that each comes after its parent.

    Args:
        config: configuration of the station.
        parents: parent of each piece.

    Raises:
        UnknownName: a parent is neither a robot nor a piece nor the world.
        InvalidParameter: pieces are mounted on each other in a circle.
    """
    for piece, parent in parents.items():
        known = [WORLD, *config.robots, *config.pieces]
        if parent not in known:
            subject = message("stations.parent_for_piece", "parent for pieces.{piece}", piece=piece)
            raise UnknownName(subject, parent, [name for name in known if name != piece])
    # Pieces without a parent among the rest come next. If none is left, the rest is a circle.
    ordered: list[str] = []
    while len(ordered) < len(parents):
        rest = [piece for piece in parents if piece not in ordered]
        ready = [piece for piece in rest if parents[piece] not in rest]
        if not ready:
            expected = message(
                "stations.no_piece_below", "a parent that is not mounted on this piece"
            )
            raise InvalidParameter(f"pieces.{rest[0]}.parent", parents[rest[0]], expected)
        ordered += ready
    return ordered


def _mount(
    key: str,
    frame: str | None,
    parent: str,
    robots: Mapping[str, RobotModel],
    pieces: Mapping[str, PieceModel],
) -> str:
    """Find the frame of the plant on which a piece is mounted.

    Args:
        key: key of the piece that names the frame, for errors.
        frame: value of this key, or None if it is left out.
        parent: parent of the piece.
        robots: the station's robots, by name.
        pieces: the pieces that were resolved so far, by name.

    Returns:
        name of the frame: that of a robot (see :func:`flange`) or of another piece; empty for the world.

    Raises:
        UnknownName: the parent has no such frame.
        Unsuitable: a frame is named, but the parent is the world.
    """
    if parent in robots:
        known = [*robots[parent].tools, *robots[parent].links]
        if frame is not None:
            subject = message(
                "stations.tool_or_link_for",
                "tool or link of {parent} for {key}",
                parent=parent,
                key=key,
            )
            one_of(subject, frame, known)
        return flange(robots[parent].tools, robots[parent].root, frame)
    if parent == WORLD:
        if frame is not None:
            problem = message(
                "stations.world_without_frames",
                "the piece is mounted on the world, which has no frames",
            )
            raise Unsuitable(key, problem)
        return ""
    kind = message("stations.frame_of", "frame of {parent}", parent=parent)
    name = one_of(kind, frame or TCP, pieces[parent].frame_poses)
    return f"{parent}_{name}"


def held_pieces(
    config: StationConfig, carriers: Mapping[str, str], robot: str, own_tools: Collection[str]
) -> tuple[str, ...]:
    """Names of the pieces that a robot holds by its tools, directly or through other pieces.

    The other pieces that it carries are worn: they are mounted on links that are no tools, such as a backpack, or on
    pieces that are worn. A piece on the robot without a key ``frame`` counts as held, also if it is mounted on the root
    link (see :func:`flange`).

    Args:
        config: configuration of the station.
        carriers: carrier of each piece by name, each piece after its parent; see :func:`carriers_of`.
        robot: name of the robot.
        own_tools: names of the robot's own tools.
    """
    held: list[str] = []
    worn: list[str] = []
    # A parent comes before its pieces, so that it is in one of the lists already.
    for piece, carrier in carriers.items():
        if carrier != robot:
            continue
        parent = config.pieces[piece].parent
        # Only a piece that is directly on the robot has a frame of the robot.
        frame = config.pieces[piece].frame if parent == robot else None
        is_on_link = frame is not None and frame not in own_tools
        if parent in worn or is_on_link:
            worn.append(piece)
        else:
            held.append(piece)
    return tuple(held)


def tool_in_use(own: Mapping[str, str], carried: Sequence[str], tcp: str | None) -> str:
    """Choose the tool to which a robot's tool centre point belongs.

    Args:
        own: frames of the robot's own tools, by name.
        carried: pieces that the robot holds, as by :func:`held_pieces`: each after its parent.
        tcp: the tool that the station names, or None.

    Returns:
        the tool that the station names, else the last of the pieces, else the robot's first own tool. It is empty
        without any.
    """
    if tcp:
        return tcp
    if carried:
        return carried[-1]
    return next(iter(own), "")


def flange(own: Mapping[str, str], root: str, tool: str | None = None) -> str:
    """Choose the frame of a robot on which a piece is mounted.

    Args:
        own: frames of the robot's own tools, by name.
        root: frame of its root link.
        tool: name of the tool or link that the station names, or None.

    Returns:
        the frame of the named tool or link, else of the robot's first tool. It is the root if there is no tool, or if
        the first tool is a foot: a robot with four legs carries its load on its trunk.
    """
    if tool is not None:
        return own.get(tool, tool)
    if not own:
        return root
    first_tool, frame = next(iter(own.items()))
    return root if first_tool.endswith(_FOOT) else frame
