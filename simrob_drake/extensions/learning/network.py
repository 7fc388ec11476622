"""Neural networks from ONNX files, checked before they run and bounded while they run.

An ONNX file describes a network as a graph of nodes. Each node applies an operator, such as a matrix product. An
operator can also be a function: a graph of its own, which the same file defines.

A file from a stranger must not stop a run or change its result from one run to the next. So a network has no
loops, no branches and no random numbers, and its memory and its first evaluation time are bounded.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from threading import Timer
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.errors import InvalidParameter, format_value
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.files import NotRead, content_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message

_LARGEST_FILE = 10_000_000
"""Largest size of a file [bytes]. A network of a million weights has less than half of it."""
_MOST_NODES = 100_000
"""Largest count of a network's nodes, after the calls of functions are replaced by the functions' nodes."""
_MOST_MEMORY = 256 * 2**20
"""Largest memory of the values of all networks while they are evaluated [bytes]."""
_LONGEST_TRIAL = 5.0
"""Longest duration of the first evaluation [s]. A network of a million weights takes about 1 ms."""
_FLOATS = {"tensor(float)": np.float32, "tensor(double)": np.float64}
"""Types of numbers that inputs and outputs may have, by ONNX Runtime's names."""
_CONTROL_FLOW = frozenset(
    {"Loop", "If", "Scan", "SequenceMap", "BeamSearch", "WhisperBeamSearch", "GreedySearch"}
)
"""Operators with loops or branches."""
_RANDOM = frozenset(
    {
        *(
            "RandomNormal",
            "RandomNormalLike",
            "RandomUniform",
            "RandomUniformLike",
            "Bernoulli",
            "Multinomial",
        ),
        *("Sampling", "BiasDropout", "BitmaskDropout", "BitmaskBiasDropout"),
    }
)
"""Operators that draw random numbers."""
_TRAINING_INPUT = 2
"""Index of Dropout's input ``training_mode``: it draws random numbers if that is true."""


class Network:
    """A function of one vector with one vector as its result, read from an ONNX file.

    ONNX Runtime evaluates it on one thread.

    Attributes:
        inputs: size of the input vector.
        outputs: size of the output vector.
    """

    def __init__(self, file: Path, key: str) -> None:
        """Read a file with a network of one input and one output, of shapes (size,) or (batch, size).

        Args:
            file: the ONNX file.
            key: key of the station file that names the file, for error messages.

        Raises:
            SimrobError: the file cannot be read, is no network, has a loop, a branch or a random operator, needs too
                much memory or time, or has other inputs and outputs. The message names the ``key``. ONNX Runtime is
                missing.
        """
        with importing_extra(message("learning.policy_of_onnx", "a policy of kind ONNX"), "rl"):
            import onnx
            import onnxruntime
        try:
            content = content_of(file, _LARGEST_FILE)
        except NotRead as problem:
            raise InvalidParameter(
                key,
                file,
                message(
                    "learning.readable_onnx",
                    "an ONNX file that can be read ({problem})",
                    problem=problem,
                ),
            ) from problem
        try:
            model = onnx.ModelProto.FromString(content)
        except Exception as problem:  # protobuf has an error class for each of its implementations
            raise InvalidParameter(
                key,
                file,
                message(
                    "learning.network_as_onnx",
                    "a network as ONNX ({problem})",
                    problem=format_value(str(problem)),
                ),
            ) from problem
        _check_operators(model, file, key)
        try:
            self._session: Any = _new_session(content)
        except Exception as problem:  # ONNX Runtime has many classes of its own, without a base
            detail = " ".join(str(problem).split())
            raise InvalidParameter(
                key,
                file,
                message(
                    "learning.network_as_onnx", "a network as ONNX ({problem})", problem=detail
                ),
            ) from problem

        inputs = self._session.get_inputs()
        outputs = self._session.get_outputs()
        if len(inputs) != 1 or len(outputs) != 1:
            detail = message(
                "learning.one_input_and_output",
                "a network of one input and one output (it has {inputs} and {outputs})",
                inputs=len(inputs),
                outputs=len(outputs),
            )
            raise InvalidParameter(key, file, detail)
        self.inputs = _vector_size(inputs[0], file, key)
        self.outputs = _vector_size(outputs[0], file, key)
        self._input_name = inputs[0].name
        self._output_name = outputs[0].name
        self._number_type = _FLOATS[inputs[0].type]
        # A network for batches of inputs gets a batch of one.
        has_batches = len(inputs[0].shape) == 2
        self._input_shape = (1, self.inputs) if has_batches else (self.inputs,)
        self._try_once(onnxruntime.RunOptions(), file, key)

    def __call__(self, values: Vector) -> Vector:
        """Compute the network's output (outputs,) for an input (inputs,)."""
        return self._evaluate(values)

    def _evaluate(self, values: Vector, options: Any = None) -> Vector:
        """Compute the output (outputs,) for an input (inputs,).

        Args:
            values: the input.
            options: ONNX Runtime's options for this evaluation, its defaults if None.
        """
        input_tensor = np.asarray(values, dtype=self._number_type).reshape(self._input_shape)
        (output,) = self._session.run(
            [self._output_name], {self._input_name: input_tensor}, options
        )
        return np.asarray(output, dtype=float).reshape(self.outputs)

    def _try_once(self, options: Any, file: Path, key: str) -> None:
        """Evaluate the network at zero, with a deadline, so that a network that fails does so before a run.

        Args:
            options: new options of ONNX Runtime for this evaluation. At the deadline, their attribute ``terminate``
                is set, which stops the evaluation.
            file: the network's file, for error messages.
            key: key of the station file that names the file, for error messages.

        Raises:
            InvalidParameter: the evaluation fails, needs more memory than the bound, or is not done at the deadline.
        """

        def stop_evaluation() -> None:
            options.terminate = True

        options.log_severity_level = 4  # only fatal errors
        deadline = Timer(_LONGEST_TRIAL, stop_evaluation)
        deadline.daemon = True
        deadline.start()
        try:
            self._evaluate(np.zeros(self.inputs), options)
        except Exception as problem:  # ONNX Runtime has many classes of its own, without a base
            detail = " ".join(str(problem).split())
            if options.terminate:
                detail = message(
                    "learning.not_done_after",
                    "it is not done after {seconds:g} s",
                    seconds=_LONGEST_TRIAL,
                )
            elif "Available memory" in detail or "bad allocation" in detail:
                detail = message(
                    "learning.needs_too_much_memory",
                    "it needs more than {megabytes} MiB of memory",
                    megabytes=_MOST_MEMORY // 2**20,
                )
            detail = format_value(detail)
            raise InvalidParameter(
                key,
                file,
                message(
                    "learning.evaluable_network",
                    "a network that can be evaluated ({problem})",
                    problem=detail,
                ),
            ) from problem
        finally:
            deadline.cancel()


@cache
def _bound_memory() -> None:
    """Register an allocator that all networks of this process share, and that refuses more than _MOST_MEMORY.

    The allocator is registered at the first call only, which is what the cache is for.
    """
    import onnxruntime

    unset = -1  # ONNX Runtime's default
    memory = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    bounds = onnxruntime.OrtArenaCfg(_MOST_MEMORY, unset, unset, unset)
    onnxruntime.create_and_register_allocator(memory, bounds)


def _new_session(content: bytes) -> Any:
    """Make an ONNX Runtime session, which evaluates a network, on one thread with bounded memory.

    Args:
        content: the bytes of the ONNX file.
    """
    import onnxruntime

    _bound_memory()
    options = onnxruntime.SessionOptions()
    # A policy is small, and several runs share the machine.
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # only fatal errors
    options.add_session_config_entry("session.use_env_allocators", "1")
    # Constants would be computed while the session is made, where the memory has no bound.
    return onnxruntime.InferenceSession(
        content,
        options,
        providers=["CPUExecutionProvider"],
        disabled_optimizers=["ConstantFolding"],
    )


class _FunctionName(NamedTuple):
    """Name by which the nodes of an ONNX file call an operator or one of the file's functions.

    Attributes:
        domain: namespace of the name; empty for ONNX's standard operators.
        name: the name in that namespace, such as ``MatMul``.
    """

    domain: str
    name: str


def _check_operators(model: Any, file: Path, key: str) -> None:
    """Check the operators of a model's graph, subgraphs and functions.

    Args:
        model: the content of the file, as an ``onnx.ModelProto``.
        file: the network's file, for error messages.
        key: key of the station file that names the file, for error messages.

    Raises:
        InvalidParameter: there is a loop, a branch, a random operator, or too many operators.
    """
    functions = {
        _FunctionName(function.domain, function.name): function for function in model.functions
    }
    constants = {tensor.name: tensor for tensor in model.graph.initializer}
    for body in (model.graph, *functions.values()):
        for node in _all_nodes(body):
            # A function of the model may have the name of an operator; its own body is checked instead.
            if _called_by(node) in functions:
                continue
            if node.op_type in _CONTROL_FLOW:
                expected = message(
                    "learning.network_without_loops",
                    "a network without loops and branches (it has the operator {operator})",
                    operator=node.op_type,
                )
                raise InvalidParameter(key, file, expected)
            if node.op_type in _RANDOM or _is_training_dropout(node, constants):
                expected = message(
                    "learning.network_without_random",
                    "a network without random numbers (it has the operator {operator})",
                    operator=node.op_type,
                )
                raise InvalidParameter(key, file, expected)
    if _count_expanded_nodes(model.graph, functions) > _MOST_NODES:
        expected = message(
            "learning.network_of_few_operators",
            "a network of at most {most} operators, with its functions written out",
            most=_MOST_NODES,
        )
        raise InvalidParameter(key, file, expected)


def _called_by(node: Any) -> _FunctionName:
    """Name of the operator or function that a node applies."""
    return _FunctionName(node.domain, node.op_type)


def _is_training_dropout(node: Any, constants: Mapping[str, Any]) -> bool:
    """Whether a node is a Dropout that may draw random numbers: its training mode is not a constant false.

    Args:
        node: a node of a graph, an ``onnx.NodeProto``.
        constants: the constant tensors of the model, by name.
    """
    if node.op_type != "Dropout":
        return False
    # The input is optional: it can be missing or have an empty name. Then the training mode is off.
    if len(node.input) <= _TRAINING_INPUT or not node.input[_TRAINING_INPUT]:
        return False
    mode = constants.get(node.input[_TRAINING_INPUT])
    if mode is None:
        return True  # computed while the network runs
    # ONNX stores a boolean in one of these two fields.
    return any(mode.raw_data) or any(mode.int32_data)


def _all_nodes(body: Any) -> Iterator[Any]:
    """Yield the nodes of a graph or function, and of the graphs that are attributes of its nodes."""
    bodies_left = [body]
    while bodies_left:
        for node in bodies_left.pop().node:
            yield node
            for attribute in node.attribute:
                if attribute.HasField("g"):
                    bodies_left.append(attribute.g)
                bodies_left.extend(attribute.graphs)


def _count_expanded_nodes(graph: Any, functions: Mapping[_FunctionName, Any]) -> int:
    """Count the nodes of a graph after each call of a function is replaced by the function's nodes.

    ONNX Runtime replaces them when it reads a model: thirty functions that call each other twice are 2**30 nodes.
    So each function's nodes are counted once, and counts stop growing at _MOST_NODES + 1. The count of a function
    that calls itself has this value, too.
    """
    too_many = _MOST_NODES + 1
    counts: dict[_FunctionName, int] = {}

    def count(called: _FunctionName) -> int:
        """Count the nodes that replace a call. A call of an operator is a single node, which stays as it is."""
        if called not in functions:
            return 1
        if called not in counts:
            # This value is found below if the function calls itself, since its count is not finished.
            counts[called] = too_many
            node_counts = [count(_called_by(node)) for node in _all_nodes(functions[called])]
            counts[called] = min(sum(node_counts), too_many)
        return counts[called]

    return sum(count(_called_by(node)) for node in _all_nodes(graph))


def _vector_size(port: Any, file: Path, key: str) -> int:
    """Size of the vectors that an input or output of a network has.

    Args:
        port: description of the input or output by ONNX Runtime, with its name, type and shape.
        file: the network's file, for error messages.
        key: key of the station file that names the file, for error messages.

    Raises:
        InvalidParameter: the values are no floats, or the shape is not (size,) or (batch, size) with a known size.
    """
    # A scalar has an empty shape; its size counts as unknown.
    *batch, size = port.shape or [None]
    if port.type not in _FLOATS or len(batch) > 1 or not isinstance(size, int):
        expected = message(
            "learning.network_of_floats",
            "a network of floats of shapes (size,) or (batch, size) ('{port}' is a {kind} of {shape})",
            port=port.name,
            kind=port.type,
            shape=port.shape,
        )
        raise InvalidParameter(key, file, expected)
    return size
