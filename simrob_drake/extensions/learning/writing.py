"""Write policies as ONNX files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.folders import replaced_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message

_OPSET = 17
_IR = 8  # versions of the format that every ONNX Runtime of the last years reads


def write_network(
    file: Path | str,
    layers: Sequence[tuple[Vector, Vector]],
    *,
    activation: str = "Tanh",
    last: str = "Identity",
) -> Path:
    r"""Write a network of full layers, :math:`x_{l+1} = \sigma(W_l x_l + b_l)`.

    Args:
        file: to be written.
        layers: weights (outputs, inputs) and biases (outputs,) of each; one alone is a linear policy.
        activation: an operator of ONNX, such as ``Tanh``, ``Relu`` or ``Elu``.
        last: that of the last layer.

    Raises:
        InvalidParameter: layers that do not fit together.
    """
    file = as_path(file, "file")
    with importing_extra(message("learning.writing_onnx", "writing ONNX"), "rl"):
        from onnx import TensorProto, checker, helper, numpy_helper
    for number, (weights, biases) in enumerate(layers):
        expected = (len(biases), weights.shape[1] if number == 0 else len(layers[number - 1][1]))
        if weights.shape != expected:
            raise InvalidParameter(
                message("learning.weights_of_layer", "weights of layer {number}", number=number),
                message("learning.of_shape", "of shape {shape}", shape=weights.shape),
                message("learning.of_shape", "of shape {shape}", shape=expected),
            )
    nodes, stored, name = list[Any](), list[Any](), "observation"
    for number, layer in enumerate(layers):
        names = [f"weights_{number}", f"biases_{number}"]
        stored += [
            numpy_helper.from_array(np.asarray(a, np.float32), n)
            for a, n in zip(layer, names, strict=True)
        ]
        at_end = number == len(layers) - 1
        sums, values = f"sums_{number}", "action" if at_end else f"values_{number}"
        nodes.append(helper.make_node("Gemm", [name, *names], [sums], transB=1))
        nodes.append(helper.make_node(last if at_end else activation, [sums], [values]))
        name = values
    ports = [
        helper.make_tensor_value_info(port, TensorProto.FLOAT, ["batch", size])
        for port, size in (("observation", layers[0][0].shape[1]), ("action", len(layers[-1][1])))
    ]
    graph = helper.make_graph(nodes, "policy", ports[:1], ports[1:], stored)
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR
    )
    checker.check_model(model)
    with replaced_at_once(file) as work:
        work.write_bytes(model.SerializeToString())
    return file
