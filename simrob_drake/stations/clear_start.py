"""Search for a first posture and a first move of a robot that is held by its root, for the draft of a first station.

A *start* is a first posture, the height of the root, and the target of a first move. A *posture* gives the positions of
the robot's n axes, in rad or m. A *follower* is an axis that a coupling moves along with another axis, its leader.

A start is clear if no body of the robot lies in the floor or too near to it, no link overlaps another one, and no motor
needs more than 90 % of its torque to hold the posture. The search begins with the home posture of the robot, and with
the same posture after its links were moved apart. It goes on to postures that differ from the latter in one axis, in
two and in three, and then to random postures. Of equally simple postures it takes the one that is farthest from a
singularity and has a clear first move.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.multibody.tree import JacobianWrtVariable

from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import join_texts, message
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.clearance import (
    SLIDES,
    TURNS,
    Clearance,
    neighbouring_postures,
    reduce_own_overlaps,
)
from simrob_drake.stations.posed import posture_range

# Limits of the first move.
_STEP_DEG = 20.0  # largest travel of a revolute axis [deg]
_STEP_METRES = 0.05  # largest travel of a prismatic axis [m]
_RANGE_SHARE = 0.4  # largest travel as a share of the way to the joint's limit
# Largest mean speed as a share of the axis' speed limit; the peak of a move is 1.9 times the mean.
_SPEED_SHARE = 0.4
_LOAD = 0.9  # largest share of a motor's torque that holding may take
# Shares of the move at which its postures are checked.
_PARTS = np.linspace(0.0, 1.0, 6)
_FEW_PARTS = _PARTS[1::2]

# Heights of the robot.
_OVER = 0.05  # height that moving links keep over the floor, where they can [m]
# A robot that reaches below its base by more than this share of its reach hangs.
_HANGS = 0.25
# Height over the floor at which a hanging robot is held, as a share of its reach.
_ABOVE = 0.1
_ROUNDING = 1e-3  # smaller differences of heights do not matter [m]

# Effort of the search.
_RANDOM = 40  # count of random postures, which also show the robot's reach
_TRIED = 150  # count of postures that are tried for each count of changed axes
_MOVED = 8  # count of postures of the same group whose first move is checked
# Largest count of steps that reduce the faults of a posture, if no posture is clear.
_STEPS = 8

# Singularities.
_CHAIN = 5  # a singular posture is avoided if a chain has at least this many axes
# Least dexterity, as a share of the dexterity that one in five random postures exceeds.
_DEXTERITY = 0.25


@dataclass(frozen=True)
class Start:
    """The start of a robot.

    Attributes:
        posture: first positions of its axes, shape (n,) [rad or m].
        target: positions at the end of its first move, shape (n,) [rad or m]; the posture itself if it does not move.
        height: height of its root over the floor [m].
        remarks: sentences for the user: what was chosen, what was checked, and what is wrong.
    """

    posture: Vector
    target: Vector
    height: float
    remarks: tuple[str, ...]


class Faults(NamedTuple):
    """The faults of a posture; each is 0 if there is none.

    Attributes:
        low: height that is missing between a link and its required height over the floor [m].
        overlap: depth of the deepest overlap between two links of the robot [m].
        overload: load of the most loaded motor above the largest allowed load of _LOAD; both are shares of the motor's
            largest torque.
    """

    low: float
    overlap: float
    overload: float


# For each field of Faults: how remarks describe the fault of the home posture.
_FAULTS_AT_HOME = (
    message("stations.fault_in_floor", "in the floor, or too near to it"),
    message("stations.fault_in_itself", "in collision with itself"),
    message("stations.fault_too_heavy", "too heavy for its motors"),
)


def _faults_in_words(faults: Vector) -> list[str]:
    """Describe faults, in the order of the fields of Faults, shape (3,). Those that are 0 are left out."""
    low, overlap, overload = faults.tolist()
    words = list[str]()
    if low:
        words.append(
            message(
                "stations.too_low",
                "{low:.2g} m below the required height over the floor",
                low=low,
            )
        )
    if overlap:
        words.append(
            message(
                "stations.overlaps_itself",
                "links that overlap by {overlap:.2g} m",
                overlap=overlap,
            )
        )
    if overload:
        words.append(
            message(
                "stations.lacks_torque",
                "a motor that needs {share:.0%} of its torque to hold the posture",
                share=overload + _LOAD,
            )
        )
    return words


class ClearStart:
    """The search for a start. Its random numbers have a fixed seed, so that each new search gives the same result.

    Attributes:
        height: height of the root over the floor [m]. The robot stands on its bodies that do not move, or hangs over
            the floor.
        hangs: whether the robot reaches so far below its root that it is held over the floor.
    """

    def __init__(
        self,
        clearance: Clearance,
        robot: StationRobot,
        duration: float,
        *,
        torque: bool,
    ) -> None:
        """Prepare the search.

        Args:
            clearance: the station, with the root of the robot at the origin. The search changes the robot's posture.
            robot: the robot.
            duration: duration of the robot's first move [s].
            torque: whether the motors must be able to hold the posture against gravity.
        """
        self._clearance = clearance
        self._robot = robot
        self._duration = duration
        self._torque = torque
        self._random = np.random.default_rng(0)
        self._home = robot.model.home
        self._longest_chain = max(clearance.chains(robot), key=lambda chain: len(chain.axes))
        # Indices of the axes that the search moves. Fingers stay where they are at home, and the positions of
        # followers (coupled axes) result from those of their leaders.
        self._axes = []
        for index, name in enumerate(robot.axes):
            if index not in robot.model.fingers and name not in robot.model.followers:
                self._axes.append(index)
        self._random_postures = self._draw_postures()
        # The k bodies of the robot with collision shapes.
        bodies = [
            clearance.plant.GetBodyByName(name, robot.instance) for name in clearance.lowest(robot)
        ]
        # A fixed body belongs to the robot's base: no axis moves it.
        moves = np.array([not clearance.plant.IsAnchored(body) for body in bodies], dtype=bool)
        # Heights of these bodies over the floor while the root is on it, in m postures, shape (m, k) [m].
        heights = np.array(
            [self._heights(posture) for posture in [self._home, *self._random_postures]]
        )
        self._place_root(heights, moves)
        # Each body that moves has to be as high as the search requires, or as high as it can be: `_highest` is its
        # greatest height in any of these postures, shape (k,) [m].
        self._highest = np.where(moves, heights.max(axis=0) + self.height, -np.inf)
        self._require_height(_OVER)

        reduced = reduce_own_overlaps(clearance, robot, self._home, self._axes)
        self._reduced_home = robot.model.with_followers(reduced)

    def _draw_postures(self) -> Vector:
        """Draw random postures within the limits, shape (_RANDOM, n) [rad or m], with fingers as at home."""
        model = self._robot.model
        postures = self._random.uniform(
            *posture_range(self._robot), (_RANDOM, len(self._robot.axes))
        )
        fingers = list(model.fingers)
        postures[:, fingers] = self._home[fingers]
        return model.with_followers(postures)

    def _place_root(self, heights: Vector, moves: Flags) -> None:
        """Choose the height of the root: set the attributes `hangs` and `height`.

        Args:
            heights: heights of the k bodies with shapes above the root's origin in m postures, the home posture first,
                shape (m, k) [m]; negative for a body that reaches below the origin.
            moves: whether each of these bodies moves, shape (k,).
        """
        at_home = heights[0]
        # The lowest point of the fixed bodies, or the root (0) if it is lower.
        base_height = float(at_home[~moves].min(initial=0.0))
        # From the lowest to the highest of all bodies in all postures.
        reach = float(np.ptp(heights)) if heights.size else 0.0
        # The robot hangs if it reaches far below its root and its fixed bodies.
        self.hangs = bool(at_home.min(initial=0.0) < base_height - _HANGS * reach)
        if self.hangs:
            # The lowest point of all postures is then `_ABOVE * reach` over the floor.
            self.height = _ABOVE * reach - float(heights.min())
        else:
            # High enough that the base is not in the floor, and that each body is over the floor in some posture.
            self.height = -float(heights.max(axis=0).min(initial=min(base_height, 0.0)))

    def find(self) -> Start:
        """Find the best start: with links well over the floor, or else just over it.

        If no clear posture with a clear first move is found, the start has the posture with the smallest faults that
        was found. It has no move then, unless that posture and a move from it are clear after all.
        """
        # First with a distance from the floor. Some robots cannot keep it: then links may be just above the floor.
        for height in (_OVER, 0.0):
            self._require_height(height)
            for postures in self._clear_postures():
                # A move takes several collision queries for each posture, so that only the best ones are tried.
                for posture in postures[:_MOVED]:
                    target = self._target(posture)
                    if target is not None:
                        return self._start(posture, target)
        # Nothing is clear. The user gets the least faulty start, with remarks that name its faults.
        candidates = [self._home, self._reduced_home, *self._random_postures]
        best = self._with_less_faults(min(candidates, key=self._total_fault))
        is_clear = not any(self._faults(best))
        target = self._target(best) if is_clear else None
        return self._start(best, best if target is None else target)

    def _start(self, posture: Vector, target: Vector) -> Start:
        """Make a start from its posture and the target of its first move, shape (n,) each [rad or m]."""
        return Start(posture, target, self.height, self._remarks(posture, target))

    def _with_less_faults(self, posture: Vector) -> Vector:
        """Reduce the faults of a posture (n,) [rad or m]; each step moves the axis that reduces the faults most.

        It takes at most _STEPS steps, and ends earlier if no move of a single axis reduces the faults. Returns the best
        posture, which may have faults.
        """
        for _ in range(_STEPS):
            neighbours = neighbouring_postures(self._robot, posture, self._axes)
            tried = [posture, *map(self._robot.model.with_followers, neighbours)]
            best = min(tried, key=self._total_fault)
            if best is posture:
                break
            posture = best
        return posture

    def _total_fault(self, posture: Vector) -> float:
        """Compute the sum of a posture's faults, by which postures are compared; its units are mixed."""
        return sum(self._faults(posture))

    def _require_height(self, height: float) -> None:
        """Set the height over the floor [m] that all moving bodies must have, or as much of it as they can have.

        The greatest height that a body can have (`_highest`) is that of its lowest point in the home posture or in one
        of the random postures, whichever is highest. The attribute `_required_heights` gets an entry for each of the k
        bodies with shapes, shape (k,) [m], less the rounding. The entry is -inf for a body that does not move.
        """
        self._required_heights = np.minimum(height, self._highest) - _ROUNDING

    def _heights(self, posture: Vector) -> Vector:
        """Set the robot to a posture, and measure the lowest points of its k bodies with shapes, shape (k,) [m].

        The result has the height of the lowest point of each body over the floor, while the root is at the origin.
        """
        self._clearance.place_robots({self._robot.name: posture})
        return np.array(list(self._clearance.lowest(self._robot).values()))

    def _faults(self, posture: Vector) -> Faults:
        """Set the robot to a posture (n,) [rad or m], and measure its faults, with the root at its height."""
        # The heights are measured with the root at the origin: over the floor they are larger by the root's height.
        missing_heights = self._required_heights - self.height - self._heights(posture)
        overlaps = self._clearance.own_overlaps(self._robot, posture)
        return Faults(
            low=float(missing_heights.max(initial=0.0)),
            overlap=max((overlap.depth for overlap in overlaps), default=0.0),
            overload=max(self._load() - _LOAD, 0.0),
        )

    def _load(self) -> float:
        """Compute the largest share of its torque limit that any motor needs to hold the posture that was set last.

        The limits are those of the robot's file. The share is 0 if the motors need not hold the robot. Passive axes do
        not count: they have no motor, and hold no posture.
        """
        driven = ~self._robot.gains.passive
        if not self._torque or not driven.any():
            return 0.0
        gravity = self._clearance.plant.CalcGravityGeneralizedForces(self._clearance.context)
        torques = self._robot.axis_map.efforts(gravity)
        return float(np.max(np.abs(torques[driven]) / self._robot.model.efforts[driven]))

    def _clear_postures(self) -> Iterator[list[Vector]]:
        """Yield lists of postures without faults, in each list the farthest from a singularity first.

        The lists contain, in this order: home, home with overlaps reduced, postures in which
        one, two or three axes differ from the latter, and random postures. Postures near a
        singularity are left out, so that a list may be empty.
        """
        # The bound is relative to the robot itself: the dexterity of an arm depends on its proportions.
        random_dexterities = [self._dexterity(posture) for posture in self._random_postures]
        # One in five random postures exceeds the quantile 0.8.
        least = _DEXTERITY * float(np.quantile(random_dexterities, 0.8))
        groups = [[self._home], [self._reduced_home]]
        groups += [self._changed_postures(count) for count in (1, 2, 3)]
        groups.append(list(self._random_postures))
        for postures in groups:
            dexterities = [self._dexterity(posture) for posture in postures]
            # Sort by dexterity; the index makes the order unique for equal dexterities.
            ranking = sorted(zip(dexterities, range(len(postures)), strict=True), reverse=True)
            dexterous = [postures[index] for dexterity, index in ranking if dexterity >= least]
            yield [posture for posture in dexterous if not any(self._faults(posture))]

    def _changed_postures(self, count: int) -> list[Vector]:
        """Draw postures (n,) within the limits, no two equal, that differ from one posture in ``count`` axes.

        That posture is the home posture with its overlaps reduced. Followers move with their leaders. A robot with
        fewer axes is moved in all of them.
        """
        postures = {}  # by their bytes, so that no posture is kept twice
        for _ in range(_TRIED):
            posture = self._reduced_home.copy()
            for axis in self._random.choice(self._axes, min(count, len(self._axes)), replace=False):
                # The steps by which an axis may be moved, in m or rad.
                steps = SLIDES if self._robot.model.prismatic[axis] else np.deg2rad(TURNS)
                posture[axis] += self._random.choice(steps)
            posture = self._robot.model.with_followers(posture)
            if self._is_within_limits(posture):
                postures[posture.tobytes()] = posture
        return list(postures.values())

    def _is_within_limits(self, posture: Vector) -> bool:
        """Whether a posture (n,) [rad or m] is within the limits of all axes."""
        lower, upper = self._robot.model.axis_limits
        return bool(((posture >= lower) & (posture <= upper)).all())

    def _dexterity(self, posture: Vector) -> float:
        """Compute how far a posture is from a singularity.

        This is the least singular value of the Jacobian of the body at the end of the longest chain of axes. Its
        translations are divided by the largest of them, so that the value has no unit. The robot is set to the posture
        for this. If the chain has too few axes to be judged, the value is 1, and the robot stays as it is.
        """
        body, axes = self._longest_chain
        if len(axes) < _CHAIN:
            return 1.0
        self._clearance.place_robots({self._robot.name: posture})
        plant = self._clearance.plant
        world = plant.world_frame()
        # Rows: three of the angular velocity, then three of the velocity of the body's origin.
        jacobian = plant.CalcJacobianSpatialVelocity(
            self._clearance.context,
            JacobianWrtVariable.kV,
            body.body_frame(),
            np.zeros(3),
            world,
            world,
        )
        columns = self._robot.axis_map.velocities(jacobian)[:, axes]
        reach = float(np.abs(columns[3:]).max())
        columns[3:] /= max(reach, _ROUNDING)
        # The matrix has the shape (6, axes), and so min(6, axes) singular values. They fall: the last one is the least.
        singular_values = np.linalg.svd(columns, compute_uv=False)
        return float(singular_values[min(6, len(axes)) - 1])

    def _target(self, posture: Vector) -> Vector | None:
        """Find the end of a first move without faults from a posture (n,), shape (n,) [rad or m].

        All axes but fingers move to the side on which their limit is farther away; followers move with their leaders.
        If this move has faults, or takes a follower beyond a limit, each axis in turn moves to a side on which the move
        has no faults, or stays. Returns None if all axes stay then, or if the move of all these axes has faults.
        """
        step = self._with_followers(posture, self._largest_step(posture))
        # Leaders stay within their limits by construction of the step, but followers may not.
        is_within_limits = not self._robot.model.followers or self._is_within_limits(posture + step)
        if is_within_limits and self._is_clear(posture, step, _PARTS):
            return posture + step
        # One axis with a fault spoils the motion of all. Axes are added one at a time, so that only this axis stays.
        step = self._combined_step(posture, step)
        # The combination was checked at few parts of the move: check it at all of them.
        if step.any() and self._is_clear(posture, step, _PARTS):
            return posture + step
        return None

    def _largest_step(self, posture: Vector) -> Vector:
        """Compute how far each axis may move from a posture (n,) in the first move, shape (n,) [rad or m].

        The sign is that of the side on which the axis' limit is farther away; if both limits are equally far, or if
        there are none, it is positive. Fingers do not move.
        """
        model = self._robot.model
        lower, upper = model.axis_limits
        to_upper = upper - posture
        to_lower = lower - posture  # negative
        to_limit = np.where(to_upper >= -to_lower, to_upper, to_lower)
        by_range = _RANGE_SHARE * np.abs(to_limit)
        # Infinite for an axis without a speed limit, so that the other bounds decide.
        by_speed = _SPEED_SHARE * model.speed_limits * self._duration
        by_size = model.bounds(_STEP_DEG, _STEP_METRES)
        largest = np.minimum(by_size, by_speed)
        largest[list(model.fingers)] = 0.0
        return np.asarray(np.sign(to_limit) * np.minimum(largest, by_range))

    def _combined_step(self, posture: Vector, step: Vector) -> Vector:
        """Combine the parts of a step that have no faults and end within the limits, axis by axis.

        To save time, few postures of each move are checked here.

        Args:
            posture: posture at the start of the move, shape (n,) [rad or m].
            step: largest step of each axis, shape (n,) [rad or m]. Each axis makes its step, the opposite, or none,
                but followers move with their leaders.

        Returns:
            the combined step, shape (n,) [rad or m]; zero for an axis that stays.
        """
        combined = np.zeros_like(step)
        for axis, name in enumerate(self._robot.axes):
            if name in self._robot.model.followers:
                continue
            for travel in (step[axis], -step[axis]):
                tried = combined.copy()
                tried[axis] = travel
                tried = self._with_followers(posture, tried)
                if self._is_within_limits(posture + tried) and self._is_clear(
                    posture, tried, _FEW_PARTS
                ):
                    combined = tried
                    break
        return combined

    def _with_followers(self, posture: Vector, step: Vector) -> Vector:
        """Add the steps of followers (coupled axes) to a step (n,) from a posture (n,) [rad or m]."""
        model = self._robot.model
        # Without followers, keep the step as it is: adding and subtracting would round it.
        return model.with_followers(posture + step) - posture if model.followers else step

    def _is_clear(
        self,
        posture: Vector,
        step: Vector,
        shares: Sequence[float] | Vector,
    ) -> bool:
        """Whether the move by a step (n,) from a posture (n,) [rad or m] has no fault at any of its shares, 0 to 1."""
        return not any(any(self._faults(posture + share * step)) for share in shares)

    def _remarks(self, posture: Vector, target: Vector) -> tuple[str, ...]:
        """Write sentences for the user: what was chosen, what was checked, and what is wrong.

        Args:
            posture: the first posture, shape (n,) [rad or m].
            target: the end of the first move, shape (n,) [rad or m].
        """
        remarks = list[str]()
        has_shapes = self._required_heights.size > 0
        if not has_shapes:
            remarks.append(
                message(
                    "stations.clearance_not_checked",
                    "Collisions were not checked, since the robot has no collision shapes.",
                )
            )
        if self.hangs:
            remarks.append(
                message(
                    "stations.held_over_floor",
                    "The root is held {height:.3g} m above the floor, since the robot reaches below its root.",
                    height=self.height,
                )
            )
        elif self.height > _ROUNDING:
            remarks.append(
                message(
                    "stations.raised_to_stand",
                    "The root is raised by {height:.3g} m, so that the robot stands on the floor.",
                    height=self.height,
                )
            )
        if not np.array_equal(posture, self._home):
            # The faults are those at the height that the search required last.
            faults = self._faults(self._home)
            why: list[str] = [
                text for text, fault in zip(_FAULTS_AT_HOME, faults, strict=True) if fault
            ]
            # A home without faults is passed over if it is near a singularity, or if no first move from it is clear.
            if not why:
                why.append(
                    message(
                        "stations.home_is_singular",
                        "near a singularity (for example outstretched), or without a clear first move",
                    )
                )
            reasons = join_texts(why)
            remarks.append(
                message(
                    "stations.not_at_home",
                    "Not in the home posture, in which the robot is {reasons}.",
                    reasons=reasons,
                )
            )
        return (*remarks, *self._remarks_on_move(posture, target))

    def _remarks_on_move(self, posture: Vector, target: Vector) -> list[str]:
        """Check the move from a posture (n,) to a target (n,) [rad or m] again, and write a sentence on the result.

        Returns:
            a list with one sentence: the faults of the move, or what was checked and found to be good. The list is
            empty if nothing was checked: the robot has no shapes, and no motor that must hold it.
        """
        faults = list[Faults]()
        loads = list[float]()
        # The whole move is measured again, as the remarks describe its worst posture, not its first one.
        for part in _PARTS:
            faults.append(self._faults(posture + part * (target - posture)))
            loads.append(self._load())  # of the posture that `_faults` has set
        worst = np.max(faults, axis=0)
        wrong = _faults_in_words(worst)
        if wrong:
            return [
                message(
                    "stations.no_clear_start",
                    "No start without faults was found. Faults of this one: {faults}.",
                    faults=join_texts(wrong),
                )
            ]
        good = list[str]()
        if self._required_heights.size:
            good.append(
                message("stations.is_clear", "no collision with the floor or between links")
            )
        passive = self._robot.gains.passive
        if self._torque and not passive.all():
            share = max(loads)
            good.append(
                message(
                    "stations.motors_hold_driven",
                    "the motors need at most {share:.0%} of their torque to hold the driven axes",
                    share=share,
                )
                if passive.any()
                else message(
                    "stations.motors_hold_it",
                    "the motors need at most {share:.0%} of their torque to hold the robot",
                    share=share,
                )
            )
        if not good:
            return []
        return [
            message(
                "stations.checked_in_postures",
                "Checked in {count} postures of the first move: {results}.",
                count=len(_PARTS),
                results=join_texts(good, message("stations.and_also", ", and ")),
            )
        ]
