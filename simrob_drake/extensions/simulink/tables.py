"""Tables of this part of the package: what becomes of blocks, what they compute, what networks are made of."""

from functools import cache
from pathlib import Path
from typing import Any

from simrob_drake.base.yaml_files import read_yaml


@cache
def table(name: str) -> dict[str, Any]:
    """Return what a table of this folder holds, ``name.yaml``."""
    return read_yaml(Path(__file__).with_name(f"{name}.yaml"))
