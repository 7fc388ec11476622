"""A station's configuration with the robots and pieces behind its names: read once, and checked as a whole."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidParameter, UnknownName, Unsuitable, one_of
from simrob_drake.base.file_cache import FileCache
from simrob_drake.base.frames import Vector, transform_from_pose
from simrob_drake.base.messages import message
from simrob_drake.base.packages import granted_folders
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.importer.named_robots import read_described_robot
from simrob_drake.parts.controllers import flows_of, loops_of, readers_of
from simrob_drake.parts.controllers.loop import check_loops, sensors_read
from simrob_drake.parts.couplings import Gear
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.references import ReferenceConfig
from simrob_drake.parts.resolved import WORLD, ResolvedPiece, ResolvedRobot, StationContents
from simrob_drake.parts.sensors.sensor import SampledSensor
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel, load_robot
from simrob_drake.robots.coupled_axes import CoupledAxes
from simrob_drake.robots.motors import Drives
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
from simrob_drake.stations.config import (
    FloorConfig,
    JointStops,
    RobotConfig,
    ServoConfig,
    StationConfig,
)
from simrob_drake.stations.coupled import coupled_axes, mimic_gears, starting_positions
from simrob_drake.stations.piece_config import PieceConfig
from simrob_drake.stations.prescribed import with_prescribed_axes
from simrob_drake.stations.servos import (
    check_drives,
    check_motors,
    check_servo_without_model,
    drives_of,
    servo_gains,
    station_motors,
    with_passive_axes,
)
from simrob_drake.stations.target_limits import check_targets


@dataclass(frozen=True)
class ResolvedStation(StationContents):
    """A station, resolved."""

    # Its configuration, with the gears of axes that mimic others in their robots' files.
    config: StationConfig
    # Gears of mimic joints that the solver does not hold, by key. The start and the references obey these gears, but no
    # force holds the axes together during a run.
    unheld_gears: Mapping[str, Gear] = field(default_factory=dict)
    # Keys of the gears that come from the robots' files, not from the station.
    mimics: tuple[str, ...] = ()

    @cached_property
    def coupled(self) -> CoupledAxes:
        """The couplings between axes, of all robots in order, by their full names."""
        axes = [f"{robot.prefix}{axis}" for robot in self.robots.values() for axis in robot.axes]
        return coupled_axes(self.config, self.unheld_gears, axes)


_SERVO_KEYS = "kp", "ki", "kd", "torque_limit", "integral_limit", "speed_limit"
_FOOT = "foot"  # how tools on feet are called, after their side


# Stations that were resolved last, by the identity of their configuration. A run resolves the same configuration
# when it is loaded and checked, and when its diagram is built.
_STATIONS: FileCache[tuple[StationConfig, ResolvedStation]] = FileCache(size=8)
# Robots that were read last, by the name or file that a station gives for them. Changed copies of a configuration,
# such as those with other pieces or forces, have the same robots.
_ROBOTS: FileCache[RobotModel] = FileCache(size=32)


def resolve(config: StationConfig) -> ResolvedStation:
    """Read the robots and pieces of a station, and check that its keys fit them.

    The result for a configuration object is kept, and returned again until one of the station's files changes.

    Args:
        config: the station. An equal configuration that is another object is resolved anew.

    Raises:
        SimrobError: a name or a value does not fit; the message names its key.
    """
    # The folders that the user allows decide which files a robot may name.
    key = (id(config), tuple(granted_folders()))
    # The cached value contains the configuration: as long as it is there, no other object can have the same identity.
    _, station = _STATIONS.value(key, lambda: (config, _resolve_from_files(config)))
    return station


def _resolve_from_files(config: StationConfig) -> ResolvedStation:
    """Resolve a station without a look at former results. Raises the errors of `resolve`."""
    # Controllers need inputs that the station may not list.
    loops = readers_of(config.controllers).values()
    needed_inputs = {name for loop in loops for name in loop.needs}
    added_inputs = sorted(needed_inputs - set(config.inputs))
    if added_inputs:
        config = config.model_copy(update={"inputs": (*config.inputs, *added_inputs)})

    models = {
        name: _robot_model(entry, config.servo_of(name)) for name, entry in config.robots.items()
    }
    # The engine holds some gears of mimic joints as couplings. The references obey the others.
    mimics = mimic_gears(config, models)
    held = {name: gear for name, gear in mimics.items() if gear.is_held(config.engine)}
    unheld_gears = {name: gear for name, gear in mimics.items() if name not in held}
    if held:
        config = config.model_copy(update={"couplings": {**config.couplings, **held}})
    # Before the robots, as an axis may follow one of another robot.
    starts = starting_positions(config, models, unheld_gears)
    pieces = {piece.name: piece for piece in _pieces(config, models)}
    for name in config.pieces:
        if name in config.robots or name == WORLD:
            expected = message(
                "stations.unused_name",
                "a name that neither a robot of the station nor the world has",
            )
            raise InvalidParameter(f"pieces.{name}", name, expected)
    # After the pieces, since boxes that are fixed are ground, too.
    contact_model = config.contact.model if config.contact else ""
    ground = _ground(config.floor, contact_model, pieces)
    robots = dict[str, ResolvedRobot]()
    for name, model in models.items():
        robots[name] = _robot(config, name, model, pieces, ground, starts[name])
    # A sampled sensor that a controller reads has to be computed in the loop, not afterwards from the record.
    sensors = dict(config.sensors)
    for name in sensors_read(readers_of(config.controllers), sensors):
        if isinstance(sensors[name], SampledSensor):
            sensors[name] = sensors[name].model_copy(update={"in_loop": True})
    return ResolvedStation(
        engine=config.engine,
        has_contact=config.contact is not None,
        ground=ground,
        robots=robots,
        pieces=pieces,
        # Sensors that read others come after them.
        sensors=dict(sorted(sensors.items(), key=lambda entry: len(entry[1].read(sensors)))),
        config=config,
        unheld_gears=unheld_gears,
        mimics=tuple(mimics),
    )


def check_parts(station: ResolvedStation) -> None:
    """Check that something moves, and that parts find what they name; raises SimrobError: key, what would be right."""
    config = station.config
    free = config.free_pieces
    if not (config.robots or free):
        expected = message(
            "stations.something_that_moves",
            "given as robot: {{model: ...}}, or a piece must have free: true, since a station needs "
            "something that moves",
        )
        raise InvalidParameter("robots", "empty", expected)
    if free and not config.engine.moves_by_forces:
        expected = message(
            "stations.false_in_kinematic", "false in a kinematic station, which moves robots only"
        )
        raise InvalidParameter(f"pieces.{free[0]}.free", True, expected)
    _check_engine(config)
    for robot in station.robots.values():
        check_targets(config, robot)
    for name, sensor in config.sensors.items():
        sensor.check(f"sensors.{name}", station)
    for name, monitor in config.monitors.items():
        monitor.check(name, station)
        # The condition is built only to raise the errors that a run would raise.
        monitor.condition(name, station)
    check_loops(station, loops_of(config.controllers))
    for name, flow in flows_of(config.controllers).items():
        flow.check(f"controllers.{name}", station)
    for name, coupling in config.couplings.items():
        coupling.check(f"couplings.{name}", station)
    for name, force in config.forces.items():
        force.check(f"forces.{name}", station)


def _check_engine(config: StationConfig) -> None:
    """Check that the engine of a station supports what the station contains.

    Raises:
        InvalidParameter: the engine does not support the contact model, prescribed joints, or a coupling.
    """
    engine = config.engine
    if (
        config.contact is not None
        and config.contact.model != "point"
        and not engine.has_surface_contact
    ):
        expected = message(
            "stations.point_with_engine",
            "point with solver.kind {engine}, which has no contact over surfaces",
            engine=engine.name,
        )
        raise InvalidParameter("contact.model", config.contact.model, expected)
    refused = dict[str, list[str]]()
    if not engine.has_prescribed_joints:
        refused["prescribed"] = list(config.prescribed)
    if not engine.has_forces_of_couplings:
        couplings = config.couplings.items()
        refused["couplings"] = [
            name for name, coupling in couplings if not coupling.is_constrained(engine)
        ]
    for key, names in refused.items():
        if names:
            expected = message(
                "stations.left_out_with_engine",
                "left out with solver.kind {engine}, which supports only joints moved by forces, and only "
                "gears as couplings",
                engine=engine.name,
            )
            raise InvalidParameter(key, ", ".join(names), expected)


def _robot_model(entry: RobotConfig, servo: ServoConfig) -> RobotModel:
    """Read a robot with its passive axes and its drives (rotors, gears, friction).

    Drives of the station come before those of the robot's own file, and these before those of its motors.

    Raises:
        SimrobError: the files have a defect, or a value does not fit the robot.
    """
    robot = _robot_as_described(entry)
    if entry.drives is not None:
        robot = robot.with_drives(entry.drives)
    robot = with_passive_axes(robot, servo)
    if entry.drives is not None:
        check_drives(robot, entry.drives)
    motors = station_motors(robot, servo)
    if not any(motors):
        return robot
    # Drives that are applied last win: first those of the motors, then those of robot and station.
    without_drives = robot.model_copy(update={"drives": Drives()})
    return without_drives.with_drives(drives_of(motors, robot)).with_drives(robot.drives)


def _robot_as_described(entry: RobotConfig) -> RobotModel:
    """Read a robot from its files, or take it from the cache, without the drives that the station gives it.

    Raises:
        SimrobError: the files have a defect.
    """
    options = "" if entry.import_options is None else entry.import_options.model_dump_json()
    # All that the robot's files are read with: another import option gives another robot.
    key = (entry.urdf, entry.model, options, tuple(granted_folders()))
    return _ROBOTS.value(key, lambda: _robot_from_files(entry))


def _robot_from_files(entry: RobotConfig) -> RobotModel:
    """Read a robot with its URDF from its files.

    Raises:
        SimrobError: the files have a defect.
    """
    robot = _described_robot(entry)
    robot.element  # noqa: B018  # reads the URDF now, so that the cache records its file
    return robot


def _described_robot(entry: RobotConfig) -> RobotModel:
    """Read the description of a robot: a URDF, a YAML file, or a robot of the package by its name."""
    if entry.urdf is not None:
        # Few stations need the importer.
        from simrob_drake.importer.importing import robot_from_file

        return robot_from_file(entry.urdf, entry.import_options)
    # A station names robots of other files under `urdf`, where the borders of the station's folder are checked.
    model = str(entry.model)
    return read_described_robot(Path(model)) if is_yaml_name(model) else load_robot(model)


def _ground(
    floor: FloorConfig | None,
    contact: str,
    pieces: Mapping[str, ResolvedPiece],
) -> Ground:
    """Collect on what robots of a station can stand: the floor, its terrain, and boxes that do not move.

    Args:
        floor: the floor, or None if the station has no floor.
        contact: model of contact, or an empty text without contact.
        pieces: the station's pieces, each after its parent.

    Raises:
        InvalidParameter: soft terrain with point contact.
    """
    boxes = tuple(_fixed_boxes(pieces))
    if floor is None:
        return Ground(has_floor=False, boxes=boxes)
    plane = Ground(
        float(np.deg2rad(floor.incline_deg)), float(np.deg2rad(floor.heading_deg)), boxes=boxes
    )
    if floor.terrain is None:
        return plane
    if floor.terrain.soft is not None and contact == "point":
        expected = message(
            "stations.left_out_or_hydroelastic",
            "left out, or used with contact.model hydroelastic or hydroelastic_with_fallback, since "
            "point contact has no modulus",
        )
        found = message("stations.given_with_point_contact", "given with point contact")
        raise InvalidParameter("floor.terrain.soft", found, expected)
    # The terrain is described relative to the floor, which may be inclined.
    terrain_boxes = tuple(
        (plane.floor_pose @ block.pose, block.half) for block in floor.terrain.blocks(floor.size)
    )
    return replace(plane, boxes=(*terrain_boxes, *boxes), depth=floor.terrain.depth)


def _fixed_boxes(pieces: Mapping[str, ResolvedPiece]) -> Iterator[tuple[RigidTransform, Vector]]:
    """Yield the boxes of all pieces that are fixed to the world, directly or through other pieces.

    Args:
        pieces: the station's pieces, each after its parent.

    Yields:
        the pose of a box in the world, and half of its sides, shape (3,) [m].
    """
    poses: dict[str, RigidTransform] = {}  # of the fixed pieces in the world
    for piece in pieces.values():
        is_fixed = not piece.free and piece.parent in (WORLD, *poses)
        if not is_fixed:
            continue
        pose = piece.pose
        if piece.parent in poses:
            # The name of the frame in the plant has the parent's name before it.
            frame_name = piece.mount.removeprefix(f"{piece.parent}_")
            frame = pieces[piece.parent].model.frame_poses[frame_name]
            pose = poses[piece.parent] @ transform_from_pose(frame) @ pose
        poses[piece.name] = pose
        for shape in piece.model.shapes:
            if shape.box is not None and shape.collides:
                # The pose of a box in the world: that of the piece, then that of the shape in the
                # piece.
                yield pose @ transform_from_pose(shape.pose), np.array(shape.box) / 2


def _robot(
    config: StationConfig,
    name: str,
    model: RobotModel,
    pieces: Mapping[str, ResolvedPiece],
    ground: Ground,
    initial: Vector,
) -> ResolvedRobot:
    """Resolve a robot of a station.

    Args:
        config: configuration of the station.
        name: name of the robot in the station.
        model: the robot with its drives.
        pieces: the station's pieces.
        ground: the station's ground.
        initial: initial positions of the robot's axes, shape (n,) [rad or m].

    Raises:
        SimrobError: a key of the robot's section does not fit the robot.
    """
    entry = config.robots[name]
    servo = config.servo_of(name)
    _check_axis_values(model, servo, config.reference_of(name))
    if config.engine.moves_by_forces and model.base == "floating":
        check_servo_without_model(servo)
    if model.feet is None and entry.feet is not None:
        problem = message("stations.has_no_feet", "{model} has no feet", model=model.name)
        raise Unsuitable(f"robots.{name}.feet", problem)
    carried = tuple(piece.name for piece in pieces.values() if piece.carrier == name)
    held = _held_pieces(config, name, model, pieces)
    # Each carried piece is a tool, too, whose frame is its tool centre point.
    tool_frames = {**model.tools, **{piece: f"{piece}_{TCP}" for piece in carried}}
    if entry.tcp in model.links:
        tool_frames.setdefault(entry.tcp, entry.tcp)
    tcp = tool_in_use(model.tools, held, entry.tcp)
    if tcp:
        one_of(message("base.tool_of", "tool of {model}", model=name), tcp, tool_frames)
    stops = config.stops_of(name)
    # Axes that a mapping leaves out have the stops of a station without the section.
    usual_stops = JointStops().model_dump()
    stiffness = model.axis_vector(
        stops.stiffness, "joint_stops.stiffness", usual_stops["stiffness"]
    )
    damping = model.axis_vector(stops.damping, "joint_stops.damping", usual_stops["damping"])
    floats = model.base == "floating"
    # A robot with a free base stands on the floor, which may be inclined.
    base = (ground.floor_pose if floats else RigidTransform()) @ transform_from_pose(entry.base)
    robot = ResolvedRobot(
        name=name,
        prefix=config.prefix(name),
        model=model,
        base=base,
        floats=config.engine.moves_by_forces and floats,
        gains=servo_gains(model, servo, dampers=config.motors_are_dampers(name)),
        motors=tuple(station_motors(model, servo)),
        stops=(stiffness, damping),
        initial=initial,
        carried=carried,
        loads={piece: pieces[piece].model.mass for piece in carried},
        held=held,
        tool_frames=tool_frames,
        tcp=tcp,
        tcp_offset=entry.tcp_offset,
        feet=model.feet.kind(entry.feet) if model.feet else None,
        prescribed={},
    )
    resolved = with_prescribed_axes(config, robot)
    check_motors(config, resolved)
    return resolved


def _check_axis_values(
    model: RobotModel,
    servo: ServoConfig,
    reference: ReferenceConfig,
) -> None:
    """Check that the values by axis in the servo and the reference of a robot name axes of the robot.

    Raises:
        SimrobError: an axis is unknown, or there are too few or too many values.
    """
    values: dict[str, AxisValues | None] = {
        **{f"servo.{key}": getattr(servo, key) for key in _SERVO_KEYS},
        **{f"reference.{key}": value for key, value in reference.axis_values().items()},
    }
    for key, value in values.items():
        if value is not None:
            model.axis_vector(value, key)


def _held_pieces(
    config: StationConfig,
    robot: str,
    model: RobotModel,
    pieces: Mapping[str, ResolvedPiece],
) -> tuple[str, ...]:
    """Names of the pieces that a robot holds by its tools, directly or through other pieces.

    The other pieces that it carries are worn: they are mounted on links that are no tools, such as a backpack.
    """
    held: list[str] = []
    worn: list[str] = []
    for piece in pieces.values():
        if piece.carrier != robot:
            continue
        # Only a piece that is directly on the robot has a frame of the robot.
        frame = config.pieces[piece.name].frame if piece.parent == robot else None
        is_on_link = frame is not None and frame not in model.tools
        is_worn = piece.parent in worn or is_on_link
        (worn if is_worn else held).append(piece.name)
    return tuple(held)


def _pieces(config: StationConfig, robots: Mapping[str, RobotModel]) -> Iterator[ResolvedPiece]:
    """Yield the station's pieces, each after its parent.

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
        InvalidParameter: a mesh is far too large or small, for instance in millimetres; or a piece of the station's
            own shapes that is free or carried has no mass.
        OutputError: the cache of converted meshes cannot be written.
    """
    changes = {
        key: value for key, value in entry.model_dump(exclude_none=True).items() if key in _OWN_KEYS
    }
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
        piece = described_piece(Path(model) if is_yaml_name(model) else piece_file(model))
    has_own_shapes = entry.mesh is not None or bool(shapes)
    has_mass = entry.mass is not None or entry.density is not None
    # A piece that is fixed to the world does not move, so its mass has no effect.
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


def _mesh_piece(entry: PieceConfig, file: Path, where: str) -> PieceModel:
    """Create a piece from a mesh file.

    Args:
        entry: the piece's section.
        file: the mesh file.
        where: key of the section, for errors.

    Raises:
        InvalidModel: the mesh cannot be read.
        InvalidParameter: the size of the mesh is not that of a piece, or its unit is uncertain.
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


def tool_in_use(own: Mapping[str, str], carried: Sequence[str], tcp: str | None) -> str:
    """Choose the tool to which a robot's tool centre point belongs.

    Args:
        own: frames of the robot's own tools, by name.
        carried: pieces that the robot carries by its tools, the outermost last.
        tcp: the tool that the station names, or None.

    Returns:
        the tool of the station, else the outermost piece, else the robot's first own tool. It is empty without any.
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
