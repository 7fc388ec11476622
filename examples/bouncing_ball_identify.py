r"""Find stiffness and dissipation of a floor from a measured bounce: ``python bouncing_ball_identify.py [TRACE.csv]``.

The file has the columns ``time`` [s] and ``height`` [m] of the ball's lowest point. Without one, a run of the station
with 1 mm of noise on it stands for a measurement. The law is that of Drake's point contact: with the height h of the
ball's lowest point,

.. math:: m\,\ddot h = -m g + \max\bigl(0,\; k x (1 + d\,\dot x)\bigr), \qquad x = \max(0, -h).

Flights are parabolas in closed form; contacts are integrated (Hunt and Crossley's law has no simple solution).
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.stats import t as student

from simrob_drake import load_station, simulate
from simrob_drake.base.arguments import as_path
from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import InvalidConfig, InvalidParameter
from simrob_drake.base.files import read_columns
from simrob_drake.base.frames import Vector
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure

BALL = 0.9048  # kg
NOISE = 1e-3  # m
COLUMNS = ("time", "height")
_LONGEST_GAP = 5.0  # times the usual interval
_FEWEST_SAMPLES = 20
_FEWEST_BOUNCES = 2
_TOLERANCE = 1e-9
_LONGEST = 50.0  # half periods of the spring that a contact may last
_CONFIDENCE = 0.95
_ROUND_ABOUT = (
    0.4,
    0.7,
    1.0,
    1.4,
    2.5,
)  # parts of the first guess of k that are tried: the error has many valleys
_STEPS = np.array([1e-4, 1e-4, 1e-5, 1e-5])  # parts of the unknowns, for the Jacobian
_RAISED = 1.0  # m and m/s that are added to height and speed: a part of an unknown that is zero would be no step
_FEW = 200  # samples that tell good starts from bad ones


@dataclass(frozen=True)
class BounceTrace:
    """Heights of a ball that bounces.

    Attributes:
        times: shape (m,) [s], rising.
        heights: of the ball's lowest point over the floor, shape (m,) [m]; negative while it is pressed in.
    """

    times: Vector
    heights: Vector

    def __repr__(self) -> str:
        """Say in one line how much of it there is."""
        return f"<BounceTrace of {len(self.times)} samples in {np.ptp(self.times):.3g} s, {self.bounces} bounces>"

    @property
    def bounces(self) -> int:
        """How often the ball came back up: falls to the floor with a rise behind them."""
        high = (self.heights.max() - min(self.heights.min(), 0.0)) / 10
        low_points, falling = 0, False
        for height in self.heights:
            if height > high:
                low_points, falling = low_points + falling, False
            elif height < high / 2:
                falling = True
        return low_points


def read_bounces(file: Path | str) -> BounceTrace:
    """Read a CSV file with the columns ``time`` [s] and ``height`` [m] of the ball's lowest point over the floor.

    Raises:
        InvalidConfig: a file without these columns, with something that is no number, with gaps, with times that do
            not rise, or with too few bounces to learn from.
        InvalidParameter: no path.
    """
    file = as_path(file, "file")
    values, lines = read_columns(file, COLUMNS)
    times, heights = values.T
    if len(times) < _FEWEST_SAMPLES:
        raise InvalidConfig(
            file, "", f"has {len(times)} samples; it takes at least {_FEWEST_SAMPLES}"
        )
    intervals = np.diff(times)
    if (intervals <= 0).any():
        row = int(np.flatnonzero(intervals <= 0)[0])
        problem = f"times must rise, but {times[row + 1]:g} s follows {times[row]:g} s"
        raise InvalidConfig(file, f"line {lines[row + 1]}", problem)
    usual = float(np.median(intervals))
    if intervals.max() > _LONGEST_GAP * usual:
        row = int(np.argmax(intervals))
        problem = f"a gap of {intervals[row]:.3g} s from {times[row]:.4g} s on, where {usual:.3g} s is usual"
        raise InvalidConfig(
            file, f"line {lines[row + 1]}", f"{problem}; cut the trace there or measure again"
        )
    trace = BounceTrace(times, heights)
    if trace.bounces < _FEWEST_BOUNCES:
        problem = f"holds {trace.bounces} bounces; it takes at least {_FEWEST_BOUNCES}, each with the rise behind it"
        raise InvalidConfig(file, "", problem)
    return trace


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
                landing = (
                    now + (speed + np.sqrt(speed**2 + 2 * self.gravity * height)) / self.gravity
                )
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


@dataclass(frozen=True)
class Identified:
    """What was found.

    Attributes:
        stiffness, dissipation: k [N/m] and d [s/m].
        stiffness_interval, dissipation_interval: 95 % confidence intervals.
        residual: root mean square of the difference between measured and computed height [m].
        heights: computed, at the times of the trace, shape (m,) [m].
    """

    stiffness: float
    dissipation: float
    stiffness_interval: tuple[float, float]
    dissipation_interval: tuple[float, float]
    residual: float
    heights: Vector = field(repr=False)


def identify_bounces(
    trace: BounceTrace, *, mass: float, gravity: float = STANDARD_GRAVITY
) -> Identified:
    """Find stiffness and dissipation that explain measured bounces best, in the least-squares sense.

    The height and speed at the start are found along with them. Intervals come from the Jacobian at the solution, with
    the noise that the residuals show, in the logarithms of the two figures.

    Args:
        trace: of the ball's lowest point, at least two bounces.
        mass: of the ball [kg].
        gravity: [m/s²].

    Raises:
        InvalidParameter: a mass that is not positive.
    """
    if not (np.isfinite(mass) and mass > 0):
        raise InvalidParameter("mass", mass, "positive [kg]")
    stiffness, dissipation, height, speed = _first_guess(trace, mass, gravity)

    def residuals(unknowns: Vector, times: Vector, heights: Vector) -> Vector:
        log_stiffness, log_dissipation, height, speed = unknowns
        law = BounceLaw(mass, float(np.exp(log_stiffness)), float(np.exp(log_dissipation)), gravity)
        return law.heights(times, height - _RAISED, speed - _RAISED) - heights

    thinned = slice(None, None, max(len(trace.times) // _FEW, 1))
    few = trace.times[thinned], trace.heights[thinned]
    rest = np.log(dissipation), height + _RAISED, speed + _RAISED
    starts = [np.array([np.log(part * stiffness), *rest]) for part in _ROUND_ABOUT]
    scale = np.array([0.1, 0.1, 1e-3, 1e-2])
    rough = min(starts, key=lambda start: float(np.sum(residuals(start, *few) ** 2)))
    near = least_squares(residuals, rough, x_scale=scale, args=few, diff_step=_STEPS)
    every = trace.times, trace.heights
    solution = least_squares(residuals, near.x, x_scale=scale, args=every, diff_step=_STEPS)

    free = len(trace.times) - len(solution.x)
    variance = 2 * float(solution.cost) / free
    jacobian = np.asarray(solution.jac)
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    reach = float(student.ppf((1 + _CONFIDENCE) / 2, free)) * np.sqrt(np.diag(covariance)[:2])
    low, high = np.exp(solution.x[:2] - reach), np.exp(solution.x[:2] + reach)
    stiffness, dissipation = np.exp(solution.x[:2])
    return Identified(
        stiffness=float(stiffness),
        dissipation=float(dissipation),
        stiffness_interval=(float(low[0]), float(high[0])),
        dissipation_interval=(float(low[1]), float(high[1])),
        residual=float(np.sqrt(np.mean(solution.fun**2))),
        heights=trace.heights + solution.fun,
    )


def _first_guess(
    trace: BounceTrace, mass: float, gravity: float
) -> tuple[float, float, float, float]:
    """Return k, d, and height and speed at the start, from the fall, the first flight, and the contact between them.

    A contact lasts about half a period of the spring, and throws back the part 1 - 2/3 d v of the speed v.
    """
    times, heights = trace.times, trace.heights
    high = heights > heights[heights > 0].max() / 4
    lands = int(np.argmax(~high & (times > times[np.argmax(high)])))
    leaves = lands + int(np.argmax(high[lands:]))
    down = leaves + int(np.argmax(~high[leaves:])) if not high[leaves:].all() else len(times)
    fall, flight = (
        _parabola(times[part], heights[part], gravity)
        for part in (slice(0, lands), slice(leaves, down))
    )
    speeds = [float(np.sqrt(2 * gravity * max(top, 1e-6))) for _, top in (fall, flight)]
    lasted = (flight[0] - speeds[1] / gravity) - (fall[0] + speeds[0] / gravity)
    lasted = max(lasted, float(np.median(np.diff(times))) / 4)
    dissipation = float(np.clip(1.5 * (1 - speeds[1] / speeds[0]) / speeds[0], 1e-3, 2.0))
    start = float(times[0]) - fall[0]
    return (
        mass * (np.pi / lasted) ** 2,
        dissipation,
        fall[1] - gravity * start**2 / 2,
        -gravity * start,
    )


def _parabola(times: Vector, heights: Vector, gravity: float) -> tuple[float, float]:
    """Return time and height of the top of a flight."""
    middle = float(np.mean(times))
    level, slope = np.polynomial.polynomial.polyfit(
        times - middle, heights + gravity * (times - middle) ** 2 / 2, 1
    )
    after = float(slope) / gravity
    return middle + after, float(level) + gravity * after**2 / 2


def measurement(
    *, stiffness: float = 4e3, dissipation: float = 0.08, duration: float = 1.2
) -> BounceTrace:
    """Return what a camera of 250 pictures a second would have seen of the station's ball."""
    contact = {"contact.stiffness": stiffness, "contact.dissipation": dissipation}
    station = load_station(
        "bouncing_ball", {**contact, "sample_rate": 250, "solver.accuracy": 1e-5}
    )
    result = simulate(station, duration=duration, progress=False)
    noise = np.random.default_rng(seed=5).normal(0.0, NOISE, len(result.times))
    return BounceTrace(result.times, result["distance.gap"] + noise)


def picture(trace: BounceTrace, found: Identified, file: Path) -> Path:
    """Draw measured and computed heights."""
    figure, ((axes,),) = panels("a ball that bounces, measured and computed", size=(9, 4))
    axes.plot(trace.times, 1e3 * trace.heights, ".", markersize=3, color="0.6", label="measured")
    text = f"computed with {found.stiffness:.4g} N/m and {found.dissipation:.3g} s/m"
    axes.plot(trace.times, 1e3 * found.heights, color=COLOURS[0], label=text)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("lowest point of the ball over the floor [mm]")
    return save_figure(figure, file)


def run(file: Path | None = None) -> tuple[BounceTrace, Identified]:
    """Read a trace, or make one, and find the floor's figures."""
    trace = measurement() if file is None else read_bounces(file)
    return trace, identify_bounces(trace, mass=BALL)


def main(file: Path | None = None) -> None:
    """Print the figures with their intervals, and draw both curves."""
    trace, found = run(file)
    for name, unit in (("stiffness", "N/m"), ("dissipation", "s/m")):
        low, high = getattr(found, f"{name}_interval")
        print(
            f"{name} {getattr(found, name):.4g} {unit}, with 95 % confidence from {low:.4g} to {high:.4g}"
        )
    print(f"what is left: {1e3 * found.residual:.2f} mm rms over {len(trace.times)} samples")
    print(picture(trace, found, Path("runs/bouncing_ball_identify.png")))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
