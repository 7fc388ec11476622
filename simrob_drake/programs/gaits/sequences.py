"""Postures one after the other: the thesis's step and march, bows, waves, swimming strokes, as data."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from simrob_drake.blocks.references import smooth
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.interpolation import stacked
from simrob_drake.kinematics.skeleton import Skeleton
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import March, Posing
from simrob_drake.programs.gaits.phases import SAMPLE, check_steps
from simrob_drake.programs.gaits.walker import Walker, mirrored
from simrob_drake.robots.axis_values import AxisValues
from simrob_drake.robots.catalog import RobotModel


def posing(robot: str | RobotModel | Walker, name: str, **changes: Any) -> JointMotion:
    """Return one of a robot's sequences of postures.

    Args:
        robot: its name, its model, or a :class:`Walker` that tells what it carries and on what slope.
        name: of the sequence in the robot's `gaits.yaml`.
        changes: parameters of :class:`Posing` to change.

    Raises:
        UnknownName: no such sequence, or an axis that is none.
        InvalidConfig: a parameter that cannot be.
        InvalidParameter: targets whose times do not rise.
    """
    walker = Walker.of(robot)
    gait: Posing = walker.gait("sequences", name, changes)
    model = walker.model
    start = _vector(model, gait.start_deg, np.zeros(len(model.axes)))
    times, postures = [0.0], [start]
    for number in range(gait.repeat):
        begun = number * gait.targets[-1].time
        for target in gait.targets:
            times.append(begun + target.time)
            postures.append(_vector(model, target.target_deg, postures[-1]))
    if (np.diff(times) <= 0).any():
        raise InvalidParameter("targets", f"at {[target.time for target in gait.targets]} s", "one after the other")
    motion = _motion(walker, gait.feet, times, postures, gait.ramps, gait.rest)
    return replace(motion, feed_velocity=gait.feed_velocity, falls=gait.falls)


def march(
    robot: str | RobotModel | Walker, steps: int, name: str = "march", *, amplitude: float = 1.0, **changes: Any
) -> JointMotion:
    """Return a walk by joint angles in the thesis's manner: each step a few sub-moves, left and right in turn.

    Args:
        robot: its name, its model, or a :class:`Walker` that tells what it carries and on what slope.
        steps: how many full steps ahead; the first and the last one are half as long, so there is one more.
        name: of the march in the robot's `gaits.yaml`.
        amplitude: scales how far all joints go from the posture at the start, which keeps their proportions.
        changes: parameters of :class:`March` to change.

    Raises:
        InvalidParameter: no step, or an amplitude that is not positive.
        UnknownName: no such march.
    """
    walker = Walker.of(robot)
    gait: March = walker.gait("marches", name, changes)
    check_steps(steps)
    if not amplitude > 0:
        raise InvalidParameter("amplitude", amplitude, "positive")
    model = walker.model
    start = _vector(model, gait.start_deg, np.zeros(len(model.axes)))
    left = [_vector(model, posture, start) for posture in gait.left]
    moves = {0: left, 1: [mirrored(model, posture) for posture in left]}
    postures = [start]
    for step in range(steps + 1):
        share = amplitude * (0.5 if step == 0 else 1.0)
        sub_moves = moves[step % 2] if step < steps else [*moves[step % 2][:-1], start]
        postures += [start + share * (posture - start) for posture in sub_moves]
    times = np.arange(len(postures)) * gait.move_time
    motion = _motion(walker, gait.feet, list(times), postures, "linear", gait.rest)
    return replace(motion, servo=gait.servo, feed_velocity=gait.feed_velocity)


def standing_height(skeleton: Skeleton, angles: Vector, feet: str | None = None) -> float:
    """Return how high the root of a robot is while its lowest foot touches the floor [m]."""
    if skeleton.model.feet is None:
        return 0.0
    frames, contact = skeleton.frames(angles[np.newaxis]), skeleton.model.feet.kind(feet)
    lowest = [contact.lowest_points(link, skeleton.link_poses(link, frames))[0, :, 2].min() for link in contact.links]
    return -min(0.0, *map(float, lowest))


def _vector(model: RobotModel, values: AxisValues, otherwise: Vector) -> Vector:
    return np.deg2rad(model.axis_vector(values, "target_deg", np.rad2deg(otherwise)))


def _motion(
    walker: Walker,
    feet: str | None,
    times: Sequence[float],
    postures: Sequence[Vector],
    ramps: Literal["smooth", "linear"],
    rest: float,
) -> JointMotion:
    """Join postures, by straight lines or at rest in each."""
    at: Vector = np.arange(round((times[-1] + rest) / SAMPLE) + 1, dtype=float) * SAMPLE
    piece = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    starts, ends = np.array(times)[piece], np.array(times)[piece + 1]
    share = np.clip((at - starts) / (ends - starts), 0.0, 1.0)
    if ramps == "smooth":
        share = smooth(share)
    table = np.array(postures)
    positions = table[piece] + share[:, np.newaxis] * (table[piece + 1] - table[piece])
    count, height = len(at), standing_height(walker.skeleton, table[0], feet)
    root = stacked(np.tile([0.0, 0.0, height], (count, 1)), np.tile(np.eye(3), (count, 1, 1)))
    return JointMotion(walker.model, feet, at, positions, root)
