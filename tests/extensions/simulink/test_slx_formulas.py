"""Blocks by formulas, each against the same function in Python, over time."""

import numpy as np
import pytest
from slx_files import Level, write_model

from simrob_drake.base.errors import InvalidModel
from simrob_drake.extensions.simulink.signals.forms import flat, mapped, signal
from simrob_drake.extensions.simulink.simulink_model import read_simulink
from simrob_drake.extensions.simulink.writing.references import over_time

TIMES = np.linspace(0.02, 2, 34)
SAMPLED = {"SampleTime": "0.09", "gainval": "2", "InitialCondition": "0.3"}


def steps(t):
    """Samples of 0.09 s that are past."""
    return np.floor(t / 0.09)


def before(t, late):
    return np.maximum(steps(t) - late, 0)


def summed(last):
    """The sum of the samples 0, 0.09, ... up to one, which is its number."""
    return 0.09 * last * (last + 1) / 2


def outputs(tmp_path, kind, inputs, parameters):
    """Return the outputs, (n, t), of a block of the time and 0.7; of the negative time on a physical line."""
    level = Level()
    sid = level.block(kind, "B", **parameters)
    if kind.startswith("fl_lib") and inputs:  # of a physical line
        level.connect(
            f"{level.block('fl_lib/PS/PS Ramp', 'S', slope='-1')}#rconn:1", f"{sid}#lconn:1"
        )
        inputs = 0
    for number, source in enumerate(
        (("Clock", {}), ("Constant", {"Value": "0.7"}))[:inputs], start=1
    ):
        level.wire(
            f"{level.block(source[0], f'S{number}', **source[1])}#out:1", f"{sid}#in:{number}"
        )
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (node,) = (node for node in model.expanded.nodes if node.block.name == "B")
    values = flat(model.tracer.output(node))
    if node in model.tracer.opened:
        raise InvalidModel(tmp_path, "B", model.tracer.opened[node] or "open")
    return over_time(values, TIMES)


@pytest.mark.parametrize(
    ("kind", "inputs", "parameters", "function"),
    [
        ("DigitalClock", 0, {"SampleTime": "0.25"}, lambda t: 0.25 * np.floor(t / 0.25 + 1e-9)),
        ("fl_lib/PS/PS Switch", 1, {"Threshold": "-1"}, lambda t: -t),
        ("fl_lib/PS/PS Switch", 1, {}, lambda t: 0 * t),
        ("Math", 1, {"Operator": "10^u"}, lambda t: 10**t),
        ("Math", 1, {"Operator": "reciprocal"}, lambda t: 1 / t),
        ("Math", 1, {}, np.exp),
        ("Math", 1, {"Operator": "log10"}, np.log10),
        ("Math", 2, {"Operator": "mod"}, lambda t: np.mod(t, 0.7)),
        ("Math", 2, {"Operator": "rem"}, lambda t: np.fmod(t, 0.7)),
        ("Math", 2, {"Operator": "hypot"}, lambda t: np.hypot(t, 0.7)),
        ("Math", 2, {"Operator": "pow"}, lambda t: t**0.7),
        ("Sqrt", 1, {"Operator": "signedSqrt"}, np.sqrt),
        ("Sqrt", 1, {"Function": "rSqrt"}, lambda t: 1 / np.sqrt(t)),
        ("Trigonometry", 2, {"Operator": "atan2"}, lambda t: np.arctan2(t, 0.7)),
        ("Trigonometry", 1, {"Function": "cos"}, np.cos),
        ("Rounding", 1, {"Operator": "ceil"}, np.ceil),
        ("Rounding", 1, {"Operator": "round"}, lambda t: np.floor(t + 0.5)),
        ("Abs", 1, {}, np.abs),
        ("simulink/Discontinuities/Coulomb & Viscous Friction", 1, {"offset": "2", "gain": "3"}, lambda t: 3 * t + 2),
        ("Polyval", 1, {"Coefs": "[2 -3 0 0.5]"}, lambda t: np.polyval([2, -3, 0, 0.5], t)),
        ("MinMax", 2, {"Function": "max", "Inputs": "2"}, lambda t: np.maximum(t, 0.7)),
        ("MinMax", 2, {"Inputs": "2"}, lambda t: np.minimum(t, 0.7)),
        ("RelationalOperator", 2, {"Operator": "~="}, lambda t: t != 0.7),
        ("RelationalOperator", 2, {}, lambda t: t <= 0.7),
        ("simulink/Logic/Compare To Constant", 1, {"relop": ">", "const": "1.1"}, lambda t: t > 1.1),
        ("simulink/Logic/Compare To Zero", 1, {"relop": "<"}, lambda t: t < 0),
        ("Quantizer", 1, {"QuantizationInterval": "0.37"}, lambda t: 0.37 * np.round(t / 0.37)),
        ("Bias", 1, {"Bias": "[1 2]"}, lambda t: [t + 1, t + 2]),
        ("DotProduct", 2, {}, lambda t: 0.7 * t),
        ("UnaryMinus", 1, {}, lambda t: -t),
        ("DiscretePulseGenerator", 0, {"Amplitude": "[2 3]", "Period": "0.5", "PulseWidth": "30", "PhaseDelay": "0.3"},
         lambda t: np.outer([2, 3], (t >= 0.3) & ((t - 0.3) % 0.5 < 0.15))),
        ("DiscretePulseGenerator", 0, {"PulseType": "Sample based", "Period": "5", "PulseWidth": "2", "PhaseDelay": "3",
                                       "SampleTime": "0.1"}, lambda t: (t >= 0.3) & ((t - 0.3) % 0.5 < 0.2)),
        ("SignalGenerator", 0, {"Amplitude": "2", "Frequency": "0.8"}, lambda t: 2 * np.sin(1.6 * np.pi * t)),
        ("SignalGenerator", 0, {"WaveForm": "square", "Units": "rad/sec", "Frequency": "5"},
         lambda t: np.where(5 * t / (2 * np.pi) % 1 < 0.5, 1, -1)),
        ("SignalGenerator", 0, {"WaveForm": "sawtooth", "Frequency": "0.7"}, lambda t: 2 * (0.7 * t % 1) - 1),
        ("Interval Test", 1, {"lowlimit": "0.5", "uplimit": "1.5"}, lambda t: (t >= 0.5) & (t <= 1.5)),
        ("UniformRandomNumber", 0, {"Minimum": "1"}, np.ones_like),
        ("fl_lib/PS/PS Math Function", 1, {"function": "foundation.enum.exp"}, lambda t: np.exp(-t)),
        ("DataTypeConversion", 1, {"OutDataTypeStr": "double"}, lambda t: t),
        ("DataTypeConversion", 1, {"OutDataTypeStr": "int16"}, np.floor),
        ("DataTypeConversion", 1, {"OutDataTypeStr": "uint8", "RndMeth": "Nearest"}, lambda t: np.floor(t + 0.5)),
        ("DataTypeConversion", 2, {"OutDataTypeStr": "boolean"}, np.ones_like),
        ("DiscreteIntegrator", 1, SAMPLED, lambda t: 0.3 + 0.18 * summed(steps(t) - 1)),
        ("DiscreteIntegrator", 1, {**SAMPLED, "IntegratorMethod": "Integration: Backward Euler"},
         lambda t: 0.3 + 0.18 * summed(steps(t))),
        ("DiscreteIntegrator", 1, {**SAMPLED, "IntegratorMethod": "Integration: Trapezoidal"},
         lambda t: 0.3 + 0.09 * (summed(steps(t)) + summed(steps(t) - 1))),
        ("DiscreteIntegrator", 1, {**SAMPLED, "IntegratorMethod": "Accumulation: Forward Euler"},
         lambda t: 0.3 + 2 * summed(steps(t) - 1)),
        ("DiscreteIntegrator", 1, {**SAMPLED, "LimitOutput": "on", "UpperSaturationLimit": "0.9"},
         lambda t: np.minimum(0.9, 0.3 + 0.18 * summed(steps(t) - 1))),
        ("ZeroOrderHold", 1, {"SampleTime": "0.09"}, lambda t: 0.09 * steps(t)),
        ("ZeroOrderHold", 1, {}, lambda t: t),
        ("DiscreteFir", 1, {"SampleTime": "0.09", "Coefficients": "[0.2 0.3 0.5]"},
         lambda t: 0.09 * (0.2 * steps(t) + 0.3 * before(t, 1) + 0.5 * before(t, 2))),
        ("DiscreteFilter", 1, {"SampleTime": "0.09", "Numerator": "[0 1]", "Denominator": "[1]"},
         lambda t: 0.09 * before(t, 1)),
        ("UnitDelay", 1, {"SampleTime": "0.09", "InitialCondition": "7"},
         lambda t: np.where(steps(t) < 1, 7, 0.09 * before(t, 1))),
        ("TransportDelay", 1, {"DelayTime": "0"}, lambda t: t),
        ("Saturate", 1, {"UpperLimit": "1.3", "LowerLimit": "[0.4; -inf]"},
         lambda t: [np.clip(t, 0.4, 1.3), np.minimum(t, 1.3)]),
        ("DeadZone", 1, {"LowerValue": "0", "UpperValue": "0.5"}, lambda t: np.maximum(t - 0.5, 0)),
        ("Step", 0, {"Time": "1", "Before": "[2 3]", "After": "5"},
         lambda t: [np.where(t < 1, 2, 5), np.where(t < 1, 3, 5)]),
        ("simulink/Sources/Ramp", 0, {"slope": "2", "start": "0.5", "InitialOutput": "1"},
         lambda t: 1 + 2 * np.maximum(t - 0.5, 0)),
        ("Sin", 0, {"Amplitude": "[1 2]", "Frequency": "3", "Phase": "0.2", "Bias": "1"},
         lambda t: [np.sin(3 * t + 0.2) + 1, 2 * np.sin(3 * t + 0.2) + 1]),
        ("Sin", 1, {"TimeSource": "Use external signal"}, np.sin),
        ("fl_lib/PS/PS Sine Wave", 0, {"amplitude": "2", "frequency": "3", "frequency_unit": "Hz", "phase": "90",
                                       "phase_unit": "deg", "bias": "1"},
         lambda t: 2 * np.sin(6 * np.pi * t + np.pi / 2) + 1),
        ("fl_lib/PS/PS Abs", 1, {}, lambda t: t),
        ("fl_lib/PS/PS Floor", 1, {}, lambda t: np.floor(-t)),
        ("fl_lib/PS/PS Constant", 0, {"constant": "[5 7]", "constant_unit": "cm"},
         lambda t: [0 * t + 0.05, 0 * t + 0.07]),
    ],
)  # fmt: skip
def test_a_block_computes_its_formula(tmp_path, kind, inputs, parameters, function):
    expected = np.atleast_2d(np.asarray(function(TIMES), dtype=float))
    np.testing.assert_allclose(outputs(tmp_path, kind, inputs, parameters), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "parameters", "told"),
    [("Trigonometry", {"Operator": "sincos"}, "open"), ("RelationalOperator", {"Operator": "isNaN"}, "not plain"),
     ("Bias", {"Bias": "unknown_"}, None), ("Saturate", {"UpperLimit": "'a'"}, "UpperLimit")],
)  # fmt: skip
def test_a_choice_that_is_not_known_leaves_the_block_open(tmp_path, kind, parameters, told):
    if told is None:  # the default, and the variable is named
        assert np.allclose(outputs(tmp_path, kind, 1, parameters), TIMES)
        return
    with pytest.raises(InvalidModel, match=told):
        outputs(tmp_path, kind, 1, parameters)


@pytest.mark.parametrize(
    ("kind", "parameters", "expected"),
    [
        ("Fcn", {"Expr": "sqrt(u) + u[2]*u(1)"}, [38.0]),
        ("Fcn", {"Expr": "sgn(-u[2]) + ln(exp(u)) + pow(u[1], 2) + fabs(-u[1])"}, [23.0]),
        (
            "LookupNDDirect",
            {"NumberOfTableDimensions": "1", "Table": "[7 6 5 4 3.5 2]'"},
            [3.5, 2.0],
        ),
    ],
)
def test_a_function_of_u_takes_its_first_element(tmp_path, kind, parameters, expected):
    level = Level()
    source = level.block("Constant", "S", Value="[4 9]")
    level.wire(f"{source}#out:1", f"{level.block(kind, 'B', **parameters)}#in:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (node,) = (node for node in model.expanded.nodes if node.block.name == "B")
    assert flat(model.tracer.output(node)) == pytest.approx(expected)


@pytest.mark.filterwarnings("error")
def test_what_no_number_is_comes_without_a_warning():
    assert np.isnan(float(mapped(np.sqrt, signal([-1.0]))[0]))


def test_vectors_are_multiplied_across(tmp_path):
    level = Level()
    for number, text in enumerate(("[1 2 3]", "[4 -5 7]"), start=1):
        level.wire(f"{level.block('Constant', f'S{number}', Value=text)}#out:1", f"9#in:{number}")
    level.first = 7
    assert level.block("simulink/Vector/Cross Product", "B") == "9"
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (node,) = (node for node in model.expanded.nodes if node.block.name == "B")
    np.testing.assert_allclose(flat(model.tracer.output(node)), np.cross([1, 2, 3], [4, -5, 7]))


@pytest.mark.parametrize("angles", [(0.3, -0.4, 0.5), (2.0, 0.0, -1.0)])
def test_rotation_angles_of_a_quaternion_are_those_of_a_turn_about_z_y_x(tmp_path, angles):
    """Of any length; the angles in the order of their axes."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = 2.0 * Rotation.from_euler("ZYX", angles).as_quat()
    level = Level()
    source = level.block("Constant", "Q", Value=f"[{w} {x} {y} {z}]")
    block = level.block("sharedtransform/Quaternions to Rotation Angles", "B", rotationOrder="ZYX")
    level.wire(f"{source}#out:1", f"{block}#in:1")
    model = read_simulink(write_model(tmp_path / "a.slx", level))
    (node,) = (node for node in model.expanded.nodes if node.block.name == "B")
    np.testing.assert_allclose(
        [float(one) for one in flat(model.tracer.output(node))], angles, atol=1e-12
    )
    assert not model.tracer.opened
