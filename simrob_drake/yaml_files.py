"""Read YAML safely, and turn pydantic's findings into one line that names file, key and what would be right."""

import json
import re
from collections import Counter
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from simrob_drake.errors import InvalidConfig, nearest, quoted, shortened
from simrob_drake.files import NotRead, text_of

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)  # which has no public name

Model = TypeVar("Model", bound=BaseModel)
Number = Annotated[float, Field(strict=True)]
"""A number, and no text or truth value that could pass for one."""
YAML_SUFFIXES = (".yaml", ".yml")
_MOST_VALUES, _DEEPEST, _LONGEST_NUMBER = 200_000, 60, 1000
_SURROGATE = re.compile("[\ud800-\udfff]")
_LONGEST_NAME = 200  # bytes; file systems take 255, and results put date and time behind a name


def is_file_name(name: str) -> bool:
    """Whether a file or a folder could have this name, in whatever folder it stands."""
    plain = name.isprintable() and not set(name) & set("/\\") and name.strip(". ")
    return bool(plain) and len(name.encode()) <= _LONGEST_NAME


def _file_name(name: str) -> str:
    if not is_file_name(name):
        raise ValueError("must be a name that a folder could have: no /, not . or .., at most 200 letters")
    return name


FileName = Annotated[str, AfterValidator(_file_name)]
"""A name that folders may be called by: one segment of a path."""


_QUOTED = re.compile(r"'([^']+)'")
_UNION_BRANCH = re.compile(r"^(float|int|bool|str|constrained-\w+)$|^(list|dict|tuple|constrained)\b.*\[")


class _Told(ModelMetaclass):
    """Makes the classes whose objects, made in Python, are told of as the content of a file is."""

    def __call__(cls, /, *given: Any, **content: Any) -> Any:  # noqa: N805  # of a class of classes
        try:
            return super().__call__(*given, **content)
        except ValidationError as problem:
            raise _first_finding(problem, cast(type[BaseModel], cls), cls.__name__) from problem


class Strict(BaseModel, metaclass=_Told):
    """Base of everything read from YAML: unknown keys are errors, and nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    def __repr_args__(self) -> Any:
        """Show what was given, and no defaults."""
        return [(name, value) for name, value in super().__repr_args__() if name in self.model_fields_set]


class _Loader(yaml.CSafeLoader):
    """A safe loader for which a key that stands twice is an error, and 1e-3 a number as in YAML 1.2."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            if len(node.value) > _LONGEST_NUMBER and node.tag.endswith((":int", ":float")):
                raise ValueError("too long")  # figures of YAML 1.1 to the base 60, 1:1:1:1..., take minutes
            return super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError) as problem:  # of !!bool maybe, 2001-99-99, and others
            found = f"'{shortened(str(node.value))}' is no {node.tag.rpartition(':')[2]}"
            raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark) from problem

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        text = super().construct_scalar(node)
        if "\0" in text or _SURROGATE.search(text):
            found = f"{shortened(ascii(text))} holds a character that is in no text"
            raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark)
        return text

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        for key, count in Counter(str(key.value) for key, _ in node.value).items():
            if count > 1:
                found = f"'{shortened(key)}' stands twice"
                raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Return the mapping that a YAML file holds.

    Raises:
        InvalidConfig: the file cannot be read, is not YAML, or holds no mapping.
    """
    try:
        text = text_of(path)
    except NotRead as problem:
        raise InvalidConfig(path, "", f"cannot be read ({problem})") from problem
    content = parse_yaml(text, path)
    if not isinstance(content, dict):
        raise InvalidConfig(path, "", "must hold a mapping of keys to values")
    return content


def parse_yaml(text: str, where: Path | str) -> Any:
    """Return the value that a YAML text stands for.

    Raises:
        InvalidConfig: the text is not YAML.
    """
    try:
        return deepcopy(_parsed(text))
    except (yaml.YAMLError, ValueError) as problem:
        raise InvalidConfig(where, "", f"is not YAML: {_yaml_problem(problem)}") from problem


def _yaml_problem(problem: Exception) -> str:
    """Return what is wrong with a YAML text and where, without what yaml calls a text that it was handed."""
    if not isinstance(problem, yaml.MarkedYAMLError):
        return " ".join(str(problem).replace('in "<unicode string>", ', "at ").split())
    mark = problem.problem_mark or problem.context_mark
    text = ", ".join(part for part in (problem.context, problem.problem) if part)
    return f"{text} (line {mark.line + 1}, column {mark.column + 1})" if mark else text


@lru_cache(maxsize=200)
def _parsed(text: str) -> Any:
    """Return the value of a text; the same files are read again whenever a station is rebuilt."""
    _check_growth(text)
    return yaml.load(text, Loader=_Loader)  # a child of SafeLoader: it makes plain data only


def _check_growth(text: str) -> None:
    """Refuse a text whose values go deep, or whose aliases make many of a few, as all that is told of them would be."""
    sizes: dict[str | None, int] = {}  # by anchor
    within: list[tuple[str | None, int]] = []  # what has begun: its anchor, and the values before it
    count = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, before = within.pop()
            sizes |= {anchor: count - before} if anchor else {}
        elif isinstance(event, yaml.AliasEvent):
            count += sizes.get(event.anchor, _MOST_VALUES)  # one that is not known yet holds itself
        elif isinstance(event, yaml.NodeEvent):
            count += 1
            if isinstance(event, yaml.CollectionStartEvent):
                within.append((event.anchor, count - 1))
            elif event.anchor:
                sizes[event.anchor] = 1
        if count > _MOST_VALUES or len(within) > _DEEPEST:
            limit = f"{_DEEPEST} levels" if len(within) > _DEEPEST else f"{_MOST_VALUES} values, aliases counted"
            raise yaml.MarkedYAMLError(problem=f"more than {limit}", problem_mark=cast(yaml.Mark, event.start_mark))


def validated(model: type[Model], content: dict[str, Any], where: Path | str) -> Model:
    """Return ``content`` as a ``model``.

    Raises:
        InvalidConfig: names ``where``, the first wrong key and what would be right.
    """
    try:
        return model.model_validate(content)
    except ValidationError as problem:
        raise _first_finding(problem, model, where) from problem


def file_schema(model: type[BaseModel], *, from_place: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the JSON Schema of a file that holds a model.

    Args:
        model: what the file holds.
        from_place: fields that follow from where the file lies; they need not stand in it.
    """
    schema = model.model_json_schema()
    schema["required"] = [key for key in schema.get("required", []) if key not in from_place]
    return schema


def write_schema(file: Path, schema: dict[str, Any]) -> Path:
    """Write a schema, for editors that complete and check YAML, and return its file."""
    file.write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return file


def _first_finding(problem: ValidationError, model: type[BaseModel], where: Path | str) -> InvalidConfig:
    """Return the finding that tells most: an unknown key, else the deepest, which is of the right branch of a union."""
    findings = problem.errors()
    finding = next((f for f in findings if f["type"] == "extra_forbidden"), max(findings, key=lambda f: len(f["loc"])))
    path, known, nodes = _walk(model, finding["loc"])
    key = ".".join(path)
    context, given = finding.get("ctx", {}), finding["input"]
    match finding["type"]:
        case "extra_forbidden":
            text = f"unknown key{nearest(path[-1], known)}"
        case "missing" if isinstance(finding["loc"][-1], int):
            sizes = [node["maxItems"] for node in nodes if "maxItems" in node]
            text = f"needs {sizes[0] if sizes else 'more'} values, not {shortened(repr(given))}"
        case "missing":
            text = "this key is needed"
        case "union_tag_not_found":
            kinds = [kind for node in nodes if (kind := _kind(node)) is not None]
            key, text = f"{key}.kind", f"this key is needed; known: {', '.join(kinds)}"
        case "union_tag_invalid":
            key, text = f"{key}.kind", _no_such(str(context["tag"]), context["expected_tags"])
        case "literal_error":
            text = _no_such(str(given), context["expected"])
        case "model_type" | "model_attributes_type" | "dict_type":
            keys = dict.fromkeys(key for node in nodes for key in node.get("properties", {}))
            section = f"a section with keys of: {', '.join(keys)}" if keys else "a section of names and their entries"
            text = f"must be {section} (it is {quoted(given)})"
        case _:
            message = finding["msg"].removeprefix("Value error, ").replace("a valid tuple", "a list")
            value = f" (it is {quoted(given)})" if key else ""  # else it is the whole file
            text = f"{message[:1].lower()}{message[1:]}{value}"
    return InvalidConfig(where, key, text)


def _no_such(given: str, expected: str) -> str:
    """Say that a value is none of those that pydantic expected, listed in quotes."""
    return f"there is no '{shortened(given)}'{nearest(given, _QUOTED.findall(expected))}"


def _walk(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[list[str], set[str], list[dict[str, Any]]]:
    """Follow a location through the JSON Schema: the keys a user wrote, the keys known beside the last one, its nodes.

    Pydantic puts the branches of unions that it tried into a location; these are no keys and are left out.
    """
    schema = model.model_json_schema()
    nodes = _branches(schema, schema)
    path: list[str] = []
    known: set[str] = set()
    for depth, part in enumerate(location):
        alternatives = nodes if len(nodes) > 1 else []
        tagged = [node for node in alternatives if part in (_kind(node), node.get("title"))]
        if tagged or _UNION_BRANCH.match(str(part)):
            nodes = tagged or nodes
            continue
        if isinstance(part, int):  # a place in a list; what is missing at the end of one is told of the list
            items = [node["items"] for node in nodes if isinstance(node.get("items"), dict)]
            below = [branch for item in items for branch in _branches(item, schema)]
            if below and depth < len(location) - 1:
                nodes, path[-1:] = below, [f"{path[-1]}[{part}]"]
            continue
        children: list[dict[str, Any]] = []
        for node in nodes:
            child = node.get("properties", {}).get(part) or node.get("additionalProperties")
            if isinstance(child, dict):
                children += _branches(child, schema)
        known = {key for node in nodes for key in node.get("properties", {})}
        path.append(str(part))
        nodes = children
    return path, known, nodes


def _kind(node: dict[str, Any]) -> str | None:
    """Return the kind of section that a schema node stands for; None if it is of none, such as null."""
    kind: str | None = node.get("properties", {}).get("kind", {}).get("const")
    return kind


def _branches(node: dict[str, Any], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the alternatives that a schema node allows, references followed."""
    if "$ref" in node:
        return _branches(schema["$defs"][node["$ref"].rsplit("/", 1)[-1]], schema)
    alternatives = node.get("anyOf") or node.get("oneOf")
    return [branch for one in alternatives for branch in _branches(one, schema)] if alternatives else [node]
