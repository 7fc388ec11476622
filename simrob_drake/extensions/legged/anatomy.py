"""The limbs of a robot on legs, by geometry: which chains are legs, left and right, where it looks, knees, signs."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.tree import RevoluteJoint

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.clearance import Clearance, outline
from simrob_drake.stations.legs import (
    Leg,
    chain_lengths,
    ends_of,
    has_any_equal_length,
    legs_of,
    put_upright,
    straight,
)
from simrob_drake.walking.knees import Knee, knee_of

_LONG = 1.25  # times as far as hips are apart ahead, that they are to the side: then the robot looks along its y
_ALIKE = 0.03  # part by which legs may differ in size
_PLACED = 0.05  # part of the distance between hips by which a pair may stand unlike
_TOES = 0.05  # part of its length by which the middle of a sole is ahead of the ankle, to tell where the robot looks
_PITCHES = 0.7  # cosine of an axis and the side, from which on it pitches
_BEND = 0.5  # rad
_LOPSIDED = (
    0.05  # part of its range by which a joint turns farther to one side, to tell which way it bends
)
_JOINTS = 2, 7
_ROWS_OF_LEGS = {1: ("",), 2: ("front_", "rear_"), 3: ("front_", "middle_", "rear_")}
_KINDS = "roll", "pitch", "yaw"
_FORWARD = {"roll": 1.0, "pitch": -1.0, "yaw": 1.0}
"""Sense of a left limb's joint, about ahead, left and up, whose positive angle turns the limb out, forward and left."""


class _Unpaired(SimrobError):
    """Legs that are not left and right of the middle of a robot that looks somewhere."""


@dataclass(frozen=True)
class NamedLeg:
    """A leg, called by its place."""

    name: str  # such as ``left``, or ``front_left``
    left: bool  # on which side it is
    leg: Leg  # its axes and links
    knee: Knee  # of them

    @property
    def foot(self) -> str:
        """What its foot is called."""
        return f"{self.name}_foot"


@dataclass(frozen=True)
class Anatomy:
    """The limbs of a robot."""

    robot: StationRobot  # whose
    clearance: Clearance  # that places it
    legs: list[NamedLeg]  # right before left, front before rear
    facing: float  # where it looks while its root is not turned, from the root's x axis [rad]
    arms: list[list[int]]  # the axes of chains that are in pairs and no legs
    head: list[int]  # the axes of others

    @property
    def groups(self) -> list[list[str]]:
        """The feet that stand and swing together: those of one row's right and the next row's left."""
        rows = len(self.legs) // 2
        right = [self.legs[2 * row + (row % 2)].foot for row in range(rows)]
        left = [self.legs[2 * row + 1 - (row % 2)].foot for row in range(rows)]
        return [right, left]

    @property
    def has_soles(self) -> bool:
        """Whether its feet lie flat."""
        return self.legs[0].leg.normal is not None

    @cached_property
    def names(self) -> list[str]:
        """Names of the axes: those of legs by place and direction where that is one name each, else the joints'."""
        names = list(self.robot.axes)
        for limb in self.legs:
            for place, axis in enumerate(limb.leg.axes):
                part = "hip" if place < limb.knee.place else "ankle"
                names[axis] = (
                    f"{limb.name}_{part}_{self._kind(axis)[0]}" if place != limb.knee.place else ""
                )
                names[axis] = names[axis] or f"{limb.name}_knee"
        count = Counter(names)
        return [
            name if count[name] == 1 else own
            for name, own in zip(names, self.robot.axes, strict=True)
        ]

    def signs(self, posture: Vector) -> list[int]:
        """Return the senses of all axes; knees bend to positive angles as they do in a posture (n,) [rad]."""
        signs = [1] * len(self.robot.axes)
        for limb in self.legs:
            for place, axis in enumerate(limb.leg.axes):
                signs[axis] = self._sign(axis, limb.left, ankle=place > limb.knee.place)
            knee = limb.leg.axes[limb.knee.place]
            signs[knee] = 1 if limb.knee.bend_at(posture[knee]) >= 0 else -1
        for axes in self.arms:
            put_upright(self.clearance, self.robot, straight(self.robot))
            left = self.ahead(self.origin(axes[0]))[1] > 0
            for axis in axes:
                signs[axis] = self._sign(axis, left, ankle=False)
        return signs

    def _sign(self, axis: int, left: bool, *, ankle: bool) -> int:
        kind, sense = self._kind(axis)
        sense *= _FORWARD[kind] * (-1.0 if ankle and kind != "yaw" else 1.0)
        return int(-sense if kind == "roll" and not left else sense)

    def _kind(self, axis: int) -> tuple[str, float]:
        """Return what an axis turns about where all are at zero, and in which sense."""
        joint = self.robot.joints[axis]
        if not isinstance(joint, RevoluteJoint):
            return "yaw", 1.0
        put_upright(self.clearance, self.robot, straight(self.robot))
        pose = joint.frame_on_child().CalcPoseInWorld(self.clearance.context)
        turn = self.ahead(pose.rotation() @ joint.revolute_axis())
        place = int(np.abs(turn).argmax())
        return _KINDS[place], math.copysign(1.0, turn[place])

    def origin(self, axis: int) -> Vector:
        """Return where a joint is as the robot is placed, shape (3,) [m]."""
        return np.asarray(
            self.robot.joints[axis]
            .frame_on_child()
            .CalcPoseInWorld(self.clearance.context)
            .translation()
        )

    def ahead(self, way: Vector) -> Vector:
        """Return a way (3,) as ahead, left and up."""
        return np.asarray(RotationMatrix.MakeZRotation(-self.facing) @ way)

    def knees_ahead(self, posture: Vector) -> bool:
        """Whether the knees are ahead of the line from hip to foot in a posture (n,) [rad]."""
        put_upright(self.clearance, self.robot, posture)
        leg = self.legs[0].leg
        hip, knee = (self.origin(leg.axes[place]) for place in (0, self.legs[0].knee.place))
        foot = self.clearance.plant.EvalBodyPoseInWorld(
            self.clearance.context, leg.foot
        ).translation()
        share = (hip - knee)[2] / max((hip - foot)[2], 1e-6)
        return bool(self.ahead(knee - hip - share * (foot - hip))[0] > 0)


def anatomy_of(clearance: Clearance, robot: StationRobot) -> Anatomy:
    """Return the limbs of a robot with a free base.

    Raises SimrobError: it has no legs, or such as nothing here walks on; it says which were found.
    """
    legs = _legs(clearance, robot)
    put_upright(clearance, robot, straight(robot))
    hips = np.array([_hip(clearance, leg) for leg in legs])
    across, along = np.ptp(hips[:, 1]), np.ptp(hips[:, 0])
    facing = (
        0.0
        if (along <= _LONG * across if len(legs) == 2 else across <= _LONG * along)
        else math.pi / 2
    )
    try:
        limbs = list(_named(clearance, robot, legs, facing))
    except _Unpaired:
        # a body as wide as it is long does not tell, but its pairs do
        facing = math.pi / 2 - facing
        limbs = list(_named(clearance, robot, legs, facing))
    put_upright(clearance, robot, straight(robot))
    ahead = float(np.mean([_toes(clearance, robot, leg, facing) for leg in legs]))
    if abs(ahead) < _TOES and len(legs) == 2 and legs[0].normal is not None:
        ahead = _bends(clearance, robot, limbs[0], facing)
    if ahead < 0 and len(legs) == 2:
        facing += math.pi if facing <= 0 else -math.pi
        limbs = list(_named(clearance, robot, legs, facing))
    found = Anatomy(robot, clearance, limbs, facing, [], [])
    arms = _arms(found, max(across, along))
    rest = {*range(len(robot.axes))} - {
        axis for axes in [*arms, *(limb.leg.axes for limb in limbs)] for axis in axes
    }
    return replace(found, arms=arms, head=sorted(rest))


def _arms(anatomy: Anatomy, wide: float) -> list[list[int]]:
    """Return the axes of chains that have a like one on the other side, and are no legs."""
    used, sides = (
        {axis for limb in anatomy.legs for axis in limb.leg.axes},
        dict[tuple[int, ...], Vector](),
    )
    chains = {
        tuple(axes)
        for _, axes in anatomy.clearance.chains(anatomy.robot)
        if axes and not used & {*axes}
    }
    put_upright(anatomy.clearance, anatomy.robot, straight(anatomy.robot))
    inner = {chain[:count] for chain in chains for count in range(len(chain))}
    for axes in sorted(chains - inner):
        own = tuple(
            axis
            for axis in axes
            if sum(axis in other for other in chains if len(other) >= len(axes)) == 1
        )
        sides[own] = anatomy.ahead(anatomy.origin(axes[-1]))
    return [
        list(axes)
        for axes, place in sides.items()
        if any(
            np.abs(place * [1, -1, 1] - other).max() < _PLACED * wide < abs(place[1])
            for other in sides.values()
        )
    ]


def _legs(clearance: Clearance, robot: StationRobot) -> list[Leg]:
    """Return the legs: of the chains that reach lowest those that are alike."""
    groups = legs_of(clearance, robot)
    if not groups:
        bare = _bare_ends(clearance, robot)
        if bare:
            what = message(
                "legged.ends_without_shape",
                "{links} at the ends of its chains have no collision shape",
                links=", ".join(bare),
            )
            raise SimrobError(
                message(
                    "legged.no_legs_to_stand",
                    "{model} has no legs to stand on: {what}; give each foot one, as a ball or a box",
                    model=robot.model.name,
                    what=what,
                )
            )
        ends = ", ".join(body.name() for body, _ in ends_of(clearance, robot)) or message(
            "legged.none_with_shape", "none with a shape"
        )
        expected = message(
            "legged.chains_in_pairs",
            "chains of at least two joints, in pairs, whose ends have collision shapes and reach lowest",
        )
        raise SimrobError(
            message(
                "legged.no_legs",
                "{model} has no legs ({expected}); its chains end in: {ends}",
                model=robot.model.name,
                expected=expected,
                ends=ends,
            )
        )
    found = groups[0]
    for other in groups[1:]:
        if (
            len(other[0].axes) == len(found[0].axes)
            and len(other) == len(found) == 2
            and not _is_arm(robot, other[0])
        ):
            found = [*found, *other]
    fewest, most = _JOINTS
    if len(found) % 2 or len(found) > 6:
        raise SimrobError(
            message(
                "legged.legs_not_in_pairs",
                "{model} has {count} legs that are alike; two, four or six are to be in pairs",
                model=robot.model.name,
                count=len(found),
            )
        )
    if not fewest <= len(found[0].axes) <= most:
        count = len(found[0].axes)
        raise SimrobError(
            message(
                "legged.joints_of_legs",
                "{model} has legs of {count} joints; they are to have {fewest} to {most}",
                model=robot.model.name,
                count=count,
                fewest=fewest,
                most=most,
            )
        )
    return found


def _bare_ends(clearance: Clearance, robot: StationRobot) -> list[str]:
    """Return the links without a shape at the ends of chains of two joints and more."""
    shaped, chains = clearance.lowest(robot).keys(), clearance.chains(robot)
    inner = {tuple(axes[:count]) for _, axes in chains for count in range(len(axes))}
    return [
        body.name()
        for body, axes in chains
        if len(axes) > 1 and tuple(axes) not in inner and body.name() not in shaped
    ]


def _is_arm(robot: StationRobot, leg: Leg) -> bool:
    """Whether a chain starts on another link than the root."""
    return bool(robot.joints[leg.axes[0]].parent_body().index() != robot.root.body().index())


def _hip(clearance: Clearance, leg: Leg) -> Vector:
    return np.asarray(
        clearance.plant.EvalBodyPoseInWorld(clearance.context, leg.links[0]).translation()
    )


def _toes(clearance: Clearance, robot: StationRobot, leg: Leg, facing: float) -> float:
    """Return how far the middle of a foot is ahead of its last joint that pitches, as part of its length.

    Where the others lie along their axes says nothing.
    """
    if leg.normal is None:
        return 0.0
    way, side = (
        np.array([math.cos(turn), math.sin(turn), 0.0]) for turn in (facing, facing + math.pi / 2)
    )
    pose = clearance.plant.EvalBodyPoseInWorld(clearance.context, leg.foot)
    ankle = pose.translation()
    for axis in leg.axes:
        joint = robot.joints[axis]
        place = joint.frame_on_child().CalcPoseInWorld(clearance.context)
        if (
            isinstance(joint, RevoluteJoint)
            and abs(place.rotation() @ joint.revolute_axis() @ side) > _PITCHES
        ):
            ankle = place.translation()
    ahead = (pose.rotation() @ outline(clearance.station, leg.foot).T).T @ way + (
        pose.translation() - ankle
    ) @ way
    return float((ahead.max() + ahead.min()) / 2 / max(np.ptp(ahead), 1e-6))


def _bends(clearance: Clearance, robot: StationRobot, limb: NamedLeg, facing: float) -> float:
    """Return how far ahead a knee goes that bends as its limits let it most [m]; 0 where they tell nothing.

    Where a knee bends as well to both sides, the hip before it tells: it turns farther when the thigh goes ahead.
    """
    for place, straightened, sense in (
        (limb.knee.place, limb.knee.straight, -1.0),
        (limb.knee.place - 1, 0.0, 1.0),
    ):
        axis, tried = limb.leg.axes[place], straight(robot)
        lower, upper = (limit[axis] - straightened for limit in robot.model.axis_limits)
        if place < 0 or abs(upper + lower) <= _LOPSIDED * (upper - lower):
            continue
        tried[axis] = straightened + math.copysign(_BEND, upper + lower)
        places = []
        for posture in (straight(robot), tried):
            put_upright(clearance, robot, posture)
            pose = clearance.plant.EvalBodyPoseInWorld(clearance.context, limb.leg.foot)
            places.append(RotationMatrix.MakeZRotation(-facing) @ pose.translation())
        return float(sense * (places[1] - places[0])[0])
    return 0.0


def _named(
    clearance: Clearance, robot: StationRobot, legs: Sequence[Leg], facing: float
) -> Iterator[NamedLeg]:
    """Yield the legs with their names, right before left, front before rear.

    Raises SimrobError: they are unlike, or slide; _Unpaired: they are not in pairs by mirror symmetry.
    """
    turn = RotationMatrix.MakeZRotation(-facing)
    put_upright(clearance, robot, straight(robot))
    hips = {id(leg): turn @ _hip(clearance, leg) for leg in legs}
    left = sorted((leg for leg in legs if hips[id(leg)][1] > 0), key=lambda leg: -hips[id(leg)][0])
    right = sorted(
        (leg for leg in legs if hips[id(leg)][1] <= 0), key=lambda leg: -hips[id(leg)][0]
    )
    apart = max(float(np.ptp(list(hips.values()), axis=0).max()), 1e-6)
    pairs = list(zip(right, left, strict=False))
    off = [float(np.abs(hips[id(a)] * [1, -1, 1] - hips[id(b)]).max()) for a, b in pairs]
    if len(left) != len(right) or max(off) > _PLACED * apart:
        names = ", ".join(leg.foot.name() for leg in legs)
        raise _Unpaired(
            message(
                "legged.legs_not_left_and_right",
                "the legs of {model} ({names}) are not left and right of its middle in pairs alike",
                model=robot.model.name,
                names=names,
            )
        )
    for pair in pairs:
        ways = [chain_lengths(clearance, robot, leg.axes, leg) for leg in pair]
        if not has_any_equal_length(ways[0], ways[1], _ALIKE):
            what = join_texts(
                (
                    compound("{foot} {way:.3f} m", foot=leg.foot.name(), way=way[0])
                    for leg, way in zip(pair, ways, strict=True)
                ),
                " and ",
            )
            expected = message(
                "legged.legs_alike",
                "a right and a left one are to be alike, within {alike:.0%}",
                alike=_ALIKE,
            )
            raise SimrobError(
                message(
                    "legged.unlike_legs",
                    "{model} has legs of unlike length ({what}); {expected}",
                    model=robot.model.name,
                    what=what,
                    expected=expected,
                )
            )
    for row, pair in zip(_ROWS_OF_LEGS[len(pairs)], pairs, strict=True):
        for side, leg in zip(("right", "left"), pair, strict=True):
            joints = [robot.joints[axis] for axis in leg.axes]
            sliding = next(
                (joint.name() for joint in joints if not isinstance(joint, RevoluteJoint)), None
            )
            if sliding is not None:
                remedy = message(
                    "legged.legs_are_to_turn",
                    "legs are to turn; if it is a spring or a switch of the foot, make it fixed in the file",
                )
                raise SimrobError(
                    message(
                        "legged.sliding_leg",
                        "{model} has the joint {joint} in a leg, which slides; {remedy}",
                        model=robot.model.name,
                        joint=sliding,
                        remedy=remedy,
                    )
                )
            put_upright(clearance, robot, robot.model.home)
            knee = knee_of(
                clearance.plant, clearance.context, joints, leg.foot.body_frame(), leg.point
            )
            signed = replace(
                knee, straight=robot.axis_map.signs[leg.axes[knee.place]] * knee.straight
            )
            yield NamedLeg(f"{row}{side}", side == "left", leg, signed)
