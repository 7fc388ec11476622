"""A careful stride: one foot after the other goes up, ahead and down, the weight always over the one that stands.

Strides take a robot over stairs, gaps and thresholds, one after the other, each planned from where its feet have come
to stand. Soles with edges may stand over an edge of the ground by a part of their length, as on stairs; so a stride
over an edge is shorter than the sole.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from simrob_drake.blocks.references import smooth
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.biped import SIDES
from simrob_drake.programs.gaits.feet import Foot
from simrob_drake.programs.gaits.gait import Pace, SolvedGait
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.phases import GaitPlan, Phase, gait_plan
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.sections import NotNegative, Number, Positive

Place = tuple[Number, Number, Number, Number]  # of a sole: ahead, left, up [m] and turn [rad]

_UP, _DOWN = 0.35, 0.35  # parts of a swing in which the foot goes up, and down
_AHEAD = (0.25, 0.8)  # from when to when of it the foot goes ahead
_CARRIED = (0.1, 0.9)  # from when to when of a swing the trunk goes up


class Climb(SolvedGait):
    """Both feet a stride ahead, one after the other, on ground that may rise and fall between them."""

    section: ClassVar[str] = "climbs"
    usual: ClassVar[str] = "climb"

    start: Mapping[str, Place] | None = None
    """Where the soles stand at first, by foot; side by side unless given. The lowest is at the height 0."""
    goals: Mapping[str, Place] | None = None
    """Where they go; `stride` ahead unless given."""
    over: NotNegative = 0.0
    """The highest ground on the way, over the lowest sole at first [m]."""
    turned: Number = 0.0
    """The turn of the trunk at first, to the left [rad]; it ends at 0."""
    stride: Positive = 0.1
    """The longest way of a foot on one level [m]."""
    lift: Positive = 0.03
    """How high the soles pass over the ground [m]."""
    step_time: Pace = 1.2
    """From one footfall to the next [s]."""
    double_support: Positive = 0.4
    """Part of a step in which both feet stand."""
    settle: Pace = 0.8
    """Time to shift the weight to the first foot that stands, and to both again [s]."""
    zmp_inward: Number = 0.0
    """How far inside of the middle of the standing foot the zero-moment point goes [m]."""
    margin: NotNegative = 0.02
    """What toes keep from a riser, and heels from one that they have come down [m]."""
    overhang: NotNegative = 0.035
    """By how much a sole with edges may stand over an edge below which the ground is lower [m]."""
    rest: NotNegative = 0.0
    """Time to stand at the end [s]."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Return its motion; raises InvalidParameter: a robot that has not two feet, or whose feet cannot be level."""
        feet = {foot.name: foot for foot in walker.feet(self.feet)}
        if sorted(feet) != sorted(SIDES) or any(len(foot.axes) < 6 for foot in feet.values()):
            expected = "one with two legs of six joints, to climb so"
            raise InvalidParameter(f"robot {walker.model.name}", f"one with {len(feet)} feet", expected)
        return WholeBody(walker, self, self._gait_plan(feet)).solve()[0]

    def _gait_plan(self, feet: Mapping[str, Foot]) -> GaitPlan:
        """Return what feet, trunk and zero-moment point do."""
        home = {name: (0.0, foot.home[1] + foot.side * self.widen, 0.0, 0.0) for name, foot in feet.items()}
        at = {name: np.array((self.start or home)[name]) for name in SIDES}
        goals = {
            name: np.array(self.goals[name]) if self.goals else at[name] + [self.stride, 0, 0, 0] for name in SIDES
        }
        swing, both = (1 - self.double_support) * self.step_time, self.double_support * self.step_time
        middle = np.mean([at[name][:2] for name in SIDES], axis=0)
        begins = {SIDES[0]: self.settle, SIDES[1]: self.settle + swing + both}
        stands = {SIDES[0]: at[SIDES[1]], SIDES[1]: goals[SIDES[0]]}
        phases = []
        for name, shift in zip(SIDES, (self.settle, both), strict=True):
            (other,) = (foot for foot in feet.values() if foot.name != name)
            under = stands[name][:2] - [0.0, other.side * self.zmp_inward]
            phases += [Phase(shift, under, shift), Phase(swing, under, 0.0)]
        end = np.mean([goals[name][:2] for name in SIDES], axis=0)
        phases.append(Phase(self.settle + self.rest, end, self.settle))
        way = gait_plan({name: place[[0, 1, 3]] for name, place in at.items()}, middle, phases)
        times = way.times
        paths = {name: self._swung(_share(times, begins[name], swing), at[name], goals[name]) for name in SIDES}
        heading = self.turned * (1.0 - smooth(_share(times, 0.0, begins[SIDES[1]] + swing)))
        return replace(way, feet=paths, heading=heading, ground=self._ground(times, begins, swing, at, goals))

    def _swung(self, share: Vector, start: Vector, goal: Vector) -> Vector:
        """Return the places (m, 4) of a sole at shares (m,) of its swing: up, ahead, and down."""
        top = max(start[2], goal[2], self.over) + self.lift
        path = start + np.outer(smooth(_share(share, _AHEAD[0], _AHEAD[1] - _AHEAD[0])), goal - start)
        up, down = smooth(_share(share, 0.0, _UP)), smooth(_share(share, 1.0 - _DOWN, _DOWN))
        path[:, 2] = start[2] + (top - start[2]) * up - (top - goal[2]) * down
        return path

    def _ground(
        self, times: Vector, begins: Mapping[str, float], swing: float, at: Mapping[str, Vector],
        goals: Mapping[str, Vector],
    ) -> Vector:  # fmt: skip
        """Return heights (m,) over which the trunk is carried: it sinks before a foot does, and rises with the last."""
        heights, low = np.zeros(len(times)), 0.0
        now = {name: place[2] for name, place in at.items()}
        for name in SIDES:
            now[name] = goals[name][2]
            change = min(now.values()) - low
            if change > 0:
                share = _share(times, begins[name] + _CARRIED[0] * swing, (_CARRIED[1] - _CARRIED[0]) * swing)
            else:
                before = self.settle if name == SIDES[0] else self.double_support * self.step_time
                share = _share(times, begins[name] - before, before)
            heights, low = heights + change * smooth(share), low + change
        return heights


def _share(times: Vector, begin: float, length: float) -> Vector:
    """Return which part of a stretch of time has gone by, 0 before it and 1 after it."""
    return np.clip((times - begin) / length, 0.0, 1.0)
