"""Planner of a walk: its equations, and the effect of each parameter. No robot is needed for these tests."""

from __future__ import annotations

from cmath import exp as complex_exp
from math import exp
from typing import Any, ClassVar

import numpy as np
import pytest

from simrob_drake.walking.body import StanceFeet, slope_weights_of
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.parameters import WalkingParameters
from simrob_drake.walking.planner import WalkPlanner
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import Corrections, Ground, Step, Stride, Swing, Trunk, smoothstep

OMEGA = 5.2  # 1/s
PERIOD = 0.01  # s
HALF_WIDTH = 0.06  # m

SETTLE = 0.4  # s
STEP_TIME = 0.3  # s
DOUBLE_SUPPORT = 0.2
TRANSFER = DOUBLE_SUPPORT * STEP_TIME  # s
DEADBAND = (0.01, 0.005)  # m

TWO_FEET = StanceFeet([[0], [1]], [[0j], [0j]], [[0j], [0j]], HALF_WIDTH, 1.0)
PAIR = [0.2 - 0.1j, -0.2 + 0.1j]
PAIR_WEIGHTS = slope_weights_of(PAIR)
FOUR_FEET = StanceFeet([[0, 1], [2, 3]], [PAIR, PAIR], [PAIR_WEIGHTS, PAIR_WEIGHTS], 0.0, 1.0)

FEEDBACK = {"lean_rate": 4.0, "deadband": list(DEADBAND), "late_touchdown": 0.05}
PARAMETERS = {
    "bearing": {"height": 0.4},
    "step_time": STEP_TIME,
    "double_support": DOUBLE_SUPPORT,
    "lift": 0.04,
    "zmp_inward": 0.01,
    "zmp_ahead": 0.005,
    "settle": SETTLE,
    "max_speed_change": [1, 1, 360],
    "max_speed": {"ahead": 0.4, "backward": 0.2, "sideways": 0.1, "turn_deg": 40},
    "foothold": {"ahead": 0.3, "behind": 0.3, "inner": 0.02, "outer": 0.4},
}
COMMAND = Command(0.2 + 0j)

# Samples from rest to the start of the third step: the settling and the first swing, and one more step.
TO_THIRD_STEP = 40 + 30 + 30


def make_planner(
    stance: StanceFeet = TWO_FEET, period: float = PERIOD, **feedback: Any
) -> WalkPlanner:
    """Make a planner with changed parameters of the feedback; `gait` has changed parameters of the walk."""
    gait = feedback.pop("gait", {})
    parameters = {**PARAMETERS, "feedback": {**FEEDBACK, **feedback}, **gait}
    return WalkPlanner(WalkingParameters.model_validate(parameters), stance, period)


def at_rest(planner: WalkPlanner) -> Stride:
    """State of a robot that stands."""
    foot = planner.steps.standing_places[0]
    middle = planner.steps.middle(1, foot)
    return Stride(Step(zmp_from=middle), Swing(foot), trunk=Trunk(com=middle, zmp=middle))


def walk_on(
    planner: WalkPlanner, stride: Stride, samples: int, command: Command = COMMAND
) -> Stride:
    """State after some samples without feedback."""
    for _ in range(samples):
        _, _, stride = planner.sample(stride, command, None, OMEGA)
    return stride


def walk_from_rest(planner: WalkPlanner, samples: int, command: Command = COMMAND) -> Stride:
    """State after some samples from rest, without feedback."""
    return walk_on(planner, at_rest(planner), samples, command)


@pytest.fixture(scope="module")
def swinging() -> Stride:
    """State in the middle of the swing of the third step."""
    return walk_from_rest(make_planner(), TO_THIRD_STEP + 15)


@pytest.fixture(scope="module")
def landing() -> Stride:
    """State at the last sample of the third step."""
    return walk_from_rest(make_planner(), TO_THIRD_STEP + 29)


def reference_xi(planner: WalkPlanner, stride: Stride, command: Command = COMMAND) -> complex:
    """Reference of the divergent component, from the motion of the centre of mass that follows it."""
    before = stride.trunk.com
    now = planner.sample(stride, command, None, OMEGA)[0].trunk.com
    return before + (now - before) / (1.0 - exp(-OMEGA * planner._period))


def estimate_of(
    planner: WalkPlanner, stride: Stride, error: complex = 0j, **other: Any
) -> Estimate:
    """Estimate of a robot that follows its references, except an error of the divergent component and `other`."""
    offset = stride.corrections.com_offset
    exact = Estimate(
        com=stride.trunk.com + offset,
        xi=reference_xi(planner, stride) + offset + error,
        lean=0.0,
        pitch=0.0,
        heading=0.0,
        slope=0j,
        touches=False,
    )
    return exact._replace(**other)


def sample(
    planner: WalkPlanner,
    stride: Stride,
    error: complex = 0j,
    command: Command = COMMAND,
    **other: Any,
) -> tuple[Stride, Stride]:
    """Advance by a sample with feedback: the references of the sample, and the state for the next one."""
    estimate = estimate_of(planner, stride, error, **other)
    now, _, after = planner.sample(stride, command, estimate, OMEGA)
    return now, after


def lag_part(rate: float) -> float:
    """Part of its error that a first-order lag with a rate [1/s] removes in one sample."""
    return 1.0 - exp(-rate * PERIOD)


def start_weight() -> float:
    """Weight w_0 of the first zero-moment point of a step, by the formula of Englsberger's closed form."""
    exponent = OMEGA * TRANSFER
    return 1.0 - (1.0 - exp(-exponent)) / exponent


class TestPendulum:
    """A walk without feedback is the motion of a linear inverted pendulum over its footsteps."""

    period = 0.001

    def trace(self, command: Command, steps: int) -> tuple[np.ndarray, np.ndarray, list[complex]]:
        """Zero-moment point and centre of mass of each sample, and the footholds, from the first stance foot [m]."""
        planner = make_planner(period=self.period)
        stride = at_rest(planner)
        origin = 0j
        turn = 1 + 0j
        zmps = list[complex]()
        coms = list[complex]()
        footholds = list[complex]()
        while len(footholds) < steps:
            now, _, after = planner.sample(stride, command, None, OMEGA)
            zmps.append(origin + turn * now.trunk.zmp)
            coms.append(origin + turn * now.trunk.com)
            if after.step.standing != now.step.standing:
                origin += turn * now.swing.place
                turn *= complex_exp(1j * now.swing.yaw)
                footholds.append(origin)
            stride = after
        return np.array(zmps), np.array(coms), footholds

    @pytest.mark.parametrize("command", [COMMAND, Command(0.1 + 0.05j, 0.3)])
    def test_the_divergent_component_is_the_discounted_future_of_the_zero_moment_point(
        self, command: Command
    ) -> None:
        r"""The bounded solution of :math:`\dot\xi = \omega (\xi - p)` is :math:`\omega \int p e^{-\omega \tau}`."""
        zmps, coms, _ = self.trace(command, 14)
        xi = coms[:-1] + np.diff(coms) / (1.0 - exp(-OMEGA * self.period))

        horizon = 2000
        first = 1900  # the speed has reached the command's
        count = 300
        times = self.period * (np.arange(horizon) + 0.5)
        discount = OMEGA * self.period * np.exp(-OMEGA * times)
        expected = [
            discount @ zmps[start : start + horizon] for start in range(first, first + count)
        ]

        errors = np.abs(xi[first - 1 : first - 1 + count] - expected)
        assert errors.max() < 1.5e-3  # m; the planner only looks three steps ahead

    def test_the_centre_of_mass_obeys_the_equation_of_the_pendulum(self) -> None:
        zmps, coms, _ = self.trace(COMMAND, 8)

        walking = slice(600, -10)  # after the first weight transfer
        acceleration = (np.diff(coms, 2) / self.period**2)[walking]
        expected = (OMEGA**2 * (coms[1:-1] - zmps[1:-1]))[walking]

        assert np.median(np.abs(acceleration - expected)) < 0.05  # m/s²
        assert np.abs(expected).max() > 1.0

    def test_steps_have_the_length_of_the_command(self) -> None:
        speed = 0.2 + 0.05j

        _, _, footholds = self.trace(Command(speed), 12)

        assert footholds[-1] - footholds[-3] == pytest.approx(2 * STEP_TIME * speed, abs=2e-4)

    @pytest.mark.parametrize("turn", [0.5, -0.5])
    def test_a_turn_leads_along_a_circle(self, turn: float) -> None:
        _, _, footholds = self.trace(Command(0.2 + 0j, turn), 12)

        chords = np.diff(footholds[-5::2])
        assert np.angle(chords[1] / chords[0]) == pytest.approx(2 * STEP_TIME * turn, abs=1e-3)

    def test_a_walk_ends_over_the_middle_of_its_feet(self) -> None:
        planner = make_planner()

        stride = walk_on(planner, walk_from_rest(planner, 150), 200, Command())

        middle = planner.steps.middle(int(stride.step.standing), stride.swing.place)
        assert not stride.step.active
        assert abs(stride.swing.place) == pytest.approx(2 * HALF_WIDTH, abs=0.01)
        assert stride.trunk.com == pytest.approx(middle, abs=1e-3)


class TestLandings:
    """Place and time of a landing, for an error of the divergent component outside of the deadband."""

    error = 0.03 + 0.012j
    beyond_deadband = complex(0.03 - DEADBAND[0], 0.012 - DEADBAND[1])

    def shift_of_landing(self, stride: Stride, **feedback: Any) -> complex:
        """Shift of the foothold by the error, at the planned time of the landing [m]."""
        planner = make_planner(**{"time_weight": 1e6, **feedback})

        answer = sample(planner, stride, self.error)[0].landing

        planned = planner.sample(stride, COMMAND, None, OMEGA)[0].landing
        assert answer.time == pytest.approx(STEP_TIME)
        return answer.place - planned.place

    @pytest.mark.parametrize(("weight", "gain"), [(0.0, 1.0), (0.25, 1.0), (0.0, 0.5), (1.0, 0.8)])
    def test_the_foothold_follows_the_pendulum(
        self, swinging: Stride, weight: float, gain: float
    ) -> None:
        r"""An error grows by :math:`e^{\omega t}`; the foothold u changes the condition by (1 - w_0) u."""
        remaining = STEP_TIME - swinging.step.time
        grown = exp(OMEGA * remaining) * self.beyond_deadband

        shift = self.shift_of_landing(swinging, place_weight=weight, step_gain=gain)

        expected = gain / (1.0 + weight) * grown / (1.0 - start_weight())
        assert shift == pytest.approx(expected, abs=1e-9)

    @pytest.mark.parametrize(
        ("gain", "limit"), [(0.5, [1, 1]), (1.0, [1, 1]), (2.0, [0.004, 0.02]), (2.0, [0, 0])]
    )
    def test_soles_answer_a_part_of_the_error(
        self, swinging: Stride, gain: float, limit: list[float]
    ) -> None:
        """A zero-moment point that is shifted by s reduces the error at the landing by (exp(omega t) - 1) s."""
        growth = exp(OMEGA * (STEP_TIME - swinging.step.time))
        zmp_shift = complex(
            min(gain * self.beyond_deadband.real, limit[0]),
            min(gain * self.beyond_deadband.imag, limit[1]),
        )

        shift = self.shift_of_landing(swinging, place_weight=0.0, zmp_gain=gain, zmp_limit=limit)

        grown = growth * self.beyond_deadband - (growth - 1.0) * zmp_shift
        assert shift == pytest.approx(grown / (1.0 - start_weight()), abs=1e-9)

    @pytest.mark.parametrize("place_weight", [0.0, 0.3])
    @pytest.mark.parametrize("time_weight", [0.0, 0.2, 2.0])
    def test_no_other_time_has_a_lower_cost(
        self, swinging: Stride, time_weight: float, place_weight: float
    ) -> None:
        """The cost of the formula at each time of a fine grid, with a slow foot that cannot reach each foothold."""
        foot_speed = 0.6  # m/s
        planner = make_planner(
            time_weight=time_weight, place_weight=place_weight, max_foot_speed=foot_speed
        )
        answer = sample(planner, swinging, self.error)[0].landing
        planned = planner.sample(swinging, COMMAND, None, OMEGA)[0].landing
        start, offset = planner.steps.dcm_at_landing(int(swinging.step.standing), COMMAND, OMEGA)
        now = swinging.step.time
        rest = planner.steps.rest_points[int(swinging.step.standing)]
        xi = reference_xi(planner, swinging) + self.beyond_deadband

        def cost(time: float) -> float:
            """Cost of a landing at a time."""
            xi_at_landing = (xi - rest) * exp(OMEGA * (time - now)) + rest
            desired = (xi_at_landing - offset) / (1.0 - start)
            place = planned.place + (desired - planned.place) / (1.0 + place_weight)
            path = place - swinging.swing.place
            longest = foot_speed * (time - now)
            if abs(path) > longest:
                place = swinging.swing.place + longest * path / abs(path)
            place_cost = abs(desired - place) ** 2 + place_weight * abs(place - planned.place) ** 2
            return place_cost + time_weight * (time - planned.time) ** 2

        costs = [cost(time) for time in np.arange(now + 0.02, 0.55, 0.001)]
        assert start == pytest.approx(start_weight())
        assert cost(answer.time) <= min(costs) + 2e-4  # m²; the planner compares times 20 ms apart
        assert cost(answer.time) < max(costs) - 1e-3

    def test_a_time_weight_keeps_the_time(self, swinging: Stride) -> None:
        error = 0.05 + 0.012j

        advances = []
        for time_weight in (0.0, 0.2, 100):
            planner = make_planner(time_weight=time_weight, max_foot_speed=0.6, place_weight=0.02)
            advances.append(STEP_TIME - sample(planner, swinging, error)[0].landing.time)

        assert advances[0] > 1.5 * advances[1] > 0.0
        assert advances[2] == 0.0

    def test_a_place_weight_keeps_the_foothold(self, swinging: Stride) -> None:
        shifts = [
            abs(self.shift_of_landing(swinging, place_weight=weight)) for weight in (0.0, 0.1, 1.0)
        ]

        assert shifts[0] > 1.05 * shifts[1] > 1.5 * shifts[2] > 0.0

    def test_an_error_within_the_deadband_changes_nothing(self, swinging: Stride) -> None:
        small = 0.009 - 0.004j
        planner = make_planner()

        answer = sample(planner, swinging, small)[0].landing

        planned = planner.sample(swinging, COMMAND, None, OMEGA)[0].landing
        assert answer == planned

    def test_each_direction_has_its_own_deadband(self, swinging: Stride) -> None:
        ignored_ahead = self.shift_of_landing(swinging, deadband=[0.03, 0.0])
        usual = self.shift_of_landing(swinging)
        without = self.shift_of_landing(swinging, deadband=[0.0, 0.0])

        assert ignored_ahead.real == pytest.approx(0.0, abs=1e-9)
        assert without.real > usual.real > 0.0

    @pytest.mark.parametrize("shortest", [0.1, 0.2])
    def test_a_swing_has_a_least_duration(self, shortest: float) -> None:
        lift_off = walk_from_rest(make_planner(), TO_THIRD_STEP + 7)
        planner = make_planner(min_swing_time=shortest, max_foot_speed=0.6, time_weight=0.0)

        answer = sample(planner, lift_off, -0.05 - 0.03j)[0].landing

        assert answer.time == pytest.approx(TRANSFER + shortest)

    def test_a_swing_has_a_largest_duration(self) -> None:
        lift_off = walk_from_rest(make_planner(), TO_THIRD_STEP + 7)

        times = []
        for longest in (0.25, 0.45):
            planner = make_planner(max_swing_time=longest, max_foot_speed=0.6, time_weight=0.0)
            times.append(sample(planner, lift_off, 0.03j)[0].landing.time)

        assert times[0] < TRANSFER + 0.25 + 0.02 < times[1]

    @pytest.mark.parametrize("speed", [0.3, 0.5])
    def test_a_foot_is_not_faster_than_its_limit(self, swinging: Stride, speed: float) -> None:
        planner = make_planner(max_foot_speed=speed, time_weight=1e6)

        answer = sample(planner, swinging, 0.1 + 0.1j)[0].landing

        distance = abs(answer.place - swinging.swing.place)
        assert distance == pytest.approx(speed * (STEP_TIME - swinging.step.time))

    def test_the_time_of_the_transfer_is_not_counted_for_the_swing(self) -> None:
        """A foot of a pair lifts at the end of the weight transfer, also if there is an error before."""
        planner = make_planner(FOUR_FEET, max_foot_speed=0.3, time_weight=1e6)
        in_transfer = walk_from_rest(planner, TO_THIRD_STEP + 2)

        answer = sample(planner, in_transfer, 0.1 + 0.1j)[0].landing

        distance = abs(answer.place - in_transfer.swing.place)
        assert distance == pytest.approx(0.3 * (STEP_TIME - TRANSFER))

    def test_a_foothold_is_fixed_shortly_before_the_landing(self) -> None:
        """The landing time of the last samples stays, so that the foot arrives: 30 ms before, by the planner."""
        planner = make_planner()
        early = walk_from_rest(planner, TO_THIRD_STEP + 26)
        late = walk_from_rest(planner, TO_THIRD_STEP + 28)

        early_answer = sample(planner, early, 0.05 + 0j)[0].landing
        late_answer = sample(planner, late, 0.05 + 0j)[0].landing

        assert early_answer.place != early.landing.place
        assert late_answer == late.landing

    @pytest.mark.parametrize(
        ("key", "error", "part", "expected"),
        [
            ("ahead", 0.2, "real", 0.1),
            ("behind", -0.2, "real", -0.08),
            ("inner", -0.2j, "imag", 0.07),
            ("outer", 0.2j, "imag", 0.14),
        ],
    )
    def test_a_foothold_is_within_the_reach_of_the_legs(
        self, swinging: Stride, key: str, error: complex, part: str, expected: float
    ) -> None:
        limits = {"ahead": 0.1, "behind": 0.08, "inner": 0.07, "outer": 0.14}
        planner = make_planner(gait={"foothold": limits}, time_weight=1e6, max_foot_speed=100)
        # outward is to the left of a right stance foot
        side = 1.0 if swinging.step.standing == 0 else -1.0

        place = sample(planner, swinging, complex(error.real, side * error.imag))[0].landing.place

        outward = complex(place.real, side * place.imag)
        assert key in limits
        assert getattr(outward, part) == pytest.approx(expected)


class TestReferences:
    """References of the trunk in a sample of a swing, for a robot that leans and is not at its references."""

    def test_the_trunk_approaches_the_estimate_and_returns_upright(self, swinging: Stride) -> None:
        stride = swinging._replace(trunk=swinging.trunk._replace(lean=0.1, pitch=-0.05, rise=0.02))
        planner = make_planner(lean_rate=4.0, upright_rate=3.0, height_rate=6.0)

        now = sample(planner, stride, lean=0.3, pitch=0.1)[0].trunk

        upright = 1.0 - lag_part(3.0)
        assert now.lean == pytest.approx(upright * (0.1 + lag_part(4.0) * (0.3 - 0.1)))
        assert now.pitch == pytest.approx(upright * (-0.05 + lag_part(4.0) * (0.1 + 0.05)))
        assert now.rise == pytest.approx(0.02 * (1.0 - lag_part(6.0)))

    def test_the_centre_of_mass_approaches_the_estimate_and_then_the_divergent_component(
        self, swinging: Stride
    ) -> None:
        planner = make_planner(com_rate=8.0)
        com = swinging.trunk.com
        error = 0.004 - 0.002j
        xi = reference_xi(planner, swinging)

        now = sample(planner, swinging, com=com + error)[0].trunk

        approached = com + lag_part(8.0) * error
        assert now.com == pytest.approx(approached + lag_part(OMEGA) * (xi - approached), abs=1e-12)

    @pytest.mark.parametrize(("push", "rate"), [(0j, 1.0), (0.05 + 0j, 0.1)])
    def test_errors_that_last_are_learnt_and_a_tenth_of_them_during_an_answer(
        self, swinging: Stride, push: complex, rate: float
    ) -> None:
        planner = make_planner(offset_rate=0.7, lean_integral=0.9)
        offset = 0.004 - 0.002j

        corrections = sample(
            planner, swinging, push, com=swinging.trunk.com + offset, lean=0.02, pitch=-0.03
        )[0].corrections

        assert corrections.com_offset == pytest.approx(lag_part(rate * 0.7) * offset)
        assert corrections.lean_integral == pytest.approx(-rate * 0.9 * PERIOD * (0.02 - 0.03j))

    def test_an_offset_that_is_learnt_is_no_error(self, swinging: Stride) -> None:
        planner = make_planner()
        with_offset = swinging._replace(corrections=Corrections(com_offset=0.02 + 0.01j))

        assert sample(planner, with_offset)[0].landing == sample(planner, swinging)[0].landing

    @pytest.mark.parametrize(("slope_rate", "level_rate"), [(2.0, 7.0), (0.0, 0.0)])
    def test_soles_approach_the_slope(self, slope_rate: float, level_rate: float) -> None:
        planner = make_planner(FOUR_FEET, slope_rate=slope_rate, level_rate=level_rate)
        stride = walk_from_rest(planner, TO_THIRD_STEP + 15)
        stride = stride._replace(ground=Ground(slope=0.05j, tilt=0.02 + 0j))

        ground = sample(planner, stride, slope=0.1 + 0j)[0].ground

        slope_error = 0.1 - 0.05j
        assert ground.slope == pytest.approx(0.05j + lag_part(slope_rate) * slope_error)
        assert ground.tilt == pytest.approx(0.02 + lag_part(level_rate) * (slope_error - 0.02))

    @pytest.mark.parametrize("gain", [0.0, 0.5, 2.0])
    def test_the_heading_is_held(self, swinging: Stride, gain: float) -> None:
        stride = swinging._replace(trunk=swinging.trunk._replace(desired_heading=0.1))
        planner = make_planner(heading_gain=gain)

        now = sample(planner, stride, heading=0.04)[0]

        assert now.corrections.turn_back == pytest.approx(gain * (0.1 - 0.04))
        assert now.landing.yaw == pytest.approx(gain * (0.1 - 0.04) * STEP_TIME)

    @pytest.mark.parametrize("turn", [0.5, -0.3])
    def test_the_desired_heading_turns_by_the_command(self, swinging: Stride, turn: float) -> None:
        stride = swinging._replace(trunk=swinging.trunk._replace(desired_heading=0.1))

        now = sample(make_planner(), stride, command=Command(0.2 + 0j, turn))[0]

        assert now.trunk.desired_heading == pytest.approx(0.1 + turn * PERIOD)

    @pytest.mark.parametrize("heading", [0.7, -2.0])
    def test_a_walk_keeps_the_heading_in_which_it_begins(self, heading: float) -> None:
        planner = make_planner()
        stride = at_rest(planner)
        estimate = Estimate(
            stride.trunk.com, stride.trunk.zmp, 0.0, 0.0, heading, 0j, touches=False
        )

        now, _, _ = planner.sample(stride, COMMAND, estimate, OMEGA)

        assert now.trunk.desired_heading == heading
        assert now.corrections.turn_back == 0.0


class TestLimitsOfCorrections:
    """A wrong measurement that lasts changes a correction up to its limit, in both directions, and no further."""

    both_directions = pytest.mark.parametrize("sign", [1.0, -1.0])

    def learn(self, stride: Stride, samples: int, **measured: Any) -> Corrections:
        """Corrections after samples of the same swing, in which something is measured wrongly."""
        planner = make_planner(offset_rate=5.0, lean_integral=5.0, heading_gain=5.0)
        for _ in range(samples):
            now, _ = sample(planner, stride, **measured)
            stride = stride._replace(corrections=now.corrections)
        return stride.corrections

    @both_directions
    def test_the_offset_of_the_centre_of_mass(self, swinging: Stride, sign: float) -> None:
        corrections = self.learn(swinging, 20, com=swinging.trunk.com + sign * (1.0 - 2.0j))

        assert corrections.com_offset == sign * (0.03 - 0.03j)  # m

    @both_directions
    def test_the_lean_of_the_trunk(self, swinging: Stride, sign: float) -> None:
        corrections = self.learn(swinging, 20, lean=sign * 1.0, pitch=-sign * 0.5)

        assert corrections.lean_integral == sign * (-0.15 + 0.15j)  # rad, against the measured lean

    @both_directions
    def test_the_turn_back(self, swinging: Stride, sign: float) -> None:
        corrections = self.learn(swinging, 1, heading=sign * 1.0)

        assert corrections.turn_back == -sign * 0.3  # rad/s

    @both_directions
    def test_the_trim_of_the_speed(self, landing: Stride, sign: float) -> None:
        lack = sign * (1.0 - 1.0j)  # m
        short = landing._replace(swing=landing.swing._replace(place=landing.swing.place - lack))
        planner = make_planner(speed_integral=1.0)

        now, after = sample(planner, short, touches=True)

        trim_from_old_foot = after.corrections.speed_trim * complex_exp(1j * now.swing.yaw)
        assert trim_from_old_foot == pytest.approx(sign * (0.15 - 0.1j))  # m/s


class TestFootfalls:
    """End of a step, and start of the next one."""

    @pytest.mark.parametrize(("after_share", "ends"), [(-0.1, True), (0.2, False)])
    def test_a_foot_that_touches_ends_the_step_in_the_last_part_of_its_swing(
        self, swinging: Stride, after_share: float, ends: bool
    ) -> None:
        planner = make_planner(early_touchdown=swinging.swing.share + after_share)

        _, after = sample(planner, swinging, touches=True)

        assert (after.step.standing != swinging.step.standing) == ends

    @pytest.mark.parametrize("speed", [0.1, 0.3])
    def test_a_late_foot_goes_down_for_a_while(self, landing: Stride, speed: float) -> None:
        planner = make_planner(late_touchdown=0.05, search_speed=speed)
        stride = landing

        heights = []
        while stride.step.standing == landing.step.standing:
            _, stride = sample(planner, stride)
            heights.append(stride.ground.height)

        assert len(heights) == 6  # samples: 0.05 s, and the one in which the step ends
        assert heights[2] == pytest.approx(-speed * 3 * PERIOD)

    def test_without_a_search_a_step_ends_in_time(self, landing: Stride) -> None:
        _, after = sample(make_planner(late_touchdown=0.0), landing)

        assert after.step.standing != landing.step.standing

    def test_a_stance_foot_without_contact_goes_down(self) -> None:
        """Heights are relative to the stance group: it goes down if the swing group and the root rise."""
        planner = make_planner(FOUR_FEET, search_speed=0.1, late_touchdown=0.05)
        stride = walk_from_rest(planner, TO_THIRD_STEP + 15)

        now, _ = sample(planner, stride, down=(False, False), hangs=(True, False))

        descent = 0.1 * PERIOD
        remaining = 1 - lag_part(5.0)  # rates of the root's height and of the tilt
        height_of_first, height_of_second = (
            (now.ground.tilt.conjugate() * offset).real for offset in PAIR
        )
        assert now.ground.height == pytest.approx(descent / 2)
        assert now.trunk.rise == pytest.approx(descent / 2 * remaining)
        assert height_of_first - height_of_second == pytest.approx(-descent * remaining)

    def test_without_a_search_a_stance_foot_without_contact_stays(self) -> None:
        planner = make_planner(FOUR_FEET, late_touchdown=0)
        stride = walk_from_rest(planner, TO_THIRD_STEP + 15)

        now, _ = sample(planner, stride, hangs=(True, False))

        assert now.ground.height == 0.0

    def test_a_single_foot_lifts_at_once_to_answer_an_error(self) -> None:
        planner = make_planner()
        in_transfer = walk_from_rest(planner, TO_THIRD_STEP + 3)

        calm, _ = sample(planner, in_transfer)
        answer, _ = sample(planner, in_transfer, 0.03j)

        assert 0.0 < in_transfer.step.time < in_transfer.step.transfer == planner.steps.transfer
        assert calm.step.transfer == in_transfer.step.transfer
        assert answer.step.transfer == in_transfer.step.time
        assert answer.trunk.zmp == planner.steps.rest_points[int(in_transfer.step.standing)]

    def test_the_first_weight_transfer_is_not_cut_short(self) -> None:
        planner = make_planner()
        settling = walk_from_rest(planner, 20)

        answer, _ = sample(planner, settling, 0.03j)

        assert answer.step.transfer == settling.step.transfer

    def test_a_pair_completes_its_weight_transfer(self) -> None:
        planner = make_planner(FOUR_FEET)
        in_transfer = walk_from_rest(planner, TO_THIRD_STEP + 3)

        answer, _ = sample(planner, in_transfer, 0.03j)

        assert answer.step.transfer == in_transfer.step.transfer

    @pytest.mark.parametrize(("threshold", "transfer"), [(0.03, 0.0), (0.05, TRANSFER)])
    def test_a_large_error_hurries_the_next_step(
        self, landing: Stride, threshold: float, transfer: float
    ) -> None:
        planner = make_planner(hurry_threshold=threshold)
        error = 0.04 + DEADBAND[0]  # m: 0.04 outside of the deadband

        _, after = sample(planner, landing, complex(error), touches=True)

        assert after.step.standing != landing.step.standing
        assert after.step.transfer == pytest.approx(transfer)

    @pytest.mark.parametrize("part", [0.0, 0.2, 1.0])
    def test_the_lack_of_a_short_step_is_added_to_the_speed(
        self, landing: Stride, part: float
    ) -> None:
        short = landing._replace(swing=landing.swing._replace(place=landing.swing.place - 0.01))
        planner = make_planner(speed_integral=part)

        now, after = sample(planner, short, touches=True)

        swinging = 1 - int(landing.step.standing)
        lack = planner.steps.plan_landing(swinging, COMMAND).place - now.swing.place
        trim_from_old_foot = after.corrections.speed_trim * complex_exp(1j * now.swing.yaw)
        assert lack.real > 0.003
        assert trim_from_old_foot == pytest.approx(part / STEP_TIME * lack)

    def test_a_step_that_took_longer_lacks_the_distance_of_that_time(self, landing: Stride) -> None:
        """A late touchdown at the planned foothold: the distance is speed times delay too short."""
        delay = 0.04  # s
        planner = make_planner(speed_integral=0.5, late_touchdown=1.0)
        planned = planner.steps.plan_landing(1 - int(landing.step.standing), COMMAND)
        time = STEP_TIME + delay - PERIOD
        late = landing._replace(
            step=landing.step._replace(time=time),
            swing=landing.swing._replace(place=planned.place, share=1.0),
        )

        now, after = sample(planner, late, touches=True)

        trim_from_old_foot = after.corrections.speed_trim * complex_exp(1j * now.swing.yaw)
        lack = planned.place - now.swing.place + delay * COMMAND.speed
        assert trim_from_old_foot == pytest.approx(0.5 / STEP_TIME * lack)
        assert trim_from_old_foot.real > 0.0


class TestBracing:
    """A robot whose legs cannot step aside stops on both feet until the error is over."""

    keep_steps: ClassVar[dict[str, Any]] = {"step_gain": 0.0, "time_weight": 1e6}

    @pytest.mark.parametrize(("threshold", "braces"), [(0.02, True), (0.04, False), (None, False)])
    def test_an_error_above_the_threshold_stops_the_walk(
        self, swinging: Stride, threshold: float | None, braces: bool
    ) -> None:
        planner = make_planner(brace_threshold=threshold, **self.keep_steps)

        now, _ = sample(planner, swinging, 0.03j)

        assert bool(now.step.active) != braces

    def test_the_zero_moment_point_is_between_the_feet(self, swinging: Stride) -> None:
        planner = make_planner(brace_threshold=0.02, **self.keep_steps)

        now, _ = sample(planner, swinging, 0.03j)

        middle = planner.steps.middle(int(now.step.standing), now.swing.place)
        assert now.trunk.zmp == pytest.approx(middle)
        assert now.step.brace_time == pytest.approx(0.2)

    def test_the_walk_goes_on_after_a_fifth_of_a_second_without_an_error(
        self, swinging: Stride
    ) -> None:
        planner = make_planner(brace_threshold=0.02, **self.keep_steps)
        _, stride = sample(planner, swinging, 0.03j)

        samples = 0
        while not stride.step.active and samples < 40:
            estimate = Estimate(
                stride.trunk.com, stride.trunk.zmp, 0.0, 0.0, 0.0, 0j, touches=False
            )
            _, _, stride = planner.sample(stride, COMMAND, estimate, OMEGA)
            samples += 1

        assert samples == pytest.approx(21, abs=1)

    @pytest.mark.parametrize(
        ("error", "remaining"),
        [
            (0.009j, 0.2 - PERIOD),
            (-0.009j, 0.2 - PERIOD),
            (0.011j, 0.2),
            (-0.011j, 0.2),
            (0.05, 0.2 - PERIOD),
        ],
    )
    def test_an_error_to_the_side_above_half_of_the_threshold_prolongs_the_stop(
        self, swinging: Stride, error: complex, remaining: float
    ) -> None:
        planner = make_planner(brace_threshold=0.02, **self.keep_steps)
        _, stride = sample(planner, swinging, 0.03j)
        estimate = Estimate(
            stride.trunk.com, stride.trunk.zmp + error, 0.0, 0.0, 0.0, 0j, touches=False
        )

        now, _, _ = planner.sample(stride, COMMAND, estimate, OMEGA)

        assert now.step.brace_time == pytest.approx(remaining)

    @pytest.mark.parametrize(
        ("error", "starts"), [(0.009j, False), (-0.009j, False), (0.011j, True), (-0.011j, True)]
    )
    def test_a_standing_robot_steps_for_an_error_above_twice_the_deadband(
        self, error: complex, starts: bool
    ) -> None:
        planner = make_planner()
        stride = at_rest(planner)
        estimate = Estimate(
            stride.trunk.com, stride.trunk.zmp + error, 0.0, 0.0, 0.0, 0j, touches=False
        )

        now, _, _ = planner.sample(stride, Command(), estimate, OMEGA)

        assert bool(now.step.active) == starts
        if starts:
            left_foot_swings = now.step.sides[1] == 1
            assert left_foot_swings == (error.imag > 0)  # the foot on the side of the error


class TestGait:
    """Effect of the parameters of the gait itself."""

    def test_the_first_step_has_a_settling_time(self) -> None:
        first = walk_from_rest(make_planner(), 1)

        assert first.step.transfer == pytest.approx(SETTLE)
        assert first.landing.time == pytest.approx(SETTLE + STEP_TIME)

    def test_durations_are_those_of_the_parameters(self) -> None:
        planner = make_planner(gait={"settle": 0.2, "step_time": 0.25, "double_support": 0.4})

        first = walk_from_rest(planner, 1)
        second = walk_from_rest(planner, 46)

        assert first.landing.time == pytest.approx(0.2 + 0.25)
        assert second.landing.time == pytest.approx(0.25)
        assert second.step.transfer == pytest.approx(0.4 * 0.25)

    @pytest.mark.parametrize(("lift", "exponent"), [(0.04, 3.0), (0.05, 1.5)])
    def test_the_height_of_the_foot_is_the_formula_of_its_parameters(
        self, lift: float, exponent: float
    ) -> None:
        planner = make_planner(gait={"lift": lift, "lift_exponent": exponent})
        stride = walk_from_rest(planner, 48)

        now, height, _ = planner.sample(stride, COMMAND, None, OMEGA)

        share = now.swing.share
        assert 0.2 < share < 0.4
        assert height == pytest.approx(lift * (4 * share * (1 - share)) ** exponent)

    @pytest.mark.parametrize("peak", [1.5, 1.7, 1.875])
    def test_the_peak_speed_of_a_swing_is_its_parameter(self, peak: float) -> None:
        planner = make_planner(gait={"swing_peak": peak, "step_time": 3.0})
        stride = at_rest(planner)

        places = list[complex]()
        while len(places) < 2 or stride.swing.share:
            stride = walk_on(planner, stride, 1)
            if stride.swing.share:
                places.append(stride.swing.place)

        distances = np.abs(np.diff(places))
        assert distances.max() / distances.mean() == pytest.approx(peak, rel=0.02)

    @pytest.mark.parametrize("later_samples", [0, 12])
    def test_a_foot_has_its_landing_height_from_the_middle_of_its_swing(
        self, later_samples: int
    ) -> None:
        gait = {"lift": 0.04, "lift_exponent": 1.0}
        low = make_planner(gait=gait)
        high = make_planner(gait=gait, landing_height=0.01)
        stride = walk_from_rest(low, 48 + later_samples)

        now, low_height, _ = low.sample(stride, COMMAND, None, OMEGA)
        _, high_height, _ = high.sample(stride, COMMAND, None, OMEGA)

        reached = smoothstep(min(2 * now.swing.share, 1.0))
        assert high_height - low_height == pytest.approx(0.01 * reached)
        assert (reached == 1.0) == (later_samples > 0)

    @pytest.mark.parametrize(("ahead", "inward"), [(0.005, 0.01), (-0.01, 0.02)])
    def test_the_zero_moment_point_rests_at_its_parameters(
        self, ahead: float, inward: float
    ) -> None:
        planner = make_planner(gait={"zmp_ahead": ahead, "zmp_inward": inward})

        stride = walk_from_rest(planner, TO_THIRD_STEP + 15)

        inward_sign = 1.0 if stride.step.standing == 0 else -1.0  # to the left of a right foot
        assert stride.trunk.zmp == pytest.approx(complex(ahead, inward_sign * inward))

    def test_speeds_change_from_step_to_step(self) -> None:
        planner = make_planner(gait={"max_speed_change": [0.05, 0.02, 10.0]})
        command = Command(0.12 - 0.03j, 0.3)
        stride = at_rest(planner)

        commands = list[Command]()
        for _ in range(4):
            standing = stride.step.standing
            while stride.step.standing == standing:
                stride = walk_on(planner, stride, 1, command)
            commands.append(stride.step.command)

        twenty_degrees = np.deg2rad(20.0)
        speeds = [each.speed for each in commands]
        turns = [each.turn for each in commands]
        assert speeds == pytest.approx([0.1 - 0.03j, 0.12 - 0.03j, 0.12 - 0.03j, 0.12 - 0.03j])
        assert turns[:2] == pytest.approx([min(twenty_degrees, 0.3), 0.3])

    @pytest.mark.parametrize("turn", [0.3, -0.3])
    def test_the_turn_of_a_first_step_is_limited_in_degrees(self, turn: float) -> None:
        planner = make_planner(gait={"max_speed_change": [1.0, 1.0, 10.0]})

        stride = walk_from_rest(planner, 1, Command(0j, turn))

        assert stride.step.turn == pytest.approx(np.copysign(np.deg2rad(10.0), turn))

    @pytest.mark.parametrize(
        ("heading", "ends"), [(0.0, True), (0.015, True), (0.03, False), (-0.03, False)]
    )
    def test_a_walk_only_ends_when_it_has_turned_back(self, heading: float, ends: bool) -> None:
        """The turn back is the heading's error here, and a walk ends below 0.02 rad/s."""
        planner = make_planner(heading_gain=1.0)
        stride = walk_from_rest(planner, 150)
        last = stride
        while stride.step.active:
            last = stride
            stride = walk_on(planner, stride, 1, Command())

        xi = reference_xi(planner, last, Command())
        estimate = Estimate(last.trunk.com, xi, 0.0, 0.0, heading, 0j, touches=True)
        _, _, after = planner.sample(last, Command(), estimate, OMEGA)

        assert bool(after.step.active) != ends

    def test_a_gait_without_turns_holds_no_heading(self, swinging: Stride) -> None:
        planner = make_planner(gait={"max_speed": {"ahead": 0.4, "backward": 0.2}})

        now, _ = sample(planner, swinging, heading=0.2)

        assert now.corrections.turn_back == 0.0
