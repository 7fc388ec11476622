"""Neural networks from ONNX files, checked before they run and bounded while they run.

A file from a stranger must not stop a run or change its result from one run to the next. So a network has no
loops, no branches and no random numbers, and its memory and its first evaluation time are bounded.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter, shown
from simrob_drake.extras import needed
from simrob_drake.files import NotRead, content_of
from simrob_drake.frames import Vector

_LARGEST_FILE = 10_000_000
"""Size of a file [bytes]. A network of a million weights has less than half of it."""
_MOST_NODES = 100_000
"""Number of operators of a network whose functions are written out."""
_MOST_MEMORY = 256 * 2**20
"""Memory that the values of all networks take while they are evaluated [bytes]."""
_LONGEST_TRIAL = 5.0
"""Time for the first evaluation [s]. A network of a million weights takes about 1 ms."""
_FLOATS = {"tensor(float)": np.float32, "tensor(double)": np.float64}
_CONTROL_FLOW = frozenset({"Loop", "If", "Scan", "SequenceMap", "BeamSearch", "WhisperBeamSearch", "GreedySearch"})
_RANDOM = frozenset(
    {
        *("RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Bernoulli", "Multinomial"),
        *("Sampling", "BiasDropout", "BitmaskDropout", "BitmaskBiasDropout"),
    }
)
_TRAINING_INPUT = 2
"""Index of Dropout's input ``training_mode``: it draws random numbers if that is true."""


class Network:
    """A function of one vector that gives one, from an ONNX file, evaluated by ONNX Runtime on one thread.

    Attributes:
        inputs: size of the vector that it takes.
        outputs: size of the vector that it gives.
    """

    def __init__(self, file: Path, key: str) -> None:
        """Read a file with a network of one input and one output, of shapes (size,) or (batch, size).

        Raises:
            SimrobError: the file cannot be read, is no network, has a loop, a branch or a random operator, needs too
                much memory or time, or has other inputs and outputs. The message names the ``key``. ONNX Runtime is
                missing.
        """
        with needed("a policy of kind ONNX", "rl"):
            import onnx
            import onnxruntime
        try:
            content = content_of(file, _LARGEST_FILE)
        except NotRead as problem:
            raise InvalidParameter(key, file, f"an ONNX file that can be read ({problem})") from problem
        try:
            model = onnx.ModelProto.FromString(content)
        except Exception as problem:  # protobuf has an error class for each of its implementations
            raise InvalidParameter(key, file, f"a network as ONNX ({shown(str(problem))})") from problem
        _check_operators(model, file, key)
        try:
            self._session: Any = _new_session(content)
        except Exception as problem:  # ONNX Runtime has many classes of its own, without a base
            detail = " ".join(str(problem).split())
            raise InvalidParameter(key, file, f"a network as ONNX ({detail})") from problem
        takes = self._session.get_inputs()
        gives = self._session.get_outputs()
        if len(takes) != 1 or len(gives) != 1:
            detail = f"a network of one input and one output (it has {len(takes)} and {len(gives)})"
            raise InvalidParameter(key, file, detail)
        self.inputs = _size(takes[0], file, key)
        self.outputs = _size(gives[0], file, key)
        self._input = takes[0].name
        self._output = gives[0].name
        self._kind = _FLOATS[takes[0].type]
        self._shape = (1, self.inputs) if len(takes[0].shape) == 2 else (self.inputs,)
        self._try_once(onnxruntime.RunOptions(), file, key)

    def __call__(self, values: Vector) -> Vector:
        """Return the network's output (outputs,) for an input (inputs,)."""
        return self._evaluate(values)

    def _evaluate(self, values: Vector, options: Any = None) -> Vector:
        """Return the output (outputs,) for an input (inputs,), with ONNX Runtime's options for one evaluation."""
        fed = np.asarray(values, dtype=self._kind).reshape(self._shape)
        (output,) = self._session.run([self._output], {self._input: fed}, options)
        return np.asarray(output, dtype=float).reshape(self.outputs)

    def _try_once(self, options: Any, file: Path, key: str) -> None:
        """Evaluate the network at zero, with a deadline.

        A later evaluation would fail in the same way, but in the middle of a run.

        Raises:
            InvalidParameter: the evaluation fails, needs more memory than the bound, or is not done at the deadline.
        """
        options.log_severity_level = 4
        deadline = Timer(_LONGEST_TRIAL, lambda: setattr(options, "terminate", True))
        deadline.daemon = True
        deadline.start()
        try:
            self._evaluate(np.zeros(self.inputs), options)
        except Exception as problem:  # ONNX Runtime has many classes of its own, without a base
            detail = " ".join(str(problem).split())
            if options.terminate:
                detail = f"it is not done after {_LONGEST_TRIAL:g} s"
            elif "Available memory" in detail or "bad allocation" in detail:
                detail = f"it needs more than {_MOST_MEMORY // 2**20} MiB of memory"
            detail = shown(detail)
            raise InvalidParameter(key, file, f"a network that can be evaluated ({detail})") from problem
        finally:
            deadline.cancel()


@cache
def _bound_memory() -> None:
    """Make the allocator that all networks of this process share, which refuses what exceeds the bound."""
    import onnxruntime

    unset = -1  # ONNX Runtime's default
    memory = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    bounds = onnxruntime.OrtArenaCfg(_MOST_MEMORY, unset, unset, unset)
    onnxruntime.create_and_register_allocator(memory, bounds)


def _new_session(content: bytes) -> Any:
    """Return an ONNX Runtime session on one thread with bounded memory, for the bytes of a file."""
    import onnxruntime

    _bound_memory()
    options = onnxruntime.SessionOptions()
    # A policy is small, and several runs share the machine.
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    options.add_session_config_entry("session.use_env_allocators", "1")
    # Constants would be computed while the session is made, where the memory has no bound.
    return onnxruntime.InferenceSession(
        content, options, providers=["CPUExecutionProvider"], disabled_optimizers=["ConstantFolding"]
    )


def _check_operators(model: Any, file: Path, key: str) -> None:
    """Check the operators of a model's graph, subgraphs and functions.

    Raises:
        InvalidParameter: there is a loop, a branch, a random operator, or too many operators.
    """
    functions = {(function.domain, function.name): function for function in model.functions}
    constants = {tensor.name: tensor for tensor in model.graph.initializer}
    bodies = [model.graph, *functions.values()]
    for node in (node for body in bodies for node in _all_nodes(body)):
        # A function of the model may have the name of an operator; its own body is checked instead.
        if (node.domain, node.op_type) in functions:
            continue
        if node.op_type in _CONTROL_FLOW:
            expected = f"a network without loops and branches (it has the operator {node.op_type})"
            raise InvalidParameter(key, file, expected)
        if node.op_type in _RANDOM or _is_training_dropout(node, constants):
            expected = f"a network without random numbers (it has the operator {node.op_type})"
            raise InvalidParameter(key, file, expected)
    if _written_out(model.graph, functions) > _MOST_NODES:
        expected = f"a network of at most {_MOST_NODES} operators, with its functions written out"
        raise InvalidParameter(key, file, expected)


def _is_training_dropout(node: Any, constants: Mapping[str, Any]) -> bool:
    """Tell whether a node is a Dropout that may draw random numbers: its training mode is not a constant false."""
    if node.op_type != "Dropout" or len(node.input) <= _TRAINING_INPUT or not node.input[_TRAINING_INPUT]:
        return False
    mode = constants.get(node.input[_TRAINING_INPUT])
    return mode is None or any(mode.raw_data) or any(mode.int32_data)


def _all_nodes(body: Any) -> Iterator[Any]:
    """Yield the nodes of a graph or function and of the graphs in their attributes."""
    waiting = [body]
    while waiting:
        for node in waiting.pop().node:
            yield node
            for attribute in node.attribute:
                waiting += [attribute.g] if attribute.HasField("g") else []
                waiting += attribute.graphs


def _written_out(graph: Any, functions: Mapping[tuple[str, str], Any]) -> int:
    """Count the nodes of a graph after each call of a function is replaced by the function's nodes.

    ONNX Runtime replaces them when it reads a model: thirty functions that call each other twice are 2**30 nodes.
    The count of a function that calls itself is above the bound.
    """
    counts: dict[tuple[str, str], int] = {}

    def count(name: tuple[str, str]) -> int:
        if name not in functions:
            return 1
        if name not in counts:
            counts[name] = _MOST_NODES + 1  # counts while the function is open, if it calls itself
            calls = [count((node.domain, node.op_type)) for node in _all_nodes(functions[name])]
            counts[name] = min(sum(calls), _MOST_NODES + 1)
        return counts[name]

    return sum(count((node.domain, node.op_type)) for node in _all_nodes(graph))


def _size(port: Any, file: Path, key: str) -> int:
    """Return the size of an input or output; raises InvalidParameter: it is no vector of floats of a known size."""
    *batch, size = port.shape or [None]
    if port.type not in _FLOATS or len(batch) > 1 or not isinstance(size, int):
        expected = (
            f"a network of floats of shapes (size,) or (batch, size) ('{port.name}' is a {port.type} of {port.shape})"
        )
        raise InvalidParameter(key, file, expected)
    return size
