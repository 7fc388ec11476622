"""Each difference between versions of Drake is really there, and is named as soon as it may go."""

import gc
import re
import tomllib
import weakref
from pathlib import Path

import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from simrob_drake.base import drake_versions
from simrob_drake.base.drake_versions import (
    INSTALLED,
    KEEPS_PYTHON_BLOCKS,
    OLDEST,
    SEARCH_FOR_DERIVATIVES,
    TENDONS,
    DrakeChange,
)
from simrob_drake.blocks.block import Block

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DIFFERENCES = {
    name: value for name, value in vars(drake_versions).items() if isinstance(value, DrakeChange)
}


@pytest.mark.parametrize("name", DIFFERENCES)
def test_a_difference_is_needed_as_long_as_an_older_drake_is_supported(name: str) -> None:
    since = DIFFERENCES[name].since
    assert since > OLDEST, (
        f"every supported Drake has it since {since}: remove {name} and what asks for it"
    )


def test_python_3_11_is_still_supported() -> None:
    assert PROJECT["requires-python"] == ">=3.11", "remove KEEPS_PYTHON_BLOCKS and what asks for it"


def test_the_range_of_drake_is_open_to_the_next_minor_versions() -> None:
    requirements = [text for text in PROJECT["dependencies"] if re.match(r"drake\b", text)]
    assert requirements == [f"drake>={OLDEST[0]}.{OLDEST[1]},<2"]
    assert INSTALLED >= OLDEST


def test_tendons_come_with_their_version() -> None:
    assert hasattr(MultibodyPlant, "AddTendonConstraint") == TENDONS.is_there


class Empty(LeafSystem):
    """A block without ports or state."""


def test_a_block_in_python_keeps_its_diagram_where_the_module_says_so() -> None:
    builder = DiagramBuilder()
    builder.AddSystem(Empty())
    diagram = weakref.ref(builder.Build())
    del builder

    gc.collect()

    assert (diagram() is not None) == KEEPS_PYTHON_BLOCKS


def test_no_other_module_asks_for_the_version() -> None:
    asked = re.compile(r"version_info|\bversion\(.drake.\)")
    found = [
        str(path.relative_to(ROOT))
        for path in (ROOT / "simrob_drake").rglob("*.py")
        if asked.search(path.read_text(encoding="utf-8"))
    ]
    # The summary of a result records the version; it decides nothing.
    assert sorted(found) == [
        "simrob_drake/base/drake_versions.py",
        "simrob_drake/results/record/summary.py",
    ]


def test_derivatives_are_declared_where_drake_searches_for_them() -> None:
    assert ("DoCalcTimeDerivatives" in vars(Block)) == SEARCH_FOR_DERIVATIVES.is_there
