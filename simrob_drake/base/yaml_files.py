"""Read YAML and JSON safely: plain data, of a size that somebody may have meant, no key twice."""

import json
import re
from collections import Counter
from collections.abc import Collection
from copy import deepcopy
from functools import lru_cache
from math import isfinite
from pathlib import Path
from typing import Any, cast

import yaml

from simrob_drake.base.errors import InvalidConfig, quoted, shortened
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.messages import message

YAML_SUFFIXES = (".yaml", ".yml")
_MOST_VALUES, _DEEPEST, _LONGEST_NUMBER = 200_000, 60, 1000
_SURROGATE = re.compile("[\ud800-\udfff]")


def is_yaml_name(file: Path | str) -> bool:
    """Whether a file is read as YAML, by the ending of its name. Capital letters make no difference.

    The file need not exist: names that are no paths, such as ``irb120``, are told from paths by this function.
    """
    return Path(file).suffix.lower() in YAML_SUFFIXES


class _Loader(yaml.CSafeLoader):
    """A safe loader for which a key that stands twice is an error, and 1e-3 a number as in YAML 1.2."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            if len(node.value) > _LONGEST_NUMBER and node.tag.endswith((":int", ":float")):
                raise ValueError(
                    message("base.too_long", "too long")
                )  # figures of YAML 1.1 to the base 60, 1:1:1:1..., take minutes
            return super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError) as problem:  # of !!bool maybe, 2001-99-99, and others
            found = message(
                "base.no_such_type",
                "'{text}' is no {kind}",
                text=shortened(str(node.value)),
                kind=node.tag.rpartition(":")[2],
            )
            raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark) from problem

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        text = super().construct_scalar(node)
        if "\0" in text or _SURROGATE.search(text):
            found = message(
                "base.odd_character", "{text} holds a character that is in no text", text=shortened(ascii(text))
            )
            raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark)
        return text

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        for key, count in Counter(str(key.value) for key, _ in node.value).items():
            if count > 1:
                found = message("base.key_twice", "'{key}' stands twice", key=shortened(key))
                raise yaml.constructor.ConstructorError(problem=found, problem_mark=node.start_mark)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Return the mapping in a YAML file; raises InvalidConfig: it cannot be read, is not YAML, or holds none."""
    try:
        text = text_of(path)
    except NotRead as problem:
        raise InvalidConfig(
            path, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None
    content = parse_yaml(text, path)
    if not isinstance(content, dict):
        raise InvalidConfig(path, "", message("base.no_mapping", "must hold a mapping of keys to values"))
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
        root = composed_yaml(text)
    except (NotRead, yaml.YAMLError, ValueError):
        return []
    mappings = [root] if isinstance(root, yaml.MappingNode) else []
    mappings += [value for node in mappings for _, value in node.value if isinstance(value, yaml.MappingNode)]
    found = [str(key.value) for node in mappings for key, value in node.value if isinstance(value, yaml.SequenceNode)]
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
    """Return the value that a YAML text stands for; raises InvalidConfig: the text is not YAML."""
    try:
        return deepcopy(_parsed(text))
    except yaml.constructor.ConstructorError as problem:
        tag_problem = _tag_problem(text)
        if tag_problem:
            raise InvalidConfig(where, "", tag_problem) from None
        raise InvalidConfig(
            where, "", message("base.not_yaml", "is not YAML: {problem}", problem=_yaml_problem(problem))
        ) from None
    except (yaml.YAMLError, ValueError) as problem:
        raise InvalidConfig(
            where, "", message("base.not_yaml", "is not YAML: {problem}", problem=_yaml_problem(problem))
        ) from None


def parse_json(text: str, where: Path | str) -> Any:
    """Return a JSON text's value, numbers finite, keys single; raises InvalidConfig: the text is something else."""
    try:
        return json.loads(
            text, parse_int=_finite_int, parse_float=_finite, parse_constant=_finite, object_pairs_hook=_mapping
        )
    except (ValueError, RecursionError) as problem:
        why = message("base.too_many_levels", "too many levels") if isinstance(problem, RecursionError) else problem
        raise InvalidConfig(where, "", message("base.not_json", "is not JSON: {why}", why=why)) from None


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(message("base.no_finite_number", "{text} is no finite number", text=shortened(text)))
    return number


def _finite_int(text: str) -> int:
    _finite(text)
    return int(text)


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(
            message(
                "base.key_twice_among",
                "a key stands twice among {keys}",
                keys=shortened(", ".join(key for key, _ in pairs)),
            )
        )
    return found


def _tag_problem(text: str) -> str:
    """Describe the first tag of a YAML text that stations do not have. Empty if there is none."""
    tag = next((token for token in yaml.scan(text, Loader=yaml.CSafeLoader) if isinstance(token, yaml.TagToken)), None)
    handle, suffix = ("", "") if tag is None else tag.value
    if tag is None or handle != "!":
        return ""
    return message(
        "base.has_tag",
        "has the tag {tag} (line {line}), which only scenes of Drake have; these have a list under the key directives",
        tag=f"!{suffix}",
        line=tag.start_mark.line + 1,
    )


def _yaml_problem(problem: Exception) -> str:
    """Return what is wrong with a YAML text and where, without what yaml calls a text that it was handed."""
    if not isinstance(problem, yaml.MarkedYAMLError):
        return " ".join(str(problem).replace('in "<unicode string>", ', "at ").split())
    mark = problem.problem_mark or problem.context_mark
    text = ", ".join(part for part in (problem.context, problem.problem) if part)
    return (
        message(
            "base.at_line_and_column",
            "{text} (line {line}, column {column})",
            text=text,
            line=mark.line + 1,
            column=mark.column + 1,
        )
        if mark
        else text
    )


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
            limit = (
                message("base.levels", "{levels} levels", levels=_DEEPEST)
                if len(within) > _DEEPEST
                else message("base.values_with_aliases", "{most} values, aliases counted", most=_MOST_VALUES)
            )
            raise yaml.MarkedYAMLError(
                problem=message("base.more_than", "more than {limit}", limit=limit),
                problem_mark=cast(yaml.Mark, event.start_mark),
            )


def place_of(content: Any, key: list[str], where: Path | str) -> tuple[Any, str]:
    """Return where a dotted key stands, and its last part; makes sections; raises InvalidConfig: ``where``, the key."""
    node = content
    for depth, part in enumerate(key):
        whole = ".".join(key[: depth + 1])
        if isinstance(node, list) and not (part.isdecimal() and int(part) < len(node)):
            raise InvalidConfig(
                where,
                whole,
                message(
                    "base.no_such_entry",
                    "has no place '{part}'; those there are 0 to {last}",
                    part=part,
                    last=len(node) - 1,
                ),
            )
        if not isinstance(node, dict | list):
            raise InvalidConfig(
                where,
                ".".join(key[:depth]),
                message(
                    "base.value_has_no_key", "is {value}, so it has no key '{part}'", value=quoted(node), part=part
                ),
            )
        if depth == len(key) - 1:
            break
        inner = node[int(part)] if isinstance(node, list) else node.get(part)
        if inner is None and isinstance(node, dict):
            inner = node[part] = {}
        node = inner
    return node, key[-1]
