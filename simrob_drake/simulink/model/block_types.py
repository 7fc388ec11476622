"""The table of block types: what becomes of each, in `block_types.yaml`."""

from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import yaml

Fate = Literal["exact", "ignored", "approximated", "open", "lost"]
FATES: tuple[Fate, ...] = get_args(Fate)
"""What can become of a block, the least loss first."""

Domain = Literal["structure", "mechanics", "signals"]


class BlockType(NamedTuple):
    """A row of the table.

    Attributes:
        domain: what it is part of.
        fate: what becomes of it unless more is known of the block.
        text: how it is approximated, what is left open, or what a loss counts as; may be empty.
    """

    domain: Domain
    fate: Fate
    text: str = ""


@cache
def block_types() -> dict[str, BlockType]:
    """Return the table, by type."""
    content = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    rows: dict[str, BlockType] = {}
    for domain, fates in content.items():
        for fate, types in fates.items():
            texts = types if isinstance(types, dict) else dict.fromkeys(types, "")
            rows |= {name: BlockType(domain, fate, text or "") for name, text in texts.items()}
    return rows
