"""A station's configuration with the robots and pieces behind its names: read once, and checked as a whole.

A *part* of a station is a sensor, a monitor, a controller, a coupling or a force. A *gear* is a coupling of axes; a
*mimic joint*, which follows another joint by its robot's file, becomes a gear. The *carrier* of a piece is the robot on
which it is mounted, directly or through other pieces, or the world. *Drives* are rotors, gears and friction of motors.
The *engine* is what moves the station.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
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
from simrob_drake.robots.pieces import TCP
from simrob_drake.stations.config import (
    FloorConfig,
    JointStops,
    RobotConfig,
    ServoConfig,
    StationConfig,
)
from simrob_drake.stations.coupled import coupled_axes, mimic_gears, starting_positions
from simrob_drake.stations.prescribed import with_prescribed_axes
from simrob_drake.stations.resolved_pieces import held_pieces, resolved_pieces, tool_in_use
from simrob_drake.stations.servos import (
    check_drives,
    check_motors,
    check_servo_uses_no_model,
    drives_of,
    servo_gains,
    station_motors,
    with_passive_axes,
)
from simrob_drake.stations.target_limits import check_targets


@dataclass(frozen=True)
class ResolvedStation(StationContents):
    """A station's configuration with the robots, pieces and sensors behind its names."""

    # Its configuration, with the gears of axes that mimic others in their robots' files.
    config: StationConfig
    # Gears of mimic joints that the solver does not hold, by key. The start and the references obey these gears, but no
    # force holds the axes together during a run.
    unheld_gears: Mapping[str, Gear] = field(default_factory=dict)
    # Keys of the gears that come from the robots' files, not from the station.
    mimics: tuple[str, ...] = ()

    @cached_property
    def couplings_of_axes(self) -> CoupledAxes:
        """The couplings between axes, of all robots in order, by their full names."""
        axes = [f"{robot.prefix}{axis}" for robot in self.robots.values() for axis in robot.axes]
        return coupled_axes(self.config, self.unheld_gears, axes)


_SERVO_KEYS = "kp", "ki", "kd", "torque_limit", "integral_limit", "speed_limit"


# Stations that were resolved last, by the identity of their configuration. A run resolves the same configuration
# when it is loaded and checked, and when its diagram is built.
_STATIONS: FileCache[tuple[StationConfig, ResolvedStation]] = FileCache(size=8)
# Robots that were read last, by the name or file that a station gives for them. Changed copies of a configuration,
# such as those with other pieces or forces, have the same robots.
_ROBOTS: FileCache[RobotModel] = FileCache(size=32)


def resolve(config: StationConfig) -> ResolvedStation:
    """Read the robots and pieces of a station, and check that its keys fit them.

    The results for the last configuration objects are kept, and returned again until one of the station's files
    changes.

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
    """Read the robots and pieces of a station, and complete its configuration. Raises the errors of `resolve`.

    The configuration of the result has the inputs that controllers need, and the gears of mimic joints that the engine
    holds, in addition to those of the station's file.
    """
    # Controllers that read and drive signals of the station need inputs that its file may not list.
    readers = readers_of(config.controllers).values()
    needed_inputs = {name for reader in readers for name in reader.needs}
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
    # Initial positions by robot. Before the robots, as an axis may follow one of another robot.
    starts = starting_positions(config, models, unheld_gears)
    pieces = {piece.name: piece for piece in resolved_pieces(config, models)}
    # Sensors and couplings name robots, pieces and the world alike, so that a name must be unique.
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
        # Sorted by how many sensors each one reads, so that a sensor comes after those that it reads: sensors that read
        # others are not read themselves.
        sensors=dict(sorted(sensors.items(), key=lambda entry: len(entry[1].read(sensors)))),
        config=config,
        unheld_gears=unheld_gears,
        mimics=tuple(mimics),
    )


def check_parts(station: ResolvedStation) -> None:
    """Check that something in a station moves, that its engine supports its parts, and that parts find what they name.

    Targets of references are compared with the limits of the axes, see `check_targets`.

    Raises:
        SimrobError: something does not fit; the message names the key and what would be right.
    """
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
    """Check that the engine of a station supports its contact model, its prescribed joints and its couplings.

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
    refused = dict[
        str, list[str]
    ]()  # by the key of a section, the entries that the engine does not support
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

    If a value of the drives is given several times, that of the station counts, otherwise that of the robot's own file,
    otherwise that of the motor.

    Args:
        entry: the robot's section in the station.
        servo: the section of its servos, which may name passive axes and motors.

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
    # Drives that are applied later replace earlier ones, so those of the motors come first. `robot.drives` has the
    # values of the robot's file, or of the station where it gives a value.
    without_drives = robot.model_copy(update={"drives": Drives()})
    return without_drives.with_drives(drives_of(motors, robot)).with_drives(robot.drives)


def _robot_as_described(entry: RobotConfig) -> RobotModel:
    """Read a robot from its files, or take it from the cache, without the drives that the station gives it.

    A robot whose files have changed is read again.

    Raises:
        SimrobError: the files have a defect.
    """
    options = "" if entry.import_options is None else entry.import_options.model_dump_json()
    # Everything on which the robot depends in addition to the content of its files. The granted folders, from which the
    # user allows meshes and packages to be read, decide which files are found.
    key = (entry.urdf, entry.model, options, tuple(granted_folders()))
    return _ROBOTS.value(key, lambda: _robot_from_files(entry))


def _robot_from_files(entry: RobotConfig) -> RobotModel:
    """Read a robot from its files, with its URDF or with the links that follow from its Denavit-Hartenberg table.

    Raises:
        SimrobError: the files have a defect.
    """
    robot = _described_robot(entry)
    robot.element  # noqa: B018  # read now, so that the cache records the file of the URDF
    return robot


def _described_robot(entry: RobotConfig) -> RobotModel:
    """Read the description of a robot: a URDF, a YAML file, or a robot of the package by its name."""
    if entry.urdf is not None:
        # Few stations need the importer, which takes time to load. It reads a URDF without defects where it is, unless
        # the station gives options of an import, and imports all others.
        from simrob_drake.importer.importing import robot_from_file

        return robot_from_file(entry.urdf, entry.import_options)
    # Here a text that is no YAML name is the name of a robot of the package, and never a path.
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
        contact: model of contact, such as ``point``, or an empty text without contact.
        pieces: the station's pieces, each after its parent.

    Raises:
        InvalidParameter: the floor has soft terrain, but contact is at points.
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
    """Yield the boxes that others can touch, of all pieces that are fixed to the world, directly or through others.

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
        check_servo_uses_no_model(servo)
    if model.feet is None and entry.feet is not None:
        problem = message("stations.has_no_feet", "{model} has no feet", model=model.name)
        raise Unsuitable(f"robots.{name}.feet", problem)
    carried = tuple(piece.name for piece in pieces.values() if piece.carrier == name)
    carriers = {piece.name: piece.carrier for piece in pieces.values()}
    held = held_pieces(config, carriers, name, model.tools)
    # Each carried piece is a tool, too, whose frame is its tool centre point.
    tool_frames = {**model.tools, **{piece: f"{piece}_{TCP}" for piece in carried}}
    # A link of the robot may be the tool as well, such as a foot.
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
    has_free_base = model.base == "floating"
    # A robot with a free base stands on the floor, which may be inclined: its base is relative to the floor.
    origin = ground.floor_pose if has_free_base else RigidTransform()
    base = origin @ transform_from_pose(entry.base)
    robot = ResolvedRobot(
        name=name,
        prefix=config.prefix(name),
        model=model,
        base=base,
        # A kinematic station holds a free base at its pose, too.
        floats=config.engine.moves_by_forces and has_free_base,
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
    """Check that mappings and lists of values by axis in the servo and the reference of a robot fit its axes.

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
