"""No module of the core asks for the name of a kind of part: parts declare what they offer."""

import ast
from pathlib import Path

import simrob_drake
from simrob_drake.parts import controllers, forces, sensors
from simrob_drake.parts.monitors import KINDS as MONITORS

PACKAGE = Path(simrob_drake.__file__).parent
NAMES = {
    name for kinds in (controllers.KINDS, sensors.KINDS, forces.KINDS, MONITORS) for name in kinds
}


def core_modules():
    """Return the modules of the core, without those of extensions."""
    return [
        file
        for file in PACKAGE.rglob("*.py")
        if "extensions" not in file.relative_to(PACKAGE).parts
    ]


def comparisons_of_kind(tree):
    """Yield the comparisons in a module of an attribute ``kind`` with a text, or with several."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Compare):
            continue
        sides = [node.left, *node.comparators]
        asks = any(isinstance(side, ast.Attribute) and side.attr == "kind" for side in sides)
        texts = {
            part.value
            for side in sides
            for part in ast.walk(side)
            if isinstance(part, ast.Constant)
        }
        if asks and texts & NAMES:
            yield node


def test_there_are_kinds_to_look_for():
    assert {"walk", "sequencer", "own", "camera", "distance", "push"} <= NAMES


def test_the_search_finds_a_comparison():
    assert list(comparisons_of_kind(ast.parse("if section.kind == 'walk': pass")))
    assert list(comparisons_of_kind(ast.parse("a = 'push' != force.kind")))
    assert not list(comparisons_of_kind(ast.parse("if section.command_parts: pass")))


def test_no_module_of_the_core_asks_for_the_name_of_a_kind():
    trees = {file: ast.parse(file.read_text(encoding="utf-8")) for file in core_modules()}
    found = [
        f"{file.name}:{node.lineno}"
        for file, tree in trees.items()
        for node in comparisons_of_kind(tree)
    ]
    assert found == []
