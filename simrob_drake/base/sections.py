"""Sections of YAML files as pydantic models: their base class, types of values in SI units, and errors in one line.

A *section* is a mapping in a file, such as ``servo``. It is described by a class, whose fields are the keys. Pydantic
reports several *findings* for wrong content; the most useful one becomes the error, which names the file and the key,
and says what would be right. Known keys and kinds for the error are read from the class's JSON Schema: a *node* of the
schema describes one value, and its *branches* are the alternatives that the value may have.
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
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    Self,
    TypeVar,
    dataclass_transform,
)

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
from simrob_drake.base.errors import InvalidConfig, nearest, quote_value, shorten
from simrob_drake.base.messages import message
from simrob_drake.base.renaming import former_names_of
from simrob_drake.base.value_problems import value_problem

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)  # which has no public name

Model = TypeVar("Model", bound=BaseModel)

# Strict types: pydantic would otherwise accept the text "1" and the boolean true for numbers, too.
Number = Annotated[float, Field(strict=True)]
Integer = Annotated[int, Field(strict=True)]
Boolean = Annotated[bool, Field(strict=True)]

_DEEPEST = 60
"""Count of levels that are checked. Files have no more, but a mapping of a Python program may contain itself."""

# Bounds of the size of numbers other than zero, in SI units or degrees. The modulus of steel is 2e11 Pa. Reciprocals of
# numbers within the bounds are finite.
_SMALLEST = 1e-100
_LARGEST = 1e15

_LONGEST_NAME = 200
"""Largest length of a file's name [bytes]. File systems allow 255, and results append date and time to a name."""

_LONGEST_PART = 100
"""Largest length of a name that is joined with others to the name of a file [characters]."""


def is_file_name(name: str) -> bool:
    """Whether a file or a folder could have this name on the usual systems."""
    has_separator = "/" in name or "\\" in name
    # An empty name, or one such as "..", which would lead to the folder above. Windows drops spaces at the end.
    is_dots_only = not name.strip(". ")
    is_plain = name.isprintable() and not has_separator and not is_dots_only
    # File systems count bytes: a letter with an accent has two in UTF-8.
    return is_plain and len(name.encode()) <= _LONGEST_NAME


def _check_file_name(name: str) -> str:
    """Check that a folder could have a name, and return it. Raises ValueError if none could."""
    if not is_file_name(name):
        raise ValueError(
            message(
                "base.no_folder_name",
                "must be a valid folder name: without /, not . or .., at most 200 characters",
            )
        )
    return name


def check_plain(name: str) -> None:
    """Check a name that becomes a part of the names of ports, columns and files.

    Raises:
        ValueError: the name is empty, begins with a digit, or has too many characters, or others than letters, digits
            and underscores.
    """
    # Dots and colons separate the parts of the names of columns and ports.
    if not name.isidentifier() or len(name) > _LONGEST_PART:
        rule = message(
            "base.rule_of_plain_names",
            "at most {most} letters, digits and _, not beginning with a digit",
            most=_LONGEST_PART,
        )
        raise ValueError(
            message(
                "base.no_plain_name",
                "'{name}' is not a valid name ({rule})",
                name=shorten(name),
                rule=rule,
            )
        )


def plain_name(text: str) -> str:
    """Make a name that :func:`check_plain` accepts. Other characters, as in ``robot0:finger``, become underscores."""
    # A name that begins with a digit, or is empty, gets an underscore in front.
    name = re.sub(r"\W", "_", text)[:_LONGEST_PART]
    return name if name.isidentifier() else f"_{name}"[:_LONGEST_PART]


FileName = Annotated[str, AfterValidator(_check_file_name)]
"""A name that a folder could have: one segment of a path."""

_QUOTED = re.compile(r"'([^']+)'")
"""A name in quotes in pydantic's list of allowed names."""

_UNION_BRANCH = re.compile(
    r"^(float|int|bool|str|constrained-\w+)$|^(list|dict|tuple|constrained)\b.*\["
)
"""Name of a type in the location of a finding, such as ``list[float]``. Pydantic puts the types of a union there."""


# Type checkers do not inherit this mark from pydantic's metaclass. With it they know the keywords of each class.
@dataclass_transform(kw_only_default=True, field_specifiers=(Field,))
class _CheckedModel(ModelMetaclass):
    """Metaclass of sections. Sections that a Python program makes have the same errors as those of a file."""

    # Type checkers take the keywords of a class from its fields. This method would hide the fields from them.
    if not TYPE_CHECKING:

        def __call__(cls, /, *positional: Any, **content: Any) -> Any:  # noqa: N805  # the first argument is a class
            """Make a section. Raises InvalidConfig if a keyword or a value is wrong."""
            if not cls.of_any_size:
                _check_sizes(content, cls.__name__)
            try:
                return super().__call__(*positional, **content)
            except ValidationError as problem:
                raise _first_finding(problem, cls, cls.__name__) from None


class Strict(BaseModel, metaclass=_CheckedModel):
    """Base class of sections: unknown keys are errors, and a section cannot be changed."""

    # The checks of a class are built when they are first used: a command needs few of the classes it imports.
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    of_any_size: ClassVar[bool] = False
    """Whether numbers may have any size, as computed and measured ones."""

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy the section, with other values of some fields, which are not checked."""
        copy = super().model_copy(update=update, deep=deep)
        # Cached properties were computed from the former values.
        for name in copy.__dict__.keys() - type(self).model_fields:
            del copy.__dict__[name]
        return copy

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Make the JSON Schema, with the docstring below each field as the description of its key."""
        schema = handler(core)
        properties = handler.resolve_ref_schema(schema)["properties"]
        texts = field_texts(cls)
        for name, field in cls.model_fields.items():
            key = field.alias or name
            if name in texts and field.description is None:
                properties[key]["description"] = texts[name]
        return schema

    def __repr_args__(self) -> Any:
        """Fields for ``repr``: those that were set, without defaults."""
        return [
            (name, value)
            for name, value in super().__repr_args__()
            if name in self.model_fields_set
        ]


def default_of(model: type[Model], **values: Any) -> Model:
    """Make a section as the default of a key, without checks.

    Pydantic builds the checks of a class when they are first used, which takes long. A file needs those of few classes.

    Args:
        model: class of the section.
        **values: values of its fields.
    """
    return model.model_construct(**values)


def field_texts(model: type[Strict]) -> dict[str, str]:
    """Docstrings below the fields of a class of sections and of its base classes, by the name of the field."""
    texts: dict[str, str] = {}
    # Base classes come first, so that a class replaces their docstrings.
    for kind in reversed(model.__mro__):
        if kind is not Strict:
            texts |= _texts_of(kind)
    return texts


@lru_cache(maxsize=1024)
def _texts_of(kind: type[Any]) -> Mapping[str, str]:
    """Docstrings below the fields of one class, by the name of the field.

    Empty for other classes than sections, and for a class without a source, such as one that a function call has made.
    They are read from the source code. Pydantic could do that, too, but for all classes when they are made, which would
    take a third of the time of importing them.
    """
    if not issubclass(kind, Strict):
        return {}
    try:
        source = inspect.getsource(kind)
    # The class was made by a function call, and has no source of its own.
    except OSError:
        return {}
    # The source of a class inside of a function is indented, which Python's parser would refuse.
    module = ast.parse(textwrap.dedent(source))
    statements = next(node.body for node in module.body if isinstance(node, ast.ClassDef))
    texts = {}
    # Python itself drops these docstrings: they are statements of a single text, after the statement of a field.
    for statement, following in pairwise(statements):
        match statement, following:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                value=ast.Constant(value=str(docstring))
            ):
                texts[name] = inspect.cleandoc(docstring)
    return texts


class Renamed(Strict):
    """A section with former keys. Each of them is an error that names the present key."""

    renamed: ClassVar[Mapping[str, str]] = {}
    """Present key, or a sentence about it, by former key."""

    @model_validator(mode="before")
    @classmethod
    def _check_former_keys(cls, content: Any) -> Any:
        """Check that a content has no former key, and return it. Raises ValueError if it has one."""
        for key, now in cls.renamed.items():
            # The content may also be a section that Python code has made, which has no former keys.
            if isinstance(content, dict) and key in content:
                raise ValueError(message("base.key_is_now", "{key} is now {now}", key=key, now=now))
        return content


def validate_section(model: type[Model], content: dict[str, Any], where: Path | str) -> Model:
    """Make a section from the content of a file.

    Args:
        model: class of the section.
        content: the content.
        where: name of the file, for the error.

    Raises:
        InvalidConfig: the content is wrong. The error names the most relevant wrong key, and says what would be right.
    """
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
            # A number of such a size is most likely a typing error in its exponent. Quotients could become infinite.
            if value and not _SMALLEST <= abs(value) <= _LARGEST and abs(value) < inf:
                bounds = message(
                    "base.zero_or_range",
                    "zero, or {smallest:g} to {largest:g} in magnitude",
                    smallest=_SMALLEST,
                    largest=_LARGEST,
                )
                raise InvalidConfig(
                    where,
                    key,
                    message(
                        "base.number_out_of_range",
                        "must be {bounds} (it is {value})",
                        bounds=bounds,
                        value=quote_value(value),
                    ),
                )
        # Pydantic reports a mapping that contains itself; this loop must not run for ever before.
        elif depth >= _DEEPEST:
            continue
        elif isinstance(value, Mapping):
            prefix = f"{key}." if key else ""
            entries = [(entry, f"{prefix}{name}", depth + 1) for name, entry in value.items()]
            # The last entry of the stack is checked next, so the order is reversed.
            remaining += reversed(entries)
        elif isinstance(value, list | tuple):
            entries = [(entry, f"{key}[{index}]", depth + 1) for index, entry in enumerate(value)]
            remaining += reversed(entries)


def file_schema(model: type[BaseModel], *, from_place: tuple[str, ...] = ()) -> dict[str, Any]:
    """Make the JSON Schema of a file with a section.

    Args:
        model: class of the section.
        from_place: keys that a file may lack, because they follow from its path.
    """
    schema = model.model_json_schema()
    schema["required"] = [key for key in schema.get("required", []) if key not in from_place]
    return schema


def write_schema(file: Path, schema: dict[str, Any]) -> Path:
    """Write a schema to a file, for editors that complete and check YAML. Returns the file."""
    file.write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return file


@lru_cache(maxsize=64)
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """JSON Schema of a section, for reading only. It is kept, since making that of a station takes half a second."""
    return model.model_json_schema()


def _first_finding(
    problem: ValidationError, model: type[BaseModel], where: Path | str
) -> InvalidConfig:
    """Make the error of the most relevant finding about a content.

    This is an unknown key, if there is one. Otherwise it is the finding that is deepest in the content: in a union, the
    alternative that the user meant goes deepest.

    Args:
        problem: pydantic's error.
        model: class of the section.
        where: name of the file.
    """
    findings = problem.errors()
    # A misspelt key may give two findings: it is unknown, and the right key is missing. The first one explains both.
    unknown_keys = [finding for finding in findings if finding["type"] == "extra_forbidden"]
    deepest = max(findings, key=lambda finding: len(finding["loc"]))
    finding: Mapping[str, Any] = unknown_keys[0] if unknown_keys else deepest
    location = _walk(model, finding["loc"])
    key = ".".join(location.path)
    # Pydantic reports the section, but it is the key `kind` in it that is missing or wrong.
    if finding["type"] in ("union_tag_not_found", "union_tag_invalid"):
        key = f"{key}.kind"
    return InvalidConfig(where, key, _text_of_finding(finding, location, key))


def _text_of_finding(finding: Mapping[str, Any], location: "_Location", key: str) -> str:
    """Describe what is wrong at a location, and what would be right.

    Args:
        finding: pydantic's finding.
        location: its location.
        key: dotted key of the location; empty for the whole file.
    """
    context = finding.get("ctx", {})
    found = finding["input"]
    nodes = location.nodes
    text: str
    match finding["type"]:
        case "extra_forbidden":
            suggestion = nearest(location.path[-1], location.known)
            text = message("base.unknown_key", "unknown key{suggestion}", suggestion=suggestion)
        # The location ends with an index: a list is too short.
        case "missing" if isinstance(finding["loc"][-1], int):
            sizes = [node["maxItems"] for node in nodes if "maxItems" in node]
            text = message(
                "base.needs_values",
                "needs {size} values, not {found}",
                size=sizes[0] if sizes else message("base.more_values", "more"),
                found=shorten(repr(found)),
            )
        case "missing":
            text = message("base.key_needed", "this key is required")
        case "union_tag_not_found":
            # The key selects one of several sections, each with a `kind` of its own.
            kinds = [kind for kind in map(section_kind, nodes) if kind is not None]
            text = message(
                "base.key_needed_known",
                "this key is required; known: {kinds}",
                kinds=", ".join(kinds),
            )
        case "union_tag_invalid":
            text = _no_such(str(context["tag"]), context["expected_tags"])
        case "literal_error":
            text = _no_such(str(found), context["expected"])
        case "model_type" | "model_attributes_type" | "dict_type":
            text = message(
                "base.must_be_section",
                "must be {section} (it is {found})",
                section=_section_in_words(nodes),
                found=quote_value(found),
            )
        case _:
            text = value_problem(finding)
            # Without a key, the value is the whole file, which would be too long to show.
            if key:
                text = message(
                    "base.problem_of_value",
                    "{problem} (it is {value})",
                    problem=text,
                    value=quote_value(found),
                )
    return text


def _section_in_words(nodes: list[dict[str, Any]]) -> str:
    """Describe the section that a location must have, with its known keys.

    Args:
        nodes: nodes of the JSON Schema that describe the section.
    """
    # Alternatives of a union share keys: each key is listed once, in the order of the first alternative that has it.
    keys = dict.fromkeys(key for node in nodes for key in node.get("properties", {}))
    if not keys:
        return message("base.section_of_names", "a section of names with their entries")
    return message(
        "base.section_with_keys", "a section with keys among: {keys}", keys=", ".join(keys)
    )


def _no_such(name: str, expected: str) -> str:
    """Message that a name is not known.

    Args:
        name: the name.
        expected: the known names in quotes, as pydantic lists them.
    """
    return message(
        "base.there_is_no",
        "there is no '{name}'{suggestion}",
        name=shorten(name),
        suggestion=nearest(name, _QUOTED.findall(expected)),
    )


class _Location(NamedTuple):
    """Location of a finding in the content of a file.

    Attributes:
        path: the keys from the outermost section to the location, as the user has written them. A list's entry is
            written behind its key: ``points[2]``.
        known: known keys of the section with the last key.
        nodes: nodes of the JSON Schema that describe the value at the location.
    """

    path: list[str]
    known: set[str]
    nodes: list[dict[str, Any]]


def _walk(model: type[BaseModel], location: tuple[int | str, ...]) -> _Location:
    """Follow the location of a finding through the content and the JSON Schema.

    Pydantic puts the alternatives of unions that it tried into a location. These are no keys, and are left out.

    Args:
        model: class of the section.
        location: keys, indices of lists, and names of alternatives.
    """
    schema = _schema_of(model)
    nodes = schema_branches(schema, schema)
    path: list[str] = []
    known: set[str] = set()
    for depth, part in enumerate(location):
        # Only a union has alternatives. A key "Uniform" of the user's must not be taken for the name of a class.
        alternatives = nodes if len(nodes) > 1 else []
        tagged = [node for node in alternatives if part in (section_kind(node), node.get("title"))]
        # The part is the name of an alternative.
        if tagged or _UNION_BRANCH.match(str(part)):
            nodes = tagged or nodes
        elif isinstance(part, int):
            entries = _entries_of_lists(nodes, schema)
            # What is missing at the end of a list of numbers is reported for the list.
            is_last = depth == len(location) - 1
            has_keys = any("properties" in entry for entry in entries)
            if entries and (has_keys or not is_last):
                nodes = entries
                path[-1] = f"{path[-1]}[{part}]"
        else:
            known = {key for node in nodes for key in node.get("properties", {})}
            nodes = _values_of_key(part, nodes, schema)
            path.append(part)
    return _Location(path, known, nodes)


def _entries_of_lists(nodes: list[dict[str, Any]], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Nodes of the entries of the lists among some nodes of a JSON Schema."""
    items = [node["items"] for node in nodes if isinstance(node.get("items"), dict)]
    return [branch for item in items for branch in schema_branches(item, schema)]


def _values_of_key(
    key: str, nodes: list[dict[str, Any]], schema: dict[str, Any]
) -> list[dict[str, Any]]:
    """Nodes of the values of a key in the mappings among some nodes of a JSON Schema."""
    values: list[dict[str, Any]] = []
    for node in nodes:
        # Mappings of any names have one node for all values.
        value = node.get("properties", {}).get(key) or node.get("additionalProperties")
        if isinstance(value, dict):
            values += schema_branches(value, schema)
    return values


def section_kind(node: dict[str, Any]) -> str | None:
    """Value of the key ``kind`` in the sections that a node describes. Returns None if it is not fixed."""
    kind: str | None = node.get("properties", {}).get("kind", {}).get("const")
    return kind


def schema_branches(node: dict[str, Any], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """List the alternatives of a node. References are followed, except those to other files.

    Args:
        node: the node.
        schema: the whole JSON Schema.
    """
    reference = node.get("$ref", "")
    # A reference within the schema is written as "#/$defs/NAME".
    if reference.startswith("#"):
        name = reference.rsplit("/", 1)[-1]
        return schema_branches(schema["$defs"][name], schema)
    alternatives = node.get("anyOf") or node.get("oneOf")
    if not alternatives:
        return [node]
    return [
        branch for alternative in alternatives for branch in schema_branches(alternative, schema)
    ]


FASTEST_RATE = 1e4
"""Largest rate at which signals are sampled [Hz]: ten samples in a step of 1 ms."""

Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]

Length = Annotated[Positive, Field(le=100)]
"""A length of a robot, or of its motion [m]."""

Speed = Annotated[NotNegative, Field(le=100)]
"""Speed of a robot over the ground [m/s], up to 360 km/h."""

Frequency = Annotated[Number, Field(gt=0, le=FASTEST_RATE)]
"""Frequency of an oscillation [Hz]: no faster than signals can show."""

Fraction = Annotated[Number, Field(ge=0, le=1)]
Triple = tuple[Number, Number, Number]

FARTHEST = 30.0
"""Largest coordinate of a point on a body [m]. A larger one is most likely in millimetres."""

MOST_TURN = 2.01 * pi
"""Largest angle of a pose [rad]. A larger one is most likely in degrees."""


def _check_metres(place: Any) -> Any:
    """Check that coordinates can be metres, and return them. Raises ValueError if one is too large."""
    most = max(map(abs, place))
    if most > FARTHEST:
        raise ValueError(
            message(
                "base.too_far",
                "{most:g} m is too far; lengths are in metres, and this may be in millimetres",
                most=most,
            )
        )
    return place


Place = Annotated[Triple, AfterValidator(_check_metres)]
"""A point [x y z] on a body [m]."""

Pose = tuple[Number, Number, Number, Number, Number, Number]
"""A pose vector [x y z Rz Ry Rx], R = Rz Ry Rx [m, rad]."""

Colour = tuple[Fraction, Fraction, Fraction, Fraction]
"""Red, green, blue, and opacity."""

ORIGIN: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""The pose of a frame in itself."""


def _check_time(time: float) -> float:
    """Check that a time is zero or within the times of a station, and return it. Raises ValueError if it is not."""
    if time and not SHORTEST <= time <= LONGEST:
        raise ValueError(
            message(
                "base.no_time",
                "a time must be between {shortest:g} and {longest:g} s",
                shortest=SHORTEST,
                longest=LONGEST,
            )
        )
    return time


Duration = Annotated[Number, Field(gt=0), AfterValidator(_check_time)]
"""Time that something takes [s]."""

Instant = Annotated[Number, Field(ge=0), AfterValidator(_check_time)]
"""Time at which something begins, since the start of the run [s]."""


def _check_inertia(inertia: tuple[float, ...]) -> tuple[float, ...]:
    """Check that a body can have these moments and products of inertia, and return them.

    Raises:
        ValueError: there are not three moments, or six numbers; or no body has them.
    """
    # Imported here, since Drake takes long to load, and most commands read no inertia.
    from pydrake.multibody.tree import RotationalInertia

    # Drake's class takes three moments or six numbers, and would report another count as a TypeError.
    if len(inertia) not in (3, 6):
        raise ValueError(
            message(
                "base.inertia_of_three_or_six",
                "an inertia has three moments Ixx Iyy Izz, or six numbers with the products Ixy Ixz Iyz",
            )
        )
    # All mass is positive, from which the triangle inequality of the principal moments follows. Without products, the
    # three moments are the principal ones.
    if not RotationalInertia(*inertia).CouldBePhysicallyValid():
        raise ValueError(
            message(
                "base.impossible_inertia",
                "no body can have this inertia: a principal moment is negative, or larger than "
                "the sum of the other two",
            )
        )
    return inertia


Inertia = Annotated[tuple[Number, ...], AfterValidator(_check_inertia)]
"""Moments Ixx Iyy Izz about the centre of mass [kg m²], and the products Ixy Ixz Iyz where they are not zero."""


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(__name__, {"validated": "validate_section"})
