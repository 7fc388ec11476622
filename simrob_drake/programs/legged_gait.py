"""The gaits of a robot as stages of its program: which suits it, a single step, and the way into its first posture."""

from collections.abc import Callable, Mapping
from typing import Any

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

_READY_TIME, _SETTLE_TIME = 2.0, 0.5
"""Times to take the posture in which a gait begins, and to stand in it, from far away; nearer ones take less [s]."""
_FAR = float(np.deg2rad(45.0))
"""Way of a joint that takes these times; shorter ones take as long as its acceleration then is the same [rad]."""
_SAME = 1e-9  # rad
_AT_REST = 0.02
"""Largest error of a joint [rad] and speed [rad/s] of a robot that stands still; its weight alone costs up to 0.01."""
_TAUGHT = 1.0  # deg from home
_NEAR = 0.05  # m from the soles down to what a robot stands on
_DOWN = (0.0, 0.03, 0.06, 0.1)  # how much lower the hips may be where the legs need it, in parts of their height
_SAMPLE = 0.01  # s between the samples of the way into it


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
    """Plan a gait that suits a robot, what it carries, and the slope on which it stands; nothing moves.

    ``name`` is None for the first with steps for its feet, ``steps`` for gaits that go none; ``changes`` are of its
    parameters, an amplitude scales its steps, ``station`` says where pieces will be; with ``bends`` the hips come down
    where the legs need it, as they do under a load or on a slope. Raises SimrobError: as
    :meth:`simrob_drake.LeggedRobot.walk`.
    """
    model = robot.model
    what = "act" if steps is None else "gait"
    known = gaits_of(model, steps=steps is not None)
    worn = robot.worn_feet
    name = first_gait(model, worn, known) if name is None else name
    if name not in known:
        raise UnknownName(
            message("programs.gait_or_act_of", "{what} of {model}", what=what, model=model.name), name, known
        )
    gait = known[name]
    for key in changes:
        if key not in type(gait).model_fields:
            raise UnknownName(
                message("programs.parameter_of", "parameter of the {what} {name}", what=what, name=name),
                key,
                type(gait).model_fields,
            )
    situation = resolve(station or robot.cell.config)
    _check_station(robot, situation, gait, name)
    walker = _walker(robot, situation)
    if isinstance(gait, SolvedGait) and "bearing" not in changes:
        gait = _with_arms(gait, model, taught_arms(robot, gait.feet))
    made = changes.get("feet") or gait.made_for(model)
    if gait.on_feet and not carries(model, worn, made):
        raise InvalidParameter(
            message("programs.feet_of", "feet of {model}", model=model.name),
            str(worn),
            message("programs.feet_for_gait", "{made}, for {name}: set robot.feet to {made}", made=made, name=name),
        )
    if gait.on_feet:
        gait.check_feet(model, worn, "robot.feet" if situation.config.only_robot else f"robots.{robot.name}.feet")

    def plan(**others: Any) -> JointMotion:
        return gait.changed({**changes, **others}, amplitude, name).plan(walker, steps or 0, amplitude)

    motion = _within_reach(plan, gait, bent=(bends or walker.differs) and "bearing" not in changes)
    check_limits(
        robot.trunk_chain(),
        motion.times,
        motion.positions,
        lambda time: PathPoint(0, message("programs.point_at_time", "{name} at {time:.2f} s", name=name, time=time)),
    )
    return motion


def perform(robot: LeggedGeometry, motion: JointMotion) -> SimulationResult:
    """Run a gait from where a robot stands, and return the run; the floor stays as large as it had to become."""
    here = float(np.abs(robot.base_pose.translation()[:2]).max())
    adapted = motion.adapted(robot.cell.config, robot.name, start=here)
    trajectory = hermite(*_from_here(robot, motion))
    del motion  # of ten minutes it takes 16 MB
    return robot.cell.follow_as(adapted, {robot.name: trajectory}, trajectory.end_time())


def taught_arms(robot: LeggedGeometry, feet: str | None = None) -> dict[str, float]:
    """Return where axes in no leg were moved to, which gaits leave there, by name [deg]; those near home are none."""
    legs = {axis for foot in Walker.of(robot.model).feet(feet) for axis in foot.axes}
    now, home = np.rad2deg(robot.reference), np.rad2deg(robot.model.home)
    away = [axis for axis in range(len(now)) if axis not in legs and abs(now[axis] - home[axis]) > _TAUGHT]
    return {list(robot.model.axes)[axis]: float(now[axis]) for axis in away}


def _with_arms(gait: SolvedGait, model: RobotModel, arms: dict[str, float]) -> SolvedGait:
    """Return a gait with arms elsewhere [deg]; itself if there are none."""
    if not arms:
        return gait
    degrees = model.axis_vector(gait.bearing.posture_deg, "posture_deg").tolist()
    posture = dict(zip(model.axes, degrees, strict=True)) | arms
    return gait.model_copy(update={"bearing": gait.bearing.model_copy(update={"posture_deg": posture})})


def _within_reach(plan: Callable[..., JointMotion], gait: Gait, *, bent: bool) -> JointMotion:
    """Return a planned motion; with ``bent`` knees the hips come down as far as the legs need it, and not too far."""
    if not bent or not isinstance(gait, SolvedGait):
        return plan()
    own, found = gait.bearing, list[OutOfReach]()
    for down in _DOWN:
        try:
            return plan(bearing=own.model_copy(update={"height": own.height * (1 - down)}).model_dump())
        except OutOfReach as problem:
            found.append(problem)
    raise found[0]


def _walker(robot: LeggedGeometry, station: ResolvedStation) -> Walker:
    """Return what planners know of a robot: its bodies with what it carries, and gravity as it feels it on a slope."""
    own, gaits = station.robots[robot.name], gaits_file(robot.model)
    skeleton = skeleton_of(own.model, urdf_with_pieces(station, own) if own.carried else None)
    from_floor = station.ground.floor_pose.rotation().inverse()
    turn = (from_floor @ robot.base_pose.rotation()).matrix()
    heading = np.arctan2(turn[1, 0], turn[0, 0]) + np.deg2rad(gaits.facing_deg)
    seen = RotationMatrix.MakeZRotation(-heading) @ from_floor
    gravity = seen.matrix()[:, 2] * -station.config.gravity
    return Walker(skeleton, gaits, gravity, differs=bool(own.carried or station.ground.incline))


def _check_station(robot: LeggedGeometry, station: ResolvedStation, gait: Gait, name: str) -> None:
    """Check that a robot stands, or hangs, as a gait needs it."""
    model, config = robot.model, station.config
    floats = robot.cell.model.floats(robot.name)
    if gait.hangs and floats:
        raise InvalidParameter(
            "station",
            config.name,
            message(
                "programs.station_holding_trunk",
                "one that holds {model} by its trunk, for {name}",
                model=model.name,
                name=name,
            ),
        )
    if gait.on_feet and not (floats and config.contact and station.ground.carries(robot.soles, _NEAR)):
        expected = message(
            "programs.station_with_floor",
            "a dynamic one with contact and a floor, or a box that is fixed, under {model}'s feet, for {name}",
            model=model.name,
            name=name,
        )
        raise InvalidParameter("station", config.name, expected)


def _from_here(robot: LeggedGeometry, motion: JointMotion) -> tuple[Vector, Vector, Vector]:
    """Return times, angles and their rates: into the first posture of a motion, a rest, and the motion.

    Way and rest take the less time the nearer the robot is, none if it stands there.
    """
    start, first = robot.reference, motion.positions[0]
    far = float(np.abs(first - start).max())
    share = float(np.sqrt(min(far / _FAR, 1.0))) if far > _SAME else 0.0
    still = max(np.abs(robot.velocity).max(), np.abs(robot.position - start).max()) <= _AT_REST
    count = int(np.ceil(share * _READY_TIME / _SAMPLE))
    begun = (count + int(np.ceil((share if still else 1.0) * _SETTLE_TIME / _SAMPLE))) * _SAMPLE
    if not begun:
        return motion.times, motion.positions, motion.velocities
    times: Vector = np.linspace(0.0, count * _SAMPLE, count + 1)
    way, rates = first[np.newaxis], np.zeros((1, len(first)))
    if count:
        ready = sequence(start, [count * _SAMPLE], [first])
        way, rates = ready.vector_values(times).T, ready.derivative().vector_values(times).T
    return (
        np.concatenate([times, begun + motion.times]),
        np.vstack([way, motion.positions]),
        np.vstack([rates, motion.velocities]),
    )
