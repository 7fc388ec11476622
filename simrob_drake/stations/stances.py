"""Postures in which a robot with a free base can stand on its legs, found by geometry and statics.

A *stance* is a posture (positions of the robot's axes, shape (n,)) with the height of the upright root over the floor.
A stance is *good* if statics finds nothing that prevents the robot from standing in it on its feet alone. The *support
area* is the convex hull of the points that carry, seen from above; its *margin* is the distance of the centre of mass
from its nearest side, negative outside of it. The *standing point* of a leg is the point of its foot that carries.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.tree import RevoluteJoint, RigidBody

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.clearance import (
    KNEELING,
    Clearance,
    Standing,
    reduce_own_overlaps,
    standing,
)
from simrob_drake.stations.legs import Leg, ends_of, foot_place, legs_of, put_upright, straight
from simrob_drake.stations.posed import posture_range

_BENT_LENGTHS = 0.9, 0.85, 0.8, 0.95, 0.7, 0.6
"""Lengths to which legs are bent, as fractions of their full length, in the order of trial."""

_RANDOM_SEEDS = 6
"""Count of random postures of a leg from which its inverse kinematics begins, in addition to home and mid-range."""

_TRIED_SOLUTIONS = 3
"""Count of ways to bend the first leg that are tried."""

_FOOT_TOLERANCE = 2e-3
"""Largest error of a foot's position as a fraction of the leg's length, and of its sole's direction in rad."""

_INNER_MARGIN = 1e-4
"""Fraction of an axis's range by which the solver's first guess is inside of the limits, as SciPy requires."""

_HOME_WEIGHT = 0.01
"""Weight of the distance from home, which chooses among the solutions of a leg that can be bent in many ways."""

_DISTINCT = 0.1
"""Two solutions of a leg are different if an axis differs by more than this [rad or m]."""

_CLEAR_HEIGHT = 0.02
"""Height over the ground, as a fraction of the leg's length, that all links but the feet keep."""

_SAME_HEIGHT = 1e-3
"""Feet are level if their heights differ by less than this [m]."""

_STEADY_MARGIN = 0.04
"""Smallest distance of the centre of mass from the edge of the support area, as a fraction of its height: 2.3 deg."""

_FEET_OFF_COM = 0.02
"""Distance of the feet's middle from the centre of mass, seen from above, as a fraction of the leg's length."""

_MOTOR_LOAD = 0.9
"""Largest fraction of a motor's torque that standing may take."""

_ONLY_FORWARD = 2
"""A leg of at most so many joints places its foot ahead or behind, but not to a side."""

_HOME_PREFERENCE = 0.05
"""1/rad: difference in shape from the first leg, as a fraction of length, that a rad nearer to home is worth."""

_SHIFTS = 3
"""How often the feet are placed at most: once at the given points, then after each correction."""


@dataclass(frozen=True)
class Stance:
    """A robot as it may stand.

    Attributes:
        posture: positions of the robot's axes, shape (n,) [rad or m].
        height: height of the upright root over the floor [m].
        standing: on what the robot stands, and which torques that takes.
        how: the posture in words, such as "at home".
    """

    posture: Vector
    height: float
    standing: Standing
    how: str


def _describe_bent_legs(length: float) -> str:
    """Describe a stance with bent legs by their length as a fraction of the full length."""
    return message(
        "stations.legs_bent", "with its legs bent to {share:.0%} of their length", share=length
    )


class Stances:
    """Search for the good stances of a robot: first at home, then with bent legs.

    A robot stands on the ends of its chains of axes. A robot without legs may stand on its root link as well.
    """

    def __init__(self, clearance: Clearance, robot: StationRobot) -> None:
        """Prepare the search.

        Args:
            clearance: geometry of the station, which the search moves.
            robot: a robot with a free base.
        """
        self._clearance = clearance
        self._robot = robot
        self._plant = clearance.plant
        self._home = robot.model.home
        # A fixed seed: the same robot gets the same stance in every run.
        self._random = np.random.default_rng(0)
        # The support margin [m] and the reasons against it, for every stance that was examined.
        self._examined = list[tuple[float, list[str]]]()

    @property
    def lacking(self) -> str:
        """Reasons against the best of the stances that :meth:`find` rejected, in words; empty if it rejected none.

        The best stance has the fewest reasons against it and, of these, the largest support margin.
        """
        # Tuples are compared by their first entries: fewest reasons, then the largest margin.
        failed = []
        for margin, reasons in self._examined:
            if reasons:
                failed.append((len(reasons), -margin, join_texts(reasons, "; ")))
        if not failed:
            return ""
        _, _, reasons_of_best = min(failed)
        return message(
            "stations.best_of_tried",
            "In the best of {count} tried {count:stance|stances}, {lacks}.",
            count=len(failed),
            lacks=reasons_of_best,
        )

    def find(self) -> Iterator[Stance]:
        """Yield the good stances, the most natural first."""
        home = self.as_it_is()
        groups = legs_of(self._clearance, self._robot)
        if home is not None:
            # The links that may touch the ground: the ends of all chains or, without legs, the root link, too.
            feet = {body.name() for body, _ in ends_of(self._clearance, self._robot)}
            if not groups:
                feet.add(self._robot.root.body().name())
            # The length 0 asks for no distance of the other links from the ground: home stands as the file describes
            # it.
            yield from self._good(home, [], feet, 0.0)
        for legs in groups:
            yield from self.bent_stances(legs)

    def as_it_is(self) -> Stance | None:
        """Compute the stance at home, whatever touches the ground there.

        Returns None if the robot has neither feet nor collision shapes.
        """
        return self._stance(self._home, message("stations.stands_at_home", "in the home posture"))

    def bent_stances(
        self,
        legs: list[Leg],
        lengths: Sequence[float] = _BENT_LENGTHS,
    ) -> Iterator[Stance]:
        """Yield the good stances on some legs, with the legs bent and the feet about below the hips.

        Args:
            legs: the legs on which the robot stands.
            lengths: lengths to which the legs are bent, as fractions of their full length, in the order of trial.
        """
        self._place(self._home)
        # The hips: origins of the first links of the legs, shape (legs, 3) [m].
        hips = np.array([self._origin(leg.links[0]) for leg in legs])
        # Many random postures, so that one of them has the legs about outstretched.
        random = self._random.uniform(
            *posture_range(self._robot), (10 * _RANDOM_SEEDS, len(self._home))
        )
        postures = (straight(self._robot), self._home, *random)
        # Standing points of all legs in all postures, shape (postures, legs, 3) [m].
        feet = np.array([self._feet(legs, posture) for posture in postures])
        # The full length is how far a foot reaches below its hip in any of these postures: that of the leg with the
        # shortest reach, and the same for all legs.
        full_length = float((hips - feet.min(axis=0))[:, 2].min())
        # The feet are never below the hips: these chains cannot carry the robot.
        if full_length <= 0:
            return
        below_feet = feet[0][:, :2]  # below the feet of straight legs
        # Ahead as the hips, aside as straight legs.
        below_hips_ahead = np.column_stack([hips[:, 0], feet[0][:, 1]])
        # Halfway between hips and feet, for legs that are level when straight.
        halfway = (hips[:, :2] + below_feet) / 2
        for foot_points in (below_feet, below_hips_ahead, halfway):
            for length in lengths:
                # All feet at one height: the lowest hip less the length to which the legs are bent.
                heights = np.full(len(legs), hips[:, 2].min() - length * full_length)
                targets = np.column_stack([foot_points, heights])
                yield from self._with_feet_at(
                    legs, targets, full_length, _describe_bent_legs(length)
                )

    def _place(self, posture: Vector, height: float = 0.0) -> None:
        """Put the robot into a posture (n,), its root upright at a height [m]."""
        put_upright(self._clearance, self._robot, posture, height)

    def _origin(self, link: RigidBody) -> Vector:
        """Origin of a link in the world, shape (3,) [m]."""
        return np.asarray(
            self._plant.EvalBodyPoseInWorld(self._clearance.context, link).translation()
        )

    def _feet(self, legs: list[Leg], posture: Vector) -> Vector:
        """Compute the standing points of k legs in a posture (n,), with the root at the origin, shape (k, 3) [m]."""
        self._place(posture)
        return np.array([foot_place(self._clearance, leg) for leg in legs])

    def _stance(self, posture: Vector, how: str) -> Stance | None:
        """Compute the stance of the robot in a posture (n,) [rad or m], with its lowest point on the floor.

        The words `how` describe the posture. The posed station is left in this stance. Returns None if the robot has
        neither feet nor collision shapes.
        """
        self._place(posture)
        # The root is lifted by as much as the lowest point was below it.
        height = -min(self._clearance.lowest(self._robot).values(), default=0.0)
        self._place(posture, height)
        found = standing(self._clearance.station, self._robot, self._clearance.context)
        if found is None:
            return None
        return Stance(posture, height, found, how)

    def _good(
        self,
        stance: Stance,
        legs: list[Leg],
        feet: set[str],
        length: float,
    ) -> Iterator[Stance]:
        """Examine a stance: record its margin and the reasons against it, and yield it if there are no such reasons.

        Links that overlap are turned apart first, by axes that do not belong to the legs. Coupled axes (followers) then
        go where their leaders take them. The stance after that is examined and yielded. Overlaps that remain are no
        reason against it.

        Args:
            stance: the stance to be examined.
            legs: the legs on which the robot stands; empty at home.
            feet: names of the links that may touch the ground.
            length: full length of the legs [m]; 0 if the other links need no distance from the ground.

        Yields:
            the stance once, or nothing.
        """
        model = self._robot.model
        leg_axes = {axis for leg in legs for axis in leg.axes}
        followers = {model.axis_index(name) for name in model.followers}
        # The legs have been balanced already, so that their axes stay. Followers go where their leaders take them.
        movable = set(range(len(self._home))) - leg_axes - followers
        posture = reduce_own_overlaps(self._clearance, self._robot, stance.posture, movable)
        how = stance.how
        if not np.array_equal(posture, stance.posture):
            posture = model.with_followers(posture)
            how = message(
                "stations.turned_apart",
                "{stance}, with some links turned apart",
                stance=stance.how,
            )
        tidy = self._stance(posture, how)
        if tidy is None:
            return
        reasons = list(self._reasons_against(tidy.standing, feet, length))
        # Stances with and without reasons are recorded, for `lacking`.
        self._examined.append((tidy.standing.margin, reasons))
        if not reasons:
            yield tidy

    def _reasons_against(
        self,
        found: Standing,
        feet: set[str],
        length: float,
    ) -> Iterator[str]:
        """Yield the reasons that prevent the robot from standing steadily on its feet alone, in words.

        Args:
            found: statics of the stance. The robot is placed in it already.
            feet: names of the links that may touch the ground.
            length: full length of the legs [m], by which the height of the other links is judged.
        """
        others = found.carrying_links.keys() - feet
        if others:
            yield message(
                "stations.stands_on_others",
                "the robot also stands on {links}",
                links=", ".join(sorted(others)),
            )
        # Parts of the links' lengths at which they touch the ground, measured from their joints: near 0 is a knee.
        if min(found.carrying_links.values()) < KNEELING:
            yield message("stations.it_kneels", "the robot kneels")

        heights = self._clearance.lowest(self._robot)
        low = dict[str, float]()
        for name, height in heights.items():
            # Links of `others` have a reason of their own.
            may_touch = name in feet or name in others
            if not may_touch and height <= _CLEAR_HEIGHT * length:
                low[name] = height
        if low:
            lowest_link = min(low, key=low.__getitem__)
            yield message(
                "stations.link_too_near", "{link} is too near to the ground", link=lowest_link
            )

        # tan(angle) = margin / height: the angle by which the robot may lean.
        needed_margin = _STEADY_MARGIN * found.height
        if found.margin <= needed_margin:
            is_inside = found.margin >= 0
            side = (
                message("stations.inside", "inside")
                if is_inside
                else message("stations.outside", "outside")
            )
            yield message(
                "stations.mass_not_steady",
                "the centre of mass is {margin:.0f} mm {side} the support area, but must be at least "
                "{least:.0f} mm inside",
                margin=abs(found.margin) * 1e3,
                side=side,
                least=needed_margin * 1e3,
            )

        # For each axis, the share of its motor's torque at rest that standing takes, shape (n,); infinite for a passive
        # axis that needs a torque.
        loads = self._robot.gains.holding_shares(found.torque)
        worst = int(np.argmax(loads))
        if loads[worst] > _MOTOR_LOAD:
            yield message(
                "stations.axis_overloaded",
                "{axis} requires {torque:.3g} {unit}, but its limit is {limit:.3g} {unit}",
                axis=self._robot.axes[worst],
                torque=abs(found.torque[worst]),
                unit=self._robot.model.effort_units[worst],
                limit=self._robot.gains.limit_at_rest[worst],
            )

    def _with_feet_at(
        self,
        legs: list[Leg],
        targets: Vector,
        length: float,
        how: str,
    ) -> Iterator[Stance]:
        """Yield the good stances with the feet about at given points, moved under the centre of mass.

        The first leg is bent in several ways. Each other leg is bent in the way that looks most like the first leg,
        with a small preference for angles near home.

        Args:
            legs: k legs.
            targets: positions of the feet relative to the root, shape (k, 3) [m].
            length: full length of the legs [m].
            how: the stance in words.
        """
        # For each leg, the ways to bend it: lists of the positions of its axes.
        solutions = [
            self._solutions(leg, target, length) for leg, target in zip(legs, targets, strict=True)
        ]
        if not all(solutions):
            return  # some leg does not reach its point
        feet = {leg.foot.name() for leg in legs}
        first_leg = legs[0]
        for first_angles in solutions[0][:_TRIED_SOLUTIONS]:
            posture = self._home.copy()
            posture[first_leg.axes] = first_angles
            # Legs are compared by the points of their links, as axes of two legs may have opposite
            # signs.
            shape = self._bent_shape(first_leg, posture)
            for leg, target, own_solutions in zip(
                legs[1:], targets[1:], solutions[1:], strict=True
            ):
                # Further ways: the mirror images of the first leg, corrected until the foot is at its point.
                candidates = list(own_solutions)
                for seed in self._mirrored_guesses(first_leg, first_angles, leg):
                    mirrored = self._solve(leg, target, length, seed)
                    if mirrored is not None:
                        candidates.append(mirrored)
                costs = []
                for candidate in candidates:
                    posture[leg.axes] = candidate
                    # Cost: difference in shape by the length, and 0.05 for each radian away from
                    # home.
                    difference = np.linalg.norm(self._bent_shape(leg, posture) - shape) / length
                    from_home = np.abs(candidate - self._home[leg.axes]).max()
                    costs.append(float(difference + _HOME_PREFERENCE * from_home))
                posture[leg.axes] = candidates[int(np.argmin(costs))]
            stance = self._balance(legs, posture, targets, length, how)
            if stance is not None:
                yield from self._good(stance, legs, feet, length)

    def _mirrored_guesses(self, leg: Leg, angles: Vector, other: Leg) -> Iterator[Vector]:
        """Yield first guesses for another leg that bend it like a leg with given angles.

        An angle changes its sign if the axes of the two legs point in opposite directions after mirroring.

        Args:
            leg: the leg that is bent already.
            angles: its angles, shape (k,) [rad].
            other: the other leg, with k axes as well.

        Yields:
            angles of the other leg, shape (k,) [rad]: mirrored left to right, front to rear, and not mirrored.
        """
        self._place(straight(self._robot))
        axes = np.array([self._axis_direction(axis) for axis in leg.axes])
        other_axes = np.array([self._axis_direction(axis) for axis in other.axes])
        # Rotation vectors (about ahead, left, up) are axial: a mirror keeps the component along its normal
        # and turns the others round.
        left_to_right = [-1, 1, -1]
        front_to_rear = [1, -1, -1]
        unchanged = [1, 1, 1]
        for mirror in (left_to_right, front_to_rear, unchanged):
            # Dot products of the mirrored axes with those of the other leg, axis by axis.
            cosines = np.sum(axes * mirror * other_axes, axis=1)
            yield np.where(cosines < 0, -angles, angles)

    def _axis_direction(self, axis: int) -> Vector:
        """Direction of an axis in the world, shape (3,); zero if it is prismatic."""
        joint = self._robot.joints[axis]
        direction = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else np.zeros(3)
        pose = joint.frame_on_child().CalcPoseInWorld(self._clearance.context)
        return np.asarray(pose.rotation() @ direction)

    def _bent_shape(self, leg: Leg, posture: Vector) -> Vector:
        """Shape of a leg of k links in a posture (n,), seen from the side. Moves the robot.

        Returns:
            the positions of the links ahead of and above their hip, one after the other, shape (2 k,) [m].
        """
        self._place(posture)
        origins = np.array([self._origin(link) for link in leg.links])
        return np.asarray((origins - origins[0])[:, [0, 2]].ravel())

    def _balance(
        self,
        legs: list[Leg],
        posture: Vector,
        targets: Vector,
        length: float,
        how: str,
    ) -> Stance | None:
        """Move the feet to one height and under the centre of mass.

        Args:
            legs: k legs.
            posture: posture of the robot at first, shape (n,) [rad or m].
            targets: positions of the feet relative to the root at first, shape (k, 3) [m].
            length: full length of the legs [m].
            how: the stance in words.

        Returns:
            the stance, or None if a leg does not reach its point. When the feet have been placed _SHIFTS times, the
            stance may still be unbalanced, which its statics shows.
        """
        # Legs of few joints cannot place their feet aside.
        moves_aside = len(legs[0].axes) > _ONLY_FORWARD
        targets = targets.copy()
        for _ in range(_SHIFTS):
            posture = posture.copy()
            for leg, target in zip(legs, targets, strict=True):
                angles = self._solve(leg, target, length, posture[leg.axes])
                if angles is None:
                    return None
                posture[leg.axes] = angles
            # `_feet` places the robot in this posture, with its root at the origin, for all that is measured below.
            middle = self._feet(legs, posture)[:, :2].mean(axis=0)
            lowest = self._clearance.lowest(self._robot)
            heights = np.array([lowest[leg.foot.name()] for leg in legs])
            context = self._clearance.context
            com = self._plant.CalcCenterOfMassPositionInWorld(context, [self._robot.instance])
            # From the middle of the feet to the centre of mass, seen from above; aside 0 for short
            # legs.
            offset = (com[:2] - middle) * [1.0, moves_aside]
            are_level = np.ptp(heights) < _SAME_HEIGHT
            are_below_com = np.abs(offset).max() < _FEET_OFF_COM * length
            if are_level and are_below_com:
                break
            targets[:, :2] += offset
            # Feet of different shapes reach to different depths: all are moved to their mean
            # height.
            targets[:, 2] -= heights - heights.mean()
        return self._stance(posture, how)

    def _solutions(self, leg: Leg, target: Vector, length: float) -> list[Vector]:
        """Find ways to bend a leg that bring its foot level to a point, the nearest to home first. Moves the robot.

        Args:
            leg: a leg of k axes.
            target: position of the foot relative to the root, shape (3,) [m].
            length: full length of the leg [m].

        Returns:
            the angles of each way, shape (k,) [rad or m]; empty if none is found from home, the middle of the limits
            and some random angles.
        """
        lower_limits, upper_limits = posture_range(self._robot)
        lower = lower_limits[leg.axes]
        upper = upper_limits[leg.axes]
        home = self._home[leg.axes]
        random = self._random.uniform(lower, upper, (_RANDOM_SEEDS, len(leg.axes)))
        found: list[Vector] = []
        for seed in (home, (lower + upper) / 2, *random):
            solution = self._solve(leg, target, length, seed)
            if solution is None:
                continue
            if all(np.abs(solution - other).max() > _DISTINCT for other in found):
                found.append(solution)
        return sorted(found, key=lambda solution: float(np.abs(solution - home).sum()))

    def _solve(
        self,
        leg: Leg,
        target: Vector,
        length: float,
        seed: Vector,
    ) -> Vector | None:
        """Solve the inverse kinematics of a leg, with its sole level if it has one. The robot is moved.

        A first solution stays near home where the leg has spare axes. A second one, which begins there, meets the
        target up to _FOOT_TOLERANCE.

        Args:
            leg: a leg of k axes. The other axes of the robot are at home.
            target: position of the foot relative to the root, shape (3,) [m].
            length: full length of the leg [m].
            seed: first guess, shape (k,) [rad or m].

        Returns:
            angles of the leg, shape (k,) [rad or m], or None if the foot does not reach the target, or not with a level
            sole.
        """
        from scipy.optimize import least_squares

        plant = self._plant
        context = self._clearance.context
        self._place(self._home)
        # Indices of the leg's axes among the plant's positions.
        indices = self._robot.axis_map.position_places[leg.axes]
        signs = self._robot.axis_map.signs[leg.axes]
        positions = plant.GetPositions(context)
        home = self._home[leg.axes]
        lower_limits, upper_limits = posture_range(self._robot)
        lower = lower_limits[leg.axes]
        upper = upper_limits[leg.axes]
        scale = upper - lower
        down = np.array([0.0, 0.0, -1.0])

        def foot_error(angles: Vector) -> Vector:
            """Error of the foot's position over the leg's length (3,), and of the sole's normal (3,) if it has one."""
            positions[indices] = signs * angles
            plant.SetPositions(context, positions)
            pose = plant.EvalBodyPoseInWorld(context, leg.foot)
            # Divided by the length, so that an error of the position compares with one of the direction [rad].
            position_error: Vector = (pose @ leg.point - target) / length
            if leg.normal is None:
                return position_error
            return np.concatenate([position_error, pose.rotation() @ leg.normal - down])

        def foot_and_home_error(angles: Vector) -> Vector:
            """Error of the foot, and the weighted distance of each axis from home by its range (k,)."""
            return np.concatenate([foot_error(angles), _HOME_WEIGHT * (angles - home) / scale])

        bounds = (lower, upper)
        inner_lower = lower + _INNER_MARGIN * scale
        inner_upper = upper - _INNER_MARGIN * scale
        first_guess = np.clip(seed, inner_lower, inner_upper)
        # Few evaluations: a guess that has not come close by then is a bad one, and others follow.
        near_home = least_squares(foot_and_home_error, first_guess, bounds=bounds, max_nfev=40).x
        second_guess = np.clip(near_home, inner_lower, inner_upper)
        # Without the pull to home, which would leave the foot a little off its target.
        exact = least_squares(foot_error, second_guess, bounds=bounds, max_nfev=20).x
        if np.abs(foot_error(exact)).max() >= _FOOT_TOLERANCE:
            return None
        return np.asarray(exact)
