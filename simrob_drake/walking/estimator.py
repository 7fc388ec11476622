"""What a walking robot does, from what is measured of it: the planner's feedback."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from simrob_drake.walking.body import Body, Seen, StanceFeet, sloped, uphill
from simrob_drake.walking.parameters import Feedback
from simrob_drake.walking.stride import Ground, Step, Stride

_LINES = 8  # that tell of a slope before the first step, each by what those before it left
_TOUCHES = 0.001  # over the lowest foot [m]


class Estimate(NamedTuple):
    """What a robot does, seen from the foot that stands.

    Attributes:
        com, xi: centre of mass and divergent component [m].
        lean, pitch: of the trunk, to the right and ahead [rad].
        heading: where the trunk looks in the world [rad].
        slope: of the soles that stand, ahead and to the left [1].
        touches: whether the swinging foot touches, or both feet of a pair.
        down: which feet of a pair that swings feel the ground.
        hangs: which of those that stand do not.
        origin: where the foot that stands is in the world [m].
        turn: from ahead of that foot to the world's x, a complex number of length one.
    """

    com: complex
    xi: complex
    lean: float
    pitch: float
    heading: float
    slope: complex
    touches: bool
    down: tuple[bool, ...] = ()
    hangs: tuple[bool, ...] = ()
    origin: complex = 0j
    turn: complex = 1 + 0j

    def in_world(self, place: complex) -> complex:
        """Return where a place is in the world [m]."""
        return self.origin + place * self.turn.conjugate()


class Estimator:
    """Sees what a robot does from the foot that stands; it remembers nothing but what a :class:`Stride` tells."""

    def __init__(self, body: Body, stance: StanceFeet, feedback: Feedback | None) -> None:
        """Prepare."""
        self._body, self._stance, self._feedback = body, stance, feedback

    def estimate(self, stride: Stride, seen: Seen, forces: Sequence[float] | None = None) -> Estimate:
        """Return what the robot does, from the foot that stands; ``forces`` on its feet, if they are known [N]."""
        here, there = (self._stance.groups[place] for place in stride.step.sides)
        places = [seen.feet[foot] for foot in here]
        points = [complex(x[3], y[3]) for x, y, _ in places]
        origin = sum(points) / len(points)
        if len(places) > 1:  # balls roll and turn with their legs; the line between them does not
            about = zip(points, self._stance.about[int(stride.step.standing)], strict=True)
            ahead = sum((point - origin) * place.conjugate() for point, place in about)
        else:
            ahead = sum(complex(x[0], y[0]) for x, y, _ in places)
        turn = ahead.conjugate() / abs(ahead)
        (x, y, z), (vx, vy, _) = seen.com, seen.speed
        com, speed = turn * (complex(x, y) - origin), turn * complex(vx, vy) / self._stance.rolls
        omega = self._stance.omega(max(z - min(seen.lowest), 0.05))
        forward, sideways, up = seen.trunk
        heading = math.atan2(sideways[0], forward[0])
        slope = self._sloping(stride, places, turn)
        feedback = self._feedback
        if forces is not None and feedback is not None and feedback.touch_force is not None:
            down = tuple(forces[foot] > feedback.touch_force for foot in there)
            hangs = tuple(forces[foot] < feedback.touch_force for foot in here)
            touches = all(down)
        else:
            down = hangs = ()
            lowest = seen.lowest
            stands = sum(lowest[foot] for foot in here) / len(here)
            swung = (complex(seen.feet[foot][0][3], seen.feet[foot][1][3]) - origin for foot in there)
            over = (
                lowest[foot] - uphill(stride.ground.slope, turn * at) for foot, at in zip(there, swung, strict=True)
            )
            touches = min(over) < stands + _TOUCHES
        return Estimate(com, com + speed / omega, up[1], -up[0], heading, slope, touches, down, hangs, origin, turn)

    def _sloping(self, stride: Stride, places: Sequence[Sequence[Sequence[float]]], turn: complex) -> complex:
        """Return the slope under feet that stand: that of their soles; where they are balls, along their line alone."""
        if not self._body.over:
            tilted = sum(complex(x[2], y[2]) for x, y, _ in places)
            return -turn * tilted / max(sum(z[2] for _, _, z in places), 0.5)
        standing, known = int(stride.step.standing), stride.ground.slope + stride.ground.tilt
        feet = zip(self._stance.about[standing], places, strict=True)
        return known + sloped(self._stance.planes[standing], [z[3] - uphill(known, at) for at, (_, _, z) in feet])

    def slope(self, seen: Seen) -> complex:
        """Return the slope under all feet of a robot that stands, each group telling of it in turn."""
        slope = 0j
        for line in range(_LINES):
            slope = self.estimate(Stride(Step(float(line % 2)), ground=Ground(slope=slope)), seen).slope
        return slope

    def felt(self, stride: Stride) -> Sequence[int]:
        """Return the feet whose forces count: those that may touch, and those that stand while late ones are sought."""
        feedback, (here, there) = self._feedback, stride.step.sides
        if feedback is None:
            return ()
        down = self._stance.groups[there] if stride.swing.share > feedback.early_touchdown else ()
        return (*down, *(self._stance.groups[here] if feedback.late_touchdown else ()))
