r"""A ball that bounces, by the law of Drake's point contact, integrated for itself.

With the height h of the lowest point,

.. math:: m\,\ddot h = -m g + \max\bigl(0,\; k x (1 + d\,\dot x)\bigr), \qquad x = \max(0, -h).

Flights are parabolas in closed form; contacts are integrated (Hunt and Crossley's law has no simple solution).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.frames import Vector

_TOLERANCE = 1e-9
_LONGEST = 50.0  # half periods of the spring that a contact may last


@dataclass(frozen=True)
class BounceLaw:
    """The figures of a ball on a floor."""

    mass: float  # kg
    stiffness: float  # k [N/m]
    dissipation: float  # d [s/m]
    gravity: float = STANDARD_GRAVITY  # m/s²

    def acceleration(self, height: float, speed: float) -> float:
        """Return the acceleration [m/s²] at a height [m] and a speed [m/s], upwards."""
        pressed = max(-height, 0.0)
        force = max(self.stiffness * pressed * (1 - self.dissipation * speed), 0.0)
        return force / self.mass - self.gravity

    def heights(self, times: Vector, height: float, speed: float) -> Vector:
        """Return the heights (m,) [m] at ``times`` (m,) [s], rising, from a height and a speed at the first of them."""
        found = np.empty(len(times))
        now, end, row = float(times[0]), float(times[-1]), 0
        while row < len(times):
            if height > 0 or (height == 0 and speed > 0):
                landing = now + (speed + np.sqrt(speed**2 + 2 * self.gravity * height)) / self.gravity
                last = int(np.searchsorted(times, landing, side="left"))
                flight = times[row:last] - now
                found[row:last] = height + speed * flight - self.gravity * flight**2 / 2
                height, speed = 0.0, speed - self.gravity * (landing - now)
                now, row = landing, last
            else:
                now, height, speed, row = self._contact(times, found, now, height, speed, row)
            if now >= end:
                break
        return found

    def _contact(
        self, times: Vector, found: Vector, now: float, height: float, speed: float, row: int
    ) -> tuple[float, float, float, int]:
        """Integrate a contact up to its end, or to that of ``times``; return time, height, speed and next row."""

        def leaves(_: float, state: Vector) -> float:
            return float(state[0])

        leaves.terminal, leaves.direction = True, 1.0  # type: ignore[attr-defined]
        longest = now + _LONGEST * np.pi * np.sqrt(self.mass / self.stiffness)
        end = min(longest, float(times[-1]))
        solution = solve_ivp(
            lambda _, state: (state[1], self.acceleration(state[0], state[1])),
            (now, max(end, now + 1e-12)),
            (min(height, -1e-15), speed),
            method="DOP853",
            rtol=_TOLERANCE,
            atol=_TOLERANCE * 1e-3,
            events=leaves,
            dense_output=True,
        )
        assert solution.sol is not None  # both were asked for
        assert solution.t_events is not None
        now = float(solution.t[-1])
        last = int(np.searchsorted(times, now, side="right"))
        if last > row:
            found[row:last] = solution.sol(times[row:last])[0]
        left = len(solution.t_events[0]) > 0
        return now, 0.0 if left else float(solution.y[0, -1]), float(solution.y[1, -1]), last
