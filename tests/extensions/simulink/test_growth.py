"""Expressions that ask for more memory or time than any machine has are refused before they take it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simrob_drake.extensions.simulink.values.code import CodeRun
from simrob_drake.extensions.simulink.values.evaluate import NUMBERS, Evaluator, UndefinedVariable
from simrob_drake.extensions.simulink.values.growth import LARGEST, check_growth
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood, parse

HERE = Path(__file__).parent
HOSTILE = [
    "diag(1:1000000)",
    "(1:1e6)'*(1:1e6)",
    "(1:1e6)' + (1:1e6)",
    "kron(ones(1000), ones(1000))",
    "kron(ones(150), ones(150))",
    "hypot((1:1e6)', 1:1e6)",
    "b(ones(1,1e6), ones(1,1e6))",
    "polyval(1:1e6, 1:1e6)",
    "ones(1000) * ones(1000, 1001)",
    "[big big; big big]",
    "max((1:1e6)', 1:1e6)",
    "repmat(ones(1000), 1000)",
    "zeros(1e6, 1e6)",
    "linspace(0, 1, 1e12)",
]
KNOWN = {"b": np.eye(2), "big": np.zeros((800, 800))}


def value_of(text):
    def lookup(name):
        if name not in KNOWN:
            raise UndefinedVariable(name)
        return KNOWN[name]

    return Evaluator(lookup, NUMBERS).evaluated(parse(text))


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_expression_is_refused(text):
    with pytest.raises(NotUnderstood):
        value_of(text)


@pytest.mark.long
def test_refusing_takes_no_memory():
    """In a process of at most 1.5 GB, none of them ends in a traceback."""
    lines = [
        "import resource, sys",
        "resource.setrlimit(resource.RLIMIT_AS, (1_500_000_000,) * 2)",
        "from test_growth import HOSTILE, NotUnderstood, value_of",
        "for text in HOSTILE:",
        "    try: value_of(text)",
        "    except NotUnderstood: print('refused')",
    ]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=HERE,
        check=False,
    )
    assert done.stdout.split() == ["refused"] * len(HOSTILE), done.stderr


@pytest.mark.parametrize("doubling", ["a = [a a];", "a = {a, a};"])
def test_doubling_a_value_forty_times_ends(doubling):
    run = CodeRun({"a": "text"})
    run.run("\n".join([doubling] * 40))
    assert "a" in run.unknown


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("kron([1 2], [1; 1])", [[1, 2], [1, 2]]),
        ("diag([1 2])", [[1, 0], [0, 2]]),
        ("polyval([1 0 1], [1 2])", [[2, 5]]),
        ("[1 2] + [1; 2]", [[2, 3], [3, 4]]),
        ("[1 2; 3 4] * [1; 1]", [[3], [7]]),
        ("b([1 2], 1)", [[1], [0]]),
        ("zeros(1000) + 1 > 2", np.zeros((1000, 1000))),
    ],
)
def test_ordinary_expressions_are_computed(text, value):
    np.testing.assert_allclose(value_of(text), value)


def test_bounds_are_those_of_shapes():
    assert check_growth("+", [np.zeros((3, 1)), np.zeros((1, 4))]) == 12
    assert check_growth("kron", [np.zeros((3, 2)), np.zeros((1, 4))]) == 24
    assert check_growth("*", [np.zeros((3, 2)), np.zeros((2, 5))]) == 15
    assert check_growth("+", [np.zeros((1, LARGEST)), np.zeros((1, 1))]) == LARGEST
    with pytest.raises(NotUnderstood, match="'diag'"):
        check_growth("diag", [np.zeros((1, 1001))])
