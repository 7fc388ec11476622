"""Code of MATLAB Functions as blocks of a signal flow, against the same functions in Python."""

import numpy as np
import pytest

from simrob_drake.extensions.simulink.signals.arithmetic import applied, inverse
from simrob_drake.extensions.simulink.signals.forms import (
    TIME,
    Primitive,
    blocks_in,
    flat,
    mapped,
    signal,
)
from simrob_drake.extensions.simulink.signals.sources import orientation
from simrob_drake.extensions.simulink.signals.translation import Translation, as_signal
from simrob_drake.extensions.simulink.values.code import undefined
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood, functions_of
from simrob_drake.extensions.simulink.writing.references import over_time

TIMES = np.linspace(0, 2, 81)
"""The argument u runs over these, less 1."""


def translated(code):
    functions = functions_of(code)
    (main, *_) = functions.values()
    outputs = Translation({}, undefined, None, functions).called(
        main.name, [signal([TIME - 1.0]).reshape(1, 1)]
    )
    return over_time([value for output in outputs for value in flat(as_signal(output))], TIMES)


def bisected(square):
    """The root of a number, from halves of the way between 0 and 2, and how many halves that took."""
    low, high, rounds = 0.0, 2.0, 0
    while True:
        rounds, middle = rounds + 1, (low + high) / 2
        low, high = (low, middle) if middle**2 > square else (middle, high)
        if abs(middle**2 - square) <= 1e-3:
            return middle, rounds


@pytest.mark.parametrize(
    ("code", "equation"),
    [
        ("function y = f(u)\ny = 3*u^2 - 2/(u + 5) + sin(u)*cosd(60*u);",
         lambda u: [3 * u**2 - 2 / (u + 5) + np.sin(u) * np.cos(np.deg2rad(60 * u))]),
        ("function y = f(u)\nif u < -0.5\n y = -1;\nelseif u < 0.25 && u > -0.25\n y = u*2;\nelse\n"
         " y = sqrt(u + 1);\nend",
         lambda u: [np.select([u < -0.5, (u < 0.25) & (u > -0.25)], [-1.0, 2 * u], np.sqrt(u + 1))]),
        ("function y = f(u)\ny = 0;\nif u <= 0.01\n return;\nend\ny = 1/u;",  # 1/0 stands where nobody goes
         lambda u: [np.where(u <= 0.01, 0, 1 / np.where(u <= 0.01, 1, u))]),
        ("function y = f(u)\nif u > 0.0126 % a comment\n  y = log(u);\nelse\n  y = 0;\nend\nend",
         lambda u: [np.where(u > 0.0126, np.log(np.where(u > 0.0126, u, 1)), 0)]),
        ("function [a, b] = f(u)\n[a, b] = g(u, 2);\nend\nfunction [x, y] = g(u, k)\nx = k*u; y = x - 1;\nend",
         lambda u: [2 * u, 2 * u - 1]),
        ("function y = f(u)\nR = [cos(u) -sin(u); sin(u) cos(u)];\ny = R*R*[1; 0];",
         lambda u: [np.cos(2 * u), np.sin(2 * u)]),
        ("function y = f(u)\nR = [cos(u) -sin(u); sin(u) cos(u)];\ny = [inv(R)*[1; 0]; R\\[0; 1]; ([1 0]/R)'];",
         lambda u: [np.cos(u), -np.sin(u), np.sin(u), np.cos(u), np.cos(u), np.sin(u)]),
        ("function y = f(u)\ny = [int16(3*u); uint8(2*u); int8(200*u)];",
         lambda u: [np.sign(u) * np.floor(np.abs(3 * u) + 0.5), np.clip(np.floor(2 * u + 0.5), 0, 2),
                    np.clip(np.sign(u) * np.floor(np.abs(200 * u) + 0.5), -128, 127)]),
        ("function y = f(u)\nM = [2 u; u 3];\ny = M\\[1; 0] + inv(M)*[0; sqrt(u + 2)];",
         lambda u: np.array([3 - u * np.sqrt(u + 2), 2 * np.sqrt(u + 2) - u]) / (6 - u**2)),
        ("function y = f(u)\ny = zeros(3,1);\nfor k = 1:3\n y(k) = k*max(u, 0);\nend",
         lambda u: [k * np.maximum(u, 0) for k in (1, 2, 3)]),
        ("function y = f(u)\nswitch sign(u)\ncase {1, 0}\n y = abs(u);\notherwise\n y = 7;\nend",
         lambda u: [np.where(u >= 0, u, 7.0)]),
        ("function[y] = f(u)\nu;\nu.^2 / 2;\nz = [0; u];\ny = atan(3/z(1)) + z(2);", lambda u: [np.pi / 2 + u]),
        ("function y = f(u)\nn = 1;\nwhile n < 5\n n = 2*n;\nend\nfunction z = g(k)\n if k > 1\n  z = k;\n end\nend\n"
         "y = g(n)*u;\nend", lambda u: [8 * u]),  # a function among the statements of another
        ("function y = f(u)\na = 0; b = 2; gap = 9; n = 0;\nwhile gap > 1e-3\n n = n + 1; c = (a + b)/2;\n"
         " gap = abs(c^2 - 2 - u);\n if c^2 > 2 + u\n  b = c;\n else\n  a = c;\n end\nend\ny = [c; n];",
         lambda u: np.transpose([bisected(2 + x) for x in u])),
        ("function y = f(u)\nz = (u + 2i)*(3 - u*1i)/(1 + u*1e0i) - 2;\n"
         "y = [real(z); imag(z); abs(z); real(u); imag(u) + abs(u); abs(2/z - z); real(2i*3i)];",
         lambda u: [part(one) for z in [(u + 2j) * (3 - u * 1j) / (1 + u * 1j) - 2] for part, one in
                    ((np.real, z), (np.imag, z), (np.abs, z), (np.real, u), (np.abs, u), (np.abs, 2 / z - z),
                     (lambda z: 0 * z.real - 6, z))]),
        ("function y = f(u)\ny = mod(u, 0.31) + atan2(u, 2) + norm([u; 1], 2);",
         lambda u: [np.mod(u, 0.31) + np.arctan2(u, 2) + np.hypot(u, 1)]),
    ],
)  # fmt: skip
def test_code_is_what_it_computes(code, equation):
    u = TIMES - 1.0
    u[np.abs(u) < 1e-12] = 0.0
    with np.errstate(all="ignore"):
        expected = equation(u)
    np.testing.assert_allclose(translated(code), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("code", "told"),
    [
        (
            "function y = f(u)\npersistent n\ny = u;",
            "persistent n, though nothing says its sample time",
        ),
        ("function y = f(u)\ny = eval('system(1)');", "eval"),
        ("function y = f(u)\ny = f(u);", "calls itself"),
        ("function y = f(u)\nx = u;", "gives no y"),
        ("function y = f(u)\ny = sin(u + 1i);", "complex numbers in a function"),
        ("function y = f(u)\ny = u + 1i;", "a complex number"),
        (
            "function y = f(u)\n[n, m] = size(ones(40, 50));\nA = u*ones(n, m);\ny = A*A';",
            "more than 30000 products",
        ),
        ("function y = f(u)\nif u > 0\n y = [1 2];\nelse\n y = 1;\nend", "size depends"),
    ],
)
def test_what_is_more_than_arithmetic_is_not_understood(code, told):
    with pytest.raises(NotUnderstood, match=told):
        translated(code)


def test_a_loop_that_signals_decide_ends_after_twenty_rounds_at_the_latest():
    functions, told = functions_of("function y = f(u)\ny = 0;\nwhile y < u\n y = y + 1;\nend"), []
    run = Translation({}, undefined, None, functions, note=told.append)
    (found,) = run.called("f", [signal([30 * TIME]).reshape(1, 1)])
    np.testing.assert_allclose(over_time(flat(found), TIMES), [np.minimum(np.ceil(30 * TIMES), 20)])
    assert told == ["its loops by signals end after 20 rounds at the latest"]


def test_a_rotation_is_inverted_by_its_transpose_and_a_matrix_that_only_starts_as_one_is_not():
    turn = orientation(object())
    cosine, sine = (applied(name, TIME) for name in ("cos", "sin"))
    both = turn.dot(
        np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]], dtype=object)
    )
    for rotation in (turn, turn.T, both):
        assert all(
            one is other for one, other in zip(inverse(rotation).flat, rotation.T.flat, strict=True)
        )
    grows = Primitive("integrator", {}, lambda: [TIME]).outputs[0]
    scale = np.array([[1.0 + grows, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], dtype=object)
    for other in (scale, mapped(lambda one: 2.0 * one, turn), turn + np.eye(3)):
        divisions = [
            block
            for one in inverse(other).flat
            for block in blocks_in([one])
            if "divides" in block.parameters
        ]
        assert divisions


def test_a_persistent_variable_is_what_it_was_at_the_last_sample():
    """A sum that its input begins anew, and a matrix of the last two inputs, against a loop in Python."""
    code = (
        "function [total, older] = f(u)\npersistent s m\nif isempty(m)\n m = zeros(2, 1);\n m(1) = 5;\nend\n"
        "if isempty(s) || u > 0.75\n s = 0;\nend\nolder = m(2);\nm = [u; m(1)];\ns = s + u;\ntotal = s;"
    )
    functions = functions_of(code)
    outputs = Translation({}, undefined, None, functions, period=0.1).called(
        "f", [signal([TIME]).reshape(1, 1)]
    )
    total, older = over_time(
        [flat(np.asarray(one, dtype=object))[0] for one in outputs], TIMES + 1e-9
    )
    s, m, expected = 0.0, [5.0, 0.0], []
    for sample in np.arange(21) * 0.1:
        s = 0.0 if sample > 0.75 else s
        expected.append((s + sample, m[1]))
        s, m = s + sample, [sample, m[0]]
    at_sample = np.array(expected)[np.floor(TIMES / 0.1 + 1e-9).astype(int)]
    np.testing.assert_allclose(np.transpose([total, older]), at_sample, atol=1e-9)


def test_a_comment_that_speaks_of_a_function_stays_one():
    code = " function y = f(a)\n% This function adds a rate (rad/s) to the\n% others.\ny = 2 * a;\n"
    (function,) = functions_of(code).values()
    assert (function.inputs, function.body) == (["a"], ["y = 2 * a"])
