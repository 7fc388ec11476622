"""Readers of YAML and JSON that are safe for files of strangers.

They make plain data only, and refuse a mapping with a key that occurs twice, numbers that are not finite (in JSON), and
texts whose values are many or deeply nested, as aliases of YAML can make them in a few lines.
"""

import json
import re
from collections import Counter
from collections.abc import Collection
from copy import deepcopy
from functools import lru_cache
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple, cast

import yaml

from simrob_drake.base.errors import InvalidConfig, quote_value, shorten
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.messages import message

YAML_SUFFIXES = (".yaml", ".yml")
"""Endings of the names of YAML files, in lower case."""

_MOST_VALUES = 200_000
"""Largest count of values in a text. An alias counts as many values as it stands for."""

_DEEPEST = 60
"""Largest count of levels of mappings and lists."""

_LONGEST_NUMBER = 1000
"""Largest length of a number [characters]."""

_SURROGATE = re.compile("[\ud800-\udfff]")
"""A half of a character in UTF-16. It is no character of its own, and cannot be written to a file."""


def is_yaml_name(file: Path | str) -> bool:
    """Whether a file is read as YAML, by the ending of its name. Capital letters make no difference.

    The file need not exist: names that are no paths, such as ``irb120``, are told from paths by this function.
    """
    return Path(file).suffix.lower() in YAML_SUFFIXES


class _Loader(yaml.CSafeLoader):
    """A safe loader of PyYAML. A key that occurs twice is an error, and 1e-3 is a number, as in YAML 1.2."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Make the Python object of a node. Errors of Python become those of YAML, with the line."""
        try:
            # Numbers of YAML 1.1 to the base 60, 1:1:1:1..., take minutes if they are long.
            is_number = node.tag.endswith((":int", ":float"))
            if is_number and len(node.value) > _LONGEST_NUMBER:
                raise ValueError(message("base.too_long", "too long"))
            return super().construct_object(node, deep)
        # PyYAML converts values without a check: "!!bool maybe" raises a KeyError, 2001-99-99 a ValueError.
        except (ValueError, LookupError, AttributeError) as problem:
            found = message(
                "base.no_such_type",
                "'{text}' is not a valid {kind}",
                text=shorten(str(node.value)),
                kind=node.tag.rpartition(":")[2],
            )
            raise yaml.constructor.ConstructorError(
                problem=found, problem_mark=node.start_mark
            ) from problem

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        """Make the text of a node. A character that no text has is an error.

        PyYAML calls this for a mapping, too: YAML 1.1 allows a mapping with the key ``=`` instead of a text, and the
        value of this key is then the text.
        """
        text = super().construct_scalar(node)
        # Such a text would fail only later, as the name of a file or in a table.
        if "\0" in text or _SURROGATE.search(text):
            found = message(
                "base.odd_character",
                "{text} contains a character that is not allowed in text",
                text=shorten(ascii(text)),
            )
            raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark)
        return text

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Make the dict of a node. A key that occurs twice is an error: PyYAML would drop the first value."""
        # The nodes of the keys are counted: in the dict, equal keys are one.
        for key, count in Counter(str(key.value) for key, _ in node.value).items():
            if count > 1:
                found = message("base.key_twice", "the key '{key}' occurs twice", key=shorten(key))
                raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark)
        return super().construct_mapping(node, deep)


# YAML 1.1 takes 1e-3 for a text, since it has no decimal point.
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    # PyYAML tries the expression only for texts that begin with one of these characters.
    list("-+.0123456789"),
)


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Read a YAML file with a mapping.

    Raises:
        InvalidConfig: the file cannot be read, is not YAML, or contains no mapping.
    """
    try:
        text = text_of(path)
    except NotRead as problem:
        raise InvalidConfig(
            path, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None
    content = parse_yaml(text, path)
    if not isinstance(content, dict):
        raise InvalidConfig(
            path, "", message("base.no_mapping", "must contain a mapping of keys to values")
        )
    return content


def keys_of_lists(path: Path, keys: Collection[str]) -> list[str]:
    """Find the keys of a YAML file whose values are lists, in its outermost mapping or in a mapping in that.

    Tags make no difference, and neither does what else the file contains.

    Args:
        path: the file.
        keys: keys that are looked for.

    Returns:
        the keys that were found; none if the file cannot be read, or is not YAML.
    """
    try:
        text = text_of(path)
        # A text without the word needs no parsing, which is the case for almost all files.
        if not any(f"{key}:" in text for key in keys):
            return []
        # Nodes keep lists below unknown tags, which the construction of values would refuse.
        root = composed_yaml(text)
    except (NotRead, yaml.YAMLError, ValueError):
        return []
    if not isinstance(root, yaml.MappingNode):
        return []
    # The outermost mapping, then those in it.
    mappings = [root, *(value for _, value in root.value if isinstance(value, yaml.MappingNode))]
    found = set[str]()
    for mapping in mappings:
        for key, value in mapping.value:
            if isinstance(value, yaml.SequenceNode):
                found.add(str(key.value))
    return [key for key in keys if key in found]


def composed_yaml(text: str) -> yaml.Node | None:
    """Parse a YAML text into nodes, which keep tags and lines. Nothing is constructed.

    Raises:
        YAMLError: the text is not YAML, or has too many values or levels.
    """
    _check_growth(text)
    node: yaml.Node | None = yaml.compose(text, Loader=yaml.CSafeLoader)
    return node


def parse_yaml(text: str, where: Path | str) -> Any:
    """Read the value of a YAML text.

    Args:
        text: the text.
        where: name of its file, for the error.

    Raises:
        InvalidConfig: the text is not YAML, has a key that occurs twice, a value that cannot be made (such as one with
            an unknown tag), or too many values or levels.
    """
    try:
        # A copy, since the value is kept for the next call, and callers may change theirs.
        return deepcopy(_load_yaml(text))
    except (yaml.YAMLError, ValueError) as problem:
        why: str = message(
            "base.not_yaml", "is not YAML: {problem}", problem=_yaml_problem(problem)
        )
        # An unknown tag is such an error. The user may have given a file of a Drake scene, which has tags.
        if isinstance(problem, yaml.constructor.ConstructorError):
            why = _tag_problem(text) or why
        raise InvalidConfig(where, "", why) from None


def parse_json(text: str, where: Path | str) -> Any:
    """Read the value of a JSON text.

    Args:
        text: the text.
        where: name of its file, for the error.

    Raises:
        InvalidConfig: the text is not JSON, has a number that is not finite, a key that occurs twice, or too many
            levels.
    """
    try:
        return json.loads(
            text,
            # Python's parser would make an infinity of 1e999, and accept NaN, Infinity and repeated keys.
            parse_int=_finite_int,
            parse_float=_finite,
            parse_constant=_finite,
            object_pairs_hook=_mapping,
        )
    except (ValueError, RecursionError) as problem:
        why = (
            message("base.too_many_levels", "too many levels")
            if isinstance(problem, RecursionError)
            else problem
        )
        raise InvalidConfig(
            where, "", message("base.not_json", "is not JSON: {why}", why=why)
        ) from None


def _finite(text: str) -> float:
    """Read a number. Raises ValueError if it is not finite, such as 1e999, or Python's NaN in JSON."""
    number = float(text)
    if not isfinite(number):
        raise ValueError(
            message("base.no_finite_number", "{text} is not a finite number", text=shorten(text))
        )
    return number


def _finite_int(text: str) -> int:
    """Read an integer. Raises ValueError if it is too large for a float."""
    # An integer beyond 1e308 becomes infinite in any computation with floats.
    _finite(text)
    return int(text)


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a dict of keys and values. Raises ValueError if a key occurs twice."""
    found = dict(pairs)
    # The dict has fewer entries than the text if a key occurs twice.
    if len(found) < len(pairs):
        raise ValueError(
            message(
                "base.key_twice_among",
                "a key occurs twice among {keys}",
                keys=shorten(", ".join(key for key, _ in pairs)),
            )
        )
    return found


def _tag_problem(text: str) -> str:
    """Describe the first tag of a YAML text. Empty if there is none, or if the first one is a tag of YAML itself."""
    tokens = yaml.scan(text, Loader=yaml.CSafeLoader)
    tag = next((token for token in tokens if isinstance(token, yaml.TagToken)), None)
    if tag is None:
        return ""
    handle, suffix = tag.value
    # "!!" is the handle of YAML's own tags.
    if handle != "!":
        return ""
    return message(
        "base.has_tag",
        "has the tag {tag} (line {line}), which only Drake scenes have; a Drake scene has a "
        "list under the key directives",
        tag=f"!{suffix}",
        line=tag.start_mark.line + 1,
    )


def _yaml_problem(problem: Exception) -> str:
    """Describe what is wrong with a YAML text, and where.

    Args:
        problem: error of PyYAML, or a ValueError of Python.
    """
    if not isinstance(problem, yaml.MarkedYAMLError):
        # PyYAML's own name of a text that comes from no file is left out.
        return " ".join(str(problem).replace('in "<unicode string>", ', "at ").split())
    # The problem is where the parser stopped; the context is where the broken mapping or list began.
    mark = problem.problem_mark or problem.context_mark
    text = ", ".join(part for part in (problem.context, problem.problem) if part)
    if not mark:
        return text
    return message(
        "base.at_line_and_column",
        "{text} (line {line}, column {column})",
        text=text,
        line=mark.line + 1,
        column=mark.column + 1,
    )


@lru_cache(maxsize=200)
def _load_yaml(text: str) -> Any:
    """Load the value of a text. It is kept, since the same files are read again whenever a station is built."""
    _check_growth(text)
    # The loader is a subclass of SafeLoader: it makes plain data only, and never calls code that a file names.
    return yaml.load(text, Loader=_Loader)


class _OpenCollection(NamedTuple):
    """A mapping or a list of a YAML text whose end was not read yet.

    Attributes:
        anchor: its anchor, by which aliases name it; None if it has none.
        values_before: count of the values that were read before it.
    """

    anchor: str | None
    values_before: int


def _check_growth(text: str) -> None:
    """Check that a text has not too many values or levels. An alias counts as all the values of its anchor.

    The text is only parsed, so that nothing grows here.

    Raises:
        MarkedYAMLError: it has too many.
    """
    # Count of the values of each anchor. Nested aliases multiply it: ten levels of ten aliases are 10^10 values.
    sizes: dict[str | None, int] = {}
    open_collections: list[_OpenCollection] = []
    # Count of the values so far.
    count = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if isinstance(event, yaml.CollectionEndEvent):
            ended = open_collections.pop()
            if ended.anchor:
                sizes[ended.anchor] = count - ended.values_before
        elif isinstance(event, yaml.AliasEvent):
            # The anchor of a collection that is still open is not known: the collection contains itself.
            count += sizes.get(event.anchor, _MOST_VALUES)
        elif isinstance(event, yaml.NodeEvent):
            count += 1
            if isinstance(event, yaml.CollectionStartEvent):
                open_collections.append(_OpenCollection(event.anchor, count - 1))
            elif event.anchor:
                sizes[event.anchor] = 1
        # Python's and pydantic's functions call themselves for each level, and would exceed the depth of calls.
        is_too_deep = len(open_collections) > _DEEPEST
        if count > _MOST_VALUES or is_too_deep:
            limit = message(
                "base.values_with_aliases", "{most} values, counting aliases", most=_MOST_VALUES
            )
            if is_too_deep:
                limit = message("base.levels", "{levels} levels", levels=_DEEPEST)
            raise yaml.MarkedYAMLError(
                problem=message("base.more_than", "more than {limit}", limit=limit),
                problem_mark=cast(yaml.Mark, event.start_mark),
            )


def place_of(content: Any, key: list[str], where: Path | str) -> tuple[Any, str]:
    """Find the mapping or list that contains a key, for setting it. Sections that are missing are made.

    Args:
        content: content of a file. Empty mappings are added to it for missing sections.
        key: parts of the dotted key: names, and indices of lists.
        where: name of the file or of the override, for errors.

    Returns:
        the mapping or list, and the last part of the key.

    Raises:
        InvalidConfig: a list has no such index, or a value above the key is no mapping and no list.
    """
    node = content
    for depth, part in enumerate(key):
        whole = ".".join(key[: depth + 1])
        if isinstance(node, list) and not (part.isdecimal() and int(part) < len(node)):
            problem = message(
                "base.no_such_entry",
                "has no entry '{part}'; the entries are 0 to {last}",
                part=part,
                last=len(node) - 1,
            )
            if not node:
                problem = message(
                    "base.no_entry_in_empty_list",
                    "has no entry '{part}'; the list is empty",
                    part=part,
                )
            raise InvalidConfig(where, whole, problem)
        if not isinstance(node, dict | list):
            raise InvalidConfig(
                where,
                ".".join(key[:depth]),
                message(
                    "base.value_has_no_key",
                    "is {value}, so it has no key '{part}'",
                    value=quote_value(node),
                    part=part,
                ),
            )
        # The value of the last part is what the caller sets.
        if depth == len(key) - 1:
            break
        inner = node[int(part)] if isinstance(node, list) else node.get(part)
        # A file with "servo:" and nothing below has the value null, which becomes a section, too.
        if inner is None and isinstance(node, dict):
            inner = node[part] = {}
        node = inner
    return node, key[-1]
