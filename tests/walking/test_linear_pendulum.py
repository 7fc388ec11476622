"""Footsteps: the divergent component in closed form against its differential equation, and adjusted landings."""

from cmath import exp
from math import pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simrob_drake.robots.catalog import load_robot
from simrob_drake.walking.parameters import WalkingParameters, load_walking
from simrob_drake.walking.steps import Command, DivergentComponent, Landing, Steps, weights

OMEGA = 5.2  # 1/s
STEP_TIME = 0.4  # s
HALF_WIDTH = 0.06  # m


def load_parameters(**changes: object) -> WalkingParameters:
    """Load the parameters of ZJUDancer's walk, with changes."""
    return load_walking(load_robot("zjudancer"), changes)


@pytest.fixture(scope="module")
def steps() -> Steps:
    return Steps(load_parameters(step_time=STEP_TIME, double_support=0.2), HALF_WIDTH)


@pytest.mark.parametrize(("time", "transfer"), [(0.4, 0.1), (0.3, 0.3), (0.5, 0.0)])
def test_weights_solve_the_differential_equation(time: float, transfer: float) -> None:
    zmp_start, zmp_end, xi_end = 0.03, -0.02, 0.05  # m
    step_weights = weights(OMEGA, time, transfer)
    xi_start = (
        step_weights.start * zmp_start + step_weights.rest * zmp_end + step_weights.end * xi_end
    )

    def rate(now: float, xi: np.ndarray) -> np.ndarray:
        """Rate of the divergent component [m/s]: omega (xi - p), with p on a straight line, then at rest."""
        share = min(now / transfer, 1.0) if transfer else 1.0
        return OMEGA * (xi - zmp_start - share * (zmp_end - zmp_start))

    solution = solve_ivp(rate, (0, time), [xi_start], rtol=1e-10, atol=1e-12, max_step=0.01)

    assert solution.y[0, -1] == pytest.approx(xi_end, abs=1e-7)
    assert sum(step_weights) == pytest.approx(1.0)


def test_a_prediction_is_the_inverse_of_the_weights() -> None:
    state = DivergentComponent(
        0.02 + 0.01j, OMEGA, now=0.05, lift_off=0.1, zmp=0.01j, rest=0.01 - 0.02j
    )

    xi_end = state.at(0.35)

    step_weights = weights(OMEGA, 0.35 - 0.05, 0.1 - 0.05)
    xi_start = (
        step_weights.start * state.zmp + step_weights.rest * state.rest + step_weights.end * xi_end
    )
    assert xi_start == pytest.approx(state.xi)


@pytest.mark.parametrize(
    "command", [Command(), Command(0.2 + 0.03j), Command(0.1, 0.4), Command(-0.1)]
)
def test_a_step_ends_where_the_next_one_begins(steps: Steps, command: Command) -> None:
    """The condition at the landing, seen from the next foot, is the start of the next step."""
    landing = steps.plan_landing(1, command)
    turn = exp(1j * landing.yaw)
    step_weights = weights(OMEGA, landing.time, steps.transfer)

    xi_end = steps.dcm_at_landing(0, command, OMEGA).dcm_for(landing.place)

    zmp_from_next_foot = (steps.rest_points[0] - landing.place) / turn
    xi_from_next_foot = (xi_end - landing.place) / turn
    expected = steps.dcm_at_start(1, command, step_weights, zmp_from_next_foot)
    assert xi_from_next_foot == pytest.approx(expected, abs=1e-12)


def test_steps_far_ahead_change_little(steps: Steps) -> None:
    command = Command(0.2 + 0.03j)
    step_weights = weights(OMEGA, STEP_TIME, steps.transfer)

    usual = steps.dcm_at_start(1, command, step_weights, -0.1j)
    further = steps.dcm_at_start(1, command, step_weights, -0.1j, 12)

    assert abs(usual - further) < 2e-4  # m


def test_the_middle_of_the_robot_moves_and_turns_by_the_command(steps: Steps) -> None:
    quarter_turn = Command(0.3, pi / 2 / STEP_TIME)

    landing = steps.plan_landing(1, quarter_turn)

    # The middle is to the right of the left foot, by half of the distance between the feet.
    middle = landing.place - exp(1j * landing.yaw) * HALF_WIDTH * 1j
    assert landing.yaw == pytest.approx(pi / 2)
    assert middle == pytest.approx(0.3 * STEP_TIME + HALF_WIDTH * 1j)


def test_a_condition_and_its_foothold_are_inverse(steps: Steps) -> None:
    condition = steps.dcm_at_landing(0, Command(0.2 + 0.03j, 0.3), OMEGA)
    foothold = 0.1 + 0.15j

    assert condition.foothold_for(condition.dcm_for(foothold)) == pytest.approx(foothold)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_command_changes_by_its_largest_change(sign: int) -> None:
    """The largest change of the turning speed is in degrees per second."""
    target = Command(sign * (0.3 - 0.2j), sign * 1.0)

    command = Command().approach(target, (0.06, 0.03, 15.0))

    assert command.speed == pytest.approx(sign * (0.06 - 0.03j))
    assert command.turn == pytest.approx(sign * pi / 12)


class TestAdjustedLandings:
    """Change of a landing by an error of the divergent component, after the weight transfer."""

    command = Command(0.2 + 0j)

    def adjust(
        self, steps: Steps, error: complex, standing: int = 0, now: float = 0.15
    ) -> tuple[Landing, Landing]:
        """Adjust a landing to an error: the planned landing, and the adjusted one."""
        rest = steps.rest_points[standing]
        planned = steps.plan_landing(1 - standing, self.command)
        condition = steps.dcm_at_landing(standing, self.command, OMEGA)
        step_weights = weights(OMEGA, planned.time - now, 0.0)
        xi = step_weights.rest * rest + step_weights.end * condition.dcm_for(planned.place)
        state = DivergentComponent(xi + error, OMEGA, now, steps.transfer, rest, rest)
        half_way = planned.place / 2
        return planned, steps.adjust_landing(1 - standing, planned, state, half_way, condition)

    def test_without_an_error_the_landing_is_as_planned(self, steps: Steps) -> None:
        planned, adjusted = self.adjust(steps, 0j)

        assert adjusted.time == planned.time
        assert adjusted.place == pytest.approx(planned.place, abs=1e-9)

    def test_the_foot_steps_in_the_direction_of_the_error(self, steps: Steps) -> None:
        planned, ahead = self.adjust(steps, 0.012 + 0j)
        _, left = self.adjust(steps, 0.012j)

        assert planned.place.real < ahead.place.real <= 0.15
        assert planned.place.imag < left.place.imag <= 0.2

    @pytest.mark.parametrize("error", [0.5 + 0j, -0.5 + 0j, 0.5j, -0.5j])
    @pytest.mark.parametrize(("standing", "side"), [(0, 1), (1, -1)])
    def test_footholds_stay_within_their_region(
        self, steps: Steps, error: complex, standing: int, side: int
    ) -> None:
        region = load_parameters().foothold

        _, adjusted = self.adjust(steps, error, standing, now=0.1)

        place = adjusted.place
        assert region.inner - 1e-9 <= side * place.imag <= region.outer + 1e-9
        assert -region.behind - 1e-9 <= place.real <= region.ahead + 1e-9

    def test_a_foot_is_not_faster_than_its_limit(self, steps: Steps) -> None:
        planned, adjusted = self.adjust(steps, 0.1 + 0j, now=0.35)

        distance = abs(adjusted.place - planned.place / 2)
        assert distance <= 1.5 * (adjusted.time - 0.35) + 1e-9

    def test_a_large_error_makes_the_step_shorter_in_time(self, steps: Steps) -> None:
        planned, adjusted = self.adjust(steps, 0.05 + 0j, now=0.1)

        assert adjusted.time < planned.time

    def test_the_path_of_a_foot_begins_at_lift_off(self, steps: Steps) -> None:
        """The time until lift-off is no time of the swing."""
        planned = steps.plan_landing(1, self.command)
        condition = steps.dcm_at_landing(0, self.command, OMEGA)
        rest = steps.rest_points[0]
        far_away = DivergentComponent(1.0 + 1.0j, OMEGA, now=0.0, lift_off=0.3, zmp=rest, rest=rest)
        foot = steps.standing_places[1]

        adjusted = steps.adjust_landing(1, planned, far_away, foot, condition)

        assert abs(adjusted.place - foot) <= 1.5 * (adjusted.time - 0.3) + 1e-9
        assert adjusted.place != foot
