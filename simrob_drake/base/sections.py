"""Sections of files: their base, the types of their values in SI units, and pydantic's findings in one line.

A finding names file, key, and what would be right.
"""

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise
from math import inf, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar, dataclass_transform

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from simrob_drake.base.arguments import LONGEST, SHORTEST
from simrob_drake.base.errors import InvalidConfig, nearest, quoted, shortened
from simrob_drake.base.messages import message
from simrob_drake.base.value_problems import value_problem

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)  # which has no public name

Model = TypeVar("Model", bound=BaseModel)
Number = Annotated[float, Field(strict=True)]  # a number, and no text or truth value that could pass for one
Integer = Annotated[int, Field(strict=True)]
Boolean = Annotated[bool, Field(strict=True)]
_DEEPEST = 60  # levels that are checked. Files have no more, but a mapping of a Python program may contain itself
_SMALLEST, _LARGEST = 1e-100, 1e15
"""Of figures but zero, in SI units or degrees: the modulus of steel is some 2e11 Pa, and all have a reciprocal."""
_LONGEST_NAME = 200  # bytes; file systems take 255, and results put date and time behind a name
_LONGEST_PART = 100  # letters of a name that stands beside others in one of a file


def is_file_name(name: str) -> bool:
    """Whether a file or a folder could have this name, in whatever folder it stands."""
    plain = name.isprintable() and not set(name) & set("/\\") and name.strip(". ")
    return bool(plain) and len(name.encode()) <= _LONGEST_NAME


def _file_name(name: str) -> str:
    if not is_file_name(name):
        raise ValueError(
            message(
                "base.no_folder_name", "must be a name that a folder could have: no /, not . or .., at most 200 letters"
            )
        )
    return name


def check_plain(name: str) -> None:
    """Check a name that becomes one of ports, columns and files; raises ValueError: other letters, or too many."""
    if not name.isidentifier() or len(name) > _LONGEST_PART:
        rule = message(
            "base.rule_of_plain_names", "at most {most} letters, digits and _, no digit first", most=_LONGEST_PART
        )
        raise ValueError(
            message("base.no_plain_name", "'{name}' is no plain name ({rule})", name=shortened(name), rule=rule)
        )


def plain_name(text: str) -> str:
    """Make a name that :func:`check_plain` accepts from a text such as ``robot0:left_finger``, whose signs become _."""
    name = re.sub(r"\W", "_", text)[:_LONGEST_PART]
    return name if name.isidentifier() else f"_{name}"[:_LONGEST_PART]


FileName = Annotated[str, AfterValidator(_file_name)]  # a name that folders may be called by: one segment of a path


_QUOTED = re.compile(r"'([^']+)'")
_UNION_BRANCH = re.compile(r"^(float|int|bool|str|constrained-\w+)$|^(list|dict|tuple|constrained)\b.*\[")


# Type checkers do not inherit this mark from pydantic's metaclass. With it they know the keywords of each class.
@dataclass_transform(kw_only_default=True, field_specifiers=(Field,))
class _CheckedModel(ModelMetaclass):
    """Makes the classes whose objects, made in Python, are told of as the content of a file is."""

    if not TYPE_CHECKING:  # type checkers take the keywords of a class from its fields, which this would hide

        def __call__(cls, /, *positional: Any, **content: Any) -> Any:  # noqa: N805  # of a class of classes
            """Make an object; raises InvalidConfig: a keyword or a value is wrong."""
            if not cls.of_any_size:
                _check_sizes(content, cls.__name__)
            try:
                return super().__call__(*positional, **content)
            except ValidationError as problem:
                raise _first_finding(problem, cls, cls.__name__) from None


class Strict(BaseModel, metaclass=_CheckedModel):
    """Base of everything read from YAML: unknown keys are errors, and nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    of_any_size: ClassVar[bool] = False  # whether its figures may be of any size, as measured ones may

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values of some fields; what was worked out of the fields before is not copied."""
        copy = super().model_copy(update=update, deep=deep)
        for name in copy.__dict__.keys() - type(self).model_fields:
            del copy.__dict__[name]
        return copy

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON Schema, which says of a key what the text below its field says."""
        schema = handler(core)
        properties = handler.resolve_ref_schema(schema)["properties"]
        texts = field_texts(cls)
        for name, field in cls.model_fields.items():
            key = field.alias or name
            if name in texts and field.description is None:
                properties[key]["description"] = texts[name]
        return schema

    def __repr_args__(self) -> Any:
        """Show what was given, and no defaults."""
        return [(name, value) for name, value in super().__repr_args__() if name in self.model_fields_set]


def default_of(model: type[Model], **values: Any) -> Model:
    """Return a section as the default of a key, without its checks, which take long to build: most files need few."""
    return model.model_construct(**values)


def field_texts(model: type[Strict]) -> dict[str, str]:
    """Return the texts below the fields of a class of sections, and of those that it stems from, by field."""
    return {name: text for kind in reversed(model.__mro__) if kind is not Strict for name, text in _texts_of(kind)}


@lru_cache(maxsize=1024)
def _texts_of(kind: type[Any]) -> tuple[tuple[str, str], ...]:
    """Return the fields of a class of sections with the texts below them.

    Pydantic would read the sources of all classes as they are made, which takes a third of the time to import them.
    """
    if not issubclass(kind, Strict):
        return ()
    try:
        source = inspect.getsource(kind)
    except OSError:  # of a class that was made by a call
        return ()
    statements = next(node.body for node in ast.parse(textwrap.dedent(source)).body if isinstance(node, ast.ClassDef))
    found = []
    for field, text in pairwise(statements):
        match field, text:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(said))):
                found.append((name, inspect.cleandoc(said)))
    return tuple(found)


class Renamed(Strict):
    """A section that tells of its keys that were given another place or name."""

    renamed: ClassVar[Mapping[str, str]] = {}

    @model_validator(mode="before")
    @classmethod
    def _under_new_names(cls, content: Any) -> Any:
        for key, now in cls.renamed.items():
            if isinstance(content, dict) and key in content:
                raise ValueError(message("base.key_is_now", "{key} is now {now}", key=key, now=now))
        return content


def validated(model: type[Model], content: dict[str, Any], where: Path | str) -> Model:
    """Return ``content`` as a ``model``; raises InvalidConfig: ``where``, the first wrong key, what would be right."""
    if not getattr(model, "of_any_size", False):
        _check_sizes(content, where)
    try:
        return model.model_validate(content)
    except ValidationError as problem:
        raise _first_finding(problem, model, where) from None


def _check_sizes(content: object, where: Path | str) -> None:
    """Check that no number in a content is larger or smaller than any physical quantity.

    Zero, infinity and NaN pass: a section that does not take them refuses them by the types of its fields.

    Args:
        content: mappings, lists and values, nested.
        where: name of the file, for errors.

    Raises:
        InvalidConfig: a number is too large or too small. If there are several, the message names the first one in the
            order of the content.
    """
    # Nested calls for each of the hundreds of values would take most of the time of reading a station. Instead, the
    # values that remain to be checked are kept in a stack, each with its dotted key and its depth in the content.
    remaining: list[tuple[object, str, int]] = [(content, "", 0)]
    while remaining:
        value, key, depth = remaining.pop()
        if isinstance(value, int | float):
            if value and not _SMALLEST <= abs(value) <= _LARGEST and abs(value) < inf:
                bounds = message(
                    "base.zero_or_range",
                    "zero or {smallest:g} to {largest:g} in size",
                    smallest=_SMALLEST,
                    largest=_LARGEST,
                )
                raise InvalidConfig(
                    where,
                    key,
                    message(
                        "base.number_out_of_range",
                        "a figure is {bounds} (it is {value})",
                        bounds=bounds,
                        value=quoted(value),
                    ),
                )
        elif depth >= _DEEPEST:
            continue
        elif isinstance(value, Mapping):
            prefix = f"{key}." if key else ""
            entries = [(entry, f"{prefix}{name}", depth + 1) for name, entry in value.items()]
            remaining += reversed(entries)  # the last entry of the stack is checked next
        elif isinstance(value, list | tuple):
            entries = [(entry, f"{key}[{index}]", depth + 1) for index, entry in enumerate(value)]
            remaining += reversed(entries)


def file_schema(model: type[BaseModel], *, from_place: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the JSON Schema of a file that holds a model; fields that follow ``from_place`` need not stand in it."""
    schema = model.model_json_schema()
    schema["required"] = [key for key in schema.get("required", []) if key not in from_place]
    return schema


def write_schema(file: Path, schema: dict[str, Any]) -> Path:
    """Write a schema, for editors that complete and check YAML, and return its file."""
    file.write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return file


@lru_cache(maxsize=64)
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """Return the JSON Schema of a model to be read: it takes half a second to make one of a station."""
    return model.model_json_schema()


def _first_finding(problem: ValidationError, model: type[BaseModel], where: Path | str) -> InvalidConfig:
    """Return the finding that tells most: an unknown key, else the deepest, which is of the right branch of a union."""
    findings = problem.errors()
    finding = next((f for f in findings if f["type"] == "extra_forbidden"), max(findings, key=lambda f: len(f["loc"])))
    path, known, nodes = _walk(model, finding["loc"])
    key = ".".join(path)
    context, found = finding.get("ctx", {}), finding["input"]
    text: str
    match finding["type"]:
        case "extra_forbidden":
            text = message("base.unknown_key", "unknown key{suggestion}", suggestion=nearest(path[-1], known))
        case "missing" if isinstance(finding["loc"][-1], int):
            sizes = [node["maxItems"] for node in nodes if "maxItems" in node]
            text = message(
                "base.needs_values",
                "needs {size} values, not {found}",
                size=sizes[0] if sizes else message("base.more_values", "more"),
                found=shortened(repr(found)),
            )
        case "missing":
            text = message("base.key_needed", "this key is needed")
        case "union_tag_not_found":
            kinds = [kind for node in nodes if (kind := section_kind(node)) is not None]
            key, text = (
                f"{key}.kind",
                message("base.key_needed_known", "this key is needed; known: {kinds}", kinds=", ".join(kinds)),
            )
        case "union_tag_invalid":
            key, text = f"{key}.kind", _no_such(str(context["tag"]), context["expected_tags"])
        case "literal_error":
            text = _no_such(str(found), context["expected"])
        case "model_type" | "model_attributes_type" | "dict_type":
            keys = dict.fromkeys(key for node in nodes for key in node.get("properties", {}))
            section = (
                message("base.section_with_keys", "a section with keys of: {keys}", keys=", ".join(keys))
                if keys
                else message("base.section_of_names", "a section of names and their entries")
            )
            text = message(
                "base.must_be_section", "must be {section} (it is {found})", section=section, found=quoted(found)
            )
        case _:
            text = value_problem(finding)
            if key:  # otherwise the value is the whole file
                text = message("base.problem_of_value", "{problem} (it is {value})", problem=text, value=quoted(found))
    return InvalidConfig(where, key, text)


def _no_such(name: str, expected: str) -> str:
    """Say that a value is none of those that pydantic expected, listed in quotes."""
    return message(
        "base.there_is_no",
        "there is no '{name}'{suggestion}",
        name=shortened(name),
        suggestion=nearest(name, _QUOTED.findall(expected)),
    )


def _walk(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[list[str], set[str], list[dict[str, Any]]]:
    """Follow a location through the JSON Schema: the keys a user wrote, the keys known beside the last one, its nodes.

    Pydantic puts the branches of unions that it tried into a location; these are no keys and are left out.
    """
    schema = _schema_of(model)
    nodes = schema_branches(schema, schema)
    path: list[str] = []
    known: set[str] = set()
    for depth, part in enumerate(location):
        alternatives = nodes if len(nodes) > 1 else []
        tagged = [node for node in alternatives if part in (section_kind(node), node.get("title"))]
        if tagged or _UNION_BRANCH.match(str(part)):
            nodes = tagged or nodes
            continue
        if isinstance(part, int):  # a place in a list; what is missing at the end of one is told of the list
            items = [node["items"] for node in nodes if isinstance(node.get("items"), dict)]
            below = [branch for item in items for branch in schema_branches(item, schema)]
            if below and (depth < len(location) - 1 or any("properties" in branch for branch in below)):
                nodes, path[-1:] = below, [f"{path[-1]}[{part}]"]
            continue
        children: list[dict[str, Any]] = []
        for node in nodes:
            child = node.get("properties", {}).get(part) or node.get("additionalProperties")
            if isinstance(child, dict):
                children += schema_branches(child, schema)
        known = {key for node in nodes for key in node.get("properties", {})}
        path.append(str(part))
        nodes = children
    return path, known, nodes


def section_kind(node: dict[str, Any]) -> str | None:
    """Return the kind of section that a schema node stands for; None if it is of none, such as null."""
    kind: str | None = node.get("properties", {}).get("kind", {}).get("const")
    return kind


def schema_branches(node: dict[str, Any], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the alternatives that a schema node allows, references followed but for those to other files' schemas."""
    if node.get("$ref", "").startswith("#"):
        return schema_branches(schema["$defs"][node["$ref"].rsplit("/", 1)[-1]], schema)
    alternatives = node.get("anyOf") or node.get("oneOf")
    return [branch for one in alternatives for branch in schema_branches(one, schema)] if alternatives else [node]


FASTEST_RATE = 1e4  # largest rate at which signals are sampled [Hz]: ten samples in a step of 1 ms

Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Length = Annotated[Positive, Field(le=100)]  # of a robot, or of what it does [m]
Speed = Annotated[NotNegative, Field(le=100)]  # of a robot over the ground [m/s]: 360 km/h
Frequency = Annotated[Number, Field(gt=0, le=FASTEST_RATE)]
"""Of something that swings [Hz]: no faster than signals can show."""
Fraction = Annotated[Number, Field(ge=0, le=1)]
Triple = tuple[Number, Number, Number]
FARTHEST, MOST_TURN = 30.0, 2.01 * pi  # what is told in other units than m and rad lies beyond that


def _in_metres(place: Any) -> Any:
    if (most := max(map(abs, place))) > FARTHEST:
        raise ValueError(
            message("base.too_far", "{most:g} m is too far; were these millimetres? lengths are in metres", most=most)
        )
    return place


Place = Annotated[Triple, AfterValidator(_in_metres)]  # [x y z] on a body [m]
Pose = tuple[Number, Number, Number, Number, Number, Number]  # [x y z Rz Ry Rx], R = Rz·Ry·Rx [m, rad]
Colour = tuple[Fraction, Fraction, Fraction, Fraction]  # red, green, blue, opacity
ORIGIN: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _time(time: float) -> float:
    """Check that a time is neither too short nor too long for one."""
    if time and not SHORTEST <= time <= LONGEST:
        raise ValueError(
            message("base.no_time", "a time is of {shortest:g} to {longest:g} s", shortest=SHORTEST, longest=LONGEST)
        )
    return time


Duration = Annotated[Number, Field(gt=0), AfterValidator(_time)]  # a time that something takes [s]
Instant = Annotated[Number, Field(ge=0), AfterValidator(_time)]  # when something begins, from the start of the run [s]


def _possible(inertia: tuple[float, ...]) -> tuple[float, ...]:
    """Check that there is a body with these moments, and products where they are given."""
    from pydrake.multibody.tree import RotationalInertia  # loaded where it is needed: commands read files without

    if len(inertia) not in (3, 6):
        raise ValueError(
            message(
                "base.inertia_of_three_or_six",
                "an inertia is three moments Ixx Iyy Izz, or six numbers: with the products Ixy Ixz Iyz",
            )
        )
    if not RotationalInertia(*inertia).CouldBePhysicallyValid():
        raise ValueError(
            message(
                "base.impossible_inertia",
                "no body has these moments of inertia: none is negative, none exceeds the sum of the others",
            )
        )
    return inertia


Inertia = Annotated[tuple[Number, ...], AfterValidator(_possible)]
"""Moments Ixx Iyy Izz about the centre of mass [kg m²], and the products Ixy Ixz Iyz where they are not zero."""
