"""Forces of a station: their impulses, for any steps of the solver, and errors of their sections."""

from typing import Any

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.results.result import SimulationResult

MASS = 0.9048  # kg, of the ball
FREE = {
    "gravity": 0,
    "pieces.ball.pose": [0, 0, 1, 0, 0, 0],
    "floor": None,
    "contact": None,
    "sensors": {},
}


def ball(
    forces: dict[str, Any], scheme: str = "cenic", *, until: float = 1.0, step: float = 0.1
) -> SimulationResult:
    """Simulate a free ball without weight, with forces by name.

    Args:
        forces: sections of the forces; they act on the ball.
        scheme: integration scheme.
        until: duration of the run [s].
        step: longest step of the solver [s].
    """
    overrides = {
        **FREE,
        "solver.max_step": step,
        "solver.accuracy": 3e-4,
        "solver.scheme": scheme,
        "forces": {name: {"at": "ball", **force} for name, force in forces.items()},
    }
    return simulate(load_station("bouncing_ball", overrides), duration=until, progress=False)


def velocity(result: SimulationResult) -> np.ndarray:
    """Velocity of the ball at the end, shape (3,) [m/s]."""
    return np.array([result[f"piece.ball.v{axis}"][-1] for axis in "xyz"])


@pytest.mark.parametrize(
    "scheme", ["cenic", "radau3", "runge_kutta3", "runge_kutta2", "radau1", "implicit_euler"]
)
def test_a_body_gets_the_whole_impulse_of_a_push(scheme: str) -> None:
    """A scheme that evaluates the force at the end of a step would lose 5 % if no step ended at the edges."""
    force = np.array([3.0, -10.0, 1.0])  # N
    duration = 0.1  # s

    result = ball(
        {"push": {"start": 0.213, "duration": duration, "force": force.tolist()}}, scheme, step=0.01
    )

    np.testing.assert_allclose(velocity(result), force * duration / MASS, rtol=1e-6)


def test_pushes_add_up_where_they_overlap() -> None:
    pushes = {
        "one": {"kind": "push", "start": 0, "duration": 0.2, "force": [1, 0, 0]},
        "two": {"kind": "push", "start": 0.1, "duration": 0.5, "force": [0, 4, 0]},
    }

    result = ball(pushes)

    impulses = np.array([0.2 * 1, 0.5 * 4, 0.0])  # N·s
    np.testing.assert_allclose(velocity(result), impulses / MASS, atol=2e-4)


def test_before_a_push_nothing_moves() -> None:
    result = ball({"push": {"start": 0.5, "force": [1, 1, 1]}}, until=0.5)

    np.testing.assert_array_equal(velocity(result), np.zeros(3))


def test_a_sine_swings_as_its_integral_says() -> None:
    r"""The velocity from rest is :math:`v = a (1 - \cos\omega t) / (m \omega)`."""
    amplitude = 2.0  # N
    frequency = 1.5  # Hz

    result = ball(
        {"sine": {"amplitude": [0, amplitude, 0], "frequency": frequency}}, "radau3", step=0.01
    )

    omega = 2 * np.pi * frequency
    expected_velocity = amplitude * (1 - np.cos(omega * result.times)) / omega / MASS
    expected_force = amplitude * np.sin(omega * result.times)
    np.testing.assert_allclose(result["piece.ball.vy"], expected_velocity, atol=1e-5)
    np.testing.assert_allclose(result["applied_force.sine.y"], expected_force, atol=1e-12)
    assert result.units["applied_force.sine.y"] == "N"


def test_a_floating_robot_is_pushed_at_the_centre_of_mass_of_its_root_by_default() -> None:
    """A push without ``at`` is the same as one at the robot, and another one than at its head."""
    push = {"start": 0, "duration": 0.05, "force": [0, -30, 0]}

    def run(forces: dict[str, Any]) -> SimulationResult:
        config = load_station("humanoid_dynamic", {"forces": forces})
        return simulate(config, duration=0.05, progress=False)

    at_rest = run({})
    by_default = run({"push": push})
    at_robot = run({"push": {**push, "at": "robot"}})
    at_head = run({"push": {**push, "at": "head"}})

    assert by_default["base.y"][-1] < at_rest["base.y"][-1] - 1e-3
    np.testing.assert_array_equal(by_default.values, at_robot.values)
    assert np.abs(at_head["base.y"][-1] - by_default["base.y"][-1]) > 1e-4


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"kind": "push", "start": -0.1, "force": [1, 1, 1]}, r"forces\.f\.start: .*at least 0"),
        (
            {"kind": "push", "duration": 0, "force": [1, 1, 1]},
            r"forces\.f\.duration: .*greater than 0",
        ),
        ({"kind": "push", "force": [1, 1]}, r"forces\.f\.force: "),
        ({"kind": "push", "force": [1, 2, float("nan")]}, r"forces\.f\.force: .*finite"),
        (
            {"kind": "sine", "amplitude": [1, 2, 3], "frequency": 0},
            r"forces\.f\.frequency: .*greater than 0",
        ),
        (
            {"kind": "shove", "force": [1, 1, 1]},
            r"forces\.f\.kind: there is no 'shove'.*push, sine",
        ),
        (
            {"kind": "push", "at": "tool1", "force": [1, 1, 1]},
            r"for forces\.f\.at 'tool1'; did you mean 'tool0'",
        ),
    ],
)
def test_an_invalid_section_is_refused_with_its_cause(
    section: dict[str, Any], message: str
) -> None:
    with pytest.raises(SimrobError, match=message):
        load_station("irb120_dynamic", {"forces.f": section})


def test_a_force_in_a_station_of_several_robots_names_one() -> None:
    with pytest.raises(
        SimrobError, match=r"forces\.push\.at is None; it must be one of left, right"
    ):
        load_station("two_irb120", {"forces.push": {"force": [1, 0, 0]}})


@pytest.mark.parametrize(
    ("key", "value"), [("external_force", {"kind": "sine"}), ("robot.pushes", [{"start": 1}])]
)
def test_errors_of_former_keys_name_the_new_key(key: str, value: Any) -> None:
    with pytest.raises(SimrobError, match=f"{key}.*is now .*forces: "):
        load_station("irb120_dynamic", {key: value})
