"""A form for every key of a station, made from the schema of station files: plain fields, for whatever draws them."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import yaml

from simrob_drake.base.sections import schema_branches, section_kind
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.programs.moves.move import Move
from simrob_drake.stations.load import ENTRIES

FieldKind = Literal["number", "text", "choice", "switch", "value", "section", "entries"]
"""How a key is entered: the first four by themselves, ``value`` as YAML (a list, or figures by axis); a ``section``
is there or not, and into ``entries`` new ones can be put by name."""

ENTERED_ALONE: tuple[FieldKind, ...] = ("number", "text", "choice", "switch")
"""Fields that need no YAML."""

Node = dict[str, Any]

_UNIT = re.compile(r"\[([^\]]+)\]")
_WIDE = 1_000  # columns of a YAML text: it stays in one line


@dataclass(frozen=True)
class Field:
    """A key of a station."""

    key: str  # dotted, as ``load_station`` takes it: ``servo.kp``
    kind: FieldKind  # how it is entered
    help: str = ""  # what it is
    unit: str = ""  # of its numbers; empty where it has none, or where each has its own
    value: Any = None  # what the station says, None where it says nothing
    default: Any = None  # what holds where nothing is said
    choices: tuple[str, ...] = ()  # of a choice; of entries the kinds that a new one can have
    low: float | None = None  # smallest number, None where there is no bound
    high: float | None = None  # largest number, likewise
    removable: bool = False  # whether a section can be taken out of the station
    whole: bool = False  # whether it is a whole number
    in_force: Any = (
        None  # value in force if the station leaves the key out, or None if it is unknown
    )
    origin: str = (
        ""  # origin of the value in force, see `simrob_drake.stations.values_in_force.Origin`
    )

    @property
    def top(self) -> str:
        """The section of the file that it stands in."""
        return self.key.partition(".")[0]


def form_fields(schema: Node, content: Mapping[str, Any]) -> list[Field]:
    """Return the fields of a station, of the schema of station files and the content of its own."""
    walk = _Walk(schema)
    keys = [key for key in schema["properties"] if key != "robot"]
    if "robot" in content:
        keys[keys.index("robots")] = "robot"
    return [
        field
        for key in keys
        for field in walk.fields(key, schema["properties"][key], content.get(key))
    ]


def with_values_in_force(
    fields: Iterable[Field], in_force: Mapping[str, Mapping[str, Any]]
) -> list[Field]:
    """Add the values in force to fields whose keys the station leaves out.

    Args:
        fields: the fields of the station.
        in_force: ``value`` and ``origin`` by dotted key, as the description of the station has them.
    """
    return [
        replace(field, in_force=in_force[field.key]["value"], origin=in_force[field.key]["origin"])
        if field.key in in_force
        else field
        for field in fields
    ]


def move_fields(kind: type[Move], keys: Iterable[str], content: Mapping[str, Any]) -> list[Field]:
    """Make one field for each of some keys of a kind of move.

    A key whose value has keys of its own is one field, too, which takes YAML.

    Args:
        kind: the kind of move.
        keys: the keys, in the order of the fields.
        content: the present values of the move, by key. A key without a value is left out.
    """
    schema = kind.model_json_schema()
    # The schema of a move that can contain moves of its own kind is a reference (`$ref`) to one of its definitions.
    section = next(branch for branch in schema_branches(schema, schema) if "properties" in branch)
    nodes = section["properties"]
    return [
        _leaf(key, schema_branches(nodes[key], schema), nodes[key], content.get(key))
        for key in keys
    ]


def as_text(value: Any) -> str:
    """Return a value as it is typed into a field: empty for None, YAML in one line for lists and mappings."""
    if value is None or isinstance(value, str):
        return value or ""
    text: str = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=_WIDE
    )
    return text.removesuffix("\n").removesuffix("\n...")


def as_value(field: Field, text: str) -> Any:
    """Return what a typed text stands for, of an empty one the default; raises InvalidConfig: it is no YAML."""
    if not text.strip():
        return field.default
    return text.strip() if field.kind in ("text", "choice") else parse_yaml(text, field.key)


class _Walk:
    """Goes through a schema beside the content of a file."""

    def __init__(self, schema: Node) -> None:
        self._schema = schema

    def fields(self, key: str, node: Node, value: Any) -> Iterator[Field]:
        """Give the fields of a key and all below it."""
        branches = schema_branches(node, self._schema)
        sections = [branch for branch in branches if "properties" in branch]
        optional = any(branch.get("type") == "null" for branch in branches)
        about, default = _about(node, key), node.get("default")
        entries = next((b for b in branches if self._holds_sections(b)), None)
        if entries is not None:
            yield from self._entries(key, node, entries["additionalProperties"], value or {})
        elif not sections or (
            value is not None and not _fits(value, sections)
        ):  # a motor by name, or by axis
            yield _leaf(key, branches, node, value)
        elif optional and value is None:
            yield Field(key, "section", about, value=False, default=default, removable=True)
        else:
            if optional:
                yield Field(key, "section", about, value=True, default=default, removable=True)
            content = value if isinstance(value, Mapping) else default or {}
            kinds = tuple(kind for section in sections if (kind := section_kind(section)))
            kind = str(content.get("kind", ""))
            if len(kinds) > 1:
                yield Field(f"{key}.kind", "choice", about, value=kind, default=kind, choices=kinds)
            yield from self._section(key, _of_kind(sections, kind), content)

    def _section(self, key: str, section: Node, value: Mapping[str, Any]) -> Iterator[Field]:
        """Give the fields of a section whose kind is settled."""
        for name, child in section["properties"].items():
            if "const" not in child:
                yield from self.fields(f"{key}.{name}", child, value.get(name))

    def _entries(
        self, key: str, node: Node, entry: Node, value: Mapping[str, Any]
    ) -> Iterator[Field]:
        """Give what new entries can be of, and the entries that are there; one of another kind is another entry."""
        sections = [
            branch for branch in schema_branches(entry, self._schema) if "properties" in branch
        ]
        kinds = tuple(kind for section in sections if (kind := section_kind(section)))
        yield Field(key, "entries", _about(node, key), choices=kinds, default={})
        for name, item in value.items():
            section = _of_kind(sections, item.get("kind", name))
            about, removable = _about(section, key), key in ENTRIES
            yield Field(f"{key}.{name}", "section", about, value=True, removable=removable)
            yield from self._section(f"{key}.{name}", section, item)

    def _holds_sections(self, node: Node) -> bool:
        inner = node.get("additionalProperties")
        return isinstance(inner, dict) and all(
            "properties" in branch for branch in schema_branches(inner, self._schema)
        )


def _leaf(key: str, branches: list[Node], node: Node, value: Any) -> Field:
    """Return the field of a key that is no section."""
    types = {branch.get("type") for branch in branches} - {"null"}
    choices = tuple(choice for branch in branches for choice in branch.get("enum", ()))
    kind: FieldKind = "value"
    if choices and types <= {"string"}:
        kind = "choice"
    elif types == {"boolean"}:
        kind = "switch"
    elif types == {"string"}:
        kind = "text"
    elif types <= {"number", "integer"}:
        kind = "number"
    bounds = {
        name: number for branch in branches for name, number in branch.items() if name in _BOUNDS
    }
    low, high = (
        next((bounds[name] for name in names if name in bounds), None) for names in (_LOW, _HIGH)
    )
    about, whole = _about(node, key), types == {"integer"}
    return Field(
        key,
        kind,
        about,
        _unit(key, about),
        value,
        node.get("default"),
        choices,
        low,
        high,
        whole=whole,
    )


_LOW, _HIGH = ("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum")
_BOUNDS = _LOW + _HIGH


def _about(node: Node, key: str) -> str:
    """Return what a key is, in one line; the keys of poses and figures without a word are called by their name."""
    text = " ".join(str(node.get("description", "")).split())
    return text or key.rpartition(".")[2].replace("_", " ")


def _unit(key: str, about: str) -> str:
    found = _UNIT.search(about)
    # of axes that turn; the help tells of those that slide
    unit = re.split("[,;]| or ", found[1])[0] if found else ""
    if key.endswith("_deg") and not unit.startswith("deg"):
        return "deg"
    return "" if unit.startswith("x y z") else unit


def _fits(value: Any, sections: list[Node]) -> bool:
    return isinstance(value, Mapping) and any(
        value.keys() <= section["properties"].keys() for section in sections
    )


def _of_kind(sections: list[Node], kind: str) -> Node:
    return next((section for section in sections if section_kind(section) == kind), sections[0])
