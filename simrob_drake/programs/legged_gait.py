"""Gaits of a robot in its station: planned for its load and its slope, and run from where the robot is.

A run begins with a motion into the first posture of the gait and a rest in it, both as short as the robot's posture
allows.

The *bearing* of a gait is how the robot holds itself in it: the height of its hips, and the positions of axes in no
leg. A *solved* gait is one whose legs are computed by inverse kinematics. The *walker* is the robot's description for
planners of gaits.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RotationMatrix

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import hermite, sequence
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.legs import OutOfReach
from simrob_drake.programs.gaits.motion import Gait, JointMotion, SolvedGait
from simrob_drake.programs.gaits.registry import carries, first_gait, gaits_of
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.plan import check_limits
from simrob_drake.programs.segments import PathPoint
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import urdf_with_pieces
from simrob_drake.stations.resolve import ResolvedStation, resolve

# Times for a robot whose posture is far from the first one of a gait; nearer ones take less.
_READY_TIME = 2.0  # to move into the first posture [s]
_SETTLE_TIME = 0.5  # to rest in it [s]
# Largest change of a joint from which the times above apply [rad]. A shorter one takes a time with which the
# acceleration of the joint is the same.
_FAR = float(np.deg2rad(45.0))
_SAME = 1e-9  # largest difference of two postures that are the same [rad]
# Largest error of a joint [rad] and speed [rad/s] of a robot at rest. Its weight alone causes errors up to 0.01.
_AT_REST = 0.02
_MOVED_ARM = 1.0  # least distance of an arm from home at which a gait leaves it where it is [deg]
_NEAR = 0.05  # longest distance from the soles down to the boxes on which a robot stands if there is no floor [m]
# How much lower the hips may be if the legs are too short, as parts of their height; tried one after the other.
_LOWER_BY = (0.0, 0.03, 0.06, 0.1)
_SAMPLE = 0.01  # time between the samples of the motion into the first posture [s]


def planned_gait(
    robot: LeggedGeometry,
    name: str | None,
    changes: Mapping[str, Any],
    *,
    steps: int | None = None,
    amplitude: float = 1.0,
    station: StationConfig | None = None,
    bends: bool = False,
) -> JointMotion:
    """Plan a gait for a robot in a station: with its load and its arms, and on its slope. Nothing moves.

    Args:
        robot: the robot.
        name: name of the gait. If it is None, the first one for its feet: with steps if `steps` is given, else without.
        changes: values of parameters that replace those of the gait.
        steps: count of steps. It is None for gaits without steps.
        amplitude: factor of the parameters that the gait scales, such as the step length.
        station: the station as it will be. If it is None, as it is.
        bends: whether the hips may be lower if the legs are too short. They may always under a load or on a slope, and
            never if `changes` sets a bearing.

    Returns:
        The motion, checked for the limits of the axes. How the robot gets into its first posture is no part of it.

    Raises:
        UnknownName: there is no such gait, or it has no such parameter.
        InvalidParameter: the gait needs other feet or another station.
        SimrobError: the legs cannot do the steps, or a parameter has an invalid value.
    """
    model = robot.model
    has_steps = steps is not None
    gaits = gaits_of(model, steps=has_steps)
    worn = robot.worn_feet
    name = first_gait(model, worn, gaits) if name is None else name
    if name not in gaits:
        what = message("programs.act_of", "act of {model}", model=model.name)
        if has_steps:
            what = message("programs.gait_of", "gait of {model}", model=model.name)
        raise UnknownName(what, name, gaits)
    gait = gaits[name]
    # The fields of a gait's class are its parameters.
    for key in changes:
        if key not in type(gait).model_fields:
            raise UnknownName(
                message("programs.parameter_of", "parameter of the gait {name}", name=name),
                key,
                type(gait).model_fields,
            )
    situation = resolve(station or robot.cell.config)
    _check_station(robot, situation, gait, name)
    walker = _walker(robot, situation)
    # A bearing that the user sets decides about the arms, too, and about the height of the hips.
    sets_bearing = "bearing" in changes
    if isinstance(gait, SolvedGait) and not sets_bearing:
        gait = _with_arms(gait, model, taught_arms(robot, gait.feet))
    # Kind of feet for which the gait is made, and the key of the station that chooses the robot's feet.
    made = changes.get("feet") or gait.made_for(model)
    feet_key = f"{situation.config.robot_key(robot.name)}.feet"
    if gait.on_feet and not carries(model, worn, made):
        raise InvalidParameter(
            message("programs.feet_of", "kind of feet of {model}", model=model.name),
            str(worn),
            message(
                "programs.feet_for_gait",
                "{made} for the gait {name}: set {key} to {made}",
                made=made,
                name=name,
                key=feet_key,
            ),
        )
    if gait.on_feet:
        gait.check_feet(model, worn, feet_key)

    def plan(**others: Any) -> JointMotion:
        """Plan the gait with further changes of its parameters, which replace those of the user."""
        return gait.with_changes({**changes, **others}, amplitude, name).plan(
            walker, steps or 0, amplitude
        )

    may_be_lower = (bends or walker.is_loaded_or_inclined) and not sets_bearing
    motion = (
        _plan_within_reach(plan, gait) if may_be_lower and isinstance(gait, SolvedGait) else plan()
    )
    check_limits(
        robot.trunk_chain(),
        motion.times,
        motion.positions,
        lambda time: PathPoint(
            0, message("programs.point_at_time", "{name} at {time:.2f} s", name=name, time=time)
        ),
    )
    return motion


def perform(robot: LeggedGeometry, motion: JointMotion) -> SimulationResult:
    """Run a planned gait from where a robot stands, and return the result. A floor that had to become larger stays so.

    A motion into the first posture comes before it, unless the robot rests there already. During the run the station
    has the gains and the steps of the solver that the gait needs.

    Args:
        robot: the robot.
        motion: the planned gait.
    """
    # The larger coordinate decides how far the robot is from the edge of the floor, a square around the origin [m].
    start = float(np.abs(robot.base_pose.translation()[:2]).max())
    station = motion.adapt_station(robot.cell.config, robot.name, start=start)
    path = _path_from_here(robot, motion)
    trajectory = hermite(path.times, path.positions, path.velocities)
    # Free the plan and the path before the run: ten minutes of a plan take 16 MB.
    del motion, path
    return robot.cell.follow_as(station, {robot.name: trajectory}, trajectory.end_time())


def taught_arms(robot: LeggedGeometry, feet: str | None = None) -> dict[str, float]:
    """Find the axes in no leg whose references are more than 1 degree from home. A solved gait leaves them there.

    Args:
        robot: the robot.
        feet: kind of its feet, which decides which axes are in legs. If it is None, the default one.

    Returns:
        Reference of each such axis by name [deg].
    """
    names = list(robot.model.axes)
    leg_axes = {axis for foot in Walker.of(robot.model).feet(feet) for axis in foot.axes}
    reference = np.rad2deg(robot.reference)
    home = np.rad2deg(robot.model.home)
    arms = {}
    for axis, name in enumerate(names):
        is_moved = abs(reference[axis] - home[axis]) > _MOVED_ARM
        if axis not in leg_axes and is_moved:
            arms[name] = float(reference[axis])
    return arms


def _with_arms(gait: SolvedGait, model: RobotModel, arms: dict[str, float]) -> SolvedGait:
    """Make a copy of a gait with other positions of arms in its bearing. Without any, it is the gait itself.

    Args:
        gait: the gait.
        model: the robot.
        arms: position of each such axis by name [deg].
    """
    if not arms:
        return gait
    degrees = model.axis_vector(gait.bearing.posture_deg, "posture_deg").tolist()
    posture = dict(zip(model.axes, degrees, strict=True)) | arms
    bearing = gait.bearing.model_copy(update={"posture_deg": posture})
    return gait.model_copy(update={"bearing": bearing})


def _plan_within_reach(plan: Callable[..., JointMotion], gait: SolvedGait) -> JointMotion:
    """Plan a gait with hips that are as high as the legs allow: unchanged, or lower by 3, 6 or 10 % of their height.

    Args:
        plan: function that plans the gait. Its keyword arguments replace parameters.
        gait: the gait.

    Raises:
        OutOfReach: even with the lowest hips a leg is too short, or a joint is beyond a limit. It is the error of the
            highest hips.
    """
    bearing = gait.bearing
    problems = list[OutOfReach]()
    for lower_by in _LOWER_BY:
        lower_bearing = bearing.model_copy(update={"height": bearing.height * (1 - lower_by)})
        try:
            return plan(bearing=lower_bearing.model_dump())
        except OutOfReach as problem:
            problems.append(problem)
    raise problems[0]


def _walker(robot: LeggedGeometry, station: ResolvedStation) -> Walker:
    """Describe a robot for planners: its bodies with what it carries, and gravity in the frame of its ground.

    Args:
        robot: the robot, at its current pose.
        station: the station as it will be.
    """
    resolved_robot = station.robots[robot.name]
    gaits = gaits_file(robot.model)
    skeleton = skeleton_of(
        resolved_robot.model,
        urdf_with_pieces(station, resolved_robot) if resolved_robot.carried else None,
    )
    # On a slope the floor is rotated against the world. In the floor's frame, the robot looks in direction `heading`
    # [rad]; planners need gravity in a frame that is turned about the floor's normal so that the robot looks along x.
    floor_from_world = station.ground.floor_pose.rotation().inverse()
    trunk = (floor_from_world @ robot.base_pose.rotation()).matrix()
    heading = np.arctan2(trunk[1, 0], trunk[0, 0]) + np.deg2rad(gaits.facing_deg)
    plan_from_world = RotationMatrix.MakeZRotation(-heading) @ floor_from_world
    # The third column is the world's upward direction in this frame; gravity [m/s²] points the other way.
    gravity = plan_from_world.matrix()[:, 2] * -station.config.gravity
    return Walker(
        skeleton,
        gaits,
        gravity,
        is_loaded_or_inclined=bool(resolved_robot.carried or station.ground.incline),
    )


def _check_station(robot: LeggedGeometry, station: ResolvedStation, gait: Gait, name: str) -> None:
    """Check that a robot stands on the ground, or is held by its trunk, as a gait needs it. Some gaits need neither.

    A floor counts as ground under the robot, however far below. Without a floor, all feet need a fixed box within 5 cm.

    Args:
        robot: the robot.
        station: the station as it will be.
        gait: the gait.
        name: name of the gait for the message.

    Raises:
        InvalidParameter: the gait is for a held trunk, and this one is free; or the gait is on feet, and the trunk is
            held, or the station is kinematic or has no contact or no such ground.
    """
    model = robot.model
    config = station.config
    floats = robot.cell.model.floats(robot.name)
    if gait.hangs and floats:
        raise InvalidParameter(
            "station",
            config.name,
            message(
                "programs.station_holding_trunk",
                "a station that holds the trunk of {model}, for {name}",
                model=model.name,
                name=name,
            ),
        )
    # In a kinematic station no base floats.
    stands = floats and config.contact and station.ground.carries(robot.soles, _NEAR)
    if gait.on_feet and not stands:
        expected = message(
            "programs.station_with_floor",
            "a dynamic station with contact, and with a floor or a fixed box under the feet of {model}, for {name}",
            model=model.name,
            name=name,
        )
        raise InvalidParameter("station", config.name, expected)


class _JointPath(NamedTuple):
    """Motion of all axes.

    Attributes:
        times: times of the samples, shape (m,) [s].
        positions: positions of the axes, shape (m, n) [rad].
        velocities: velocities of the axes, shape (m, n) [rad/s].
    """

    times: Vector
    positions: Vector
    velocities: Vector


def _path_from_here(robot: LeggedGeometry, motion: JointMotion) -> _JointPath:
    """Put a motion into the first posture, and a rest in it, before a planned motion.

    The motion takes less time the nearer the robot's reference is to that posture. So does the rest, if the robot is at
    rest now; otherwise it has its full length. Both take no time if the robot is at rest in the posture.

    Args:
        robot: the robot.
        motion: the planned motion.
    """
    start = robot.reference
    first = motion.positions[0]
    distance = float(np.abs(first - start).max())
    # Rest to rest, the acceleration is proportional to distance / time²: it stays the same for time ~ sqrt(distance).
    share = float(np.sqrt(min(distance / _FAR, 1.0))) if distance > _SAME else 0.0
    largest_error = np.abs(robot.position - start).max()  # of the servos [rad]
    is_at_rest = max(np.abs(robot.velocity).max(), largest_error) <= _AT_REST
    rest_share = share if is_at_rest else 1.0
    ready_samples = int(np.ceil(share * _READY_TIME / _SAMPLE))
    rest_samples = int(np.ceil(rest_share * _SETTLE_TIME / _SAMPLE))
    motion_start = (ready_samples + rest_samples) * _SAMPLE
    if not motion_start:
        return _JointPath(motion.times, motion.positions, motion.velocities)
    ready_time = ready_samples * _SAMPLE
    times: Vector = np.linspace(0.0, ready_time, ready_samples + 1)
    # If the robot is in the first posture, there is a single sample, at the time 0. The rest needs no samples of its
    # own: between the last sample of this motion and the first one of the gait, both in the posture, the robot stays.
    positions = first[np.newaxis]
    velocities = np.zeros((1, len(first)))
    if ready_samples:
        ready = sequence(start, [ready_time], [first])
        positions = ready.vector_values(times).T
        velocities = ready.derivative().vector_values(times).T
    return _JointPath(
        times=np.concatenate([times, motion_start + motion.times]),
        positions=np.vstack([positions, motion.positions]),
        velocities=np.vstack([velocities, motion.velocities]),
    )
