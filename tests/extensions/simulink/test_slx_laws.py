"""Control laws of a model that are no servos run as signal flows, against the equations of motion with the same law."""

import re

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp
from scipy.signal import tf2ss
from slx_files import Level, write_model
from test_slx_signals import Plant

from simrob_drake import simulate
from simrob_drake.extensions.simulink.importing import import_simulink


def run(plant, tmp_path, stop="2"):
    imported = import_simulink(write_model(tmp_path / "a.slx", plant, stop=stop), tmp_path / "out")
    content = yaml.safe_load(imported.station.read_text())
    return simulate(imported.station, progress=False), content, imported.report


def test_filters_limits_and_couplings_move_joints_as_the_equations_say(tmp_path):
    """Both hinges have an inertia of 1 kg m², so q'' is the torque."""
    plant = Plant()
    (qa, qb), (wa, wb) = plant.positions, plant.speeds
    wanted = plant.chain("Step", "Wanted", Time="0.25", After="0.4", Before="0")
    error = plant.chain("Sum", "e", wanted, qa, Inputs="+-")
    lead = plant.chain("TransferFcn", "Lead", error, Numerator="[2 10]", Denominator="[0.02 1]")
    bent = plant.chain("Saturate", "Bent", lead, UpperLimit="3", LowerLimit="-1")
    plant.wire(
        plant.chain("Sum", "Ta", bent, wa, plant.chain("Gain", "k", qb, Gain="0.5"), Inputs="+-+"),
        f"{plant.drives[0]}#in:1",
    )
    loose = plant.chain("DeadZone", "Loose", plant.chain("Sum", "d", qa, qb, Inputs="+-"), LowerValue="-0.1",
                        UpperValue="0.05")  # fmt: skip
    table = plant.chain("Lookup_n-D", "Table", loose, NumberOfTableDimensions="1", Table="[-8 0 2]",
                        BreakpointsForDimension1="[-1 0 1]", ExtrapMethod="Clip")  # fmt: skip
    one = plant.chain("Constant", "one", Value="1")
    late = plant.chain(
        "RelationalOperator", "Late", plant.chain("Clock", "Time"), one, Operator=">="
    )
    push = plant.chain("Switch", "Push", plant.chain("Constant", "On", Value="0.3"), late, table,
                       Criteria="u2 > Threshold", Threshold="0.5")  # fmt: skip
    plant.wire(plant.chain("Sum", "Tb", push, wb, Inputs="+-"), f"{plant.drives[1]}#in:1")
    result, content, report = run(plant, tmp_path)

    a, b, c, d = (np.atleast_2d(part).item() for part in tf2ss([2, 10], [0.02, 1]))

    def motion(t, y):
        qa, wa, qb, wb, x = y
        error = 0.4 * (t >= 0.25) - qa
        loose = max(qa - qb - 0.05, 0) + min(qa - qb + 0.1, 0)
        push = 0.3 if t >= 1 else np.interp(loose, [-1, 0, 1], [-8, 0, 2])
        return (
            wa,
            np.clip(c * x + d * error, -1, 3) - wa + 0.5 * qb,
            wb,
            push - wb,
            a * x + b * error,
        )

    exact = solve_ivp(
        motion, (0, 2), np.zeros(5), rtol=1e-9, atol=1e-9, max_step=1e-3, t_eval=result.times
    )
    np.testing.assert_allclose(result["q.A"], exact.y[0], atol=1e-4)
    np.testing.assert_allclose(result["q.B"], exact.y[2], atol=1e-4)
    assert np.ptp(exact.y[2]) > 0.1
    blocks = content["controllers"]["law"]["blocks"]
    kinds = {name: entry["kind"] for name, entry in blocks.items()}
    assert kinds == {
        "Bent": "saturation", "Lead": "transfer_function", "Wanted": "step", "Push": "switch", "Late": "compare",
        "Table": "lookup", "Loose": "dead_zone",
    }  # fmt: skip
    assert not report.of("dropped")


def test_state_space_products_and_a_limited_integral_in_a_loop(tmp_path):
    plant = Plant()
    qa, (wa, wb) = plant.positions[0], plant.speeds
    both = plant.chain("Mux", "both", qa, wa, Inputs="2")
    observer = plant.chain("StateSpace", "Observer", both, A="[-3 1; 0 -5]", B="[1 0; 0 2]", C="[1 0; 0 1]",
                           D="zeros(2)", X0="[0.1 -0.2]")  # fmt: skip
    first, second = plant.split(observer)
    square = plant.chain("Product", "Square", first, second, Inputs="2")
    cosine = plant.chain("Trigonometry", "Cosine", qa, Operator="cos")
    plant.wire(
        plant.chain(
            "Sum", "Ta", square, plant.chain("Gain", "half", cosine, Gain="0.5"), wa, Inputs="++-"
        ),
        f"{plant.drives[0]}#in:1",
    )
    store = plant.block("Integrator", "Store", InitialCondition="0.3", LimitOutput="on", UpperSaturationLimit="0.6",
                        LowerSaturationLimit="-inf")  # fmt: skip
    leak = plant.chain(
        "Sum", "Leak", plant.chain("Constant", "one", Value="1"), f"{store}#out:1", Inputs="+-"
    )
    plant.wire(leak, f"{store}#in:1")
    plant.wire(
        plant.chain("Sum", "Tb", f"{store}#out:1", wb, Inputs="+-"), f"{plant.drives[1]}#in:1"
    )
    result, _, _ = run(plant, tmp_path)

    def motion(t, y):
        qa, wa, _, wb, x1, x2 = y
        store = min(1 - 0.7 * np.exp(-t), 0.6)
        return (
            wa,
            x1 * x2 + 0.5 * np.cos(qa) - wa,
            wb,
            store - wb,
            -3 * x1 + x2 + qa,
            -5 * x2 + 2 * wa,
        )

    start = np.array([0, 0, 0, 0, 0.1, -0.2])
    exact = solve_ivp(
        motion, (0, 2), start, rtol=1e-9, atol=1e-9, max_step=1e-2, t_eval=result.times
    )
    np.testing.assert_allclose(result["q.A"], exact.y[0], atol=1e-4)
    np.testing.assert_allclose(result["q.B"], exact.y[2], atol=1e-4)


def test_derivatives_of_what_is_not_measured_are_filtered(tmp_path):
    """A brakes by a Derivative, B is held by a PID with a filter; both see their angle through a saturation."""
    plant = Plant()
    seen = [
        plant.chain("Saturate", f"S{k}", q, UpperLimit="9", LowerLimit="-9")
        for k, q in enumerate(plant.positions)
    ]
    push = plant.chain("Constant", "Push", Value="1")
    brake = plant.chain("Derivative", "Speed", seen[0])
    wanted = plant.chain("Constant", "Wanted", Value="0.3")
    error = plant.chain("Sum", "e", wanted, seen[1], Inputs="+-")
    held = plant.chain(
        "slpidlib/PID Controller", "PID", error, P="9", I="0", D="4", N="50", Controller="PD"
    )
    plant.drive(plant.chain("Sum", "T", push, brake, Inputs="+-"), held)
    result, content, report = run(plant, tmp_path)

    def motion(_, y):
        qa, wa, xa, qb, wb, xb = y
        return (
            wa, 1 - (qa - xa) / 1e-3, (qa - xa) / 1e-3,
            wb, 9 * (0.3 - qb) + 4 * 50 * (0.3 - qb - xb), 50 * (0.3 - qb - xb),
        )  # fmt: skip

    exact = solve_ivp(
        motion, (0, 2), np.zeros(6), method="Radau", rtol=1e-8, atol=1e-8, t_eval=result.times
    )
    np.testing.assert_allclose(result["q.A"], exact.y[0], atol=2e-4)
    np.testing.assert_allclose(result["q.B"], exact.y[3], atol=2e-4)
    assert content["controllers"]["law"]["blocks"]["PID"]["kind"] == "pid"
    assert [entry.text for entry in report.of("approximated")] == [
        "its derivative is filtered, by 0.001 s"
    ]
    assert not report.of("repaired")


def test_a_derivative_of_a_signal_of_time_begins_at_rest(tmp_path):
    """A is pulled at its speed behind a turned cosine, that jumped by 2 / 1 ms at the start; B by a law with a NaN."""
    (tmp_path / "law.m").write_text(
        "function y = law(u)\nif u < 2\n y = 1 - u;\nelse\n y = nan;\nend\n"
    )
    plant = Plant()
    wave = plant.chain("Sin", "Wave", Amplitude="2", Frequency="3", Phase="pi/2")
    error = plant.chain("Sum", "e", wave, plant.positions[0], Inputs="+-")
    law = plant.chain("MATLABFcn", "Law", plant.speeds[1], MATLABFcn="law")
    plant.drive(plant.chain("Derivative", "Rate", error), law)
    result, _, report = run(plant, tmp_path)

    def motion(t, y):
        _, wa, x = y
        behind = (2 * np.cos(3 * t) - 2 - x) / 1e-3
        return wa, behind - wa, behind

    exact = solve_ivp(
        motion, (0, 2), np.zeros(3), method="Radau", rtol=1e-8, atol=1e-8, t_eval=result.times
    )
    np.testing.assert_allclose(result["q.A"], exact.y[0], atol=2e-4)
    np.testing.assert_allclose(result["v.B"], 1 - np.exp(-result.times), atol=2e-4)
    assert not report.of("open")


def test_springs_and_torques_that_no_position_commands_drive_joints(tmp_path):
    """A has a spring beside its servo, B a torque of time beside a damper: of inertias of 1 kg m²."""
    plant = Plant()
    spring = {
        "SpringStiffness": "5",
        "EquilibriumPosition": "0.2",
        "EquilibriumPositionUnits": "rad",
    }
    given = "".join(f'<P Name="{name}">{text}</P>' for name, text in spring.items())
    place = next(place for place, text in enumerate(plant.blocks) if 'Name="A"' in text)
    plant.blocks[place] = plant.blocks[place].replace("<InstanceData>", f"<InstanceData>{given}")
    held = plant.chain("Gain", "kp", plant.positions[0], Gain="4")
    push = plant.chain("Sum", "Push", plant.chain("Sin", "Wave", Amplitude="2", Frequency="3", Bias="1"),
                       plant.chain("DiscretePulseGenerator", "Knocks", Period="0.5", PulseWidth="20", PhaseDelay="0.4",
                                   Amplitude="3"))  # fmt: skip
    plant.drive(
        plant.chain("Sum", "TA", held, plant.speeds[0], Inputs="--"),
        plant.chain("Sum", "TB", push, plant.speeds[1], Inputs="+-"),
    )
    result, content, report = run(plant, tmp_path)

    def motion(t, y):
        qa, wa, _, wb = y
        knock = 3 * (t >= 0.4 and (t - 0.4) % 0.5 < 0.1)
        return wa, -4 * qa - wa - 5 * (qa - 0.2), wb, 1 + 2 * np.sin(3 * t) + knock - wb

    exact = solve_ivp(
        motion, (0, 2), np.zeros(4), rtol=1e-9, atol=1e-9, max_step=1e-3, t_eval=result.times
    )
    np.testing.assert_allclose(result["q.A"], exact.y[0], atol=2e-4)
    np.testing.assert_allclose(result["q.B"], exact.y[2], atol=1e-3)
    assert set(content["controllers"]["law"]["torque"]["A"]) == {"one", "q.A", "v.A"}
    assert not report.of("dropped")


def test_an_input_is_the_reference_of_the_joint_whose_error_it_makes(tmp_path):
    plant = Plant()
    asked = plant.chain("Inport", "q_ref")
    error = plant.chain(
        "Sum", "e", plant.chain("Gain", "deg", asked, Gain="2"), plant.positions[0], Inputs="+-"
    )
    slow = plant.chain("TransferFcn", "Slow", error, Numerator="[8]", Denominator="[0.1 1]")
    plant.wire(
        plant.chain("Sum", "T", slow, plant.speeds[0], Inputs="+-"), f"{plant.drives[0]}#in:1"
    )
    plant.wire(plant.chain("Gain", "g", plant.speeds[1], Gain="-1"), f"{plant.drives[1]}#in:1")
    _, content, _ = run(plant, tmp_path)
    assert content["controllers"]["law"]["blocks"]["Slow"]["of"] == {"q_ref.A": 1.0, "q.A": -1.0}
    assert content["controllers"]["law"]["torque"]["B"] == {"v.B": -1.0}


def test_a_stop_of_any_condition_ends_the_run(tmp_path):
    plant = Plant()
    one = plant.chain("Constant", "Push", Value="1")
    plant.drive(
        plant.chain("Sum", "T", one, plant.speeds[1]),
        plant.chain("Gain", "g", plant.speeds[1], Gain="-1"),
    )
    far = plant.chain("Compare To Constant", "Far", plant.positions[0], relop=">", const="0.125")
    plant.chain("simulink/Sinks/Stop Simulation", "Halt", far)
    result, _, _ = run(plant, tmp_path)
    assert result.ending == "monitor"
    assert result.message.startswith("the stop Halt_end is active")
    assert result.times[-1] == pytest.approx(0.5, abs=0.021)  # q = t²/2; looked at where steps end


@pytest.mark.parametrize(
    ("kind", "figures", "told"),
    [
        ("TransferFcn", {"Numerator": "[1 0 0]", "Denominator": "[1 1]"}, "higher degree"),
        (
            "StateSpace",
            {"A": "-1", "B": "[1 2]", "C": "1", "D": "0"},
            "B must be 1 × 1|must be 1 × 1",
        ),
        ("DeadZone", {"LowerValue": "1", "UpperValue": "0"}, "must be at most upper"),
        (
            "Lookup_n-D",
            {"Table": "[1 2]", "BreakpointsForDimension1": "[1 0]"},
            "points must increase",
        ),
        ("Gain", {"Gain": "'a'"}, "uses the text"),
        ("Gain", {"Gain": "[1 2 3; 4 5 6]"}, "Gain has 6 numbers|Gain is 2 × 3"),
        ("Sum", {"Inputs": "+x"}, "signs"),
    ],
)
def test_a_block_whose_figures_cannot_be_is_left_open(tmp_path, kind, figures, told):
    """One block of the control does not stop the import of the mechanics, and the station runs without it."""
    plant = Plant()
    both = (
        plant.chain("Mux", "q", *plant.positions, Inputs="2")
        if kind == "Gain"
        else plant.positions[1]
    )
    odd = plant.chain(kind, "Odd", both, **figures)
    plant.drive(plant.chain("Sum", "T", odd, plant.speeds[0], Inputs="+-"), plant.speeds[1])
    _, content, report = run(plant, tmp_path, stop="0.01")
    assert any(
        entry.element == "Odd" and re.search(told, entry.text) for entry in report.of("open")
    )
    assert content["controllers"]["law"]["blocks"]["Odd"] == {"kind": "input"}
    assert content["controllers"]["law"]["torque"]["A"] == {"Odd": 1.0, "v.A": -1.0}


def test_what_is_sampled_at_an_unknown_rate_is_left_open(tmp_path):
    plant = Plant()
    held = plant.chain("DiscreteTransferFcn", "Inherited", plant.positions[0], SampleTime="-1")
    rounded = plant.chain("Rounding", "Round", plant.positions[1], Operator="round")
    plant.drive(held, rounded)
    _, _, report = run(plant, tmp_path, stop="0.1")
    assert "Inherited" in {entry.element for entry in report.of("open")}


def test_subsystems_that_run_under_a_condition_are_switches(tmp_path):
    """Of an If with its actions, whose outputs are merged, and of one that a signal enables."""
    plant = Plant()
    for number, name in enumerate(("High", "Low", "On")):
        port = {"High": "ActionPort", "Low": "ActionPort", "On": "EnablePort"}[name]
        inner = Level(first=100 * (number + 1))
        gain = inner.block("Gain", "k", Gain=str((2, -3, 5)[number]))
        inner.block(port, "Runs")
        source, outport = inner.block("Inport", "u"), inner.block("Outport", "y", InitialOutput="0.5",
                                                                  OutputWhenDisabled="reset")  # fmt: skip
        inner.wire(f"{source}#out:1", f"{gain}#in:1")
        inner.wire(f"{gain}#out:1", f"{outport}#in:1")
        plant.block("SubSystem", name, inner=inner.xml())
    clock = plant.chain("Clock", "Time")
    test = plant.block("If", "If", IfExpression="u1 > 0.5", NumInputs="1", ShowElse="on")
    plant.wire(clock, f"{test}#in:1")
    high, low, on = (
        next(
            sid
            for sid, text in enumerate(plant.blocks, 1)
            if f'Name="{name}"' in text and "SubSystem" in text
        )
        for name in ("High", "Low", "On")
    )
    plant.wire(f"{test}#out:1", f"{high}#ifaction")
    plant.wire(f"{test}#out:2", f"{low}#ifaction")
    for sid in (high, low, on):
        plant.wire(clock, f"{sid}#in:1")
    early = plant.chain(
        "RelationalOperator",
        "Early",
        clock,
        plant.chain("Constant", "End", Value="0.25"),
        Operator="<",
    )
    plant.wire(early, f"{on}#enable")
    merged = plant.chain("Merge", "Merged", f"{high}#out:1", f"{low}#out:1", Inputs="2")
    plant.drive(merged, f"{on}#out:1")
    result, _, report = run(plant, tmp_path, stop="1")
    assert not report.of("open")
    t = result.times
    for axis, acceleration in (
        ("A", np.where(t > 0.5, 2 * t, -3 * t)),
        ("B", np.where(t < 0.25, 5 * t, 0.5)),
    ):
        speed = np.concatenate(
            [[0.0], np.cumsum((acceleration[1:] + acceleration[:-1]) / 2 * np.diff(t))]
        )
        np.testing.assert_allclose(result[f"v.{axis}"], speed, atol=0.02)
    assert abs(result["v.A"][-1] - (-3 * 0.125 + 0.75)) < 1e-3


def test_a_matrix_divides_by_its_inverse(tmp_path):
    plant = Plant()
    matrix = plant.chain("Constant", "M", Value="[2 1; 0.5 4]")
    clock = plant.chain("Clock", "Time")
    both = plant.chain("Mux", "both", clock, plant.chain("Constant", "One", Value="1"), Inputs="2")
    scaled = plant.chain("Product", "Scaled", matrix, clock, Inputs="2")
    shifted = plant.chain(
        "Sum", "Shifted", scaled, plant.chain("Constant", "I", Value="eye(2)"), Inputs="++"
    )
    plant.drive(
        *plant.split(
            plant.chain("Product", "Solve", shifted, both, Inputs="/*", Multiplication="Matrix(*)")
        )
    )
    result, _, report = run(plant, tmp_path, stop="1")
    assert not report.of("open")

    def motion(t, y):
        return *y[2:], *np.linalg.solve(np.array([[2, 1], [0.5, 4]]) * t + np.eye(2), [t, 1.0])

    exact = solve_ivp(motion, (0, 1), np.zeros(4), rtol=1e-9, atol=1e-9, t_eval=result.times)
    np.testing.assert_allclose([result["q.A"], result["q.B"]], exact.y[:2], atol=1e-4)


PIDS = [
    {},
    {"LimitOutput": "on", "UpperSaturationLimit": "2", "LowerSaturationLimit": "-2",
     "AntiWindupMode": "back-calculation", "Kb": "3"},
    {"ControllerParametersSource": "external"},
]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("limited", PIDS, ids=["as it is", "limited", "its gains from outside"])
def test_a_pid_with_a_filter_is_as_simulink_has_it(tmp_path, limited):
    """A step of 0.2 for an inertia of 1, whose derivative is of the filtered error: within 1e-4 of the step."""
    plant = Plant()
    error = plant.chain(
        "Sum",
        "e",
        plant.chain("Step", "Wanted", Time="0.1", After="0.2"),
        plant.positions[0],
        Inputs="+-",
    )
    gains, inputs = {"P": "40", "I": "20", "D": "9", "N": "60"}, [error]
    if "ControllerParametersSource" in limited:
        inputs += [plant.chain("Constant", name, Value=value) for name, value in gains.items()]
        gains = {}
    held = plant.chain(
        "slpidlib/PID Controller", "PID", *inputs, Controller="PID", **gains, **limited
    )
    plant.drive(held, plant.chain("Constant", "None", Value="0"))
    result, *_ = run(plant, tmp_path)

    def motion(t, y):
        q, w, integral, x = y
        error = 0.2 * (t >= 0.1) - q
        derivative = 60 * (9 * error - x)
        free = 40 * error + integral + derivative
        torque = float(np.clip(free, -2, 2)) if "LimitOutput" in limited else free
        return w, torque, 20 * error + 3 * (torque - free), derivative

    parts = [solve_ivp(motion, (0, 0.1), np.zeros(4), method="Radau", rtol=1e-10, atol=1e-12)]
    times = result.times[result.times > 0.1]
    exact = solve_ivp(
        motion,
        (0.1, times[-1]),
        parts[0].y[:, -1],
        method="Radau",
        rtol=1e-10,
        atol=1e-12,
        max_step=1e-3,
        t_eval=times,
    )
    off = np.abs(result["q.A"][result.times > 0.1] - exact.y[0]).max()
    assert off < 2e-5, off


def test_system_objects_are_the_transfer_functions_and_states_that_they_hold(tmp_path):
    """The same filter as a block, as ``tf`` and as ``ss`` of the model's workspace: three equal torques."""
    torques = []
    for number, (kind, figures) in enumerate([
        ("TransferFcn", {"Numerator": "[3 0]", "Denominator": "[1 2 4]"}),
        ("cstblocks/LTI System", {"sys": "G", "IC": "[]"}),
        ("cstblocks/LTI System", {"sys": "ss([-2 -4; 1 0], [1; 0], [3 0], 0)", "IC": "[]"}),
    ]):  # fmt: skip
        plant = Plant()
        plant.wire(
            plant.chain(kind, "F", plant.chain("Step", "On", Time="0.1"), **figures),
            f"{plant.drives[0]}#in:1",
        )
        path = write_model(
            tmp_path / f"{number}.slx", plant, workspace="w = 2; G = tf([3 0], [1 w w^2]);"
        )
        imported = import_simulink(path, tmp_path / str(number))
        assert imported.report.of("open") == []
        torques.append(simulate(imported.station, duration=1.0, progress=False)["tau.A"])
    assert np.ptp(torques[0]) > 0.5
    np.testing.assert_allclose(torques[1], torques[0], atol=1e-12)
    np.testing.assert_allclose(torques[2], torques[0], atol=1e-3)
