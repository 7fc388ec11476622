r"""Two legs: a walk by footsteps, with the posture for every moment of them, and a kick.

Back there at rest, the foot gathers its speed v over a way b so that it is reached at the point, with no jerk of its
acceleration there, and loses it over as long a way behind it:

.. math:: \dot s(t) = v \left(3 u^2 - 2 u^3\right), \qquad u = t / T, \quad T = 2 b / v .
"""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import BPoly

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Positive
from simrob_drake.programs.gaits.motion import EvenSteps, JointMotion, Pace, SolvedGait
from simrob_drake.programs.gaits.phases import Phase, check_steps, gait_plan, on_path, ramp_shares
from simrob_drake.programs.gaits.walker import Foot, Walker
from simrob_drake.programs.gaits.whole_body import WholeBody

SIDES = ("right_foot", "left_foot")  # who steps first, and who next


class BipedWalk(EvenSteps, SolvedGait):
    """A walk on two legs."""

    section: ClassVar[str] = "walks"
    usual: ClassVar[str] = "walk"

    lift: Positive = 0.03
    """Height of the swinging foot [m]."""
    double_support: Positive = 0.2
    """Part of a step in which both feet stand."""
    zmp_inward: Number = 0.0
    """How far inside of the middle of each foot the zero-moment point goes [m]."""
    zmp_ahead: Number = 0.0
    """How far ahead of the middle of each foot it goes [m]."""

    def plan(self, walker: Walker, steps: int, amplitude: float = 1.0) -> JointMotion:
        """Return its motion."""
        return planned_walk(walker, steps, self)[0]


walk = BipedWalk.planned
"""Plan a walk; ``ramp_steps`` steps and one that brings the feet side by side come in addition to the full ones."""


def planned_walk(walker: Walker, steps: int, gait: BipedWalk) -> tuple[JointMotion, Vector, Vector]:
    """Return a walk, and its zero-moment point as asked for and as planned, each (m, 2) [m]."""
    feet = walker.feet_called(SIDES, gait.feet, message("programs.two_feet_to_walk", "two feet, to walk so"))
    _check(walker.model.name, steps, gait, feet)
    start = {name: np.array([0.0, foot.home[1] + foot.side * gait.widen, 0.0]) for name, foot in feet.items()}
    way = gait_plan(start, np.array([gait.zmp_ahead, 0.0]), _phases(steps, gait, start))
    motion, zmp = WholeBody(walker, gait, way).solve()
    return motion, way.zmp, zmp


def _phases(steps: int, gait: BipedWalk, start: dict[str, Vector]) -> list[Phase]:
    shift = gait.double_support * gait.step_time
    place = {name: at.copy() for name, at in start.items()}
    pose = np.zeros(3)

    def under(name: str) -> Vector:
        inward = -np.sign(start[name][1]) * gait.zmp_inward
        return on_path(place[name], gait.zmp_ahead, inward)[:2]

    phases = [Phase(gait.settle, under(SIDES[1]), gait.settle)]
    for number, share in enumerate(ramp_shares(steps, gait.ramp_steps)):
        swinging, standing = SIDES[number % 2], SIDES[(number + 1) % 2]
        move = share * np.array([gait.step_length, gait.sideways, np.deg2rad(gait.turn_deg)])
        pose = on_path(pose, *move)
        goal = on_path(pose, left=start[swinging][1])
        delay = shift if number else 0.0  # at first the weight is on the standing foot already
        step = Phase(gait.step_time, under(standing), delay, {swinging: goal}, gait.lift, delay, heading=pose[2])
        phases.append(step)
        place[swinging] = goal
    middle = on_path(pose, gait.zmp_ahead)[:2]
    phases.append(Phase(gait.settle, middle, gait.settle, heading=pose[2]))
    if gait.rest > 0:
        phases.append(Phase(gait.rest, middle, 0.0, heading=pose[2]))
    return phases


_AXES_OF_LEG_WITHOUT_YAW = 4  # such a leg has no yaw at the hip and no roll at the ankle


def _check(robot: str, steps: int, gait: BipedWalk, feet: dict[str, Foot]) -> None:
    """Check that a walk has steps, that each has a part on one foot, and that the legs can turn if it does.

    Raises:
        InvalidParameter: with the parameter that cannot be.
    """
    check_steps(steps)
    if not gait.double_support < 1:
        raise InvalidParameter(
            "double_support", gait.double_support, message("programs.part_of_step", "a part of the step, less than 1")
        )
    if any(len(foot.axes) == _AXES_OF_LEG_WITHOUT_YAW for foot in feet.values()) and (gait.turn_deg or gait.sideways):
        raise InvalidParameter(
            "turn_deg, sideways",
            (gait.turn_deg, gait.sideways),
            message(
                "programs.legs_cannot_turn", "0, since the legs of {robot} cannot turn or roll their feet", robot=robot
            ),
        )


class Kick(SolvedGait):
    """A kick on two legs."""

    section: ClassVar[str] = "kicks"
    usual: ClassVar[str] = "kick"

    foot: str | None = None
    """Which foot kicks; the nearer one to a ball, the right one without."""
    speed: Positive = 0.6
    """Of its tip at the point [m/s]."""
    point: tuple[Number, Number] | None = None
    """Which its tip goes through: ahead and to the left of the middle of the feet [m]; before the foot unless given."""
    toward_deg: Number = 0.0
    """Where to, counterclockwise from ahead [deg]."""
    swing: Positive = 0.08
    """The way on which it gathers its speed, and loses it [m]."""
    lift: Positive = 0.03
    """Height of its sole meanwhile [m]."""
    zmp_inward: Number = 0.0
    """How far inside of the middle of the standing foot the zero-moment point goes [m]."""
    zmp_ahead: Number = 0.0
    """How far ahead of it [m]."""
    settle: Pace = 1.0
    """Time to shift the weight to one foot, and to both again [s]."""
    raising: Pace = 0.6
    """Time to bring the foot up and back, and down again [s]."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Return its motion."""
        feet = self._feet(walker)
        start = {foot.name: self._home(foot) for foot in feet.values()}
        kicking, standing = self._kicking_and_standing(feet)
        over = start[standing.name][:2] + np.array([self.zmp_ahead, -standing.side * self.zmp_inward])
        times, knots = self._way(kicking)
        phases = [
            Phase(self.settle, over, self.settle),
            Phase(times[-1], over, 0.0),
            Phase(self.settle + self.rest, np.array([self.zmp_ahead, 0.0]), self.settle),
        ]
        way = gait_plan(start, np.array([self.zmp_ahead, 0.0]), phases)
        swung = BPoly.from_derivatives(times, knots)(np.clip(way.times - self.settle, 0.0, times[-1]))
        motion = replace(way, feet={**way.feet, kicking.name: swung})
        return WholeBody(walker, self, motion).solve()[0]

    def aimed(
        self, walker: Walker, root: Vector, angles: Vector, *, ball: Vector, radius: float, toward: Vector | None
    ) -> dict[str, Any]:
        """Return the parameters with which it hits a ball of a radius [m] at a place (2,) [m] in its middle.

        The robot's root has a pose (4, 4) in the world, its axes angles (n,) [rad]. The ball shall go ``toward`` (2,)
        [m], where the standing foot looks unless given.
        """
        feet = self._feet(walker)
        poses = {name: foot.poses(angles[np.newaxis], root[np.newaxis])[0] for name, foot in feet.items()}
        near = min(feet, key=lambda name: abs(_seen(poses[name], ball)[1]))
        kicking, standing = self._kicking_and_standing(feet, near)
        pose = poses[standing.name]
        place = _seen(pose, ball)
        way = np.array([1.0, 0.0]) if toward is None else _seen(pose, toward) - place
        turn = float(np.arctan2(way[1], way[0]))
        point = place + self._home(standing)[:2] - radius * np.array([np.cos(turn), np.sin(turn)])
        aim = {"foot": kicking.name, "toward_deg": float(np.rad2deg(turn)), "point": point.tolist()}
        return aim if radius <= kicking.over else {**aim, "lift": radius - kicking.over}

    def _feet(self, walker: Walker) -> dict[str, Foot]:
        feet = walker.feet_called(SIDES, self.feet, message("programs.two_feet_to_kick", "two, to kick"))
        if self.foot is not None and self.foot not in feet:
            raise UnknownName(message("programs.foot_of", "foot of {model}", model=walker.model.name), self.foot, feet)
        if self.toward_deg and any(len(foot.axes) < 6 for foot in feet.values()):
            expected = message(
                "programs.legs_cannot_turn_feet",
                "0, since the legs of {model} cannot turn their feet",
                model=walker.model.name,
            )
            raise InvalidParameter("toward_deg", self.toward_deg, expected)
        return feet

    def _kicking_and_standing(self, feet: dict[str, Foot], near: str = SIDES[0]) -> tuple[Foot, Foot]:
        kicking = self.foot or near
        (standing,) = (foot for name, foot in feet.items() if name != kicking)
        return feet[kicking], standing

    def _home(self, foot: Foot) -> Vector:
        """Return where a foot stands before and after, ahead and to the left of the middle, and turned, shape (3,)."""
        return np.array([0.0, foot.home[1] + foot.side * self.widen, 0.0])

    def _way(self, foot: Foot) -> tuple[Vector, list[Vector]]:
        """Return times (5,) [s] of the foot's way, and place, velocity and acceleration at each, (3, 4) [m, rad, s]."""
        turn, home = np.deg2rad(self.toward_deg), self._home(foot)
        ahead = np.array([np.cos(turn), np.sin(turn), 0.0, 0.0])
        hit = np.array([*home[:2], self.lift, turn]) + self.swing * ahead
        if self.point is not None:
            hit[:2] = self.point - foot.half[0] * ahead[:2]
        knots = np.zeros((5, 3, 4))
        knots[[0, 4], 0] = [*home[:2], 0.0, home[2]]
        knots[1:4, 0] = hit + np.outer([-self.swing, 0.0, self.swing], ahead)
        knots[2, 1] = self.speed * ahead
        stroke = 2.0 * self.swing / self.speed
        return np.cumsum([0.0, self.raising, stroke, stroke, self.raising]), list(knots)


def _seen(foot: Vector, place: Vector) -> Vector:
    """Return a place of the floor, shape (2,) [m], seen from a foot's pose, shape (4, 4): ahead and to the left."""
    ahead = foot[:2, 0] / np.linalg.norm(foot[:2, 0])
    return np.array([[ahead[0], ahead[1]], [-ahead[1], ahead[0]]]) @ (place - foot[:2, 3])
