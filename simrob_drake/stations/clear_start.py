"""How a robot that is held may begin and move at first: clear of floor and self, and so that its motors hold it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.tree import JacobianWrtVariable

from simrob_drake.frames import Vector
from simrob_drake.parts.site import StationRobot
from simrob_drake.stations.clearance import SLIDES, TURNS, Clearance, turned, untangled
from simrob_drake.stations.posed import posture_range

_STEP = 20.0, 0.05  # how far the first move goes: deg, and m of a prismatic axis
_ROOM = 0.4  # and at most this part of the way to the joint's limit
_SWIFT = 0.4  # and in its time with this part of the axis' largest speed: its peak is 1.9 times as fast
_LOAD = 0.9  # part of a motor's torque that holding may take
_OVER = 0.05  # how high links stay over the floor that can [m]
_HANGS = 0.25  # part of its reach by which a robot that hangs reaches below its foot
_ABOVE = 0.1  # and how high it is held then
_RANDOM = 40  # postures of chance, which tell what the robot can reach
_CHAIN = 5  # axes one behind the other: from as many on a singular posture is no good start
_DEXTERITY = 0.25  # part of what a good posture of chance has
_TRIED, _MOVED = 150, 8  # postures that change as many axes; and of how many of them the motion is looked at
_EASED = 8  # axes that are turned where all that fails
_PARTS = np.linspace(0.0, 1.0, 6)
_ROUNDING = 1e-3  # m
_FAULTS = {  # how a comment tells them of home, and with their figures
    "in the floor, or near it": "m below the height that it should keep over the floor",
    "in itself": "m in itself",
    "too heavy for its motors": "of its motors' torque short",
}


@dataclass(frozen=True)
class Start:
    """How a robot begins."""

    posture: Vector  # of its axes, shape (n,) [rad or m]
    target: Vector  # where its first move leads, shape (n,)
    height: float  # of its root over the floor [m]
    remarks: tuple[str, ...]  # what was looked at, and what is wrong, in words, a line each


class ClearStart:
    """The search for a start, drawn with one seed.

    It begins at home and goes on to postures that change one axis, two, three; of those with as few changes as possible
    it takes the one that is farthest from a singularity.

    Attributes:
        height: of the root over the floor [m]: it stands on what does not move, or hangs over the floor.
        hangs: whether the robot reaches so far below its root that it does.
    """

    def __init__(self, clearance: Clearance, robot: StationRobot, duration: float, *, torque: bool) -> None:
        """Prepare the search.

        Args:
            clearance: the station, with the root of the robot at the origin.
            robot: the robot.
            duration: duration of the robot's first move [s].
            torque: whether the motors must be able to hold the posture against gravity.
        """
        self._clearance, self._robot, self._duration, self._torque = clearance, robot, duration, torque
        self._random, self._home, self._near = np.random.default_rng(0), robot.model.home, robot.model.home
        self._chain = max(clearance.chains(robot), key=lambda chain: len(chain[1]))
        # Indices of the axes that the search moves. Fingers stay open, and the positions of
        # followers (coupled axes) result from those of their leaders.
        is_follower = [name in robot.model.followers for name in robot.axes]
        self._axes = [
            axis for axis in range(len(robot.axes)) if axis not in robot.model.fingers and not is_follower[axis]
        ]
        self._postures = self._random.uniform(*posture_range(robot), (_RANDOM, len(robot.axes)))
        self._postures[:, [*robot.model.fingers]] = self._home[[*robot.model.fingers]]
        self._postures = robot.model.with_followers(self._postures)
        bodies = [clearance.plant.GetBodyByName(name, robot.instance) for name in clearance.lowest(robot)]
        moves = np.array([not clearance.plant.IsAnchored(body) for body in bodies], dtype=bool)

        # Heights (postures, bodies) [m] above the floor of the root, the home posture first.
        # They show how far the robot reaches, and whether it stands or hangs.
        heights = np.array([self._heights(posture) for posture in [self._home, *self._postures]])
        foot = float(heights[0][~moves].min(initial=0.0))
        reach = float(np.ptp(heights)) if heights.size else 0.0
        highest = heights.max(axis=0)
        self.hangs = bool(heights[0].min(initial=0.0) < foot - _HANGS * reach)
        if self.hangs:
            self.height = _ABOVE * reach - float(heights.min())
        else:
            self.height = -float(highest.min(initial=min(foot, 0.0)))
        self._highest = np.where(moves, highest + self.height, -np.inf)
        self._keep_over(_OVER)

    def find(self) -> Start:
        """Return the best start that was found: with links well over the floor, or else just over it."""
        for over in (_OVER, 0.0):
            self._keep_over(over)
            for postures in self._candidates():
                for posture in postures[:_MOVED]:
                    target = self._target(posture)
                    if target is not None:
                        return Start(posture, target, self.height, self._remarks(posture, target))
        least = self._eased(min([self._home, self._near, *self._postures], key=self._fault))
        target = None if any(self._faults(least)) else self._target(least)
        target = least if target is None else target
        return Start(least, target, self.height, self._remarks(least, target))

    def _eased(self, posture: Vector) -> Vector:
        """Reduce the faults of a posture (n,) in steps; each step moves the axis that reduces the faults most."""
        for _ in range(_EASED):
            changed = turned(self._robot, posture, self._axes)
            near = [posture, *map(self._robot.model.with_followers, changed)]
            best = min(near, key=self._fault)
            if best is posture:
                break
            posture = best
        return posture

    def _fault(self, posture: Vector) -> float:
        return sum(self._faults(posture))

    def _keep_over(self, height: float) -> None:
        """Have all that moves stay at a height over the floor [m], as far as it can."""
        self._least = np.minimum(height, self._highest) - _ROUNDING

    def _heights(self, posture: Vector) -> Vector:
        """Return how high the bodies with shapes are over the root's own floor [m]."""
        self._clearance.place_robots({self._robot.name: posture})
        return np.array(list(self._clearance.lowest(self._robot).values()))

    def _faults(self, posture: Vector) -> tuple[float, float, float]:
        """Take a posture; return how far it is in floor and itself [m], and what its motors lack, by their torque."""
        low = float((self._least - self.height - self._heights(posture)).max(initial=0.0))
        own = [overlap.depth for overlap in self._clearance.overlaps() if overlap.robot == self._robot.name]
        return low, max(own, default=0.0), max(self._load() - _LOAD, 0.0)

    def _load(self) -> float:
        """Return the largest part of its torque that a motor needs to hold the present posture."""
        if not self._torque:
            return 0.0
        gravity = self._clearance.plant.CalcGravityGeneralizedForces(self._clearance.context)
        return float(np.max(np.abs(self._robot.axis_map.efforts(gravity)) / self._robot.model.efforts))

    def _candidates(self) -> Iterator[list[Vector]]:
        """Yield lists of postures without faults, in each list the farthest from a singularity first.

        The lists contain, in this order: home, home with overlaps removed, postures in which
        one, two or three axes differ from the latter, and random postures. Postures near a
        singularity are left out.
        """
        good = _DEXTERITY * float(np.quantile([self._dexterity(posture) for posture in self._postures], 0.8))
        first = untangled(self._clearance, self._robot, self._home, self._axes)
        first = self._robot.model.with_followers(first)
        self._near = first
        for postures in ([self._home], [first], *map(self._changed, (1, 2, 3)), list(self._postures)):
            # The index makes the order unique for equal dexterities, and arrays cannot be compared.
            rated = [(self._dexterity(posture), index) for index, posture in enumerate(postures)]
            ordered = [postures[index] for dexterity, index in sorted(rated, reverse=True) if dexterity >= good]
            yield [posture for posture in ordered if not any(self._faults(posture))]

    def _changed(self, count: int) -> list[Vector]:
        """Postures (n,) in which ``count`` random axes are moved away from home, within the limits.

        The starting point is the home posture after its overlaps were reduced. Followers move
        with their leaders.
        """
        found = {}
        for _ in range(_TRIED):
            posture = self._near.copy()
            for axis in self._random.choice(self._axes, min(count, len(self._axes)), replace=False):
                slides = self._robot.model.prismatic[axis]
                posture[axis] += self._random.choice(SLIDES if slides else np.deg2rad(TURNS))
            posture = self._robot.model.with_followers(posture)
            if self._within(posture):
                found[posture.tobytes()] = posture
        return list(found.values())

    def _within(self, posture: Vector) -> bool:
        lower, upper = self._robot.model.axis_limits
        return bool(((posture >= lower) & (posture <= upper)).all())

    def _dexterity(self, posture: Vector) -> float:
        """Return the least singular value of the Jacobian of the longest chain, its lengths by its reach; else 1."""
        body, axes = self._chain  # that at the end of the most axes one behind the other, and these
        if len(axes) < _CHAIN:
            return 1.0
        self._clearance.place_robots({self._robot.name: posture})
        plant, world = self._clearance.plant, self._clearance.plant.world_frame()
        jacobian = plant.CalcJacobianSpatialVelocity(
            self._clearance.context, JacobianWrtVariable.kV, body.body_frame(), np.zeros(3), world, world
        )
        columns = self._robot.axis_map.velocities(jacobian)[:, axes]
        columns[3:] /= max(float(np.abs(columns[3:]).max()), _ROUNDING)
        return float(np.linalg.svd(columns, compute_uv=False)[min(6, len(axes)) - 1])

    def _target(self, posture: Vector) -> Vector | None:
        """Find the end of a first move without faults from a posture (n,), shape (n,) [rad or m].

        All axes move to the side on which their limit is farther away. If this move has
        faults, each axis in turn moves to a side on which the move has no faults, or stays.
        Returns None if no axis can move, or if the move of all these axes has faults.
        """
        model = self._robot.model
        lower, upper = model.axis_limits
        room = np.where(upper - posture >= posture - lower, upper - posture, lower - posture)
        most = np.minimum(model.bounds(*_STEP), _SWIFT * model.speed_limits * self._duration)
        most[[*model.fingers]] = 0.0
        step: Vector = np.sign(room) * np.minimum(most, _ROOM * np.abs(room))
        step = self._with_followers(posture, step)
        # Leaders stay within their limits by construction of the step, but followers may not.
        is_within_limits = not model.followers or self._within(posture + step)
        if is_within_limits and self._is_clear(posture, step):
            return posture + step
        moved = np.zeros_like(step)
        independent_axes = [axis for axis, name in enumerate(self._robot.axes) if name not in model.followers]
        for axis in independent_axes:
            for way in (step[axis], -step[axis]):
                tried = moved.copy()
                tried[axis] = way
                tried = self._with_followers(posture, tried)
                if self._within(posture + tried) and self._is_clear(posture, tried, _PARTS[1::2]):
                    moved = tried
                    break
        return posture + moved if moved.any() and self._is_clear(posture, moved) else None

    def _with_followers(self, posture: Vector, step: Vector) -> Vector:
        """Add the steps of followers (coupled axes) to a step (n,) from a posture (n,) [rad or m]."""
        model = self._robot.model
        # Without followers, keep the step as it is: adding and subtracting would round it.
        return model.with_followers(posture + step) - posture if model.followers else step

    def _is_clear(self, posture: Vector, step: Vector, parts: Vector = _PARTS) -> bool:
        return not any(any(self._faults(posture + part * step)) for part in parts)

    def _remarks(self, posture: Vector, target: Vector) -> tuple[str, ...]:
        """Say what was chosen, looked at and found."""
        remarks = [] if self._least.size else ["Not looked at whether it is clear: it has no shapes that collide."]
        if self.hangs:
            remarks.append(f"Held {self.height:.3g} m over the floor, for it reaches below its root.")
        elif self.height > _ROUNDING:
            remarks.append(f"Raised by {self.height:.3g} m, so that it stands on the floor.")
        if not np.array_equal(posture, self._home):
            why = [text for text, fault in zip(_FAULTS, self._faults(self._home), strict=True) if fault]
            remarks.append(f"Not at home, where it is {', '.join(why) or 'outstretched, or its move is not clear'}.")
        return *remarks, *self._looked_at(posture, target)

    def _looked_at(self, posture: Vector, target: Vector) -> list[str]:
        """Say what was looked at of a move, and what is wrong with it."""
        postures = [posture + part * (target - posture) for part in _PARTS]
        faults, loads = zip(*((self._faults(each), self._load()) for each in postures), strict=True)
        if any(worst := np.max(faults, axis=0)):
            faults_text = ", ".join(
                f"{fault:.2g} {text}" for text, fault in zip(_FAULTS.values(), worst, strict=True) if fault
            )
            return [f"No start was found that is clear: this one is {faults_text}."]
        good = ["clear of the floor and of itself"] if self._least.size else []
        good += [f"its motors hold it with {max(loads):.0%} of their torque at most"] if self._torque else []
        return [f"Looked at in {len(postures)} postures of its move: {', and '.join(good)}."] if good else []
