"""A climb: all feet a stride ahead, one after the other, on ground that may rise and fall between them.

A stride takes a robot over stairs, gaps and thresholds. Each foot goes up, ahead and down while the weight is over the
standing feet: over the other foot on two legs, over the other three on four legs. Every stride is planned from where
the feet stand by then; :mod:`~simrob_drake.programs.gaits.climb_footholds` chooses where they go next.

A sole pose is a vector (4,): x ahead [m], y to the left [m], height [m] and turn to the left [rad], in a frame whose x
axis is the direction of the climb. The lowest sole at the start has the height 0. The zero-moment point (ZMP) is the
point of the floor over which the weight is; a *riser* is a step of the ground up or down.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.base.sections import NotNegative, Number, Positive
from simrob_drake.blocks.references import smooth
from simrob_drake.programs.gaits.biped import FEET
from simrob_drake.programs.gaits.motion import JointMotion, Pace, SolvedGait
from simrob_drake.programs.gaits.phases import GaitPlan, Phase, gait_plan
from simrob_drake.programs.gaits.quadruped import CRAWL_ORDER, nearest_inside
from simrob_drake.programs.gaits.walker import Foot, Walker
from simrob_drake.programs.gaits.whole_body import WholeBody
from simrob_drake.robots.catalog import RobotModel

SolePose = tuple[Number, Number, Number, Number]
"""Sole pose of a parameter: ahead, left, up [m] and turn to the left [rad]."""

_LEVEL = [0, 1, 3]  # indices of a sole pose without its height: a foothold of `phases`

# A swing is divided so that the foot clears edges: it goes nearly straight up, then ahead, then nearly straight down.
_UP = 0.35  # part of the swing in which the foot rises, at its start
_DOWN = 0.35  # part of the swing in which the foot sinks, at its end
_AHEAD_FROM = 0.25  # share of the swing at which the foot begins to go ahead
_AHEAD_TO = 0.8  # share of the swing at which the foot is above its goal
_TRUNK_FROM = 0.1  # share of a swing at which the trunk begins to rise
_TRUNK_TO = 0.9  # share of a swing at which the trunk has risen

_AXES_OF_LEVEL_SOLE = 6  # a leg needs so many axes to keep a sole level at any height


class Climb(SolvedGait):
    """A stride of all feet, one after the other, on ground that may rise and fall between them."""

    section: ClassVar[str] = "climbs"
    usual: ClassVar[str] = "climb"

    start: Mapping[str, SolePose] | None = None
    """Poses of the soles at the start, by foot. If it is not set, side by side. The lowest is at the height 0."""
    goals: Mapping[str, SolePose] | None = None
    """Poses of the soles at the end, by foot. If it is not set, `stride` ahead."""
    over: NotNegative = 0.0
    """Height of the highest ground on the way, above the lowest sole at the start [m]."""
    turned: Number = 0.0
    """Angle by which the trunk is turned to the left at the start [rad]. It is 0 at the end."""
    stride: Positive = 0.1
    """Longest distance that a foot goes ahead on one level [m]."""
    lift: Positive = 0.03
    """Height at which the soles pass over the ground [m]."""
    step_time: Pace = 1.2
    """Time from one touchdown to the next [s]."""
    double_support: Positive = 0.4
    """Part of a step in which all feet stand [1]."""
    settle: Pace = 0.8
    """Time of the first and of the last weight transfer: from the foot that goes first, and to all feet [s]."""
    zmp_inward: Number = 0.0
    """Distance of the zero-moment point from the middle of a standing foot towards the other foot, on two legs [m]."""
    inside: Positive = 0.04
    """Least distance of the zero-moment point from the sides of the triangle of three standing feet, on four legs
    [m]."""
    margin: NotNegative = 0.02
    """Least distance between the toes and a riser ahead, and between the heels and a riser behind them [m]."""
    overhang: NotNegative = 0.035
    """Longest part of a sole that may stick out over the edge of a step, over lower ground [m]."""
    rise: Positive = 0.06
    """Largest step up or down of a foot, on four legs [m]."""
    rest: NotNegative = 0.0
    """Time to stand at the end [s]."""

    def plan(self, walker: Walker, steps: int = 0, amplitude: float = 1.0) -> JointMotion:
        """Plan the stride, see :meth:`Gait.plan`.

        Args:
            walker: the robot.
            steps: not used.
            amplitude: not used.

        Raises:
            InvalidParameter: the robot has neither two legs of six axes nor four legs, the stride takes too long for
                one plan, or three standing feet leave no position that is as far inside as `inside`.
            UnknownName: the robot has no feet of the kind that the gait names.
            OutOfReach: a leg is too short for the path of its foot, or a joint is beyond a limit.
        """
        feet = {foot.name: foot for foot in walker.feet(self.feet)}
        has_four_legs = sorted(feet) == sorted(CRAWL_ORDER)
        has_two_legs = sorted(feet) == sorted(FEET)
        can_stay_level = all(len(foot.axes) == _AXES_OF_LEVEL_SOLE for foot in feet.values())
        if not has_four_legs and not (has_two_legs and can_stay_level):
            expected = message(
                "programs.legs_to_climb",
                "a robot with two legs of six joints, or with four legs",
            )
            raise InvalidParameter(
                message("base.robot_called", "robot {name}", name=walker.model.name),
                message("programs.count_of_feet", "a robot with {count} feet", count=len(feet)),
                expected,
            )
        return WholeBody(walker, self, self._gait_plan(feet)).solve()[0]

    def check_feet(self, model: RobotModel, worn: str | None, key: str) -> None:
        """Check that the feet can stand on steps, see :meth:`Gait.check_feet`: the soles of two legs need edges."""
        if has_edges(model, worn):
            return
        assert model.feet is not None  # a robot without feet has no climb
        edged = [name for name in model.feet.contacts if has_edges(model, name)]
        if edged:
            choices = join_texts(
                [f"--set {key}={name}" for name in edged], message("base.or", " or ")
            )
            expected = message(
                "programs.soles_with_edges",
                "box soles, which can stick out over the edges of steps: {choices}",
                choices=choices,
            )
        else:
            expected = message(
                "programs.describe_soles",
                "box soles, which can stick out over the edges of steps: add boxes under feet.contacts in its {file}",
                file=ROBOT_FILE,
            )
        raise InvalidParameter(
            message("programs.feet_of", "kind of feet of {model}", model=model.name),
            str(worn),
            expected,
        )

    @property
    def _all_stand_time(self) -> float:
        """Time of each step in which all feet stand [s]."""
        return self.double_support * self.step_time

    @property
    def _swing_time(self) -> float:
        """Time of each step in which a foot is in the air [s]."""
        return (1 - self.double_support) * self.step_time

    def _gait_plan(self, feet: Mapping[str, Foot]) -> GaitPlan:
        """Plan the paths of the feet, the trunk and the zero-moment point.

        The soles begin in the poses of the parameter `start`, or in the usual poses if it is not set. They end in those
        of `goals`, or one stride ahead of where they begin if it is not set.

        Args:
            feet: the feet of the robot by name.
        """
        order = FEET if len(feet) == len(FEET) else CRAWL_ORDER
        start = {}
        goals = {}
        for name in order:
            start[name] = np.array(self.start[name] if self.start else self._home(feet[name]))
            goals[name] = (
                np.array(self.goals[name]) if self.goals else start[name] + [self.stride, 0, 0, 0]
            )

        # Each foot in turn: shift the weight to the others, then swing.
        phases = list[Phase]()
        liftoffs = dict[str, float]()  # time at which each foot lifts off [s]
        current = dict(start)
        for name in order:
            shift_time = self._all_stand_time if phases else self.settle
            liftoffs[name] = sum(phase.duration for phase in phases) + shift_time
            standing = {foot: current[foot][:2] for foot in order if foot != name}
            # A phase for the shift of the weight, and one for the swing.
            zmp = self._zmp_over(standing, current, feet)
            phases.append(Phase(duration=shift_time, zmp=zmp, transfer=shift_time))
            phases.append(Phase(duration=self._swing_time, zmp=zmp, transfer=0.0))
            current[name] = goals[name]
        phases.append(
            Phase(duration=self.settle + self.rest, zmp=_middle_of(goals), transfer=self.settle)
        )

        # The phases have the zero-moment point only. The paths of the feet are other ones than a walk has.
        footholds = {name: pose[_LEVEL] for name, pose in start.items()}
        plan = gait_plan(footholds, _middle_of(start), phases)
        paths = {}
        standing_times = {}
        for name in order:
            share = _elapsed_share(plan.times, liftoffs[name], self._swing_time)
            paths[name] = self._swing_path(share, start[name], goals[name])
            standing_times[name] = (share <= 0) | (share >= 1)
        end_of_swings = liftoffs[order[-1]] + self._swing_time
        heading = self.turned * (1.0 - smooth(_elapsed_share(plan.times, 0.0, end_of_swings)))
        ground = self._trunk_ground(plan.times, liftoffs, start, goals)
        return replace(plan, feet=paths, heading=heading, ground=ground, standing=standing_times)

    def _home(self, foot: Foot) -> SolePose:
        """Pose of a sole at the start if none is set: on level ground, below the hip and further out by `widen`.

        Two feet are side by side, even if one hip is further ahead.
        """
        ahead = 0.0 if foot.name in FEET else float(foot.home[0])
        left = float(foot.home[1]) + foot.side * self.widen
        return ahead, left, 0.0, 0.0

    def _zmp_over(
        self,
        standing: Mapping[str, Vector],
        current: Mapping[str, Vector],
        feet: Mapping[str, Foot],
    ) -> Vector:
        """Compute the zero-moment point while one foot swings, shape (2,) [m].

        Args:
            standing: positions (2,) of the feet that stand, by foot [m].
            current: poses of all soles before the swing, by foot.
            feet: the feet of the robot by name.

        Raises:
            InvalidParameter: on four legs, no position is as far inside the triangle as the parameter `inside`.
        """
        # Two legs: beside the middle of the foot that stands, towards the other foot.
        if len(standing) == 1:
            ((name, position),) = standing.items()
            return position - [0.0, feet[name].side * self.zmp_inward]
        # Four legs: in the triangle of the feet that stand, as near to the middle of all feet as possible.
        triangle = np.array(list(standing.values()))
        return nearest_inside(_middle_of(current), triangle, self.inside)

    def _swing_path(self, share: Vector, start: Vector, goal: Vector) -> Vector:
        """Compute the path of a sole: up, ahead, and down.

        Args:
            share: share of the swing that has elapsed, from 0 to 1, shape (m,).
            start: sole pose at the lift-off, shape (4,).
            goal: sole pose at the touchdown, shape (4,).

        Returns:
            Sole poses, shape (m, 4).
        """
        top = max(start[2], goal[2], self.over) + self.lift
        gone_ahead = smooth(_elapsed_share(share, _AHEAD_FROM, _AHEAD_TO - _AHEAD_FROM))
        path = start + np.outer(gone_ahead, goal - start)
        risen = smooth(_elapsed_share(share, 0.0, _UP))
        sunk = smooth(_elapsed_share(share, 1.0 - _DOWN, _DOWN))
        # The height is planned apart: to the top, which is above all ground on the way, and down from there.
        path[:, 2] = start[2] + (top - start[2]) * risen - (top - goal[2]) * sunk
        return path

    def _trunk_ground(
        self,
        times: Vector,
        liftoffs: Mapping[str, float],
        start: Mapping[str, Vector],
        goals: Mapping[str, Vector],
    ) -> Vector:
        """Compute the height of the ground over which the trunk is carried, shape (m,) [m].

        On two legs it is that of the lower foot, on four legs the mean of the feet. Its changes come so that the legs
        can reach the ground: the trunk sinks before a foot does, and rises while a foot swings.

        Args:
            times: times of the plan, shape (m,) [s].
            liftoffs: time at which each foot lifts off, by foot in their order [s].
            start: sole poses at the start, by foot.
            goals: sole poses at the end, by foot.
        """
        # Function that gives the level of the trunk's ground from the heights of the soles.
        level = min if len(start) == len(FEET) else np.mean
        sole_heights = {name: pose[2] for name, pose in start.items()}
        trunk_height = float(level(list(sole_heights.values())))
        result = np.full(len(times), trunk_height)
        shift_time = self.settle  # time of the weight transfer before the swing [s]
        for name, liftoff in liftoffs.items():
            sole_heights[name] = goals[name][2]
            change = float(level(list(sole_heights.values()))) - trunk_height
            if change > 0:
                begin = liftoff + _TRUNK_FROM * self._swing_time
                share = _elapsed_share(times, begin, (_TRUNK_TO - _TRUNK_FROM) * self._swing_time)
            else:
                share = _elapsed_share(times, liftoff - shift_time, shift_time)
            result = result + change * smooth(share)
            trunk_height = trunk_height + change
            shift_time = self._all_stand_time  # only the first shift takes as long as `settle`
        return result


def has_edges(model: RobotModel, worn: str | None) -> bool:
    """Check whether the feet of a robot can stand on steps: two feet have to be boxes, whose edges may stick out.

    More feet may be of any kind.

    Args:
        model: the robot; it has feet.
        worn: kind of feet that the robot has in its station. If it is None, the default one.
    """
    assert model.feet is not None  # a robot without feet has no climb
    feet = model.feet.kind(worn)
    return len(feet.links) != len(FEET) or bool(feet.boxes)


def _middle_of(poses: Mapping[str, Vector]) -> Vector:
    """Mean horizontal position of the feet, shape (2,) [m], from their sole poses."""
    return np.asarray(np.mean([pose[:2] for pose in poses.values()], axis=0))


def _elapsed_share(times: Vector, begin: float, duration: float) -> Vector:
    """Share of an interval that has elapsed at times (m,): 0 before its begin, 1 after its end, shape (m,).

    Times, begin and duration are in the same unit: seconds, or shares of a swing.
    """
    return np.clip((times - begin) / duration, 0.0, 1.0)
