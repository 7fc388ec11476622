"""Networks of motors, gear boxes and circuits, against their equations."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from slx_files import (
    FROM_PHYSICS,
    INERTIA,
    MECHANISM,
    REVOLUTE,
    TO_PHYSICS,
    WORLD,
    Level,
    write_model,
)

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidModel
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.signals.descriptors import reduced, without_fast
from simrob_drake.extensions.simulink.simulink_model import read_simulink
from simrob_drake.extensions.simulink.writing.references import over_time

ELECTRICAL = "fl_lib/Electrical/Electrical Elements/"
TIGHT = {"solver.accuracy": 1e-7, "solver.max_step": 0.002}


def hinge():
    """A level with a hinge of 0.5 kg m² that a torque drives, without gravity; and the hinge."""
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block(
        REVOLUTE, "J", TorqueActuationMode="InputTorque", SenseVelocity="on")  # fmt: skip
    level.block(MECHANISM, "Nothing", UniformGravity="None")
    body = level.block(INERTIA, "Wheel", Mass="1", MomentsOfInertia="[0.5 0.5 0.5]")
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{body}#rconn:1")
    return level, joint


def faced(level, joint, what="Rotational"):
    """An interface of a network on a joint, which takes what drives it and gives its speed."""
    face = level.block(f"fl_lib/Mechanical/Multibody Interfaces/{what} Multibody Interface", "Face")
    level.connect(f"{face}#lconn:1", f"{joint}#lconn:2")
    level.connect(f"{face}#rconn:1", f"{joint}#rconn:2")
    return face


def motor_on_a_joint(level, torque, speed, *, swap=False, kind="Voltage", **figures):
    """A source of a kind, a DC motor and a gear box of 5 between a joint's speed and its torque; return the source."""
    ports = {"Left": [{"id": "C"}, {"id": "t"}], "Right": [{"id": "R"}, {"id": "w"}]}
    told = {"InternalSimscapePortConfiguration": json.dumps(ports)} if swap else {}
    source = level.block(f"fl_lib/Electrical/Electrical Sources/Controlled {kind} Source", "Source")
    ground = level.block(f"{ELECTRICAL}Electrical Reference", "Ground")
    held = level.block(
        "fl_lib/Mechanical/Rotational Elements/Mechanical Rotational Reference", "Held"
    )
    figures = {"Ra": "2", "La": "0.02", "Kv": "7", "Ki": "0.3", "J": "40", "J_unit": "g*cm^2", "lam": "0.001",
               "emf_or_torque": "ee.enum.emf_or_torque.ki", **figures}  # fmt: skip
    motor = level.block("ee_lib/Electromechanical/Brushed Motors/DC Motor", "Motor", **figures)
    gear = level.block("fl_lib/Mechanical/Mechanisms/Gear Box", "Gear", ratio="5", ratio_unit="1")
    face = level.block(
        "fl_lib/Mechanical/Multibody Interfaces/Rotational Multibody Interface", "Face", **told
    )
    t, c, w, r = (
        ("lconn:2", "lconn:1", "rconn:2", "rconn:1")
        if swap
        else ("lconn:1", "lconn:2", "rconn:1", "rconn:2")
    )
    level.connect(f"{source}#lconn:1", f"{motor}#lconn:1")
    level.connect(f"{source}#rconn:2", f"{motor}#rconn:1", f"{ground}#lconn:1")
    level.connect(f"{motor}#lconn:2", f"{gear}#lconn:1")
    level.connect(f"{motor}#rconn:2", f"{held}#lconn:1", f"{face}#{c}")
    level.connect(f"{gear}#rconn:1", f"{face}#{r}")
    level.connect(f"{face}#{t}", torque)
    level.connect(f"{face}#{w}", speed)
    return f"{source}#rconn:1"


def driven(tmp_path, **options):
    """A hinge of 0.5 kg m² without gravity, driven by 12 V."""
    level, joint = hinge()
    volts, into = (
        level.block("Constant", "Volts", Value="12"),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    level.wire(f"{volts}#out:1", f"{into}#in:1")
    level.connect(
        f"{into}#rconn:1",
        motor_on_a_joint(level, f"{joint}#lconn:2", f"{joint}#rconn:2", **options),
    )
    return import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out", force=True)


def speeds(times, inertia=0.5, resistance=2.0, inductance=0.02):
    """R i + L i' + K 5 w = 12, (I + 25 J) w' = 5 (K i - b 5 w)."""

    def rates(_, state):
        current, speed = state
        return [(12 - resistance * current - 1.5 * speed) / inductance,
                (1.5 * current - 0.025 * speed) / (inertia + 25 * 4e-6)]  # fmt: skip

    return solve_ivp(
        rates, (0, times[-1]), [0, 0], t_eval=times, rtol=1e-10, atol=1e-12, method="Radau"
    ).y[1]


@pytest.mark.parametrize("swap", [False, True], ids=["by default", "as the file tells"])
def test_a_motor_turns_a_joint(tmp_path, swap):
    imported = driven(tmp_path, swap=swap)
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=1.0, progress=False)
    np.testing.assert_allclose(result["v.J"], speeds(result.times), atol=2e-5)


def test_a_source_pushes_current_out_at_its_positive_pin(tmp_path):
    """As one of voltage does: 12 A through the motor, (I + 25 J) w' = 5 (K i - b 5 w), whatever its resistance is."""
    imported = driven(tmp_path, kind="Current")
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=1.0, progress=False)
    expected = 18 / 0.025 * -np.expm1(-0.025 / (0.5 + 25 * 4e-6) * result.times)
    np.testing.assert_allclose(result["v.J"], expected, rtol=1e-4, atol=1e-5)


def test_a_rotor_is_felt_as_inertia(tmp_path):
    """40 g cm² behind a gear of 5 are 1e-4 kg m² at the joint, exactly: no filtered acceleration."""
    imported = driven(tmp_path)
    assert (
        "rotor_inertia: {J: 0.0001}" in (imported.station.parent / "a" / "robot.yaml").read_text()
    )
    assert imported.report.of("approximated") == []


def test_what_settles_at_once_is_where_it_comes_to(tmp_path):
    imported = driven(tmp_path, La="1e-5")
    assert "settles within 0.0001 s" in imported.report.of("approximated")[0].text
    result = simulate(load_station(imported.station, TIGHT), duration=1.0, progress=False)
    np.testing.assert_allclose(result["v.J"], speeds(result.times, inductance=1e-5), atol=2e-4)
    assert "state_space" not in imported.station.read_text()


def test_a_network_that_is_joined_with_no_body_is_no_loss(tmp_path):
    """What a scope alone shows; where a joint takes it, what is not read of it is lost as before."""
    for lost, taken in enumerate((False, True)):
        level, joint = hinge()
        battery = level.block("ee_lib/Sources/Supercapacitor", "Battery")
        ground = level.block(f"{ELECTRICAL}Electrical Reference", "Ground")
        sensor = level.block("fl_lib/Electrical/Electrical Sensors/Voltage Sensor", "Sensor")
        level.connect(f"{battery}#lconn:1", f"{sensor}#lconn:1")
        level.connect(f"{battery}#rconn:1", f"{sensor}#rconn:2", f"{ground}#lconn:1")
        out, into = (
            level.block(FROM_PHYSICS, "Out", Unit="1"),
            level.block(TO_PHYSICS, "In", Unit="1"),
        )
        level.connect(f"{sensor}#rconn:1", f"{out}#lconn:1")
        torque = level.block("Constant", "Torque", Value="3")
        level.wire(f"{out if taken else torque}#out:1", f"{into}#in:1")
        level.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
        imported = import_simulink(
            write_model(tmp_path / "a.slx", level), tmp_path / "out", force=True
        )
        fates = {one.path: one.fate for one in imported.outcomes}
        assert {fates[name] for name in ("Battery", "Ground", "Sensor")} == {
            ("ignored", "lost")[lost]
        }
        assert ("Supercapacitor" in imported.fidelity) == bool(lost)
        assert (
            imported.fidelity == "mechanics complete; 3 network blocks joined with no body"
        ) != bool(lost)


@pytest.mark.parametrize(("sense", "sign"), [("same", 1.0), ("opposite", -1.0)])
def test_a_simple_gear_turns_a_joint(tmp_path, sense, sign):
    """2 N·m at its base, the follower at a hinge of 0.5 kg m²: the base turns three times as fast."""
    level, joint = hinge()
    torque, into = (
        level.block("Constant", "Torque", Value="2"),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    source = level.block("fl_lib/Mechanical/Mechanical Sources/Ideal Torque Source", "Source")
    held = level.block(
        "fl_lib/Mechanical/Rotational Elements/Mechanical Rotational Reference", "Held"
    )
    face = faced(level, joint)
    gear = level.block("sdl_lib/Gears/Simple Gear", "Gear", ratio="3", enable_backlash="false",
                       friction_model="sdl.enum.gear_efficiencies_load.off",
                       rotation_direction=f"sdl.enum.shaftOutputDirection.{sense}", mu_visc="[0, 0]")  # fmt: skip
    level.wire(f"{torque}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{source}#rconn:1")
    level.connect(f"{source}#lconn:1", f"{gear}#lconn:1")
    level.connect(f"{gear}#rconn:1", f"{face}#rconn:2")
    level.connect(f"{source}#rconn:2", f"{held}#lconn:1", f"{face}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=0.5, progress=False)
    np.testing.assert_allclose(result["v.J"], sign * 2 * 3 / 0.5 * result.times, atol=1e-5)


@pytest.mark.parametrize(
    "figures", [{"radius": "4", "radius_unit": "cm"}, {"R": "0.04", "or": "1"}]
)
def test_a_force_on_a_wheel_turns_its_axle(tmp_path, figures):
    """5 N at 40 mm on a hinge of 0.5 kg m², whatever the file calls the radius."""
    level, joint = hinge()
    force, into = (
        level.block("Constant", "Force", Value="5"),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    source = level.block("fl_lib/Mechanical/Mechanical Sources/Ideal Force Source", "Source")
    ground = level.block(
        "fl_lib/Mechanical/Translational Elements/Mechanical Translational Reference", "Ground"
    )
    held = level.block(
        "fl_lib/Mechanical/Rotational Elements/Mechanical Rotational Reference", "Held"
    )
    wheel, face = (
        level.block("fl_lib/Mechanical/Mechanisms/Wheel and Axle", "Wheel", **figures),
        faced(level, joint),
    )
    level.wire(f"{force}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{source}#rconn:1")
    level.connect(f"{source}#lconn:1", f"{wheel}#rconn:1")
    level.connect(f"{source}#rconn:2", f"{ground}#lconn:1")
    level.connect(f"{wheel}#lconn:1", f"{face}#rconn:2")
    level.connect(f"{face}#lconn:2", f"{held}#lconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=0.5, progress=False)
    np.testing.assert_allclose(result["v.J"], 5 * 0.04 / 0.5 * result.times, atol=1e-5)


@pytest.mark.parametrize("bound", [
    {"torque_speed_param": "ee.enum.electromech.envelope.torque_power", "torque_max": "0.3", "power_max": "6"},
    {"torque_speed_param": "1", "T_t": "[0.3 0.2 0]", "w_t": "[0 200 400]", "w_t_unit": "rpm"},
], ids=["power", "table"])  # fmt: skip
def test_a_motor_with_its_drive_follows_its_torque_within_its_bounds(tmp_path, bound):
    """0.5 N·m are asked for 1 s and -0.1 N·m then, by a gear of 8, of a motor that a battery feeds."""
    level, joint = hinge()
    asked = level.block("Step", "Asked", Time="1", Before="0.5", After="-0.1")
    into = level.block(TO_PHYSICS, "In", Unit="1")
    motor = level.block("ee_lib/Electromechanical/Motor & Drive\n(System Level)", "Motor", Tc="0.05", J="3e-5",
                        lam="1e-4", **bound)  # fmt: skip
    battery = level.block("batteryecm_lib/Battery", "Battery", Vnom="12", R1="2")
    ground = level.block(f"{ELECTRICAL}Electrical Reference", "Ground")
    held = level.block(
        "fl_lib/Mechanical/Rotational Elements/Mechanical Rotational Reference", "Held"
    )
    gear, face = (
        level.block("fl_lib/Mechanical/Mechanisms/Gear Box", "Gear", ratio="8"),
        faced(level, joint),
    )
    level.wire(f"{asked}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{motor}#lconn:2")
    level.connect(f"{battery}#lconn:1", f"{motor}#lconn:1")
    level.connect(f"{battery}#rconn:1", f"{motor}#rconn:1", f"{ground}#lconn:1")
    level.connect(f"{motor}#lconn:3", f"{gear}#lconn:1")
    level.connect(f"{gear}#rconn:1", f"{face}#rconn:2")
    level.connect(f"{motor}#rconn:3", f"{held}#lconn:1", f"{face}#lconn:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=2.0, progress=False)

    def rates(time, state):
        torque, speed = state
        turns = abs(8 * speed)
        most = (np.interp(turns, np.array([0, 200, 400]) * np.pi / 30, [0.3, 0.2, 0.0]) if "T_t" in bound
                else min(0.3, 6 / max(turns, 1e-9)))  # fmt: skip
        return [(np.clip(0.5 if time < 1 else -0.1, -most, most) - torque) / 0.05,
                8 * (torque - 1e-4 * 8 * speed) / (0.5 + 64 * 3e-5)]  # fmt: skip

    first = solve_ivp(
        rates, (0, 1), [0, 0], rtol=1e-9, atol=1e-11, max_step=1e-3, dense_output=True
    )
    second = solve_ivp(
        rates, (1, 2), first.y[:, -1], rtol=1e-9, atol=1e-11, max_step=1e-3, dense_output=True
    )
    expected = np.where(result.times < 1, first.sol(result.times)[1], second.sol(result.times)[1])
    assert np.ptp(expected) > 2
    np.testing.assert_allclose(result["v.J"], expected, atol=2e-3)


def test_a_law_without_its_figures_or_signal_is_lost_by_name(tmp_path):
    for kind, lacking in (
        ("Motor & Drive (System Level)", "Tr"),
        ("Rotational Friction", "brkwy_trq"),
    ):
        level, joint = hinge()
        part, face = (
            level.block(f"ee_lib/Some/{kind}", "Part", J="1", lam="0", Tc="1"),
            faced(level, joint),
        )
        number = 3 if lacking == "Tr" else 1
        level.connect(f"{part}#lconn:{number}", f"{face}#rconn:2")
        level.connect(f"{part}#rconn:{number}", f"{face}#lconn:2")
        lost = import_simulink(
            write_model(tmp_path / "a.slx", level), tmp_path / "out", force=True
        ).report.of("lost")
        assert any(f"Part: {lacking} is neither a figure of it" in entry.text for entry in lost)


def test_a_network_with_what_is_not_linear_is_lost_by_name(tmp_path):
    level, joint = hinge()
    source = motor_on_a_joint(level, f"{joint}#lconn:2", f"{joint}#rconn:2").partition("#")[0]
    diode = level.block("fl_lib/Electrical/Electrical Elements/Diode", "D")
    level.connect(f"{source}#lconn:1", f"{diode}#lconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    lost = {entry.element: entry.text for entry in imported.report.of("lost")}
    assert (
        lost["Motor"]
        == "its network is not read: D: a Diode in a network: it is not linear, or not read"
    )
    assert {"Motor", "Gear", "Face", "Source"} <= lost.keys()
    assert "1 drive" in imported.fidelity
    assert "DC Motor" in imported.fidelity


def test_an_element_whose_ports_have_other_names_is_lost_by_name(tmp_path):
    ports = {
        "InternalSimscapePortConfiguration": json.dumps(
            {"Left": [{"id": "head"}], "Right": [{"id": "tail"}]}
        )
    }
    level, joint = hinge()
    source = motor_on_a_joint(level, f"{joint}#lconn:2", f"{joint}#rconn:2").partition("#")[0]
    resistor = level.block(f"{ELECTRICAL}Resistor", "Other", R="1", **ports)
    level.connect(f"{source}#lconn:1", f"{resistor}#lconn:1")
    lost = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out").report.of(
        "lost"
    )
    assert any(
        "Other: its ports are head, tail, none of which is p" in entry.text for entry in lost
    )


def test_rows_that_do_not_determine_what_is_told_are_none():
    """x' = u is told, a sum of two unknowns is, but neither of them; a rate of a rate is not, either."""
    one, zero = np.eye(1), np.zeros((1, 1))
    assert reduced(one, zero, one, one).b.tolist() == [[1.0]]
    assert reduced(np.zeros((1, 2)), np.ones((1, 2)), one, np.ones((1, 2))).d[0].tolist() == [
        [-1.0]
    ]
    assert reduced(np.zeros((1, 2)), np.ones((1, 2)), one, np.eye(1, 2)) is None
    # x1 = u, x2 = x1', x3 = x2'
    rates = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert reduced(rates, np.eye(3), np.array([[-1.0], [0], [0]]), np.array([[0.0, 1, 0]])).d[
        1
    ].tolist() == [[1.0]]
    assert reduced(rates, np.eye(3), np.array([[-1.0], [0], [0]]), np.array([[0.0, 0, 1]])) is None


def test_fast_states_are_left_out_and_slow_ones_stay():
    """x1' = -x1 + u and x2' = -1e6 (x2 - x1 - u): y = x1 + x2 is 2 x1 + u."""
    full = reduced(
        np.eye(2), np.array([[-1.0, 0], [1e6, -1e6]]), np.array([[1.0], [1e6]]), np.ones((1, 2))
    )
    slow = without_fast(full)
    assert slow.a == pytest.approx(np.array([[-1.0]]), rel=1e-5)
    assert (slow.c @ slow.b)[0, 0] == pytest.approx(2.0, rel=1e-5)
    assert slow.d[0][0, 0] == pytest.approx(1.0, rel=1e-5)


ELEMENTS = "fl_lib/Mechanical/Rotational Elements/"


def stopped(tmp_path, *, pull="3", model="3", friction=True):
    """A hinge of 0.5 kg m², pulled on by a torque source, between two stops in a network that has two references."""
    level, joint = hinge()
    torque, into = (
        level.block("Constant", "Torque", Value=pull),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    level.wire(f"{torque}#out:1", f"{into}#in:1")
    source = level.block("fl_lib/Mechanical/Mechanical Sources/Ideal Torque Source", "Source")
    held, again = (
        level.block(f"{ELEMENTS}Mechanical Rotational Reference", name)
        for name in ("Held", "Again")
    )
    face = faced(level, joint)
    level.connect(f"{into}#rconn:1", f"{source}#rconn:1")
    stop = level.block(
        f"{ELEMENTS}Rotational Hard Stop", "Stop", upper_bnd="20", upper_bnd_unit="deg", lower_bnd="-0.1",
        lower_bnd_unit="rad", stiff_up="200", stiff_low="300", D_up="1.5", D_low="2", model=model, transition="0.05",
        phi_specify="on", phi="5", phi_unit="deg")  # fmt: skip
    parts = [source, stop]
    if friction:
        parts.append(level.block(f"{ELEMENTS}Rotational Friction", "Friction", brkwy_trq="0.6", Col_trq="0.4",
                                 brkwy_vel="0.1", visc_coef="0.05"))  # fmt: skip
    ends = ([f"{source}#lconn:1", *(f"{part}#lconn:1" for part in parts[1:]), f"{face}#rconn:2"],
            [f"{source}#rconn:2", *(f"{part}#rconn:1" for part in parts[1:]), f"{face}#lconn:2",
             f"{held}#lconn:1", f"{again}#lconn:1"])  # fmt: skip
    for net in ends:
        level.connect(*net)
    return import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out", force=True)


def stopped_angles(times, pull, model, friction):
    """0.5 w' = pull - friction(w) - stops, the laws as Simscape's documentation has them; angle and speed from rest."""

    def entered(depth, speed, stiffness, damping):
        if depth < 0:
            return 0.0
        share = min(depth / 0.05, 1.0)
        smooth = 3 * share**2 - 2 * share**3 if model == 1 else 1.0
        return smooth * (stiffness * depth + damping * speed * (speed >= 0 or model != 2))

    def rates(_, state):
        angle, speed = state
        place, torque = angle + np.radians(5), pull
        if friction:
            peak = (
                np.sqrt(2 * np.e)
                * 0.2
                * np.exp(-((speed / (0.1 * np.sqrt(2))) ** 2))
                * speed
                / (0.1 * np.sqrt(2))
            )
            torque -= peak + 0.4 * np.tanh(speed / 0.01) + 0.05 * speed
        torque -= entered(place - np.radians(20), speed, 200, 1.5) - entered(
            -0.1 - place, -speed, 300, 2
        )
        return [speed, torque / 0.5]

    return solve_ivp(
        rates, (0, times[-1]), [0, 0], t_eval=times, rtol=1e-10, atol=1e-12, max_step=1e-3
    ).y


@pytest.mark.parametrize(
    ("pull", "model"), [(3, 1), (3, 2), (-3, 3)], ids=["smooth", "undamped rebound", "below"]
)
def test_friction_and_hard_stops_are_their_laws(tmp_path, pull, model):
    imported = stopped(tmp_path, pull=str(pull), model=str(model))
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=1.0, progress=False)
    angle, speed = stopped_angles(result.times, pull, model, friction=True)
    np.testing.assert_allclose(result["q.J"], angle, atol=2e-5)
    np.testing.assert_allclose(result["v.J"], speed, atol=2e-3)
    assert np.ptp(np.sign(speed)) == 2  # it rebounds
    # nothing is: it has no servo
    for error in ("from its target position", "from its reference"):
        assert not any(error in warning for warning in result.warnings)


def test_a_stop_by_restitution_and_friction_that_nothing_beside_it_holds_are_lost_by_name(tmp_path):
    imported = stopped(tmp_path, model="4")
    assert "coefficient of restitution" in imported.report.of("lost")[0].text
    level, joint = hinge()
    source = level.block("fl_lib/Mechanical/Mechanical Sources/Ideal Torque Source", "Source")
    sensor = level.block(
        "fl_lib/Mechanical/Mechanical Sensors/Ideal Rotational Motion Sensor", "Sensor"
    )
    rub = level.block(
        f"{ELEMENTS}Rotational Friction",
        "Rub",
        brkwy_trq="1",
        Col_trq="1",
        brkwy_vel="1",
        visc_coef="0",
    )
    oil = level.block(f"{ELEMENTS}Rotational Damper", "Oil", D="0.1")
    held = level.block(f"{ELEMENTS}Mechanical Rotational Reference", "Held")
    level.connect(f"{source}#lconn:1", f"{sensor}#lconn:1", f"{rub}#lconn:1", f"{oil}#lconn:1")
    level.connect(
        f"{source}#rconn:2",
        f"{sensor}#rconn:1",
        f"{rub}#rconn:1",
        f"{held}#lconn:1",
        f"{oil}#rconn:1",
    )
    level.connect(f"{sensor}#rconn:2", f"{joint}#lconn:2")
    undriven = import_simulink(
        write_model(tmp_path / "c.slx", level), tmp_path / "undriven"
    ).report.of("lost")
    assert any(
        "S is neither a figure of it, nor a signal that drives it" in entry.text
        for entry in undriven
    )
    torque, into = (
        level.block("Constant", "Torque", Value="1"),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    level.wire(f"{torque}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{source}#rconn:1")
    lost = import_simulink(write_model(tmp_path / "b.slx", level), tmp_path / "other").report.of(
        "lost"
    )
    assert any(
        "nothing beside it keeps its speed; an inertia would" in entry.text for entry in lost
    )


def test_friction_along_a_line_stops_a_slider(tmp_path):
    """A mass of 2 kg at 1 m/s on friction; the reference's port is called V, as current files have it."""
    level, parts = Level(), "fl_lib/Mechanical/Translational Elements/"
    world, body = level.block(WORLD, "World"), level.block(INERTIA, "Block", Mass="2")
    level.block(MECHANISM, "Nothing", UniformGravity="None")
    joint = level.block("sm_lib/Joints/Prismatic Joint", "S", TorqueActuationMode="InputTorque", SenseVelocity="on",
                        VelocityTargetSpecify="on", VelocityTargetValue="1")  # fmt: skip
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{body}#rconn:1")
    face = faced(level, joint, "Translational")
    rub = level.block(
        f"{parts}Translational Friction",
        "Rub",
        brkwy_frc="3",
        Col_frc="2",
        brkwy_vel="0.1",
        visc_coef="0.5",
    )
    port = json.dumps({"Left": [{"id": "V"}], "Right": []})
    held = level.block(
        f"{parts}Mechanical Translational Reference", "Held", InternalSimscapePortConfiguration=port
    )
    level.connect(f"{face}#rconn:2", f"{rub}#lconn:1")
    level.connect(f"{face}#lconn:2", f"{rub}#rconn:1", f"{held}#lconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=1.5, progress=False)

    def rates(_, v):
        near = v / (0.1 * np.sqrt(2))
        return (
            -(np.sqrt(2 * np.e) * np.exp(-(near**2)) * near + 2 * np.tanh(v / 0.01) + 0.5 * v) / 2
        )

    expected = solve_ivp(
        rates, (0, 1.5), [1.0], t_eval=result.times, rtol=1e-9, atol=1e-10, max_step=1e-3
    ).y[0]
    np.testing.assert_allclose(result["v.S"], expected, atol=1e-4)


def test_a_law_on_a_shaft_beside_what_settles_at_once_keeps_all_states(tmp_path):
    """A motor whose current settles in 5 µs turns a flywheel on friction: that of the current is kept for it."""
    level, joint = hinge()
    wheel, rub, held = (
        level.block(f"{ELEMENTS}{kind}", kind, **figures)
        for kind, figures in (
            ("Inertia", {"inertia": "0.01"}),
            (
                "Rotational Friction",
                {"brkwy_trq": "1", "Col_trq": "1", "brkwy_vel": "1", "visc_coef": "0"},
            ),
            ("Mechanical Rotational Reference", {}),
        )
    )
    source = motor_on_a_joint(level, f"{joint}#lconn:2", f"{joint}#rconn:2", La="1e-5").partition(
        "#"
    )[0]
    other = level.block("ee_lib/Electromechanical/Brushed Motors/DC Motor", "Other", Ra="2", La="1e-5", Ki="0.3",
                        J="0", lam="0", emf_or_torque="ee.enum.emf_or_torque.ki")  # fmt: skip
    level.connect(f"{source}#lconn:1", f"{other}#lconn:1")
    level.connect(f"{source}#rconn:2", f"{other}#rconn:1")
    level.connect(f"{other}#lconn:2", f"{wheel}#lconn:1", f"{rub}#lconn:1")
    level.connect(f"{other}#rconn:2", f"{rub}#rconn:1", f"{held}#lconn:1")
    volts, into = (
        level.block("Constant", "Volts", Value="12"),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    level.wire(f"{volts}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{source}#rconn:1")
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    assert imported.report.of("approximated") == []


def test_a_motion_sensor_tells_the_speed_and_the_angle(tmp_path):
    """A torque of 1 N m on an inertia of 2 kg m² that nothing else holds."""
    level, mechanical = Level(), "fl_lib/Mechanical/"
    source = level.block(f"{mechanical}Mechanical Sources/Ideal Torque Source", "Source")
    sensor = level.block(f"{mechanical}Mechanical Sensors/Ideal Rotational Motion Sensor", "Sensor")
    wheel = level.block(f"{ELEMENTS}Inertia", "Wheel", inertia="2", inertia_unit="kg*m^2")
    held = level.block(f"{ELEMENTS}Mechanical Rotational Reference", "Held")
    torque, into = (
        level.block("Constant", "Torque", Value="1"),
        level.block(TO_PHYSICS, "In", Unit="1"),
    )
    level.wire(f"{torque}#out:1", f"{into}#in:1")
    level.connect(f"{into}#rconn:1", f"{source}#rconn:1")
    level.connect(f"{source}#lconn:1", f"{sensor}#lconn:1", f"{wheel}#lconn:1")
    level.connect(f"{source}#rconn:2", f"{sensor}#rconn:1", f"{held}#lconn:1")
    level.connect(f"{sensor}#rconn:2", f"{level.block(FROM_PHYSICS, 'Speed')}#lconn:1")
    level.connect(f"{sensor}#rconn:3", f"{level.block(FROM_PHYSICS, 'Angle')}#lconn:1")
    tracer = read_simulink(write_model(tmp_path / "a.slx", level)).tracer
    (node,) = (node for node in tracer.network.expanded.nodes if node.block.name == "Sensor")
    times = np.linspace(0.1, 1, 10)
    speed, angle = over_time([tracer.physical(node, "rconn", port)[0] for port in (2, 3)], times)
    np.testing.assert_allclose([np.abs(speed), np.abs(angle)], [times / 2, times**2 / 4], atol=1e-6)
    np.testing.assert_allclose(np.sign(speed), np.sign(angle))


def test_an_inertia_of_a_shaft_is_no_body(tmp_path):
    """Of a network alone nothing can move; a rotor beside a body does not fall as a piece."""
    level = Level()
    rotor = level.block("fl_lib/Mechanical/Rotational Elements/Inertia", "Rotor", inertia="0.1")
    damper = level.block("fl_lib/Mechanical/Rotational Elements/Rotational Damper", "Oil", D="0.2")
    level.connect(f"{rotor}#lconn:1", f"{damper}#rconn:1")
    with pytest.raises(InvalidModel, match="holds no Simscape Multibody bodies"):
        import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    level.connect(
        f"{level.block(WORLD, 'World')}#rconn:1",
        f"{level.block(INERTIA, 'Block', Mass='3')}#rconn:1",
    )
    files = import_simulink(write_model(tmp_path / "b.slx", level), tmp_path / "out").files
    assert list(files.pieces) == ["Block"]
