"""The planner of a walk against its equations, and what each of its parameters changes; no robot is needed for it."""

from __future__ import annotations

from cmath import exp as turned_by
from math import exp
from typing import Any

import numpy as np
import pytest

from simrob_drake.walking.body import StanceFeet, slope_weights_of
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.parameters import WalkingParameters
from simrob_drake.walking.planner import WalkPlanner
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import Corrections, Ground, Step, Stride, Swing, Trunk, smoothstep

OMEGA, PERIOD, HALF = 5.2, 0.01, 0.06
TWO_FEET = StanceFeet([[0], [1]], [[0j], [0j]], [[0j], [0j]], HALF, 1.0)
PAIR = [0.2 - 0.1j, -0.2 + 0.1j]
FOUR_FEET = StanceFeet([[0, 1], [2, 3]], [PAIR, PAIR], [slope_weights_of(PAIR), slope_weights_of(PAIR)], 0.0, 1.0)
FEEDBACK = {"lean_rate": 4.0, "deadband": [0.01, 0.005], "late_touchdown": 0.05}
PARAMETERS = {
    "bearing": {"height": 0.4},
    "step_time": 0.3,
    "double_support": 0.2,
    "lift": 0.04,
    "zmp_inward": 0.01,
    "zmp_ahead": 0.005,
    "settle": 0.4,
    "max_speed_change": [1, 1, 360],
    "max_speed": {"ahead": 0.4, "backward": 0.2, "sideways": 0.1, "turn_deg": 40},
    "foothold": {"ahead": 0.3, "behind": 0.3, "inner": 0.02, "outer": 0.4},
}
COMMAND = Command(0.2 + 0j)


def planner(stance: StanceFeet = TWO_FEET, period: float = PERIOD, **feedback: Any) -> WalkPlanner:
    """Return a planner, some keys of whose feedback are others; ``gait`` has others of the walk."""
    gait = feedback.pop("gait", {})
    return WalkPlanner(
        WalkingParameters.model_validate({**PARAMETERS, "feedback": {**FEEDBACK, **feedback}, **gait}), stance, period
    )


def at_rest(made: WalkPlanner) -> Stride:
    """Return the stride of a robot that stands."""
    foot = made.steps.apart[0]
    middle = made.steps.middle(1, foot)
    return Stride(Step(zmp_from=middle), Swing(foot), trunk=Trunk(com=middle, zmp=middle))


def later(made: WalkPlanner, stride: Stride, samples: int, command: Command = COMMAND) -> Stride:
    """Return the stride after some samples without feedback."""
    for _ in range(samples):
        stride = made.sample(stride, command, None, OMEGA)[2]
    return stride


@pytest.fixture(scope="module")
def swinging() -> Stride:
    """The stride in the middle of the swing of the third step."""
    return later(planner(), at_rest(planner()), 40 + 30 + 30 + 15)


@pytest.fixture(scope="module")
def landing() -> Stride:
    """The stride at the last sample of the third step."""
    return later(planner(), at_rest(planner()), 40 + 30 + 30 + 29)


def own_component(made: WalkPlanner, stride: Stride, command: Command = COMMAND) -> complex:
    """Return the divergent component of the reference: the centre of mass comes after it, and tells where it is."""
    before, now = stride.trunk.com, made.sample(stride, command, None, OMEGA)[0].trunk.com
    return before + (now - before) / (1.0 - exp(-OMEGA * made._period))


def seen(made: WalkPlanner, stride: Stride, error: complex = 0j, **other: Any) -> Estimate:
    """Return the estimate of a robot that does what it shall, but for an error of its component and ``other``."""
    xi = own_component(made, stride) + stride.corrections.com_offset + error
    known = Estimate(stride.trunk.com + stride.corrections.com_offset, xi, 0.0, 0.0, 0.0, 0j, touches=False)
    return known._replace(**other)


def sampled(
    made: WalkPlanner, stride: Stride, error: complex = 0j, command: Command = COMMAND, **other: Any
) -> tuple[Stride, Stride]:
    """Return the stride that is posed after a sample with feedback, and the one at the next sample."""
    now, _, then = made.sample(stride, command, seen(made, stride, error, **other), OMEGA)
    return now, then


def nearer(rate: float) -> float:
    """Return the share of its way that a first-order lag goes in a sample."""
    return 1.0 - exp(-rate * PERIOD)


class TestPendulum:
    """A walk without feedback is the motion of a linear inverted pendulum over its footsteps."""

    period = 0.001

    def traces(self, command: Command, steps: int) -> tuple[np.ndarray, np.ndarray, list[complex]]:
        """Return zero-moment point and centre of mass at each sample, and the footfalls, seen from the first foot."""
        made = planner(period=self.period)
        stride, origin, turn = at_rest(made), 0j, 1 + 0j
        zmps, coms, falls = list[complex](), list[complex](), list[complex]()
        while len(falls) < steps:
            now, _, then = made.sample(stride, command, None, OMEGA)
            zmps.append(origin + turn * now.trunk.zmp)
            coms.append(origin + turn * now.trunk.com)
            if then.step.standing != now.step.standing:
                origin, turn = origin + turn * now.swing.place, turn * turned_by(1j * now.swing.yaw)
                falls.append(origin)
            stride = then
        return np.array(zmps), np.array(coms), falls

    @pytest.mark.parametrize("command", [COMMAND, Command(0.1 + 0.05j, 0.3)])
    def test_its_component_is_the_discounted_future_of_the_zero_moment_point(self, command: Command) -> None:
        r"""The bounded solution of :math:`\dot\xi = \omega (\xi - p)` is :math:`\omega \int p e^{-\omega \tau}`."""
        zmps, coms, _ = self.traces(command, 14)
        found = coms[:-1] + np.diff(coms) / (1.0 - exp(-OMEGA * self.period))
        weights = OMEGA * self.period * np.exp(-OMEGA * self.period * (np.arange(2000) + 0.5))
        begins = 1900  # when the speed has come to the command's
        expected = [weights @ zmps[start : start + 2000] for start in range(begins, begins + 300)]
        assert np.abs(found[begins - 1 : begins + 299] - expected).max() < 1.5e-3  # m; it looks three steps ahead

    def test_its_centre_of_mass_obeys_the_pendulum(self) -> None:
        zmps, coms, _ = self.traces(COMMAND, 8)
        swings = slice(600, -10)  # the zero-moment point jumps nowhere after the first shift of the weight
        force = np.diff(coms, 2) / self.period**2
        expected = OMEGA**2 * (coms[1:-1] - zmps[1:-1])
        assert np.median(np.abs(force - expected)[swings]) < 0.05  # m/s², of 2
        assert np.abs(expected[swings]).max() > 1.0

    def test_steps_are_as_long_as_the_command_asks(self) -> None:
        falls = self.traces(Command(0.2 + 0.05j), 12)[2]
        assert falls[-1] - falls[-3] == pytest.approx(2 * 0.3 * (0.2 + 0.05j), abs=2e-4)

    def test_a_turn_is_gone_on_a_circle(self) -> None:
        falls = self.traces(Command(0.2 + 0j, 0.5), 12)[2]
        chords = np.diff(falls[-5::2])
        assert np.angle(chords[1] / chords[0]) == pytest.approx(2 * 0.3 * 0.5, abs=1e-3)

    def test_it_stops_over_the_middle_of_its_feet(self) -> None:
        made = planner()
        stride = later(made, later(made, at_rest(made), 150), 200, Command())
        assert not stride.step.active
        assert abs(stride.swing.place) == pytest.approx(2 * HALF, abs=0.01)
        assert stride.trunk.com == pytest.approx(
            made.steps.middle(int(stride.step.standing), stride.swing.place), abs=1e-3
        )


class TestLandings:
    """Where and when a step ends, for an error of the divergent component beyond the deadband."""

    error = 0.03 + 0.012j
    beyond = complex(0.03 - 0.01, 0.012 - 0.005)

    def moved(self, stride: Stride, **feedback: Any) -> complex:
        """Return by how much the landing moves at its own time."""
        made = planner(**{"time_weight": 1e6, **feedback})
        landing = sampled(made, stride, self.error)[0].landing
        assert landing.time == pytest.approx(0.3)
        return landing.place - made.sample(stride, COMMAND, None, OMEGA)[0].landing.place

    @pytest.mark.parametrize(("weight", "gain"), [(0.0, 1.0), (0.25, 1.0), (0.0, 0.5), (1.0, 0.8)])
    def test_the_place_is_that_of_the_pendulum(self, swinging: Stride, weight: float, gain: float) -> None:
        r"""An error grows by :math:`e^{\omega t}`; of a foothold the next step's own start counts for :math:`w_0`."""
        left, way = 0.3 - swinging.step.time, OMEGA * 0.2 * 0.3
        start = 1.0 - (1.0 - exp(-way)) / way
        expected = gain / (1.0 + weight) * exp(OMEGA * left) * self.beyond / (1.0 - start)
        assert self.moved(swinging, place_weight=weight, step_gain=gain) == pytest.approx(expected, abs=1e-9)

    @pytest.mark.parametrize(("gain", "limit"), [(0.5, [1, 1]), (1.0, [1, 1]), (2.0, [0.004, 0.02]), (2.0, [0, 0])])
    def test_soles_take_their_part(self, swinging: Stride, gain: float, limit: list[float]) -> None:
        left, way = 0.3 - swinging.step.time, OMEGA * 0.2 * 0.3
        start = 1.0 - (1.0 - exp(-way)) / way
        held = complex(min(gain * self.beyond.real, limit[0]), min(gain * self.beyond.imag, limit[1]))
        grown = exp(OMEGA * left) * self.beyond - (exp(OMEGA * left) - 1.0) * held
        moved = self.moved(swinging, place_weight=0.0, zmp_gain=gain, zmp_limit=limit)
        assert moved == pytest.approx(grown / (1.0 - start), abs=1e-9)

    @pytest.mark.parametrize("place_weight", [0.0, 0.3])
    @pytest.mark.parametrize("time_weight", [0.0, 0.2, 2.0])
    def test_no_other_time_costs_less(self, swinging: Stride, time_weight: float, place_weight: float) -> None:
        """The cost of the formula at each time of a fine grid, where the foot is slow and cannot reach all."""
        chosen: dict[str, Any] = {"time_weight": time_weight, "place_weight": place_weight, "max_foot_speed": 0.6}
        made = planner(**chosen)
        landing = sampled(made, swinging, self.error)[0].landing
        planned = made.sample(swinging, COMMAND, None, OMEGA)[0].landing
        way, now = OMEGA * 0.2 * 0.3, swinging.step.time
        start = 1.0 - (1.0 - exp(-way)) / way
        rest = made.steps.rest_points[int(swinging.step.standing)]
        a, b = made.steps.dcm_at_landing(int(swinging.step.standing), COMMAND, OMEGA)
        assert a == pytest.approx(start)
        xi = own_component(made, swinging) + self.beyond

        def cost(time: float) -> float:
            desired = ((xi - rest) * exp(OMEGA * (time - now)) + rest - b) / (1.0 - a)
            place = planned.place + (desired - planned.place) / (1.0 + place_weight)
            most = 0.6 * (time - now)
            if abs(place - swinging.swing.place) > most:
                place = swinging.swing.place + most * (place - swinging.swing.place) / abs(place - swinging.swing.place)
            off = abs(desired - place) ** 2 + place_weight * abs(place - planned.place) ** 2
            return off + time_weight * (time - planned.time) ** 2

        times = np.arange(now + 0.02, 0.55, 0.001)
        assert cost(landing.time) <= min(map(cost, times)) + 2e-4  # m²; of the 20 ms between the times that it compares
        assert cost(landing.time) < max(map(cost, times)) - 1e-3

    def test_weights_keep_time_and_place(self, swinging: Stride) -> None:
        error = 0.05 + 0.012j
        slow: dict[str, Any] = {"max_foot_speed": 0.6, "place_weight": 0.02}
        times = [sampled(planner(time_weight=w, **slow), swinging, error)[0].landing.time for w in (0.0, 0.2, 100)]
        assert 0.3 - times[0] > 1.5 * (0.3 - times[1]) > times[2] - 0.3 == 0.0
        ways = [abs(self.moved(swinging, place_weight=weight)) for weight in (0.0, 0.1, 1.0)]
        assert ways[0] > 1.05 * ways[1] > 1.5 * ways[2]

    def test_an_error_within_the_deadband_changes_nothing(self, swinging: Stride) -> None:
        small = 0.009 - 0.004j
        assert (
            sampled(planner(), swinging, small)[0].landing
            == planner().sample(swinging, COMMAND, None, OMEGA)[0].landing
        )
        assert self.moved(swinging, deadband=[0.03, 0.0]).real == pytest.approx(0.0, abs=1e-9)
        assert abs(self.moved(swinging, deadband=[0.0, 0.0]).real) > abs(self.moved(swinging).real)

    def test_swings_are_within_their_times(self) -> None:
        made = planner()
        begun = later(made, at_rest(made), 40 + 30 + 30 + 7)  # just lifted, after 0.06 s of transfer
        late = -0.05 - 0.03j
        early: dict[str, Any] = {"max_foot_speed": 0.6, "time_weight": 0.0}
        for least in (0.1, 0.2):
            landing = sampled(planner(min_swing_time=least, **early), begun, late)[0].landing
            assert landing.time == pytest.approx(0.06 + least)
        most = [sampled(planner(max_swing_time=most, **early), begun, 0.03j)[0].landing.time for most in (0.25, 0.45)]
        assert most[0] < 0.06 + 0.25 + 0.02 < most[1]

    @pytest.mark.parametrize("speed", [0.3, 0.5])
    def test_a_foot_goes_no_faster_than_it_may(self, swinging: Stride, speed: float) -> None:
        landing = sampled(planner(max_foot_speed=speed, time_weight=1e6), swinging, 0.1 + 0.1j)[0].landing
        assert abs(landing.place - swinging.swing.place) == pytest.approx(speed * (0.3 - swinging.step.time))

    @pytest.mark.parametrize(
        ("key", "error", "part"),
        [("ahead", 0.2, "real"), ("behind", -0.2, "real"), ("inner", -0.2j, "imag"), ("outer", 0.2j, "imag")],
    )
    def test_footholds_end_where_the_legs_do(self, swinging: Stride, key: str, error: complex, part: str) -> None:
        limit = {"ahead": 0.1, "behind": 0.08, "inner": 0.07, "outer": 0.14}
        made = planner(gait={"foothold": limit}, time_weight=1e6, max_foot_speed=100)
        side = 1.0 if swinging.step.standing == 0 else -1.0  # to the left of a right foot
        place = sampled(made, swinging, complex(error.real, side * error.imag))[0].landing.place
        found = complex(place.real, side * place.imag)
        assert getattr(found, part) == pytest.approx(-limit[key] if key == "behind" else limit[key])


class TestReferences:
    """What the references do in a sample of a swing; a robot that leans, and is not where it shall be."""

    def test_trunk_and_centre_of_mass_come_to_what_is_measured(self, swinging: Stride) -> None:
        stride = swinging._replace(trunk=swinging.trunk._replace(lean=0.1, pitch=-0.05, rise=0.02))
        made = planner(com_rate=8.0, lean_rate=4.0, upright_rate=3.0, height_rate=6.0)
        xi, com = own_component(made, stride), stride.trunk.com
        now = sampled(made, stride, lean=0.3, pitch=0.1, com=com + 0.004 - 0.002j)[0].trunk
        upright = 1.0 - nearer(3.0)
        assert now.lean == pytest.approx(upright * (0.1 + nearer(4.0) * 0.2))
        assert now.pitch == pytest.approx(upright * (-0.05 + nearer(4.0) * 0.15))
        assert now.rise == pytest.approx(0.02 * (1.0 - nearer(6.0)))
        followed = com + nearer(8.0) * (0.004 - 0.002j)
        assert now.com == pytest.approx(followed + nearer(OMEGA) * (xi - followed), abs=1e-12)

    def test_what_lasts_is_learnt(self, swinging: Stride) -> None:
        away, lean, pitch = 0.004 - 0.002j, 0.02, -0.03
        com = swinging.trunk.com + away
        for push, calm in ((0j, 1.0), (0.05 + 0j, 0.1)):  # who answers an error learns a tenth
            made = planner(offset_rate=0.7, lean_integral=0.9)
            learnt = sampled(made, swinging, push, com=com, lean=lean, pitch=pitch)[0].corrections
            assert learnt.com_offset == pytest.approx(nearer(calm * 0.7) * away)
            assert learnt.lean_integral == pytest.approx(-calm * 0.9 * PERIOD * complex(lean, pitch))

    def test_what_was_learnt_is_no_error(self, swinging: Stride) -> None:
        known = swinging._replace(corrections=Corrections(com_offset=0.02 + 0.01j))
        assert sampled(planner(), known)[0].landing == sampled(planner(), swinging)[0].landing

    @pytest.mark.parametrize(("rate", "level"), [(2.0, 7.0), (0.0, 0.0)])
    def test_soles_lie_on_the_slope(self, rate: float, level: float) -> None:
        made = planner(FOUR_FEET, slope_rate=rate, level_rate=level)
        stride = later(made, at_rest(made), 115)._replace(ground=Ground(slope=0.05j, tilt=0.02 + 0j))
        ground = sampled(made, stride, slope=0.1 + 0j)[0].ground
        assert ground.slope == pytest.approx(0.05j + nearer(rate) * (0.1 - 0.05j))
        assert ground.tilt == pytest.approx(0.02 + nearer(level) * (0.1 - 0.05j - 0.02))

    @pytest.mark.parametrize("gain", [0.0, 0.5, 2.0])
    def test_the_heading_is_held(self, swinging: Stride, gain: float) -> None:
        stride = swinging._replace(trunk=swinging.trunk._replace(desired_heading=0.1))
        now = sampled(planner(heading_gain=gain), stride, heading=0.04)[0]
        assert now.corrections.turn_back == pytest.approx(gain * 0.06)
        assert now.landing.yaw == pytest.approx(gain * 0.06 * 0.3)
        assert sampled(planner(), stride, command=Command(0.2, 0.5))[0].trunk.desired_heading == pytest.approx(0.105)


class TestLimitsOfCorrections:
    """A wrong measurement that lasts changes a correction up to its limit, in both directions, and no further."""

    directions = pytest.mark.parametrize("sign", [1.0, -1.0])

    def learnt_after(self, stride: Stride, samples: int, **measured: Any) -> Corrections:
        """Return the corrections after samples of the same swing, in which something is measured wrongly."""
        made = planner(offset_rate=5.0, lean_integral=5.0, heading_gain=5.0)
        corrections = stride.corrections
        for _ in range(samples):
            now = sampled(made, stride._replace(corrections=corrections), **measured)[0]
            corrections = now.corrections
        return corrections

    @directions
    def test_the_offset_of_the_centre_of_mass(self, swinging: Stride, sign: float) -> None:
        com = swinging.trunk.com + sign * (1.0 - 2.0j)

        corrections = self.learnt_after(swinging, 20, com=com)

        assert corrections.com_offset == sign * (0.03 - 0.03j)  # m

    @directions
    def test_the_lean_of_the_trunk(self, swinging: Stride, sign: float) -> None:
        corrections = self.learnt_after(swinging, 20, lean=sign * 1.0, pitch=-sign * 0.5)

        assert corrections.lean_integral == sign * (-0.15 + 0.15j)  # rad, against the measured lean

    @directions
    def test_the_turn_back(self, swinging: Stride, sign: float) -> None:
        corrections = self.learnt_after(swinging, 1, heading=sign * 1.0)

        assert corrections.turn_back == -sign * 0.3  # rad/s

    @directions
    def test_the_trim_of_the_speed(self, landing: Stride, sign: float) -> None:
        lacks = sign * (1.0 - 1.0j)  # m
        off = landing._replace(swing=landing.swing._replace(place=landing.swing.place - lacks))
        made = planner(speed_integral=1.0)

        now, then = sampled(made, off, touches=True)

        in_stance_frame = then.corrections.speed_trim * turned_by(1j * now.swing.yaw)
        assert in_stance_frame == pytest.approx(sign * (0.15 - 0.1j))  # m/s


class TestFootfalls:
    """How a step ends, and the next one begins."""

    def test_a_foot_that_touches_ends_the_step(self, swinging: Stride) -> None:
        share = swinging.swing.share
        for early, ends in ((share - 0.1, True), (share + 0.2, False)):
            then = sampled(planner(early_touchdown=early), swinging, touches=True)[1]
            assert (then.step.standing != swinging.step.standing) == ends

    @pytest.mark.parametrize("search", [0.1, 0.3])
    def test_a_late_foot_is_sought_and_waited_for(self, landing: Stride, search: float) -> None:
        made, stride, samples = planner(late_touchdown=0.05, search_speed=search), landing, 0
        while stride.step.standing == landing.step.standing:
            stride, samples = sampled(made, stride)[1], samples + 1
            if samples == 3:
                assert stride.ground.height == pytest.approx(-search * 3 * PERIOD)
        assert samples == 6
        assert sampled(planner(late_touchdown=0.0), landing)[1].step.standing != landing.step.standing

    def test_a_foot_that_should_stand_and_hangs_goes_down(self) -> None:
        made = planner(FOUR_FEET, search_speed=0.1, late_touchdown=0.05)
        stride = later(made, at_rest(made), 115)
        now = sampled(made, stride, down=(False, False), hangs=(True, False))[0]
        way = 0.1 * PERIOD
        assert (now.ground.height, now.trunk.rise) == (
            pytest.approx(way / 2),
            pytest.approx(way / 2 * (1 - nearer(5.0))),
        )
        lowered = [(now.ground.tilt.conjugate() * about).real for about in PAIR]
        assert lowered[0] - lowered[1] == pytest.approx(-way * (1 - nearer(5.0)))
        assert sampled(planner(FOUR_FEET, late_touchdown=0), stride, hangs=(True, False))[0].ground.height == 0.0

    def test_an_error_lets_the_foot_lift_before_the_weight_has_come_over(self) -> None:
        made = planner()
        going, settling = (later(made, at_rest(made), samples) for samples in (40 + 30 + 30 + 3, 20))
        assert 0.0 < going.step.time < going.step.transfer == made.steps.transfer
        calm, answers = (sampled(made, going, error)[0] for error in (0j, 0.03j))
        assert calm.step.transfer == going.step.transfer
        assert answers.step.transfer == going.step.time
        assert answers.trunk.zmp == made.steps.rest_points[int(going.step.standing)]
        assert sampled(made, settling, 0.03j)[0].step.transfer == settling.step.transfer  # between two feet it waits
        pairs = planner(FOUR_FEET)
        trots = later(pairs, at_rest(pairs), 40 + 30 + 30 + 3)
        assert sampled(pairs, trots, 0.03j)[0].step.transfer == trots.step.transfer

    def test_an_error_hurries_the_next_step(self, landing: Stride) -> None:
        for limit, transfer in ((0.03, 0.0), (0.05, 0.06)):  # s; 0.05 m are 0.04 m beyond the deadband
            made = planner(hurry_threshold=limit)
            then = sampled(made, landing, 0.05 + 0j, touches=True)[1]
            assert then.step.standing != landing.step.standing
            assert then.step.transfer == pytest.approx(transfer)

    @pytest.mark.parametrize("part", [0.0, 0.2, 1.0])
    def test_a_step_that_was_too_short_is_made_good(self, landing: Stride, part: float) -> None:
        short = landing._replace(swing=landing.swing._replace(place=landing.swing.place - 0.01))
        made = planner(speed_integral=part)
        now, then = sampled(made, short, touches=True)
        lacks = made.steps.plan_landing(1 - int(landing.step.standing), COMMAND).place - now.swing.place
        assert lacks.real > 0.003
        assert then.corrections.speed_trim * turned_by(1j * now.swing.yaw) == pytest.approx(part / 0.3 * lacks)

    def test_who_cannot_step_aside_braces_itself(self, swinging: Stride) -> None:
        error = 0.03j
        kept: dict[str, Any] = {"step_gain": 0.0, "time_weight": 1e6}
        now, then = sampled(planner(brace_threshold=0.02, **kept), swinging, error)
        assert (now.step.active, now.step.brace_time) == (0.0, pytest.approx(0.2))
        assert sampled(planner(brace_threshold=0.04, **kept), swinging, error)[0].step.active
        assert sampled(planner(brace_threshold=None, **kept), swinging, error)[0].step.active
        middle = planner().steps.middle(int(now.step.standing), now.swing.place)
        assert now.trunk.zmp == pytest.approx(middle)
        made = planner(brace_threshold=0.02)
        samples = 0
        while not then.step.active:  # on its feet until it has been over for 0.2 s
            estimate = Estimate(then.trunk.com, then.trunk.zmp, 0.0, 0.0, 0.0, 0j, touches=False)
            then, samples = made.sample(then, COMMAND, estimate, OMEGA)[2], samples + 1
        assert samples == pytest.approx(21, abs=1)


class TestGait:
    """What the keys of the gait itself change."""

    def swung(self, **gait: Any) -> Stride:
        made = planner(gait=gait)
        return later(made, at_rest(made), 40 + 15)

    def test_times(self) -> None:
        first = later(planner(), at_rest(planner()), 1)
        assert first.step.transfer == pytest.approx(0.4)
        assert first.landing.time == pytest.approx(0.7)
        made = planner(gait={"settle": 0.2, "step_time": 0.25, "double_support": 0.4})
        assert later(made, at_rest(made), 1).landing.time == pytest.approx(0.45)
        second = later(made, at_rest(made), 46)
        assert second.landing.time == pytest.approx(0.25)
        assert second.step.transfer == pytest.approx(0.1)

    @pytest.mark.parametrize(("lift", "exponent"), [(0.04, 3.0), (0.05, 1.5)])
    def test_a_foot_rises_as_its_keys_say(self, lift: float, exponent: float) -> None:
        made = planner(gait={"lift": lift, "lift_exponent": exponent})
        now, height, _ = made.sample(later(made, at_rest(made), 40 + 8), COMMAND, None, OMEGA)
        share = now.swing.share
        assert 0.2 < share < 0.4
        assert height == pytest.approx(lift * (4 * share * (1 - share)) ** exponent)

    @pytest.mark.parametrize("peak", [1.5, 1.7, 1.875])
    def test_a_swing_peaks_at_what_its_key_says(self, peak: float) -> None:
        made = planner(gait={"swing_peak": peak, "step_time": 3.0})
        stride, places = at_rest(made), list[complex]()
        while len(places) < 2 or stride.swing.share:
            stride = later(made, stride, 1)
            places += [stride.swing.place] if stride.swing.share else []
        ways = np.abs(np.diff(places))
        assert ways.max() / ways.mean() == pytest.approx(peak, rel=0.02)

    def test_a_foot_is_held_over_the_ground_as_it_lands(self) -> None:
        keys = {"lift": 0.04, "lift_exponent": 1.0}
        low, high = planner(gait=keys), planner(gait=keys, landing_height=0.01)
        stride = later(low, at_rest(low), 40 + 8)
        early = smoothstep(2 * high.sample(stride, COMMAND, None, OMEGA)[0].swing.share)
        assert 0.3 < early < 0.99
        for samples, part in ((0, early), (12, 1.0)):
            now = later(low, stride, samples) if samples else stride
            heights = [made.sample(now, COMMAND, None, OMEGA)[1] for made in (low, high)]
            assert heights[1] - heights[0] == pytest.approx(0.01 * part)

    def test_the_zero_moment_point_rests_where_it_shall(self, swinging: Stride) -> None:
        side = 1.0 if swinging.step.standing == 0 else -1.0
        assert swinging.trunk.zmp == pytest.approx(complex(0.005, side * 0.01))
        made = planner(gait={"zmp_ahead": -0.01, "zmp_inward": 0.02})
        assert later(made, at_rest(made), 115).trunk.zmp == pytest.approx(complex(-0.01, side * 0.02))

    def test_speeds_change_step_by_step(self) -> None:
        made = planner(gait={"max_speed_change": [0.05, 0.02, 10.0]})
        stride, command, found = at_rest(made), Command(0.12 - 0.03j, 0.3), list[Command]()
        for _ in range(4):
            standing = stride.step.standing
            while stride.step.standing == standing:
                stride = later(made, stride, 1, command)
            found.append(stride.step.command)
        ten = np.deg2rad(10.0)
        assert [each.speed for each in found] == pytest.approx([0.1 - 0.03j, 0.12 - 0.03j, 0.12 - 0.03j, 0.12 - 0.03j])
        assert [each.turn for each in found[:2]] == pytest.approx([min(2 * ten, 0.3), 0.3])

    def test_without_turns_no_heading_is_held(self, swinging: Stride) -> None:
        made = planner(gait={"max_speed": {"ahead": 0.4, "backward": 0.2}})
        assert sampled(made, swinging, heading=0.2)[0].corrections.turn_back == 0.0
