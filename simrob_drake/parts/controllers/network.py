"""A network in an ONNX file: figures in, figures out."""

from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.extras import needed
from simrob_drake.files import NotRead, content_of
from simrob_drake.frames import Vector

_LARGEST = 10_000_000
"""Of a file [bytes]: a policy of a million weights has less than half of it."""
_FLOATS = {"tensor(float)": np.float32, "tensor(double)": np.float64}


class Network:
    """A function of one vector that gives one, from an ONNX file, evaluated by ONNX Runtime on one thread.

    Attributes:
        inputs: the size of what it takes.
        outputs: the size of what it gives.
    """

    def __init__(self, file: Path, key: str) -> None:
        """Read the file.

        Args:
            file: with a network of one input and one output, of shapes (size,) or (batch, size).
            key: where the file is named, for errors.

        Raises:
            SimrobError: no such file, no network, or one of another kind; ONNX Runtime is missing.
        """
        with needed("a policy of kind ONNX", "rl"):
            import onnxruntime
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1  # it is small, and runs beside others
        options.log_severity_level = 4
        try:
            content = content_of(file, _LARGEST)
            self._session: Any = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except NotRead as problem:
            raise InvalidParameter(key, str(file), f"an ONNX file that can be read ({problem})") from problem
        except Exception as problem:  # ONNX Runtime has many classes of its own, without a base
            detail = " ".join(str(problem).split())
            raise InvalidParameter(key, str(file), f"a network as ONNX ({detail})") from problem
        takes, gives = self._session.get_inputs(), self._session.get_outputs()
        if len(takes) != 1 or len(gives) != 1:
            detail = f"a network of one input and one output (it has {len(takes)} and {len(gives)})"
            raise InvalidParameter(key, str(file), detail)
        self.inputs, self.outputs = (_size(port, file, key) for port in (takes[0], gives[0]))
        self._input, self._output, self._kind = takes[0].name, gives[0].name, _FLOATS[takes[0].type]
        self._shape = (1, self.inputs) if len(takes[0].shape) == 2 else (self.inputs,)

    def __call__(self, values: Vector) -> Vector:
        """Return what it gives (outputs,) for values (inputs,)."""
        fed = np.asarray(values, dtype=self._kind).reshape(self._shape)
        (output,) = self._session.run([self._output], {self._input: fed})
        return np.asarray(output, dtype=float).reshape(self.outputs)


def _size(port: Any, file: Path, key: str) -> int:
    *batch, size = port.shape or [None]
    if port.type not in _FLOATS or len(batch) > 1 or not isinstance(size, int):
        expected = (
            f"a network of floats of shapes (size,) or (batch, size) ('{port.name}' is a {port.type} of {port.shape})"
        )
        raise InvalidParameter(key, str(file), expected)
    return size
