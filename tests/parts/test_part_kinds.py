"""Kinds of parts: imported when a station names them, and each in the table and in the union of its family."""

import ast
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from simrob_drake import load_station
from simrob_drake.errors import InvalidConfig

FAMILIES = ("sensors", "monitors", "references", "forces", "controllers")
ELSEWHERE = "flow_"  # files of kinds of blocks of a signal flow, in its own union


@pytest.mark.parametrize("family", FAMILIES)
def test_a_kind_stands_in_the_table_and_in_the_union(family: str) -> None:
    """Forgetting either is red: a kind without the first is unknown, one without the second escapes the type check."""
    package = import_module(f"simrob_drake.parts.{family}")
    folder = Path(package.__file__).parent
    declared = {
        kind
        for file in folder.glob("*.py")
        if not file.name.startswith(ELSEWHERE)
        for kind in re.findall(r'^    kind: Literal\["(\w+)"\]', file.read_text(), re.MULTILINE)
    }
    assert set(package.KINDS) == declared
    [block] = (node for node in ast.parse(Path(package.__file__).read_text()).body if isinstance(node, ast.If))
    union = block.body[-1]
    assert isinstance(union, ast.Assign)
    named = [node.id for node in ast.walk(union.value) if isinstance(node, ast.Name)]
    assert sorted(named) == sorted(model.__name__ for model in package.KINDS.models.values())
    for kind, model in package.KINDS.models.items():
        assert model.model_fields["kind"].annotation.__args__ == (kind,)


def test_a_station_imports_the_kinds_that_it_names() -> None:
    code = """
import sys
from simrob_drake import load_station, simulate
held = ("sensors.imu", "monitors.fall", "references.cruise", "controllers.walk", "controllers.flow_blocks")
before = [name for name in held if f"simrob_drake.parts.{name}" in sys.modules]
load_station("irb120_dynamic", {"reference": {"kind": "trapezoid", "target_deg": 10}})
print(before, [name for name in held if f"simrob_drake.parts.{name}" in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[] ['references.cruise']\n"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"sensors": {"a": {"kind": "imuu"}}}, "sensors.a.kind: there is no 'imuu'; did you mean 'imu'"),
        ({"sensors": {"a": {"rate": 3}}}, "sensors.a.kind: this key is needed; known: force, distance"),
        ({"sensors": {"imu": {"ratte": 3}}}, "sensors.imu.ratte: unknown key; did you mean 'rate'"),
        ({"monitors": {"fall": {"height": -1}}}, "monitors.fall.height: "),
        ({"reference": {"kind": ["ramp"]}}, "reference.kind: "),
        ({"controllers": {"a": 3}}, "controllers.a: "),
    ],
)
def test_a_wrong_section_is_told_by_its_key(overrides: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidConfig, match=re.escape(message)):
        load_station("irb120_dynamic", overrides)
