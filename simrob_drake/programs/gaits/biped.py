"""Walking on two legs: footsteps, and the posture for every moment of them."""

from typing import ClassVar

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.feet import Foot
from simrob_drake.programs.gaits.gait import EvenSteps, SolvedGait
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.phases import Phase, check_steps, gait_plan, on_path, ramp_shares
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.sections import Number, Positive

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
    feet = {foot.name: foot for foot in walker.feet(gait.feet)}
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


def _check(robot: str, steps: int, gait: BipedWalk, feet: dict[str, Foot]) -> None:
    if sorted(feet) != sorted(SIDES):
        raise InvalidParameter(f"robot {robot}", f"one with {len(feet)} feet", "one with two feet, to walk so")
    check_steps(steps)
    if not gait.double_support < 1:
        raise InvalidParameter("double_support", gait.double_support, "a part of the step, less than 1")
    if any(len(foot.axes) == 4 for foot in feet.values()) and (gait.turn_deg or gait.sideways):
        raise InvalidParameter("turn_deg, sideways", (gait.turn_deg, gait.sideways),
                               f"0, since the legs of {robot} cannot turn or roll their feet")  # fmt: skip
