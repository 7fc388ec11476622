"""YAML texts with tags, such as ``!Rpy``, which Drake's files have."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import yaml


@dataclass(frozen=True)
class Tagged:
    """A mapping in a YAML file with a tag, such as ``!Rpy``."""

    tag: str
    content: Mapping[str, Any]


class _Dumper(yaml.SafeDumper):
    """Writes tagged mappings, and short lists in one line."""


_Dumper.add_representer(
    Tagged,
    lambda dumper, value: dumper.represent_mapping(f"!{value.tag}", value.content, flow_style=True),
)
_Dumper.add_representer(
    tuple,
    lambda dumper, value: dumper.represent_sequence(
        "tag:yaml.org,2002:seq", value, flow_style=True
    ),
)


def yaml_text(content: Mapping[str, Any]) -> str:
    """Write the content of a file: mappings in the order of their keys, tuples as lists in one line."""
    return yaml.dump(dict(content), Dumper=_Dumper, sort_keys=False, width=110)
