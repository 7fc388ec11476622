"""Linear models of stations: against closed forms, finite differences of runs, and how runs swing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydrake.systems.controllers import LinearQuadraticRegulator
from scipy.linalg import expm
from scipy.optimize import least_squares

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import OutputError, SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.linear import LinearModel, linearize
from simrob_drake.extensions.linear.model import bode_figure
from simrob_drake.results.record.state import State
from simrob_drake.simulation import Runner, simulate
from simrob_drake.stations.load import load_station
from tests.stations.test_backlash import rod as loose_rod  # noqa: F401  # a fixture

pytestmark = pytest.mark.usefixtures("no_plots")

POSTURE = np.full(6, np.deg2rad(30.0))
MASS, ARM, INERTIA, KP, KD, DAMPING = (
    2.0,
    0.25,
    0.04,
    60.0,
    1.5,
    0.2,
)  # of a rod of half a metre about a level axis

ROD = f"""
dh:
  convention: classical
  base: [0, 0, 1, 0, 0, 1.5707963267948966]
  rows:
    - {{a: 0.5, limit_deg: [-180, 180], effort: 40, mass: {MASS}, com: [-{ARM}, 0, 0], damping: {DAMPING},
       inertia: [1.0e-3, {INERTIA}, {INERTIA}]}}
axes: {{lift: {{joint: joint_1, sign: -1}}}}
"""


@pytest.fixture
def rod(tmp_path: Path) -> Path:
    (tmp_path / "robot.yaml").write_text(ROD)
    (tmp_path / "rod.yaml").write_text(
        f"robot: {{model: robot.yaml}}\nservo: {{kp: {KP}, kd: {KD}}}\n"
    )
    return tmp_path / "rod.yaml"


@pytest.fixture(scope="module")
def arm() -> LinearModel:
    return linearize("irb120_dynamic", POSTURE)


def test_a_rod_is_its_closed_form(rod: Path) -> None:
    """I q'' = kp (r - q) - (kd + d) q' + m g l cos q + f, of an axis that counts against its joint: downwards."""
    config = load_station(rod, {"inputs": ["external_force", "reference_velocity"]})
    model = linearize(config, [0.3])
    inertia, weight = INERTIA + MASS * ARM**2, MASS * STANDARD_GRAVITY * ARM
    rest = model.x0[0]
    assert KP * (0.3 - rest) + weight * np.cos(rest) == pytest.approx(0, abs=1e-9)
    stiffness = KP + weight * np.sin(rest)
    np.testing.assert_allclose(
        model.A, [[0, 1], [-stiffness / inertia, -(KD + DAMPING) / inertia]], atol=1e-9
    )
    assert model.states == ("q.lift", "v.lift")
    assert model.inputs == (
        "reference.lift",
        "reference_velocity.lift",
        *(f"external_force.{x}" for x in "xyz"),
    )
    np.testing.assert_allclose(
        model.B[1], [KP / inertia, KD / inertia, 0, -0.5 / inertia, 0], atol=1e-9
    )
    assert model.outputs[:3] == ("q.lift", "v.lift", "tau.lift")
    np.testing.assert_allclose(model.part(outputs=["tau"]).C, [[-KP, -KD]], atol=1e-9)
    np.testing.assert_allclose(model.part(outputs=["tau"]).D[0, :2], [KP, KD], atol=1e-9)
    gain = model.part(inputs=["reference"], outputs=["q", "tcp"]).response([0.0])[0, :, 0].real
    # about the level axis, downwards
    moved = [
        -0.5 * np.sin(rest),
        0,
        -0.5 * np.cos(rest),
        0,
        1,
        0,
    ]
    np.testing.assert_allclose(gain, KP / stiffness * np.array([1, *moved]), atol=1e-9)
    mode = model.modes[0]
    omega = np.sqrt(stiffness / inertia)
    assert mode.damping == pytest.approx((KD + DAMPING) / (2 * inertia * omega))
    assert mode.frequency == pytest.approx(omega * np.sqrt(1 - mode.damping**2) / (2 * np.pi))
    assert mode.time_constant == pytest.approx(2 * inertia / (KD + DAMPING))
    assert model.is_stable


def test_a_robot_that_takes_feedforward_rests_where_it_is_asked(rod: Path) -> None:
    config = load_station(rod, {"inputs": ["feedforward"], "servo": {"kp": 0, "kd": 0}})
    model = linearize(config, [0.3])
    assert model.x0 == pytest.approx([0.3, 0.0])
    weight = MASS * STANDARD_GRAVITY * ARM
    assert model.u0[1] == pytest.approx(-weight * np.cos(0.3))
    inertia = INERTIA + MASS * ARM**2
    # the rod hangs below the level, and swings
    roots = np.roots([inertia, DAMPING, weight * np.sin(0.3)])
    np.testing.assert_allclose(np.sort_complex(model.poles), np.sort_complex(roots), atol=1e-9)
    gain, _ = LinearQuadraticRegulator(
        model.A, model.part(inputs=["feedforward"]).B, np.eye(2), np.eye(1)
    )
    assert (np.linalg.eigvals(model.A - model.part(inputs=["feedforward"]).B @ gain).real < 0).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"servo.realization": "implicit"},
        {"servo.realization": "vector", "solver": {"kind": "continuous", "scheme": "cenic"}},
        {
            "servo.realization": "implicit",
            "solver": {"kind": "discrete", "time_step": 1e-3},
            "contact": {},
        },
        {
            "robot.drives.friction": 3.0,
            "solver": {"kind": "continuous", "scheme": "cenic"},
            "monitors": {"fall": None},
        },
    ],
)
def test_it_is_the_same_model_however_the_station_is_solved(
    arm: LinearModel, changes: dict
) -> None:
    changes.pop("monitors", None)
    other = linearize(load_station("irb120_dynamic", changes), POSTURE)
    np.testing.assert_allclose(other.A, arm.A, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other.B, arm.B, rtol=1e-9, atol=1e-9)
    notes = " ".join(other.notes)
    assert ("steps of 0.001 s" in notes) == ("contact:" in notes) == ("contact" in changes)


def test_the_note_on_controllers_says_what_the_input_of_the_model_is() -> None:
    (note,) = [
        note for note in linearize("irb120_force_control").notes if note.startswith("controllers")
    ]
    assert (
        note
        == "controllers: they are not part of the model, whose input is the reference that they would drive"
    )


@pytest.mark.long
def test_it_is_what_runs_do_that_differ_a_little(arm: LinearModel) -> None:
    """Where runs are after 50 ms, by central differences of start and reference, to 1e-5 of the largest.

    Steps of one length, of third order, are within 1e-6 here; their errors are the same on both sides.
    """
    time, step = 0.05, 1e-4
    config = load_station(
        "irb120_dynamic", {"solver.error_control": False, "solver.max_step": 5e-4, "duration": time}
    )
    runner = Runner(config)
    count = len(POSTURE)
    at_rest = runner.run(reference=([0, time], [POSTURE, POSTURE]), progress=False).final_state
    assert at_rest is not None

    def end(state: np.ndarray, reference: np.ndarray) -> np.ndarray:
        q, v = {"robot": state[:count]}, {"robot": state[count:]}
        joints = {
            name: replace(joint, position=state[[place]], velocity=state[[count + place]])
            for place, (name, joint) in enumerate(at_rest.joints.items())
        }
        start: State = replace(at_rest, positions=q, velocities=v, joints=joints)
        run = runner.run(reference=([0, time], [reference, reference]), start=start, progress=False)
        return np.concatenate([run.axes("q")[-1], run.axes("v")[-1]])

    np.testing.assert_allclose(end(arm.x0, POSTURE), arm.x0, rtol=0, atol=1e-8)  # it rests
    moves = step * np.eye(2 * count)
    flow = np.column_stack(
        [(end(arm.x0 + d, POSTURE) - end(arm.x0 - d, POSTURE)) / (2 * step) for d in moves]
    )
    augmented = expm(time * np.block([[arm.A, arm.B], [np.zeros((count, 3 * count))]]))
    np.testing.assert_allclose(flow, augmented[:12, :12], rtol=0, atol=1e-5 * np.abs(flow).max())
    pushes = step * np.eye(count)
    driven = np.column_stack(
        [(end(arm.x0, POSTURE + d) - end(arm.x0, POSTURE - d)) / (2 * step) for d in pushes]
    )
    np.testing.assert_allclose(
        driven, augmented[:12, 12:], rtol=0, atol=1e-5 * np.abs(driven).max()
    )


def test_poles_foretell_how_the_move_swings_out(arm: LinearModel) -> None:
    """Joint 2 after the 30 degree move of a converged run: frequency and decay of the slowest mode within 2 %."""
    slowest = arm.modes[0]
    assert slowest.mostly == "joint_2"
    result = simulate(
        load_station("irb120_dynamic", {"solver.accuracy": 1e-5, "sample_rate": 500}),
        progress=False,
    )
    late = (result.times > 1.4) & (result.times < 2.4)
    times, way = result.times[late] - 1.4, 1e3 * (result["q.joint_2"][late] - arm.x0[1])

    def missed(found: np.ndarray) -> np.ndarray:
        decay, turn, cosine, sine = found
        return (
            np.exp(decay * times) * (cosine * np.cos(turn * times) + sine * np.sin(turn * times))
            - way
        )

    decay, turn, *_ = least_squares(missed, [-1.0, 25.0, 1.0, 1.0]).x
    assert slowest.pole.real == pytest.approx(decay, rel=0.02)
    assert slowest.pole.imag == pytest.approx(turn, rel=0.02)


@pytest.mark.long
def test_it_is_saved_with_names_and_drawn(arm: LinearModel, tmp_path: Path) -> None:
    folder = arm.save(tmp_path / "linear")
    with np.load(folder / "linear.npz") as saved:
        np.testing.assert_array_equal(saved["A"], arm.A)
        assert saved["inputs"].tolist() == list(arm.inputs)
    told = yaml.safe_load((folder / "linear.yaml").read_text())
    assert told["modes"][0]["pole"] == [arm.modes[0].pole.real, arm.modes[0].pole.imag]
    assert (folder / "bode.png").stat().st_size > 10_000
    with pytest.raises(OutputError, match="--force"):
        arm.save(folder)
    figure = bode_figure(arm, [("reference.joint_2", "q.joint_2")])
    frequencies, size = figure.axes[0].lines[0].get_data()
    expected = 20 * np.log10(np.abs(arm.response(frequencies)[:, 1, 1]))
    np.testing.assert_allclose(size, expected, atol=1e-9)
    # flat below all poles
    assert size[0] == pytest.approx(20 * np.log10(abs(arm.response([0])[0, 1, 1])), abs=0.5)
    shape = arm.system().get_output_port().size(), arm.system().get_input_port().size()
    assert shape == (len(arm.outputs), len(arm.inputs))


def test_two_arms_and_integrators_have_names_of_their_own() -> None:
    two = linearize("two_irb120")
    assert {"left.q.joint_1", "right.v.joint_6"} <= set(two.states)
    assert "right.tcp.z" in two.outputs
    integral = linearize(
        load_station("irb120_dynamic", {"servo.ki": 100, "servo.realization": "vector"}), POSTURE
    )
    assert integral.states[12] == "servo.integrator.0"
    np.testing.assert_allclose(integral.x0[:6], POSTURE, atol=1e-9)  # it does not sag


@pytest.mark.long
def test_the_command_prints_poles_and_saves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "linear"
    command = [
        "linearize",
        "irb120_dynamic",
        "--out",
        str(folder),
        "--set",
        "robot.drives.friction=2",
    ]
    assert run_command([*command, "--at", "{joint_2: 30, joint_3: 20}"]) == 0
    out = capsys.readouterr().out
    model = linearize("irb120_dynamic", np.deg2rad([0, 30, 20, 0, 0, 0]))
    assert f"{model.modes[0].frequency:.3f}" in out
    assert "irb120_dynamic: stable" in out
    assert "left out: Coulomb friction" in out
    with np.load(folder / "linear.npz") as saved:
        np.testing.assert_allclose(saved["A"], model.A, atol=1e-12)
    assert run_command([*command, "--at", "30"]) == 2  # it is there
    for wrong, told in (
        ("[1, 2]", "6 numbers"),
        ("{joint_9: 1}", "joint_6"),
        ("fast", "numbers per axis"),
    ):
        assert run_command([*command, "--force", "--at", wrong]) == 2
        assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("station", "changes", "at", "message"),
    [
        ("irb120_kinematic", {}, None, "dynamic"),
        ("bouncing_ball", {}, None, "with robots"),
        ("humanoid_dynamic", {}, None, "fixed base"),
        (
            "irb120_dynamic",
            {"servo.torque_limit": 2},
            POSTURE,
            "joint_2 takes 20.79 N·m, and has 2",
        ),
        ("irb120_dynamic", {"servo.kp": 0}, POSTURE, "raise servo.kp, or list feedforward"),
        ("irb120_dynamic", {}, np.full(6, 4.0), "within the joint limits"),
        ("irb120_dynamic", {}, {"left": POSTURE}, "robot"),
        ("two_irb120", {}, POSTURE, "left"),
    ],
)
def test_what_cannot_be_is_told(station: str, changes: dict, at: object, message: str) -> None:
    with pytest.raises(SimrobError, match=message):
        linearize(load_station(station, changes), at)  # type: ignore[arg-type]


def test_names_of_ports_are_known(arm: LinearModel) -> None:
    with pytest.raises(SimrobError, match="reference"):
        arm.part(inputs=["referenze"])
    with pytest.raises(SimrobError, match="finite"):
        arm.response("fast")


def test_play_between_motor_and_link_is_left_out_with_a_note(loose_rod):  # noqa: F811
    model = linearize(load_station(loose_rod))
    assert len(model.states) == 2
    assert "backlash" in model.notes[0]
