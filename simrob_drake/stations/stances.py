"""Postures in which a robot with a free base may stand on its legs, found by geometry and statics."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.tree import RevoluteJoint, RigidBody

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.clearance import KNEELING, Clearance, Standing, reduce_own_overlaps, standing
from simrob_drake.stations.legs import Leg, ends_of, foot_place, legs_of, put_upright, straight
from simrob_drake.stations.posed import posture_range

_BENT = 0.9, 0.85, 0.8, 0.95, 0.7, 0.6  # parts of their length to which legs are bent, in the order of trial
_SEEDS, _SOLUTIONS = 6, 3  # postures of chance from which a leg is bent; how many ways of bending are tried
_REACHED = 2e-3  # part of a leg's length by which its foot may miss its place
_INNER = 1e-4  # part of its range by which an axis begins within its limits
_REST = 0.01  # weight of staying near home, where a leg may be bent in many ways
_LOW = 0.02  # part of a leg's length that all but the feet stay over the ground
_LEVEL = 1e-3  # m: feet at one height
_STEADY = 0.04  # part of its height by which the centre of mass is within the support area: an angle of 2.3 deg
_UNDER = 0.02  # part of a leg's length by which feet may be off the centre of mass
_LOAD = 0.9  # part of a motor's torque that standing may take
_FORWARD = 2  # joints of a leg that steps ahead alone, not aside
_TURNED = 0.05  # 1/rad; how much unlike others, by its length, a leg may bend to stay nearer to home
_SHIFTS = 3  # how often the feet are put under the centre of mass


@dataclass(frozen=True)
class Stance:
    """A robot as it may stand."""

    posture: Vector  # of its axes, shape (n,) [rad or m]
    height: float  # of its root over the floor [m]
    standing: Standing  # what it stands on, and what that takes
    how: str  # in words


def _bent_by(share: float) -> str:
    """Describe a stance with bent legs by the share of their full length."""
    return message("stations.legs_bent", "with its legs bent to {share:.0%} of their length", share=share)


class Stances:
    """The stances of a robot of a station: home if it stands there, else legs bent so that the feet are lowest.

    A robot stands on the ends of its chains of axes; one that has no legs may stand on its base, too.
    """

    def __init__(self, clearance: Clearance, robot: StationRobot) -> None:
        self._clearance, self._robot, self._plant = clearance, robot, clearance.plant
        self._home = robot.model.home
        self._random = np.random.default_rng(0)
        self._looked_at = list[tuple[float, list[str]]]()

    @property
    def lacking(self) -> str:
        """What is lacking in the best of the stances that :meth:`find` looked at and did not yield, in words."""
        failed = [(len(lacks), -margin, join_texts(lacks, "; ")) for margin, lacks in self._looked_at if lacks]
        if not failed:
            return ""
        _, _, lacks = min(failed)
        return message(
            "stations.best_of_tried", "In the best of {count} that were tried {lacks}.", count=len(failed), lacks=lacks
        )

    def find(self) -> Iterator[Stance]:
        """Yield stances that hold by statics, the most natural first."""
        home, groups = self.as_it_is(), legs_of(self._clearance, self._robot)
        if home is not None:
            feet = {body.name() for body, _ in ends_of(self._clearance, self._robot)}
            yield from self._good(home, [], feet if groups else feet | {self._robot.root.body().name()}, 0.0)
        for legs in groups:
            yield from self.bent(legs)

    def as_it_is(self) -> Stance | None:
        """Return how it stands at home, whatever it stands on; None without shapes."""
        return self._stance(self._home, message("stations.stands_at_home", "at home"))

    def _place(self, posture: Vector, height: float = 0.0) -> None:
        put_upright(self._clearance, self._robot, posture, height)

    def _origin(self, link: RigidBody) -> Vector:
        return np.asarray(self._plant.EvalBodyPoseInWorld(self._clearance.context, link).translation())

    def _feet(self, legs: list[Leg], posture: Vector) -> Vector:
        """Return where feet are in a posture with the root at the origin, shape (k, 3) [m]."""
        self._place(posture)
        return np.array([foot_place(self._clearance, leg) for leg in legs])

    def _stance(self, posture: Vector, how: str) -> Stance | None:
        """Return how the robot stands in a posture, its root upright."""
        self._place(posture)
        height = -min(self._clearance.lowest(self._robot).values(), default=0.0)
        self._place(posture, height)
        found = standing(self._clearance.station, self._robot, self._clearance.context)
        return None if found is None else Stance(posture, height, found, how)

    def _good(self, stance: Stance, legs: list[Leg], feet: set[str], length: float) -> Iterator[Stance]:
        """Yield a stance in which nothing is lacking.

        What lies in itself of it is taken apart, as far as its legs have no part in that.
        """
        still = {axis for leg in legs for axis in leg.axes}
        posture = reduce_own_overlaps(self._clearance, self._robot, stance.posture, set(range(len(self._home))) - still)
        how = stance.how
        if not np.array_equal(posture, stance.posture):
            how = message("stations.turned_apart", "{stance} but for links that are turned apart", stance=stance.how)
        tidy = self._stance(posture, how)
        if tidy is None:
            return
        lacks = list(self._lacks(tidy.standing, feet, length))
        self._looked_at.append((tidy.standing.margin, lacks))
        if not lacks:
            yield tidy

    def _lacks(self, found: Standing, feet: set[str], length: float) -> Iterator[str]:
        """Yield what keeps the robot, which is placed in a stance, from standing there steadily, on its feet alone."""
        if others := found.ends.keys() - feet:
            yield message("stations.stands_on_others", "it stands on {links}, too", links=", ".join(sorted(others)))
        if min(found.ends.values()) < KNEELING:
            yield message("stations.it_kneels", "it kneels")
        lowest = self._clearance.lowest(self._robot).items()
        low = {name: height for name, height in lowest if name not in feet | others and height <= _LOW * length}
        if low:
            nearest = min(low, key=low.__getitem__)
            yield message("stations.link_too_near", "{link} is too near to the ground", link=nearest)
        if found.margin <= _STEADY * found.height:
            side = message("stations.inside", "inside") if found.margin >= 0 else message("stations.outside", "outside")
            yield message(
                "stations.mass_not_steady",
                "its centre of mass is {margin:.0f} mm {side} of the support, and steady from {least:.0f} mm inside on",
                margin=abs(found.margin) * 1e3,
                side=side,
                least=_STEADY * found.height * 1e3,
            )
        loads = self._robot.gains.holding_shares(found.torque)
        worst = int(np.argmax(loads))
        if loads[worst] > _LOAD:
            axis, unit = self._robot.axes[worst], self._robot.model.effort_units[worst]
            has = self._robot.gains.limit_at_rest[worst]
            yield message(
                "stations.axis_overloaded",
                "{axis} takes {torque:.3g} {unit} and has {limit:.3g} {unit}",
                axis=axis,
                torque=abs(found.torque[worst]),
                unit=unit,
                limit=has,
            )

    def bent(self, legs: list[Leg], parts: Sequence[float] = _BENT) -> Iterator[Stance]:
        """Yield stances that hold on some legs, bent to parts of their length, with the feet below straight legs'."""
        self._place(self._home)
        hips = np.array([self._origin(leg.links[0]) for leg in legs])
        chance = self._random.uniform(*posture_range(self._robot), (10 * _SEEDS, len(self._home)))
        feet = np.array([self._feet(legs, posture) for posture in (straight(self._robot), self._home, *chance)])
        length = float((hips - feet.min(axis=0))[:, 2].min())
        if length <= 0:
            return
        aside = np.column_stack([hips[:, 0], feet[0][:, 1]])
        for below in (feet[0][:, :2], aside, (hips[:, :2] + feet[0][:, :2]) / 2):  # the last for legs that lie level
            for part in parts:
                targets = np.column_stack([below, np.full(len(legs), hips[:, 2].min() - part * length)])
                yield from self._with_feet_at(legs, targets, length, part)

    def _with_feet_at(self, legs: list[Leg], targets: Vector, length: float, part: float) -> Iterator[Stance]:
        """Yield stances whose feet are about at places below the root, shape (k, 3) [m], moved under the mass."""
        ways = [self._solutions(leg, target, length) for leg, target in zip(legs, targets, strict=True)]
        if not all(ways):
            return
        feet = {leg.foot.name() for leg in legs}
        for first in ways[0][:_SOLUTIONS]:
            posture = self._home.copy()
            posture[legs[0].axes] = first
            shape = self._bend(legs[0], posture)
            for leg, target, solutions in zip(legs[1:], targets[1:], ways[1:], strict=True):
                mirrored = [self._solve(leg, target, length, seed) for seed in self._mirrored(legs[0], first, leg)]
                known, tried = [*solutions, *(one for one in mirrored if one is not None)], []
                for solution in known:
                    posture[leg.axes] = solution
                    unlike = np.linalg.norm(self._bend(leg, posture) - shape) / length
                    tried.append(float(unlike + _TURNED * np.abs(solution - self._home[leg.axes]).max()))
                posture[leg.axes] = known[int(np.argmin(tried))]
            stance = self._balanced(legs, posture, targets, length, _bent_by(part))
            if stance is not None:
                yield from self._good(stance, legs, feet, length)

    def _mirrored(self, leg: Leg, angles: Vector, other: Leg) -> Iterator[Vector]:
        """Yield angles (k,) of another leg that bend it as one with angles (k,): mirrored to a side, and as it is."""
        self._place(straight(self._robot))
        own, others = (np.array([self._axis(axis) for axis in each.axes]) for each in (leg, other))
        for mirror in ([-1, 1, -1], [1, -1, -1], [1, 1, 1]):  # of turns about ahead, left and up
            senses = np.sum(own * mirror * others, axis=1)
            yield np.where(senses < 0, -angles, angles)

    def _axis(self, axis: int) -> Vector:
        """Return the direction of an axis in the world (3,)."""
        joint = self._robot.joints[axis]
        own = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else np.zeros(3)
        pose = joint.frame_on_child().CalcPoseInWorld(self._clearance.context)
        return np.asarray(pose.rotation() @ own)

    def _bend(self, leg: Leg, posture: Vector) -> Vector:
        """Return where the links of a leg are, seen from the side, ahead of and under its hip, shape (2 k,) [m]."""
        self._place(posture)
        places = np.array([self._origin(link) for link in leg.links])
        return np.asarray((places - places[0])[:, [0, 2]].ravel())

    def _balanced(self, legs: list[Leg], posture: Vector, targets: Vector, length: float, how: str) -> Stance | None:
        """Return a stance whose feet are at one height and under the centre of mass."""
        targets = targets.copy()
        for _ in range(_SHIFTS):
            posture = posture.copy()
            for leg, target in zip(legs, targets, strict=True):
                bent = self._solve(leg, target, length, posture[leg.axes])
                if bent is None:
                    return None
                posture[leg.axes] = bent
            middle = self._feet(legs, posture)[:, :2].mean(axis=0)
            lowest = self._clearance.lowest(self._robot)
            heights = np.array([lowest[leg.foot.name()] for leg in legs])
            com = self._plant.CalcCenterOfMassPositionInWorld(self._clearance.context, [self._robot.instance])
            off = (com[:2] - middle) * [1.0, len(legs[0].axes) > _FORWARD]
            if np.ptp(heights) < _LEVEL and np.abs(off).max() < _UNDER * length:
                break
            targets[:, :2] += off
            targets[:, 2] -= heights - heights.mean()
        return self._stance(posture, how)

    def _solutions(self, leg: Leg, target: Vector, length: float) -> list[Vector]:
        """Return ways in which a leg brings its foot to a place, those near home first, each shape (k,) [rad or m]."""
        lower, upper = (limit[leg.axes] for limit in posture_range(self._robot))
        chance = self._random.uniform(lower, upper, (_SEEDS, len(leg.axes)))
        found: list[Vector] = []
        for seed in (self._home[leg.axes], (lower + upper) / 2, *chance):
            solution = self._solve(leg, target, length, seed)
            if solution is not None and all(np.abs(solution - other).max() > 0.1 for other in found):
                found.append(solution)
        return sorted(found, key=lambda solution: float(np.abs(solution - self._home[leg.axes]).sum()))

    def _solve(self, leg: Leg, target: Vector, length: float, seed: Vector) -> Vector | None:
        """Return angles (k,) of a leg whose foot is at a place, its sole down if it has one; None if it can't be."""
        from scipy.optimize import least_squares

        plant, context, robot = self._plant, self._clearance.context, self._robot
        self._place(self._home)
        places, signs = robot.axis_map.position_places[leg.axes], robot.axis_map.signs[leg.axes]
        positions, rest = plant.GetPositions(context), self._home[leg.axes]
        lower, upper = (limit[leg.axes] for limit in posture_range(robot))
        scale = upper - lower
        down = np.array([0.0, 0.0, -1.0])

        def missed(angles: Vector) -> Vector:
            positions[places] = signs * angles
            plant.SetPositions(context, positions)
            pose = plant.EvalBodyPoseInWorld(context, leg.foot)
            off = (pose @ leg.point - target) / length
            return off if leg.normal is None else np.concatenate([off, pose.rotation() @ leg.normal - down])

        def cost(angles: Vector) -> Vector:
            return np.concatenate([missed(angles), _REST * (angles - rest) / scale])

        bounds, inside = (lower, upper), (lower + _INNER * scale, upper - _INNER * scale)
        near = least_squares(cost, np.clip(seed, *inside), bounds=bounds, max_nfev=40).x
        exact = least_squares(missed, np.clip(near, *inside), bounds=bounds, max_nfev=20).x
        return np.asarray(exact) if np.abs(missed(exact)).max() < _REACHED else None
