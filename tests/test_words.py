"""Names say what they mean, in the terms of docs/glossary.md: which words must not come back, one class a name."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import simrob_drake

PACKAGE = Path(simrob_drake.__file__).parent
INSTEAD = {
    "told": "a message, what is expected, what is reported",
    "given": "a value, an argument, a parameter, a request",
    "wanted": "desired, requested, a target, a reference",
    "beside": "a neighbour, a variant, a margin",
    "telling": "a message",
    "ongoing": "running, with state",
    "course": "a reference, a trajectory, a path, a plan, a heading",
    "courses": "references, trajectories",
    "figures": "parameters, values, measures; those of Matplotlib are figures",
    "braces": "a threshold",
    "let_be": "a deadband",
}
"""Words that no name may have among its own, and what it may be in their place."""
FIGURES = {"results/plots/own.py", "extensions/tuning/sweep_folder.py"}
"""Where figures are those of Matplotlib."""
PUBLIC = {
    ("blocks/references.py", "course"),
    ("extensions/mujoco/runner.py", "wanted"),
    ("results/plots/own.py", "beside"),
}
"""Names that users' scripts have."""
OF_EQUAL_NAME = 3
"""So many names of classes that modules share have more than one meaning, at most."""


@cache
def modules() -> dict[str, ast.Module]:
    return {
        str(file.relative_to(PACKAGE)): ast.parse(file.read_text())
        for file in sorted(PACKAGE.rglob("*.py"))
    }


def names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield all names of a module's own and where they are: of variables, arguments, attributes, functions, classes."""
    for node in ast.walk(tree):
        for key in ("id", "arg", "attr", "name", "asname"):
            if isinstance(name := getattr(node, key, None), str):
                yield name, getattr(node, "lineno", 0)


@cache
def words(name: str) -> frozenset[str]:
    """Return which words of the list a name has."""
    parts = f"_{name.strip('_').lower()}_"
    return frozenset(word for word in INSTEAD if f"_{word}_" in parts)


def found(module: str) -> list[str]:
    """Return the names of a module that are to be others, and what they may be."""
    own = {(Path(module).stem, 0), *names(modules()[module])}
    bad = {
        (line, name, word)
        for name, line in own
        for word in words(name)
        if (module, word) not in PUBLIC
    }
    bad = {
        (line, name, word) for line, name, word in bad if word != "figures" or module not in FIGURES
    }
    return [f"{module}:{line}: {name}; {word}: {INSTEAD[word]}" for line, name, word in sorted(bad)]


def test_names_are_the_terms_of_the_field():
    assert [line for module in modules() for line in found(module)] == []


def test_classes_have_names_of_their_own():
    places = defaultdict(list)
    for module, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(f"{module}:{node.lineno}")

    equal = {name: where for name, where in places.items() if len(where) > 1}
    assert len(equal) <= OF_EQUAL_NAME, equal
