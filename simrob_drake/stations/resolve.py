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
from simrob_drake.base.packages import granted
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.importer.named_robots import read_described_robot
from simrob_drake.parts.controllers import flows_of, loops_of, readers_of
from simrob_drake.parts.controllers.loop import check_loops, sensors_read
from simrob_drake.parts.couplings import Gear
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.resolved import WORLD, ResolvedPiece, ResolvedRobot, Surroundings
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
from simrob_drake.stations.config import FloorConfig, JointStops, RobotConfig, ServoConfig, StationConfig
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
class ResolvedStation(Surroundings):
    """A station, resolved."""

    config: StationConfig  # its configuration, with the gears of axes that mimic others in their robots' files
    # Gears of mimic joints that the solver does not hold, by key. The start and the references obey these gears, but no
    # force holds the axes together during a run.
    unheld_gears: Mapping[str, Gear] = field(default_factory=dict)
    mimics: tuple[str, ...] = ()  # keys of the gears that come from the robots' files, not from the station

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
    key = (id(config), tuple(granted()))
    # The cached value contains the configuration: as long as it is there, no other object can have the same identity.
    _, station = _STATIONS.value(key, lambda: (config, _resolve_from_files(config)))
    return station


def _resolve_from_files(config: StationConfig) -> ResolvedStation:
    """Resolve a station without a look at former results. Raises the errors of `resolve`."""
    driven = {name for loop in readers_of(config.controllers).values() for name in loop.needs} - set(config.inputs)
    config = config.model_copy(update={"inputs": (*config.inputs, *sorted(driven))}) if driven else config
    models = {name: _robot_model(entry, config.servo_of(name)) for name, entry in config.robots.items()}
    mimics = mimic_gears(config, models)
    held = {name: gear for name, gear in mimics.items() if gear.is_held(config.engine)}
    unheld_gears = {name: gear for name, gear in mimics.items() if name not in held}
    config = config.model_copy(update={"couplings": {**config.couplings, **held}}) if held else config
    starts = starting_positions(config, models, unheld_gears)
    pieces = {piece.name: piece for piece in _pieces(config, models)}
    for name in config.pieces:
        if name in config.robots or name == WORLD:
            raise InvalidParameter(
                f"pieces.{name}",
                name,
                message("stations.unused_name", "a name that no robot of the station has, nor the world"),
            )
    ground = _ground(config.floor, config.contact.model if config.contact else "", pieces)
    robots = {name: _robot(config, name, model, pieces, ground, starts[name]) for name, model in models.items()}
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
            "given as robot: {{model: ...}}, or a piece have free: true: a station needs something that moves",
        )
        raise InvalidParameter("robots", "empty", expected)
    if free and not config.engine.moves_by_forces:
        raise InvalidParameter(
            f"pieces.{free[0]}.free",
            True,
            message("stations.false_in_kinematic", "false in a kinematic station, which moves robots only"),
        )
    _check_engine(config)
    for robot in station.robots.values():
        check_targets(config, robot)
    for name, sensor in config.sensors.items():
        sensor.check(f"sensors.{name}", station)
    for name, monitor in config.monitors.items():
        monitor.check(name, station)
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
    if config.contact is not None and config.contact.model != "point" and not engine.has_surface_contact:
        expected = message(
            "stations.point_with_engine",
            "point with solver.kind {engine}, which knows no pressure over a surface",
            engine=engine.name,
        )
        raise InvalidParameter("contact.model", config.contact.model, expected)
    refused = dict[str, list[str]]()
    if not engine.has_prescribed_joints:
        refused["prescribed"] = list(config.prescribed)
    if not engine.has_forces_of_couplings:
        couplings = config.couplings.items()
        refused["couplings"] = [name for name, coupling in couplings if not coupling.is_constrained(engine)]
    for key, names in refused.items():
        if names:
            expected = message(
                "stations.left_out_with_engine",
                "left out with solver.kind {engine}, which has joints moved by forces, and gears alone",
                engine=engine.name,
            )
            raise InvalidParameter(key, ", ".join(names), expected)


def _robot_model(entry: RobotConfig, servo: ServoConfig) -> RobotModel:
    """Return a robot with the drives that its motors, its own file and the station tell, each over those before."""
    robot = _robot_as_described(entry)
    robot = robot if entry.drives is None else robot.with_drives(entry.drives)
    robot = with_passive_axes(robot, servo)
    if entry.drives is not None:
        check_drives(robot, entry.drives)
    motors = station_motors(robot, servo)
    if not any(motors):
        return robot
    return robot.model_copy(update={"drives": Drives()}).with_drives(drives_of(motors, robot)).with_drives(robot.drives)


def _robot_as_described(entry: RobotConfig) -> RobotModel:
    """Read a robot from its files, or take it from the cache, without the drives that the station gives it.

    Raises:
        SimrobError: the files have a defect.
    """
    options = "" if entry.import_options is None else entry.import_options.model_dump_json()
    key = (entry.urdf, entry.model, options, tuple(granted()))
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
        from simrob_drake.importer.importing import robot_from_file  # few stations need the importer

        return robot_from_file(entry.urdf, entry.import_options)
    # A station names robots of other files under `urdf`, where the borders of the station's folder are checked.
    model = str(entry.model)
    return read_described_robot(Path(model)) if is_yaml_name(model) else load_robot(model)


def _ground(floor: FloorConfig | None, contact: str, pieces: Mapping[str, ResolvedPiece]) -> Ground:
    places: dict[str, RigidTransform] = {}
    boxes: list[tuple[RigidTransform, Vector]] = []
    for piece in pieces.values():
        if piece.free or piece.parent not in (WORLD, *places):
            continue
        place = piece.pose
        if piece.parent in places:
            frame = pieces[piece.parent].model.frame_poses[piece.mount.removeprefix(f"{piece.parent}_")]
            place = places[piece.parent] @ transform_from_pose(frame) @ place
        places[piece.name] = place
        solid = [shape for shape in piece.model.shapes if shape.box is not None and shape.collides]
        boxes += [(place @ transform_from_pose(shape.pose), np.array(shape.box) / 2) for shape in solid]
    if floor is None:
        return Ground(has_floor=False, boxes=tuple(boxes))
    even = Ground(float(np.deg2rad(floor.incline_deg)), float(np.deg2rad(floor.heading_deg)), boxes=tuple(boxes))
    if floor.terrain is None:
        return even
    if floor.terrain.soft is not None and contact == "point":
        expected = message(
            "stations.left_out_or_hydroelastic",
            "left out, or with contact.model hydroelastic or hydroelastic_with_fallback: points know no modulus",
        )
        raise InvalidParameter(
            "floor.terrain.soft", message("stations.given_with_point_contact", "given with point contact"), expected
        )
    field = tuple((even.floor_pose @ block.pose, block.half) for block in floor.terrain.blocks(floor.size))
    return replace(even, boxes=(*field, *even.boxes), depth=floor.terrain.depth)


def _robot(
    config: StationConfig,
    name: str,
    model: RobotModel,
    pieces: Mapping[str, ResolvedPiece],
    ground: Ground,
    initial: Vector,
) -> ResolvedRobot:
    """Resolve a robot of a station whose axes begin at ``initial`` (n,) [rad or m].

    Raises:
        SimrobError: a key of its section that does not fit the robot.
    """
    entry = config.robots[name]
    servo, reference = config.servo_of(name), config.reference_of(name)
    values: dict[str, AxisValues | None] = {
        **{f"servo.{key}": getattr(servo, key) for key in _SERVO_KEYS},
        **{f"reference.{key}": value for key, value in reference.axis_values().items()},
    }
    for key, value in values.items():
        if value is not None:
            model.axis_vector(value, key)
    if config.engine.moves_by_forces and model.base == "floating":
        check_servo_without_model(servo)
    if model.feet is None and entry.feet is not None:
        raise Unsuitable(
            f"robots.{name}.feet", message("stations.has_no_feet", "{model} has no feet", model=model.name)
        )
    carried = tuple(piece.name for piece in pieces.values() if piece.carrier == name)
    worn: list[str] = []  # on links that are no tools, and what hangs on such pieces
    for piece in carried:
        frame = config.pieces[piece].frame if pieces[piece].parent == name else None
        if pieces[piece].parent in worn or (frame is not None and frame not in model.tools):
            worn.append(piece)
    held = tuple(piece for piece in carried if piece not in worn)
    frames = {**model.tools, **{piece: f"{piece}_{TCP}" for piece in carried}}
    if entry.tcp in model.links:
        frames.setdefault(entry.tcp, entry.tcp)
    tcp = tool_in_use(model.tools, held, entry.tcp)
    if tcp:
        one_of(message("base.tool_of", "tool of {model}", model=name), tcp, frames)
    stops, usual = config.stops_of(name).model_dump(), JointStops().model_dump()
    stiffness, damping = (model.axis_vector(stops[key], f"joint_stops.{key}", usual[key]) for key in stops)
    resolved = with_prescribed_axes(
        config,
        ResolvedRobot(
            name=name,
            prefix=config.prefix(name),
            model=model,
            base=(ground.floor_pose if model.base == "floating" else RigidTransform())
            @ transform_from_pose(entry.base),
            floats=config.engine.moves_by_forces and model.base == "floating",
            gains=servo_gains(model, servo, dampers=config.motors_are_dampers(name)),
            motors=tuple(station_motors(model, servo)),
            stops=(stiffness, damping),
            initial=initial,
            carried=carried,
            load=sum(pieces[piece].model.mass for piece in carried),
            held=held,
            tool_frames=frames,
            tcp=tcp,
            tcp_offset=entry.tcp_offset,
            feet=model.feet.kind(entry.feet) if model.feet else None,
            prescribed={},
        ),
    )
    check_motors(config, resolved)
    return resolved


def _pieces(config: StationConfig, robots: Mapping[str, RobotModel]) -> Iterator[ResolvedPiece]:
    """Yield the pieces, each after what it hangs on."""
    carriers, models = carriers_of(config), dict[str, PieceModel]()
    for piece, carrier in carriers.items():
        entry, parent = config.pieces[piece], _parent(config, piece)
        model = models[piece] = piece_of(entry, piece)
        if entry.free and not (model.mass > 0 and min(model.inertia[:3]) > 0):
            expected = message(
                "stations.piece_with_inertia", "a piece with mass and inertia: gravity and contact move it"
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
_SIZES = 1e-4, 50.0  # of a piece from a mesh [m]
_UNSCALED = 1.0  # size from which the unit of a mesh must be given [m]


def piece_of(entry: PieceConfig, name: str) -> PieceModel:
    """Return the piece that the section ``pieces.<name>`` of a station stands for, with all its figures.

    It is the piece of the package of that name, unless the section names another source. Raises UnknownName: no such
    piece; InvalidConfig: a figure that cannot be; InvalidModel: a mesh that cannot be read, or has no volume though a
    density is given; InvalidParameter: a mesh that is far too large or small, as one in millimetres is; or a form of
    the station's own that is free, or that a robot carries, and what it weighs is not said; OutputError: the cache of
    converted meshes cannot be written.
    """
    changes = {key: value for key, value in entry.model_dump(exclude_none=True).items() if key in _OWN_KEYS}
    model = entry.model or name
    forms = entry.model_dump(include={*FORMS}, exclude_none=True)
    shapes = entry.shapes or ((PieceShape(**forms),) if forms else ())
    if entry.mesh is not None:
        piece = _mesh_piece(entry, entry.mesh, f"pieces.{name}")
    elif shapes:
        piece = PieceModel(folder=Path(), shapes=shapes)
    else:
        piece = described_piece(Path(model) if is_yaml_name(model) else piece_file(model))
    weightless = entry.mass is None and entry.density is None and (entry.free or entry.parent != WORLD)
    if weightless and (entry.mesh is not None or shapes):
        seen = "" if entry.free else message("stations.zero_if_seen", ", 0 if it is only seen")
        expected = message("stations.mass_or_give_density", "a mass [kg]{seen}; or give a density [kg/m³]", seen=seen)
        raise InvalidParameter(f"pieces.{name}.mass", None, expected)
    return with_changes(piece, changes, f"pieces.{name}")


def _mesh_piece(entry: PieceConfig, file: Path, where: str) -> PieceModel:
    # Few stations need what reads meshes.
    from simrob_drake.importer.meshes.checks import FORMATS_WITHOUT_UNIT
    from simrob_drake.importer.meshes.library import drake_mesh

    mesh, scale = drake_mesh(file), entry.scale or 1.0
    size = max(mesh_sides(mesh, scale))
    if not _SIZES[0] <= size <= _SIZES[1]:
        expected = message(
            "stations.scale_of_mesh",
            "such that the mesh, now {size:.3g} m long, is of a piece's size; for millimetres 0.001",
            size=size,
        )
        raise InvalidParameter(f"{where}.scale", scale, expected)
    if entry.scale is None and size > _UNSCALED and file.suffix.lower() in FORMATS_WITHOUT_UNIT:
        raise InvalidParameter(
            f"{where}.scale",
            None,
            message(
                "stations.scale_for_millimetres", "0.001 for millimetres, or 1 if it is {size:.3g} m long", size=size
            ),
        )
    return PieceModel(folder=mesh.parent, shapes=(PieceShape(mesh=mesh.name, scale=scale),))


def carriers_of(config: StationConfig) -> dict[str, str]:
    """Return which robot carries each piece, directly or through others, or ``world``: each after what it hangs on.

    Raises UnknownName: a parent that is no robot, no piece and not the world; InvalidParameter: pieces that hang on
    each other in a circle.
    """
    parents = {piece: _parent(config, piece) for piece in config.pieces}
    carriers: dict[str, str] = {}
    for piece in _outward(config, parents):
        carriers[piece] = carriers.get(parents[piece], parents[piece])
    return carriers


def _parent(config: StationConfig, piece: str) -> str:
    """Return what a piece hangs on: ``world``, a robot's name or another piece's name."""
    entry = config.pieces[piece]
    if entry.parent is None and not entry.free:
        choices = ", ".join([WORLD, *config.robots, *(other for other in config.pieces if other != piece)])
        expected = message(
            "stations.what_it_hangs_on", "what it hangs on, one of {choices}; or say free: true", choices=choices
        )
        raise InvalidParameter(f"pieces.{piece}.parent", message("stations.left_out", "left out"), expected)
    return entry.parent or WORLD


def _outward(config: StationConfig, parents: Mapping[str, str]) -> list[str]:
    """Return the names of the pieces, each after what it hangs on."""
    for piece, parent in parents.items():
        known = [WORLD, *config.robots, *config.pieces]
        if parent not in known:
            raise UnknownName(
                message("stations.parent_for_piece", "parent for pieces.{piece}", piece=piece),
                parent,
                [name for name in known if name != piece],
            )
    ordered: list[str] = []
    while len(ordered) < len(parents):
        ready = [p for p in parents if p not in ordered and (parents[p] not in parents or parents[p] in ordered)]
        if not ready:
            rest = next(piece for piece in parents if piece not in ordered)
            raise InvalidParameter(
                f"pieces.{rest}.parent",
                parents[rest],
                message("stations.no_piece_below", "no piece that hangs on this one"),
            )
        ordered += ready
    return ordered


def _mount(
    key: str, frame: str | None, parent: str, robots: Mapping[str, RobotModel], pieces: Mapping[str, PieceModel]
) -> str:
    """Return the plant's frame that a piece hangs on: a robot's (:func:`flange`), a piece's; empty for the world."""
    if parent in robots:
        places = [*robots[parent].tools, *robots[parent].links]
        if frame is not None:
            one_of(
                message("stations.tool_or_link_for", "tool or link of {parent} for {key}", parent=parent, key=key),
                frame,
                places,
            )
        return flange(robots[parent].tools, robots[parent].root, frame)
    if parent == WORLD:
        if frame is not None:
            raise Unsuitable(
                key, message("stations.world_without_frames", "the piece hangs on the world, which has no frames")
            )
        return ""
    kind = message("stations.frame_of", "frame of {parent}", parent=parent)
    name = one_of(kind, frame or TCP, pieces[parent].frame_poses)
    return f"{parent}_{name}"


def tool_in_use(own: Mapping[str, str], carried: Sequence[str], tcp: str | None) -> str:
    """Return the tool that a robot's tool centre point belongs to; empty without any.

    That is the one that its station names as ``tcp``, else the outermost piece of those that it carries, in this order,
    else the first of its own, of which the frames are given by name.
    """
    return tcp or [*carried[-1:], *own, ""][0]


def flange(own: Mapping[str, str], root: str, tool: str | None = None) -> str:
    """Return the frame that what a robot carries hangs on: of the tool or link that is named, else of its first tool.

    It is the root where there is none, or where that is a foot: on four legs a load lies on the trunk. ``own`` are the
    frames of its tools by name, ``root`` is that of its root link.
    """
    if tool is not None:
        return own.get(tool, tool)
    first, frame = next(iter(own.items()), (_FOOT, root))
    return root if first.endswith(_FOOT) else frame
