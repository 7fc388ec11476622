"""The divergent component in closed form against its differential equation, and footsteps that keep a walk in step."""

from cmath import exp
from math import pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simrob_drake.robots.catalog import load_robot
from simrob_drake.walking.parameters import WalkingParameters, load_walking
from simrob_drake.walking.steps import Command, DivergentComponent, Landing, Steps, weights

OMEGA = 5.2


def figures(**changes: object) -> WalkingParameters:
    return load_walking(load_robot("zjudancer"), changes)


@pytest.fixture(scope="module")
def steps() -> Steps:
    return Steps(figures(step_time=0.4, double_support=0.2), 0.06)


@pytest.mark.parametrize(("time", "transfer"), [(0.4, 0.1), (0.3, 0.3), (0.5, 0.0)])
def test_weights_are_those_of_the_differential_equation(time: float, transfer: float) -> None:
    first, last, end = 0.03, -0.02, 0.05
    told = weights(OMEGA, time, transfer)
    start = told.start * first + told.rest * last + told.end * end

    def rate(now: float, xi: np.ndarray) -> np.ndarray:
        share = min(now / transfer, 1.0) if transfer else 1.0
        return OMEGA * (xi - first - share * (last - first))

    whole = solve_ivp(rate, (0, time), [start], rtol=1e-10, atol=1e-12, max_step=0.01)
    assert whole.y[0, -1] == pytest.approx(end, abs=1e-7)
    assert sum(told) == pytest.approx(1.0)


def test_a_component_goes_where_its_equation_says() -> None:
    now = DivergentComponent(0.02 + 0.01j, OMEGA, 0.05, 0.1, 0.01j, 0.01 - 0.02j)
    there = now.at(0.35)
    told = weights(OMEGA, 0.3, 0.05)
    assert told.start * now.zmp + told.rest * now.rest + told.end * there == pytest.approx(now.xi)


@pytest.mark.parametrize("command", [Command(), Command(0.2 + 0.03j), Command(0.1, 0.4), Command(-0.1)])
def test_a_step_as_planned_ends_where_the_next_one_begins(steps: Steps, command: Command) -> None:
    """Seen from the next foot, the component is that of the same step a foot later; looking three steps ahead."""
    here, landing = steps.rest_points[0], steps.plan_landing(1, command)
    turn = exp(1j * landing.yaw)
    a, b = steps.dcm_at_landing(0, command, OMEGA)
    end = (1 - a) * landing.place + b
    parts = weights(OMEGA, landing.time, steps.transfer)
    then = steps.dcm_at_start(1, command, parts, (here - landing.place) / turn)
    assert (end - landing.place) / turn == pytest.approx(then, abs=1e-12)
    further = steps.dcm_at_start(1, command, parts, (here - landing.place) / turn, 12)
    assert abs(then - further) < 2e-4


def test_commands_turn_and_walk_about_the_middle_of_the_feet(steps: Steps) -> None:
    landing = steps.plan_landing(1, Command(0.3, pi / 2 / 0.4))
    middle = landing.place - exp(1j * landing.yaw) * 0.06j
    assert (middle, landing.yaw) == (pytest.approx(0.12 + 0.06j), pytest.approx(pi / 2))


class TestAdjustedLandings:
    """What an error changes."""

    command = Command(0.2 + 0j)

    def landing(self, steps: Steps, error: complex, standing: int = 0, now: float = 0.15) -> tuple[Landing, Landing]:
        rest, planned = steps.rest_points[standing], steps.plan_landing(1 - standing, self.command)
        after = steps.dcm_at_landing(standing, self.command, OMEGA)
        told = weights(OMEGA, planned.time - now, 0.0)
        own = told.rest * rest + told.end * ((1 - after[0]) * planned.place + after[1])
        state = DivergentComponent(own + error, OMEGA, now, steps.transfer, rest, rest)
        return planned, steps.adjust_landing(1 - standing, planned, state, planned.place / 2, after)

    def test_none_without_an_error(self, steps: Steps) -> None:
        planned, found = self.landing(steps, 0j)
        assert (found.time, found.place) == (planned.time, pytest.approx(planned.place, abs=1e-9))

    def test_the_foot_goes_after_the_robot(self, steps: Steps) -> None:
        planned, found = self.landing(steps, 0.012 + 0j)
        assert planned.place.real < found.place.real <= 0.15
        planned, found = self.landing(steps, 0.012j)
        assert planned.place.imag < found.place.imag <= 0.2

    def test_feet_do_not_cross_nor_leave_their_reach(self, steps: Steps) -> None:
        reach = figures().foothold
        for error in (0.5 + 0j, -0.5 + 0j, 0.5j, -0.5j):
            for standing, side in ((0, 1), (1, -1)):
                found = self.landing(steps, error, standing, now=0.1)[1].place
                assert reach.inner - 1e-9 <= side * found.imag <= reach.outer + 1e-9
                assert -reach.behind - 1e-9 <= found.real <= reach.ahead + 1e-9

    def test_no_foot_is_faster_than_it_can(self, steps: Steps) -> None:
        planned, found = self.landing(steps, 0.1 + 0j, now=0.35)
        assert abs(found.place - planned.place / 2) <= 1.5 * (found.time - 0.35) + 1e-9

    def test_a_large_error_hurries_the_step(self, steps: Steps) -> None:
        planned, found = self.landing(steps, 0.05 + 0j, now=0.1)
        assert found.time < planned.time
