"""A policy as a block, in a station's file and as ONNX: the same figures; and what is refused."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from simrob_drake import load_station, simulate
from simrob_drake.errors import SimrobError
from simrob_drake.parts.controllers.policy import LearntPolicy, Policy

pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")

from simrob_drake.learning.writing import write_network  # noqa: E402
from simrob_drake.parts.controllers.policy import Network  # noqa: E402

SECTION = {
    "kind": "policy",
    "rate": 50,
    "reads": {"position": "encoders", "velocity": "encoders"},
    "moves_deg": {"joint_2": 20, "joint_5": 10},
    "observes": ["position", "velocity", "action", "clock", "goal"],
    "clock": [1.0],
    "goal": [0.3],
}
SIZE = 6 + 6 + 2 + 2 + 1
ENCODERS = {"kind": "encoders", "rate": 100, "resolution_deg": 0.01, "noise_deg": 0.05, "seed": 3}
STILL = {
    "pieces": {},
    "floor": None,
    "reference": {"kind": "hold"},
    "solver": {"kind": "discrete", "time_step": 1e-3},
    "servo.realization": "implicit",
    "sensors.encoders": ENCODERS,
}


def layers(hidden=8, inputs=SIZE, outputs=2):
    draw = np.random.default_rng(1)
    return [
        (draw.normal(size=(hidden, inputs)), draw.normal(size=hidden)),
        (draw.normal(size=(outputs, hidden)), draw.normal(size=outputs)),
    ]


def by_numpy(observation, layers):
    (first, one), (second, two) = layers
    return second @ np.tanh(first @ observation + one) + two


def station(file, **changed):
    return load_station("irb120_dynamic", {**STILL, "controllers.learnt": {**SECTION, "network": str(file), **changed}})


def test_onnx_is_the_network_that_was_written(tmp_path):
    network = Network(write_network(tmp_path / "net.onnx", layers()), "here")
    seen = np.linspace(-1, 1, SIZE)
    assert (network.inputs, network.outputs) == (SIZE, 2)
    np.testing.assert_allclose(network(seen), by_numpy(seen, layers()), atol=2e-6)  # 32 bits


def test_a_linear_policy_and_one_that_ends_in_a_bounded_layer_are_networks_too(tmp_path):
    seen, (layer, _) = np.linspace(-1, 1, SIZE), layers(hidden=2)
    linear = Network(write_network(tmp_path / "linear.onnx", [layer]), "here")
    bounded = Network(write_network(tmp_path / "bounded.onnx", [layer], last="Tanh"), "here")
    expected = layer[0] @ seen + layer[1]
    np.testing.assert_allclose(linear(seen), expected, atol=2e-6)
    np.testing.assert_allclose(bounded(seen), np.tanh(expected), atol=2e-6)


def test_block_station_and_onnx_give_the_same(tmp_path):
    """The station's run tells what was observed; the block alone, fed with that, and NumPy give the same actions."""
    file = write_network(tmp_path / "net.onnx", layers())
    config = station(file)
    result = simulate(config, duration=0.5, progress=False)
    reach = np.deg2rad([0, 20, 0, 0, 10, 0])
    section = Policy(kind="policy", moves_deg=1.0, observes=SECTION["observes"], clock=[1.0], goal=[0.3])
    block = LearntPolicy(section, reach=reach, home=np.zeros(6))
    block.law = Network(file, "here")
    context = block.CreateDefaultContext()
    samples = np.arange(0, 0.5, 0.02)
    last, actions = np.zeros(2), []
    for time in samples:
        at = np.searchsorted(result.times, time - 1e-9)  # what stood there when the sample was taken
        told = {
            name: np.array([result[f"{name}.encoders.joint_{joint}"][at] for joint in range(1, 7)])
            for name in ("position", "velocity")
        }
        for name, value in told.items():
            block.GetInputPort(name).FixValue(context, value)
        clock = 2 * np.pi * time
        seen = np.concatenate([told["position"], told["velocity"], last, [np.sin(clock), np.cos(clock), 0.3]])
        np.testing.assert_allclose(block.observe(context), seen, atol=1e-12)
        context.get_mutable_discrete_state().SetFrom(block.EvalUniquePeriodicDiscreteUpdate(context))
        last = block.GetOutputPort("action").Eval(context)
        np.testing.assert_allclose(last, np.clip(by_numpy(seen, layers()), -1, 1), atol=5e-6)
        np.testing.assert_array_equal(block.GetOutputPort("offset").Eval(context)[[1, 4]], reach[[1, 4]] * last)
        actions.append(last)
    rows = np.searchsorted(result.times, samples + 0.01 - 1e-9)
    shown = np.column_stack([result["learnt.offset.joint_2"][rows], result["learnt.offset.joint_5"][rows]])
    np.testing.assert_array_equal(shown, reach[[1, 4]] * actions)
    assert np.ptp(actions, axis=0).min() > 0.05
    np.testing.assert_allclose(result["q_ref.joint_2"][rows], shown[:, 0], atol=1e-12)


def test_attitude_is_seen_from_how_the_robot_stood():
    start = RollPitchYaw(0, 0, np.pi / 2).ToRotationMatrix()
    section = Policy(kind="policy", moves_deg=1.0, observes=["attitude", "angular_velocity"])
    block = LearntPolicy(section, reach=np.ones(2), home=np.zeros(2), upright=start)
    context = block.CreateDefaultContext()
    now = start @ RotationMatrix(RollPitchYaw(0.1, -0.2, 0.3))
    block.GetInputPort("orientation").FixValue(context, -now.ToQuaternion().wxyz())  # of either sign
    block.GetInputPort("angular_velocity").FixValue(context, [1, 2, 3])
    np.testing.assert_allclose(block.observe(context), [0.1, -0.2, 0.3, 1, 2, 3], atol=1e-12)


def test_a_policy_of_the_wrong_size_is_refused_with_both_sizes(tmp_path):
    file = write_network(tmp_path / "net.onnx", layers(inputs=5, outputs=3))
    with pytest.raises(
        SimrobError, match=r"takes 5 figures and gives 3; it must be one that takes the 17 .* and gives 2"
    ):
        simulate(station(file), duration=0.1)


def test_a_network_that_gives_no_number_is_told_as_what_it_is(tmp_path):
    """From a moment on: at the start the clock's sine is 0, later times a weight of infinity it is."""
    (first, one), (second, two) = layers()
    second[0, 0] = np.inf
    result = simulate(station(write_network(tmp_path / "net.onnx", [(first, one), (second, two)])), duration=0.1)
    assert (result.ending, result.stopped_by) == ("completed", None)  # an infinite action is one, at its bound
    second[0, 1] = -np.inf
    one[:2], first[:2] = 1.0, 0.0
    result = simulate(station(write_network(tmp_path / "net.onnx", [(first, one), (second, two)])), duration=0.1)
    assert (result.ending, result.stopped_by) == ("failed", "controller.learnt")
    assert result.message == "controller.learnt failed at 0 s: it has a network that gives nan as an action"


@pytest.mark.parametrize(
    ("content", "told"),
    [(None, "No such file"), (b"no network", "must be a network as ONNX"), (b"", "must be a network as ONNX")],
)
def test_a_file_that_is_no_network_is_refused(tmp_path, content, told):
    file = tmp_path / "net.onnx"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SimrobError, match=told) as refused:
        simulate(station(file), duration=0.1)
    assert "controllers.learnt.network" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_networks_of_several_inputs_or_of_whole_numbers_are_refused(tmp_path):
    helper, kind = onnx.helper, onnx.TensorProto
    for name, types, told in (
        ("two", [kind.FLOAT, kind.FLOAT], r"one input and one output \(it has 2 and 1\)"),
        ("whole", [kind.INT64], r"tensor\(int64\)"),
    ):
        inputs = [helper.make_tensor_value_info(f"in{n}", each, [1, 2]) for n, each in enumerate(types)]
        output = helper.make_tensor_value_info("out", types[0], [1, 2])
        node = helper.make_node("Add", [inputs[0].name, inputs[-1].name], ["out"])
        graph = helper.make_graph([node], "g", inputs, [output])
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        file = tmp_path / f"{name}.onnx"
        file.write_bytes(model.SerializeToString())
        with pytest.raises(SimrobError, match=told):
            Network(file, "here")


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"observes": ["positon"], "reads": {}, "clock": [], "goal": []}, "did you mean 'position'"),
        ({"clock": []}, "clock goes with 'clock'"),
        ({"observes": ["position"], "reads": {}, "clock": []}, "goal goes with 'goal'"),
        ({"observes": ["heading_error"], "clock": [], "goal": [], "reads": {}}, "heading_error goes with a goal"),
        ({"moves_deg": {"joint_9": 3}}, "joint_9"),
        ({"moves_deg": {"joint_2": -3}}, "positive"),
    ],
)
def test_a_section_that_cannot_be_says_why(tmp_path, changed, told):
    with pytest.raises(SimrobError, match=told):
        simulate(load_station("irb120_dynamic", {**STILL, "controllers.learnt": {**SECTION, **changed}}), duration=0.1)


def test_layers_that_do_not_fit_are_refused(tmp_path):
    (first, _), (_, second) = layers(), layers(hidden=5)
    with pytest.raises(SimrobError, match=r"weights of layer 1 is of shape \(2, 5\); it must be of shape \(2, 8\)"):
        write_network(tmp_path / "net.onnx", [first, second])
