"""The gaits of a robot as stages of its program: which suits it, a single step, and the way into its first posture."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from pydrake.math import RotationMatrix

from simrob_drake.blocks.references import hermite, sequence
from simrob_drake.errors import InvalidParameter, UnknownName, shown
from simrob_drake.frames import Vector
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.checks import check_limits
from simrob_drake.programs.gaits.legs import OutOfReach
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import Posing, load_gaits
from simrob_drake.programs.gaits.registry import Section, carries, first_gait, gaits_of, made_for
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.moves import LegMove, Walk, WalkMove, checked, move_of
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import urdf_with_pieces
from simrob_drake.stations.resolve import ResolvedStation, resolve

SEQUENCE = "step"
"""The sequence of a robot's ``gaits.yaml`` that is a step by joint angles, if it has one."""
_PACES = ("step_time", "leg_time", "move_time")  # what gaits call the time of a step
_READY_TIME, _SETTLE_TIME = 2.0, 0.5
"""Times to take the posture in which a gait begins, and to stand in it, from far away; nearer ones take less [s]."""
_FAR = float(np.deg2rad(45.0))
"""Way of a joint that takes these times; shorter ones take as long as its acceleration then is the same [rad]."""
_SAME = 1e-9  # rad
_AT_REST = 0.02
"""Largest error of a joint [rad] and speed [rad/s] of a robot that stands still; its weight alone costs up to 0.01."""
_LONGEST = 1e4
"""Time of a walk [s]: its reference is planned as a whole."""
_NEAR = 0.05  # m from the soles down to what a robot stands on
_DOWN = (0.0, 0.03, 0.06, 0.1)  # how much lower the hips may be under a load or on a slope, in parts of their height
_SAMPLE = 0.01  # s between the samples of the way into it


def planned_gait(
    robot: LeggedGeometry,
    name: str | None,
    changes: Mapping[str, Any],
    *,
    steps: int | None = None,
    amplitude: float = 1.0,
    station: StationConfig | None = None,
) -> JointMotion:
    """Plan a gait that suits a robot, what it carries, and the slope on which it stands; nothing moves.

    Args:
        robot: whose gait.
        name: of the gait; with steps the first for the robot's feet if None.
        changes: parameters of the gait in place of its own.
        steps: how many; None for gaits that go no steps.
        amplitude: scales the steps.
        station: with the pieces where they will be; as it is now unless given.

    Raises:
        SimrobError: as :meth:`simrob_drake.LeggedRobot.walk`.
    """
    model = robot.model
    what = "act" if steps is None else "gait"
    known = gaits_of(model, steps=steps is not None)
    worn = robot.worn_feet
    name = first_gait(model, worn, known) if name is None else name
    if name not in known:
        raise UnknownName(f"{what} of {model.name}", name, known)
    section, gait = known[name]
    for key in changes:
        if key not in type(gait).model_fields:
            raise UnknownName(f"parameter of the {what} {name}", key, type(gait).model_fields)
    paces = [value for key in _PACES if isinstance(value := changes.get(key, getattr(gait, key, 0)), (int, float))]
    if (steps or 1) * max(paces) > _LONGEST:
        raise InvalidParameter("steps", f"{steps} of {shown(max(paces))} s", f"at most {_LONGEST:g} s in all")
    situation = resolve(station or robot.cell.config)
    _check_station(robot, situation, section, name, held=getattr(gait, "held", False))
    walker = _walker(robot, situation)
    made = changes.get("feet") or made_for(model, gait)
    if section.on_feet and not carries(model, worn, made):
        raise InvalidParameter(f"feet of {model.name}", str(worn), f"{made}, for {name}: set robot.feet to {made}")
    plan = partial(section.plan, walker, *([] if steps is None else [steps]), name)
    sizes = {} if steps is None else {"amplitude": amplitude}
    motion = _within_reach(partial(plan, **sizes), gait, changes, bent=walker.differs)
    check_limits(robot.chain(robot.tools[0]), motion.times, motion.positions, lambda at: (0, f"{name} at {at:.2f} s"))
    return motion


def step_moves(model: RobotModel, feet: str | None, move_time: float | None = None) -> list[LegMove]:
    """Return one step ahead: the robot's sequence ``step``, else a step of its first gait, of full length.

    Args:
        model: the robot.
        feet: those that it wears.
        move_time: of each move of the sequence, or of each step of the gait [s]; their own unless given.

    Raises:
        InvalidParameter: a robot without feet or gaits, without a gait for the feet that it wears, or a time that is
            not positive.
    """
    if model.feet is None:
        raise InvalidParameter("robot", model.name, "one with legs: step() is for legged robots")
    own = load_gaits(model).sequences.get(SEQUENCE)
    if own is not None and carries(model, feet, made_for(model, own)):
        return _moves_of(model, own, move_time)
    known = gaits_of(model, steps=True)
    _, gait = known[first_gait(model, feet, known)]
    keys = type(gait).model_fields
    changes: dict[str, Any] = {"ramp_steps": 0} if "ramp_steps" in keys else {}  # the first step has its full length
    if move_time is not None:
        changes |= {key: move_time for key in _PACES if key in keys}
    return [WalkMove(walk=checked(Walk, steps=1, **changes))]


def _moves_of(model: RobotModel, sequence: Posing, move_time: float | None) -> list[LegMove]:
    times = np.diff([0.0, *(target.time for target in sequence.targets)])
    return [
        move_of(
            target.target_deg
            if isinstance(target.target_deg, dict)
            else dict(zip(model.axes, model.axis_vector(target.target_deg, SEQUENCE).tolist(), strict=True)),
            float(time) if move_time is None else move_time,
        )
        for target, time in zip(sequence.targets, times, strict=True)
    ]


def perform(robot: LeggedGeometry, motion: JointMotion) -> SimulationResult:
    """Run a gait from where a robot stands, and return the run; the floor stays as large as it had to become."""
    cell, own = robot.cell, robot.cell.config
    here = float(np.abs(robot.base_pose.translation()[:2]).max())
    adapted = motion.adapted(own, robot.name, start=here)
    trajectory = hermite(*_from_here(robot, motion))
    del motion  # of ten minutes it takes 16 MB
    cell.change(adapted)
    result = cell.follow({robot.name: trajectory}, trajectory.end_time())
    cell.change(own.model_copy(update={"floor": adapted.floor}))
    return result


def _within_reach(
    plan: Callable[..., JointMotion], gait: Any, changes: Mapping[str, Any], *, bent: bool
) -> JointMotion:
    """Return a planned motion; with ``bent`` knees the hips come down as far as the legs need it, and not too far."""
    if not bent or "bearing" in changes or not hasattr(gait, "bearing"):
        return plan(**changes)
    own = gait.bearing
    for down in _DOWN:
        try:
            return plan(**changes, bearing=own.model_copy(update={"height": own.height * (1 - down)}).model_dump())
        except OutOfReach:
            if down == _DOWN[-1]:
                raise
    raise AssertionError


def _walker(robot: LeggedGeometry, station: ResolvedStation) -> Walker:
    """Return what planners know of a robot: its bodies with what it carries, and gravity as it feels it on a slope."""
    own, gaits = station.robots[robot.name], load_gaits(robot.model)
    skeleton = skeleton_of(own.model, urdf_with_pieces(station, own) if own.carried else None)
    from_floor = station.ground.tilt.rotation().inverse()
    turn = (from_floor @ robot.base_pose.rotation()).matrix()
    heading = np.arctan2(turn[1, 0], turn[0, 0]) + np.deg2rad(gaits.facing_deg)
    seen = RotationMatrix.MakeZRotation(-heading) @ from_floor
    gravity = seen.matrix()[:, 2] * -station.config.gravity
    return Walker(skeleton, gaits, gravity, differs=bool(own.carried or station.ground.incline))


def _check_station(robot: LeggedGeometry, station: ResolvedStation, section: Section, name: str, *, held: bool) -> None:
    """Check that a robot stands, or hangs, as a gait needs it."""
    model, config = robot.model, station.config
    floats = robot.cell.model.floats(robot.name)
    if held and floats:
        raise InvalidParameter("station", config.name, f"one that holds {model.name} by its trunk, for {name}")
    if section.on_feet and not (floats and config.contact and station.ground.carries(robot.soles, _NEAR)):
        wanted = (
            f"a dynamic one with contact and a floor, or a box that is fixed, under {model.name}'s feet, for {name}"
        )
        raise InvalidParameter("station", config.name, wanted)


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
