"""Kinds of parts: imported when a station names them, and each in the table of its family."""

import re
import subprocess
import sys
from importlib import import_module
from inspect import isabstract
from pathlib import Path

import pytest

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.extension import core_names

FAMILIES = ("sensors", "monitors", "references", "forces", "couplings", "controllers")
ELSEWHERE = "flow_"  # files of kinds of blocks of a signal flow, in its own union


@pytest.mark.parametrize("family", FAMILIES)
def test_a_kind_stands_in_the_table_and_can_be_made(family: str) -> None:
    """Forgetting either is red: a kind without the first is unknown, one that lacks a method is abstract."""
    package = import_module(f"simrob_drake.parts.{family}")
    file = Path(package.__file__)

    declared = {
        kind
        for file in (file.parent.glob("*.py") if file.name == "__init__.py" else [file])
        if not file.name.startswith(ELSEWHERE)
        for kind in re.findall(r'^    kind: Literal\["(\w+)"\]', file.read_text(), re.MULTILINE)
    }

    assert core_names(family) == declared
    for kind, model in package.KINDS.models.items():
        assert model.model_fields["kind"].annotation.__args__ == (kind,)
        assert not isabstract(model), kind


@pytest.mark.long
def test_a_station_imports_the_kinds_that_it_names() -> None:
    code = """
import sys
from simrob_drake import load_station, simulate
held = ("sensors.frames", "sensors.camera", "controllers.walk", "controllers.flow_blocks")
before = [name for name in held if f"simrob_drake.parts.{name}" in sys.modules]
load_station("irb120_dynamic", {"sensors": {"wrist": {"kind": "frame", "frame": "tool0"}}})
print(before, [name for name in held if f"simrob_drake.parts.{name}" in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[] ['sensors.frames']\n"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"sensors": {"a": {"kind": "imuu"}}},
            "sensors.a.kind: there is no 'imuu'; did you mean 'imu'",
        ),
        (
            {"sensors": {"a": {"rate": 3}}},
            "sensors.a.kind: this key is required; known: force, distance",
        ),
        ({"sensors": {"imu": {"ratte": 3}}}, "sensors.imu.ratte: unknown key; did you mean 'rate'"),
        ({"monitors": {"fall": {"height": -1}}}, "monitors.fall.height: "),
        ({"reference": {"kind": ["ramp"]}}, "reference.kind: "),
        ({"controllers": {"a": 3}}, "controllers.a: "),
    ],
)
def test_a_wrong_section_is_told_by_its_key(overrides: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidConfig, match=re.escape(message)):
        load_station("irb120_dynamic", overrides)
