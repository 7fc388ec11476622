"""The posture of a robot for a moment of its walk: the legs put the feet where they shall be."""

import math
from cmath import exp as turned_by
from collections.abc import Sequence
from operator import mul

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.walking.body import Body, Rows, StanceFeet, uphill
from simrob_drake.walking.parameters import Bearing
from simrob_drake.walking.stride import Stride


class Poser:
    """Finds postures by the robot's kinematics, each from the one that the body was in."""

    def __init__(self, body: Body, stance: StanceFeet, bearing: Bearing) -> None:
        """Prepare."""
        self.body, self._stance, self._bearing = body, stance, bearing

    def posture(self, stride: Stride, centre: Sequence[float], lift: float, rounds: int = 1) -> Vector:
        """Return the posture (n,) of a stride whose foot is ``lift`` high, from the one that the body took."""
        bearing, body, (step, swing, _, trunk, ground, learnt) = self._bearing, self.body, stride
        pitch = math.radians(bearing.pitch_deg) + trunk.pitch + learnt.counter.imag
        turn = turned(trunk.lean + learnt.counter.real, pitch, trunk.heading)
        x, y = (sum(map(mul, row, centre)) for row in turn[:2])
        x, y, z = trunk.com.real - x, trunk.com.imag - y, bearing.height + trunk.rise  # of the root
        roll, pitch = math.atan(ground.slope.imag), -math.atan(ground.slope.real)
        (here, there), yaw = step.sides, turned_by(1j * swing.yaw)
        stands, swings = self._stance.about[here], [swing.place + yaw * each for each in self._stance.about[there]]

        def poses(group: int, places: Sequence[complex], turn: Rows, height: float, tilt: complex) -> list[Rows]:
            up, (ahead, left, upward) = body.over + height, turn
            return [
                (
                    (*ahead, place.real - x),
                    (*left, place.imag - y),
                    (*upward, up + uphill(ground.slope, place) + uphill(tilt, about) - z),
                )
                for place, about in zip(places, self._stance.about[group], strict=True)
            ]

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
