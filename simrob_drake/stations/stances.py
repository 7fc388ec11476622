"""Postures in which a robot with a free base may stand on its legs, found by geometry and statics."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RevoluteJoint, RigidBody

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.stations.clearance import KNEELING, Clearance, Standing, outline, span, standing, untangled

_LOWEST = 0.7  # part of what the lowest chains reach that others reach which may be legs
_ALIKE = 0.02  # part by which the sizes of chains may differ that are alike
_REACHES = 60  # postures of chance in which it is looked how low chains reach
_FLAT = np.cos(np.deg2rad(3.0))  # facets of a hull whose normals differ by less are one
_SOLE = 0.15  # part of the surface of a foot that its sole has at least
_ACROSS, _DOWNWARD = 0.9, 1.2  # cosine of its normal and the last axis; and weight of where it looks
_ROUND = 0.3  # a foot whose middle is so near to its joint, by its size, is a wheel or a ball


@dataclass(frozen=True)
class Leg:
    """A chain of axes from the root to a foot."""

    axes: list[int]  # their numbers, from the root outward
    links: list[RigidBody]  # that they move, in this order; the first is the hip
    foot: RigidBody  # the link at its end
    point: Vector  # with which it stands, in the foot [m]
    normal: Vector | None  # of its sole, outward, in the foot; None for a tip or a ball


def put_upright(clearance: Clearance, robot: StationRobot, posture: Vector, height: float = 0.0) -> None:
    """Put a robot with a free base into a posture (n,) [rad or m], its root upright at a height [m]."""
    pose = RigidTransform(np.array([0.0, 0.0, height]))
    clearance.plant.SetFreeBodyPose(clearance.context, robot.root.body(), pose)
    clearance.place_robots({robot.name: posture})


def foot_place(clearance: Clearance, leg: Leg) -> Vector:
    """Return where a foot is that stands with its point (3,) [m], in the present configuration."""
    return np.asarray(clearance.plant.EvalBodyPoseInWorld(clearance.context, leg.foot) @ leg.point)


def ends_of(clearance: Clearance, robot: StationRobot) -> list[tuple[RigidBody, list[int]]]:
    """Return the bodies with shapes at the ends of a robot's chains of axes, and these."""
    shaped = set(clearance.lowest(robot))
    chains = [(body, axes) for body, axes in clearance.chains(robot) if axes and body.name() in shaped]
    inner = {tuple(axes[:count]) for _, axes in chains for count in range(len(axes))}
    return [(body, axes) for body, axes in chains if tuple(axes) not in inner]


def legs_of(clearance: Clearance, robot: StationRobot) -> list[list[Leg]]:
    """Return groups of chains that are alike, those that reach lowest at home or stretched out, else anyhow, first."""
    groups = list[tuple[Vector, list[Leg]]]()
    for body, axes in ends_of(clearance, robot):
        if len(axes) > 1:
            links, stood_on = (
                [robot.joints[axis].child_body() for axis in axes],
                _foot(clearance, robot, body, axes[-1]),
            )
            leg, own = Leg(axes, links, body, *stood_on), lengths(clearance, robot, axes)
            for others, group in groups:
                if len(group[0].axes) == len(axes) and alike(own, others, _ALIKE):
                    group.append(leg)
                    break
            else:
                groups.append((own, [leg]))

    pairs = [group for _, group in groups if len(group) > 1]
    natural = [robot.model.home, straight(robot)]
    chance = np.random.default_rng(0).uniform(*span(robot), (_REACHES, len(robot.axes)))
    for postures in (natural, [*natural, *chance]):  # legs that lie level, or are up, reach down in others
        heights = [_lowest(clearance, robot, group, postures) for group in pairs]
        legs = [row for row in np.argsort(heights, kind="stable") if heights[row] < _LOWEST * min(heights)]
        if legs:
            return [pairs[row] for row in legs]
    return []


def lengths(clearance: Clearance, robot: StationRobot, axes: Sequence[int], foot: Leg | None = None) -> Vector:
    """Return how long a chain is from joint to joint, and straight from its first to its last, shape (2,) [m].

    Both up to the point on which a leg stands if that is asked for, where all axes are zero. Of a pair one may differ:
    the first where joints are drawn at other places along their axes, the second where zero is another posture.
    """
    put_upright(clearance, robot, straight(robot))
    places = [robot.joints[axis].frame_on_child().CalcPoseInWorld(clearance.context).translation() for axis in axes]
    if foot is not None:
        places.append(foot_place(clearance, foot))
    ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return np.array([ways.sum(), np.linalg.norm(places[-1] - places[0])])


def alike(some: Vector, others: Vector, part: float) -> bool:
    """Whether one of the lengths (2,) of two chains differs by a part of it at most."""
    return bool((np.abs(some - others) <= part * np.maximum(some, others)).any())


def _lowest(clearance: Clearance, robot: StationRobot, legs: list[Leg], postures: Iterable[Vector]) -> float:
    """Return the height over the root at which one of legs stands lowest in some posture [m]."""
    heights = []
    for posture in postures:
        put_upright(clearance, robot, posture)
        heights += [foot_place(clearance, leg)[2] for leg in legs]
    return float(min(heights))


def straight(robot: StationRobot) -> Vector:
    """Return the posture (n,) in which most legs are straight, be it within their limits or not: zero."""
    return np.zeros(len(robot.axes))


def _foot(clearance: Clearance, robot: StationRobot, body: RigidBody, axis: int) -> tuple[Vector, Vector | None]:
    """Return with what a foot stands: the middle of a flat sole and its normal, its centre if round, or its tip."""
    points = outline(clearance.station, body)
    ways = np.linalg.norm(points, axis=1)
    joint = robot.joints[axis]
    turns = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else np.zeros(3)
    put_upright(clearance, robot, straight(robot))
    down = -clearance.plant.EvalBodyPoseInWorld(clearance.context, body).rotation().matrix()[2]
    sole = _sole(points, float(KNEELING * ways.max()), turns, down)
    if sole is not None:
        return sole
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    return (middle if np.linalg.norm(middle) < _ROUND * ways.max() else points[int(ways.argmax())]), None


def _sole(points: Vector, near: float, turns: Vector, down: Vector) -> tuple[Vector, Vector] | None:
    """Return the middle and the normal of the flat side on which a body can stand, in its frame; None without.

    That is a large one, which no point of its outline (k, 3) is nearer to the joint of than a knee is, ``near`` [m],
    and the last axis, whose direction ``turns`` is zero if it slides, is not normal to it, as a wheel's is. Of several
    it is a large one that looks ``down`` where all axes are zero.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    normals, corners = hull.equations[:, :3], points[hull.simplices]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    same = normals @ normals.T > _FLAT
    far = np.array([np.linalg.norm(corners[row].reshape(-1, 3), axis=1).min() for row in same]) > near
    fits = far & (same @ areas > _SOLE * areas.sum()) & (np.abs(normals @ turns) < _ACROSS)
    if not fits.any():
        return None
    best = int(np.argmax(np.where(fits, (same @ areas) * (_DOWNWARD + normals @ down), -np.inf)))
    parts = same[best]
    centre = (areas[parts, np.newaxis] * corners[parts].mean(axis=1)).sum(axis=0) / areas[parts].sum()
    normal = areas[parts] @ normals[parts]
    return np.asarray(centre), np.asarray(normal / np.linalg.norm(normal))


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
        failed = [(len(lacks), -margin, "; ".join(lacks)) for margin, lacks in self._looked_at if lacks]
        return f"In the best of {len(failed)} that were tried {min(failed)[2]}." if failed else ""

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
        return self._stance(self._home, "at home")

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
        posture = untangled(self._clearance, self._robot, stance.posture, set(range(len(self._home))) - still)
        apart = "" if np.array_equal(posture, stance.posture) else " but for links that are turned apart"
        tidy = self._stance(posture, f"{stance.how}{apart}")
        if tidy is None:
            return
        lacks = list(self._lacks(tidy.standing, feet, length))
        self._looked_at.append((tidy.standing.margin, lacks))
        if not lacks:
            yield tidy

    def _lacks(self, found: Standing, feet: set[str], length: float) -> Iterator[str]:
        """Yield what keeps the robot, which is placed in a stance, from standing there steadily, on its feet alone."""
        if others := found.ends.keys() - feet:
            yield f"it stands on {', '.join(sorted(others))}, too"
        if min(found.ends.values()) < KNEELING:
            yield "it kneels"
        lowest = self._clearance.lowest(self._robot).items()
        low = {name: height for name, height in lowest if name not in feet | others and height <= _LOW * length}
        if low:
            yield f"{min(low, key=low.__getitem__)} is too near to the ground"
        if found.margin <= _STEADY * found.height:
            side = "inside" if found.margin >= 0 else "outside"
            place = f"its centre of mass is {abs(found.margin) * 1e3:.0f} mm {side} of the support"
            yield f"{place}, and steady from {_STEADY * found.height * 1e3:.0f} mm inside on"
        loads = np.abs(found.torque) / self._robot.gains.torque_limit
        worst = int(np.argmax(loads))
        if loads[worst] > _LOAD:
            axis, unit = self._robot.axes[worst], self._robot.model.effort_units[worst]
            has = self._robot.gains.torque_limit[worst]
            yield f"{axis} takes {abs(found.torque[worst]):.3g} {unit} and has {has:.3g} {unit}"

    def bent(self, legs: list[Leg], parts: Sequence[float] = _BENT) -> Iterator[Stance]:
        """Yield stances that hold on some legs, bent to parts of their length, with the feet below straight legs'."""
        self._place(self._home)
        hips = np.array([self._origin(leg.links[0]) for leg in legs])
        chance = self._random.uniform(*span(self._robot), (10 * _SEEDS, len(self._home)))
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
            stance = self._balanced(legs, posture, targets, length, f"with its legs bent to {part:.0%} of their length")
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
        lower, upper = (limit[leg.axes] for limit in span(self._robot))
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
        lower, upper = (limit[leg.axes] for limit in span(robot))
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
