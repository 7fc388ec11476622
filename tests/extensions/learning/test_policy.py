"""A policy as a block, in a station's file and as ONNX: the same figures; and what is refused."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.learning.policy import LearntPolicy, Policy

pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")

from simrob_drake.extensions.learning.policy import Network  # noqa: E402
from simrob_drake.extensions.learning.writing import write_network  # noqa: E402

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
    return load_station(
        "irb120_dynamic",
        {**STILL, "controllers.learnt": {**SECTION, "network": str(file), **changed}},
    )


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
    section = Policy(
        kind="policy", moves_deg=1.0, observes=SECTION["observes"], clock=[1.0], goal=[0.3]
    )
    block = LearntPolicy(section, reach=reach, home=np.zeros(6))
    block.law = Network(file, "here")
    context = block.CreateDefaultContext()
    samples = np.arange(0, 0.5, 0.02)
    last, actions = np.zeros(2), []
    for time in samples:
        # what stood there when the sample was taken
        at = np.searchsorted(result.times, time - 1e-9)
        told = {
            name: np.array([result[f"{name}.encoders.joint_{joint}"][at] for joint in range(1, 7)])
            for name in ("position", "velocity")
        }
        for name, value in told.items():
            block.GetInputPort(name).FixValue(context, value)
        clock = 2 * np.pi * time
        seen = np.concatenate(
            [told["position"], told["velocity"], last, [np.sin(clock), np.cos(clock), 0.3]]
        )
        np.testing.assert_allclose(block.observe(context), seen, atol=1e-12)
        context.get_mutable_discrete_state().SetFrom(
            block.EvalUniquePeriodicDiscreteUpdate(context)
        )
        last = block.GetOutputPort("action").Eval(context)
        np.testing.assert_allclose(last, np.clip(by_numpy(seen, layers()), -1, 1), atol=5e-6)
        np.testing.assert_array_equal(
            block.GetOutputPort("offset").Eval(context)[[1, 4]], reach[[1, 4]] * last
        )
        actions.append(last)
    rows = np.searchsorted(result.times, samples + 0.01 - 1e-9)
    shown = np.column_stack(
        [result["learnt.offset.joint_2"][rows], result["learnt.offset.joint_5"][rows]]
    )
    np.testing.assert_array_equal(shown, reach[[1, 4]] * actions)
    assert np.ptp(actions, axis=0).min() > 0.05
    np.testing.assert_allclose(result["q_ref.joint_2"][rows], shown[:, 0], atol=1e-12)


def test_attitude_is_seen_from_how_the_robot_stood():
    start = RollPitchYaw(0, 0, np.pi / 2).ToRotationMatrix()
    section = Policy(kind="policy", moves_deg=1.0, observes=["attitude", "angular_velocity"])
    block = LearntPolicy(section, reach=np.ones(2), home=np.zeros(2), upright=start)
    context = block.CreateDefaultContext()
    now = start @ RotationMatrix(RollPitchYaw(0.1, -0.2, 0.3))
    # of either sign
    block.GetInputPort("orientation").FixValue(context, -now.ToQuaternion().wxyz())
    block.GetInputPort("angular_velocity").FixValue(context, [1, 2, 3])
    np.testing.assert_allclose(block.observe(context), [0.1, -0.2, 0.3, 1, 2, 3], atol=1e-12)


def test_a_policy_of_the_wrong_size_is_refused_with_both_sizes(tmp_path):
    file = write_network(tmp_path / "net.onnx", layers(inputs=5, outputs=3))
    with pytest.raises(
        SimrobError,
        match=r"takes 5 figures and gives 3; it must be one that takes the 17 .* and gives 2",
    ):
        simulate(station(file), duration=0.1)


@pytest.mark.parametrize(
    ("weights", "value"), [([np.inf, 0], "inf"), ([-np.inf, 0], "-inf"), ([np.inf, -np.inf], "nan")]
)
def test_an_action_that_is_not_finite_ends_the_run_with_its_value(tmp_path, weights, value):
    (first, one), (second, two) = layers()
    first[:2], one[:2] = 0.0, 1.0  # two neurons of tanh(1), whatever is observed
    second[0, :2] = weights
    result = simulate(
        station(write_network(tmp_path / "net.onnx", [(first, one), (second, two)])), duration=0.1
    )
    assert (result.ending, result.stopped_by) == ("failed", "controller.learnt")
    assert (
        result.message
        == f"controller.learnt failed at 0 s: it has a network that gives {value} as an action"
    )


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "No such file"),
        (b"no network", "must be a network as ONNX"),
        (b"", "must be a network as ONNX"),
    ],
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
        inputs = [
            helper.make_tensor_value_info(f"in{n}", each, [1, 2]) for n, each in enumerate(types)
        ]
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
        (
            {"observes": ["positon"], "reads": {}, "clock": [], "goal": []},
            "did you mean 'position'",
        ),
        ({"clock": []}, "clock goes with 'clock'"),
        ({"observes": ["position"], "reads": {}, "clock": []}, "goal goes with 'goal'"),
        (
            {"observes": ["heading_error"], "clock": [], "goal": [], "reads": {}},
            "heading_error goes with a goal",
        ),
        ({"moves_deg": {"joint_9": 3}}, "joint_9"),
        ({"moves_deg": {"joint_2": -3}}, "positive"),
    ],
)
def test_a_section_that_cannot_be_says_why(tmp_path, changed, told):
    with pytest.raises(SimrobError, match=told):
        simulate(
            load_station("irb120_dynamic", {**STILL, "controllers.learnt": {**SECTION, **changed}}),
            duration=0.1,
        )


def test_layers_that_do_not_fit_are_refused(tmp_path):
    (first, _), (_, second) = layers(), layers(hidden=5)
    with pytest.raises(
        SimrobError, match=r"weights of layer 1 is of shape \(2, 5\); it must be of shape \(2, 8\)"
    ):
        write_network(tmp_path / "net.onnx", [first, second])


def network_file(folder, nodes, constants=(), functions=()):
    """Write a network of an input x (1, 2) and an output y (1, 2), with these nodes, and return its file."""
    helper = onnx.helper
    ports = [helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, 2]) for name in "xy"]
    graph = helper.make_graph(nodes, "graph", ports[:1], ports[1:], list(constants))
    opsets = [helper.make_opsetid("", 17), helper.make_opsetid("own", 1)]
    model = helper.make_model(graph, opset_imports=opsets, ir_version=8, functions=list(functions))
    file = folder / "net.onnx"
    file.write_bytes(model.SerializeToString())
    return file


def own_function(name, nodes):
    return onnx.helper.make_function(
        "own", name, ["x"], ["y"], nodes, [onnx.helper.make_opsetid("", 17)]
    )


def loop_of(rounds):
    """Return the node and the constants of a loop that copies its value in each of its rounds."""
    helper, kind = onnx.helper, onnx.TensorProto
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["going"], ["goes_on"]),
            helper.make_node("Identity", ["before"], ["after"]),
        ],
        "body",
        [
            helper.make_tensor_value_info("number", kind.INT64, []),
            helper.make_tensor_value_info("going", kind.BOOL, []),
            helper.make_tensor_value_info("before", kind.FLOAT, [1, 2]),
        ],
        [
            helper.make_tensor_value_info("goes_on", kind.BOOL, []),
            helper.make_tensor_value_info("after", kind.FLOAT, [1, 2]),
        ],
    )
    constants = [
        helper.make_tensor("rounds", kind.INT64, [], [rounds]),
        helper.make_tensor("always", kind.BOOL, [], [True]),
    ]
    return helper.make_node("Loop", ["rounds", "always", "x"], ["y"], body=body), constants


def test_a_loop_is_refused_before_it_runs(tmp_path):
    node, constants = loop_of(2**62)
    told = r"here is .*net.onnx; it must be a network without loops and branches \(it has the operator Loop\)"
    with pytest.raises(SimrobError, match=told):
        Network(network_file(tmp_path, [node], constants), "here")


@pytest.mark.parametrize("operator", ["RandomNormalLike", "RandomUniformLike", "Bernoulli"])
@pytest.mark.parametrize("hidden", [False, True], ids=["in the graph", "in a function"])
def test_random_operators_are_refused_by_name(tmp_path, operator, hidden):
    node = onnx.helper.make_node(operator, ["x"], ["y"])
    call = onnx.helper.make_node("Draw", ["x"], ["y"], domain="own")
    file = network_file(
        tmp_path,
        [call if hidden else node],
        functions=[own_function("Draw", [node])] if hidden else [],
    )
    with pytest.raises(
        SimrobError, match=rf"without random numbers \(it has the operator {operator}\)"
    ):
        Network(file, "here")


@pytest.mark.parametrize("training", [True, False])
def test_a_dropout_is_refused_only_in_training(tmp_path, training):
    helper, kind = onnx.helper, onnx.TensorProto
    constants = [helper.make_tensor("ratio", kind.FLOAT, [], [0.5])]
    constants.append(helper.make_tensor("training", kind.BOOL, [], [training]))
    node = helper.make_node("Dropout", ["x", "ratio", "training"], ["y"])
    file = network_file(tmp_path, [node], constants)
    if training:
        with pytest.raises(
            SimrobError, match=r"without random numbers \(it has the operator Dropout\)"
        ):
            Network(file, "here")
    else:
        np.testing.assert_array_equal(Network(file, "here")(np.array([1.0, -2.0])), [1.0, -2.0])


def test_a_network_that_makes_gigabytes_is_refused(tmp_path):
    """8 GB of zeros, of which the largest is added to the input."""
    helper, kind = onnx.helper, onnx.TensorProto
    constants = [helper.make_tensor("shape", kind.INT64, [2], [100_000, 20_000])]
    nodes = [
        helper.make_node("ConstantOfShape", ["shape"], ["zeros"]),
        helper.make_node("ReduceMax", ["zeros"], ["largest"], keepdims=1),
        helper.make_node("Add", ["x", "largest"], ["y"]),
    ]
    with pytest.raises(SimrobError, match=r"needs more than 256 MiB"):
        Network(network_file(tmp_path, nodes, constants), "here")


def test_functions_that_call_others_twice_are_counted_written_out(tmp_path):
    """Forty functions of two calls each are 2**40 operators."""
    make = onnx.helper.make_node
    functions = [own_function("F0", [make("Tanh", ["x"], ["y"])])]
    for number in range(1, 41):
        calls = [
            make(f"F{number - 1}", ["x"], ["z"], domain="own"),
            make(f"F{number - 1}", ["z"], ["y"], domain="own"),
        ]
        functions.append(own_function(f"F{number}", calls))
    file = network_file(tmp_path, [make("F40", ["x"], ["y"], domain="own")], functions=functions)
    with pytest.raises(SimrobError, match="at most 100000 operators"):
        Network(file, "here")
