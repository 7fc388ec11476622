"""The walking engine: from a command, and what the robot does, to a posture at each sample; in three parts."""

import math
from cmath import exp as turned_by
from collections.abc import Sequence
from operator import mul

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.walking.body import Body, Rows, StanceFeet, uphill
from simrob_drake.walking.estimator import Estimate, Estimator
from simrob_drake.walking.height_map import HeightMap
from simrob_drake.walking.parameters import WalkingParameters
from simrob_drake.walking.planner import WalkPlanner
from simrob_drake.walking.steps import Command, Landing
from simrob_drake.walking.stride import Ground, Step, Stride, Swing, Trunk

_FIRST_ROUNDS, _SETTLINGS = 10, 12  # of Newton's method, from a posture that may be far away; of the centre of mass


class WalkingEngine:
    """Makes a walk, sample by sample; it remembers nothing but what a :class:`Stride` and a posture tell.

    Attributes:
        body: the robot's kinematics.
        estimator: what the robot does.
        planner: where steps land, and when.
        max_speed: that the legs can follow.
    """

    def __init__(
        self,
        body: Body,
        parameters: WalkingParameters,
        groups: Sequence[Sequence[int]],
        period: float,
        height_map: HeightMap | None = None,
    ) -> None:
        """Prepare.

        Args:
            body: the robot's kinematics.
            parameters: of its walk.
            groups: the feet that stand and swing together, the right ones first.
            period: between samples [s].
            height_map: of the ground; None: nothing is known of that but what is felt.
        """
        self.body, self.max_speed = body, parameters.max_speed
        self.stance = StanceFeet.of(body, parameters, groups)
        self.estimator = Estimator(body, self.stance, parameters.feedback)
        self.planner = WalkPlanner(parameters, self.stance, period, height_map)
        self._bearing = parameters.bearing

    def standing(self, posture: Vector, slope: complex = 0j) -> tuple[Stride, Vector]:
        """Return a stride in which both feet stand side by side, and its posture (n,), found from one that is alike."""
        steps = self.planner.steps
        foot = steps.apart[0]
        middle = steps.middle(1, foot)
        trunk, landing = Trunk(com=middle, zmp=middle), Landing(0.0, foot)
        stride = Stride(Step(zmp_from=middle), Swing(foot), landing, trunk, Ground(slope=slope))
        for _ in range(_SETTLINGS):
            self.body.take(posture)
            posture = self._posture(stride, self.body.centre(), 0.0, _FIRST_ROUNDS)
        return stride, posture

    def sample(
        self, stride: Stride, posture: Vector, command: Command, estimate: Estimate | None
    ) -> tuple[Stride, Vector]:
        """Return where a walk is a sample later, and its posture (n,); without feedback if there is no estimate."""
        self.body.take(posture)
        centre = self.body.centre()
        omega = self.stance.omega(self._bearing.height + centre[2])
        now, lift, later = self.planner.sample(stride, command, estimate, omega)
        return later, self._posture(now, centre, lift)

    def _posture(self, stride: Stride, centre: Sequence[float], lift: float, rounds: int = 1) -> Vector:
        """Return the posture (n,) of a stride whose foot is ``lift`` high, from the one that the body took.

        The legs put the feet where they shall be.
        """
        bearing, body, (step, swing, _, trunk, ground, learnt) = self._bearing, self.body, stride
        pitch = math.radians(bearing.pitch_deg) + trunk.pitch + learnt.counter.imag
        turn = turned(trunk.lean + learnt.counter.real, pitch, trunk.heading)
        x, y = (sum(map(mul, row, centre)) for row in turn[:2])
        root = trunk.com.real - x, trunk.com.imag - y, bearing.height + trunk.rise
        roll, pitch = math.atan(ground.slope.imag), -math.atan(ground.slope.real)
        (here, there), yaw = step.sides, turned_by(1j * swing.yaw)
        stands, swings = self.stance.about[here], [swing.place + yaw * each for each in self.stance.about[there]]

        def poses(group: int, places: Sequence[complex], turn: Rows, up: float, tilt: complex) -> list[Rows]:
            about = zip(places, self.stance.about[group], strict=True)
            up += body.over
            points = [(at.real, at.imag, up + uphill(ground.slope, at) + uphill(tilt, own)) for at, own in about]
            return [[(*row, to - of) for row, to, of in zip(turn, at, root, strict=True)] for at in points]

        flat = turned(roll, pitch, 0.0)
        swung = (np.array(flat) @ turned(0.0, 0.0, swing.yaw)).tolist() if swing.yaw else flat
        standing = poses(here, stands, flat, 0.0, ground.tilt)
        swinging = poses(there, swings, swung, ground.height + lift, ground.foot_tilt)
        feet = np.array([*standing, *swinging] if here == 0 else [*swinging, *standing])
        return body.reached(turn, feet, rounds)


def turned(roll: float, pitch: float, yaw: float) -> Rows:
    """Return the matrix of a turn about x, then about the fixed y, then about the fixed z [rad], in plain numbers."""
    a, b, c, d, e, f = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    return (
        (e * c, e * d * b - f * a, e * d * a + f * b),
        (f * c, f * d * b + e * a, f * d * a - e * b),
        (-d, c * b, c * a),
    )
