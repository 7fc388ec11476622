"""Tables of this part of the package: what becomes of blocks, what they compute, what networks are made of."""

from functools import cache
from pathlib import Path
from typing import Any

import yaml


@cache
def table(name: str) -> dict[str, Any]:
    """Return what a table of this folder holds, ``name.yaml``."""
    content: dict[str, Any] = yaml.safe_load(Path(__file__).with_name(f"{name}.yaml").read_text(encoding="utf-8"))
    return content
