r"""A kick: standing on one foot, the other one swings through a point at a speed, and comes back beside the first.

Back there at rest, the foot gathers its speed v over a way b so that it is reached at the point, with no jerk of its
acceleration there, and loses it over as long a way behind it:

.. math:: \dot s(t) = v \left(3 u^2 - 2 u^3\right), \qquad u = t / T, \quad T = 2 b / v .
"""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import BPoly

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.biped import SIDES
from simrob_drake.programs.gaits.feet import Foot
from simrob_drake.programs.gaits.gait import Pace, SolvedGait
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.phases import Phase, gait_plan
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.sections import Number, Positive


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
        feet = {foot.name: foot for foot in walker.feet(self.feet)}
        if sorted(feet) != sorted(SIDES):
            raise InvalidParameter(f"robot {walker.model.name}", f"one with {len(feet)} feet", "one with two, to kick")
        if self.foot is not None and self.foot not in feet:
            raise UnknownName(f"foot of {walker.model.name}", self.foot, feet)
        if self.toward_deg and any(len(foot.axes) < 6 for foot in feet.values()):
            expected = f"0, since the legs of {walker.model.name} cannot turn their feet"
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
