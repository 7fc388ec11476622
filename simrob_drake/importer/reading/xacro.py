"""Expand xacro files with xacro itself, in a process that gets only what it may read; and say what a file offers.

That is its macros, and its arguments with what may be chosen for them: what the file and those that it includes compare
an argument with, and the names of files and folders that stand where a path holds the argument, as in
``$(find arms)/config/$(arg type)/limits.yaml``.
"""

import ast
import fnmatch
import html
import importlib.util
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from os.path import exists  # which is false for names that no file can have
from pathlib import Path
from typing import Any

from simrob_drake.base.errors import InvalidModel, shortened
from simrob_drake.base.extras import lacking
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.messages import as_data, compound, join_texts, message, message_of
from simrob_drake.base.packages import Border, OutsideBorder, sorted_entries
from simrob_drake.importer.meshes.places import unknown_package
from simrob_drake.importer.reading.child import ChildFailed, in_child
from simrob_drake.importer.reading.xml_file import read_included, xml_text
from simrob_drake.robots.imports import ImportOptions, ImportReport

XACRO = "xacro:"  # what stands before the names of xacro's elements

TIME_LIMIT = 20.0  # of an expansion [s]: a xacro can call itself for ever

_EXPANSION = "simrob_drake.importer.reading.expansion"
_UNDEFINED = re.compile(r"Undefined substitution argument '?([\w.-]+)")
_LINK = re.compile(r"<link[\s/>]")
_MOST_LISTED = 200  # that a pattern may name


def expand_xacro(path: Path, text: str, options: ImportOptions, report: ImportReport) -> str:
    """Return a xacro file's expansion, made in a process of its own; raises InvalidModel: no xacro, or it fails."""
    package = importlib.util.find_spec("xacro")
    if package is None or package.origin is None:  # a robot's folder of that name has no origin
        raise report.refusal("", lacking(message("importer.is_xacro", "is a xacro file, which"), "xacro"))
    path = path.absolute()
    files = _Files({str(path): text}, Border(path, options.mesh_path, options.package_folders), report)
    arguments = _arguments(options, report)
    while True:
        job, end, problem = {"file": str(path), "arguments": arguments}, dict[str, Any](), ""
        try:
            end = in_child(_EXPANSION, job, files.answer, report, seconds=TIME_LIMIT)
        except ChildFailed as failure:
            problem = message_of(failure)
        offers = outline(files.texts.values(), files.package)
        # an argument that was asked for before its declaration, if that gives a plain value
        found = _UNDEFINED.match(problem)
        default = offers.arguments.get(found[1]) if found else None
        missing = found[1] if found and default is not None and "$" not in default else None
        if missing is None or missing in arguments:
            break
        arguments[missing] = str(offers.arguments[missing])
        said = message(
            "importer.declared_after_use",
            "{argument}:={value}, which the file declares after its first use",
            argument=missing,
            value=arguments[missing],
        )
        report.add("defaulted", message("importer.xacro_argument", "xacro argument"), said)
    summary = (
        message(
            "importer.xacro_arguments",
            "arguments, given with --xacro-arg NAME:=VALUE: {summary}",
            summary=offers.summary(),
        )
        if offers.arguments
        else ""
    )
    if problem:
        refusal: str = message("importer.xacro_cannot_expand", "xacro cannot expand it: {problem}", problem=problem)
        raise report.refusal("", join_texts([refusal, summary], "; ") if summary else refusal)
    if offers.macros and not _LINK.search(end["urdf"]):
        raise report.refusal("", _only_macros(offers.macros, files.border.root))
    if summary:
        report.add("read", "", summary)
    for sentence in end["messages"]:
        report.add("read", "", message("importer.file_says", "the file says: {text}", text=shortened(sentence, 400)))
    return str(end["urdf"])


@dataclass(frozen=True)
class _Files:
    """What an expansion gets to read: files where meshes may lie, too; ``texts`` are the XML files that it got."""

    texts: dict[str, str]
    border: Border
    report: ImportReport

    def answer(self, asked: str, about: str) -> dict[str, Any]:
        """Return what is ``found``, or why it is ``missing`` or ``refused``."""
        finders = {
            "package": lambda name: str(self.package(name)),
            "files": self._listed,
            "yaml": lambda name: text_of(self._file(name)),
            "xml": self._xml,
        }
        try:
            return {"found": finders[asked](about)}
        except FileNotFoundError as problem:
            return {"missing": problem.strerror}
        except (LookupError, InvalidModel) as problem:  # which say what and where
            return {"refused": as_data(message_of(problem))}
        except (OutsideBorder, NotRead) as problem:
            return {"refused": as_data(compound("{about}: {problem}", about=about, problem=problem))}

    def package(self, name: str) -> Path:
        """Return the folder of a package; raises LookupError: there is none that may be read."""
        folder = self.border.package(name)
        if folder is None:
            raise LookupError(unknown_package(name))
        return folder

    def _file(self, name: str) -> Path:
        path = self.border.readable(Path(name))
        if not exists(path):
            raise FileNotFoundError(2, "No such file or directory")
        return path

    def _xml(self, name: str) -> str:
        if name not in self.texts:
            self.texts[name] = read_included(xml_text, self._file(name), self.report)
        return self.texts[name]

    def _listed(self, pattern: str) -> list[str]:
        folder, name = os.path.split(pattern)
        names = fnmatch.filter(sorted_entries(self.border.readable(Path(folder))), name)
        return [os.path.join(folder, name) for name in names[:_MOST_LISTED]]


def _arguments(options: ImportOptions, report: ImportReport) -> dict[str, str]:
    values = {}
    for text in options.xacro_arg:
        name, means, value = text.partition(":=")
        if not (name.strip() and means):
            raise report.refusal(
                "",
                message(
                    "importer.odd_xacro_argument",
                    "--xacro-arg '{text}' is not of the form NAME:=VALUE",
                    text=shortened(text),
                ),
            )
        values[name.strip()] = value.strip()
    return values


def _only_macros(macros: Mapping[str, str], package: Path) -> str:
    """Say what a file holds that makes no robot, and which one would."""
    listed = ", ".join(f"{name}({parameters})" for name, parameters in macros.items())
    summary = message(
        "importer.macros_for_others",
        "holds no robot, but macros that others call: {macros}",
        macros=shortened(listed, 900),
    )
    found = [str(file.relative_to(package)) for file in callers(macros, package)]
    return (
        message(
            "importer.called_by",
            "{summary}; called by {found}",
            summary=summary,
            found=shortened(", ".join(found), 300),
        )
        if found
        else summary
    )


_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_TAG = re.compile(r"""<(xacro:[\w.:-]+)((?:\s+[\w:]+\s*=\s*(?:"[^"]*"|'[^']*'))*)""")
_ATTRIBUTE = re.compile(r"""([\w:]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_USED = re.compile(r"\$\(arg\s+([\w.-]+)\s*\)")
_EXPRESSION = re.compile(r"\$\{([^}]{1,500})\}|\$\(eval ([^)]{1,500})\)")
_PATH = re.compile(r"""\$\(find\s+([\w.-]+)\s*\)/([^"'<>]*)""")
_VARIABLE = re.compile(r"\$\(arg\s+([\w.-]+)\s*\)|\$\{\s*(\w+)\s*\}|\$\{[^}]*\}|\$\([^)]*\)")
_CHOICE, _ANYTHING = "(?P<choice>[^/]+)", "[^/]*"
_MOST_CHOICES, _MOST_VARIABLES, _MOST_FILES, _MOST_EXPRESSIONS = 30, 3, 1000, 20_000
_LONGEST = 900  # letters of what is told


@dataclass(frozen=True)
class Outline:
    """What a file offers."""

    macros: dict[str, str]  # the parameters of each macro that it defines
    arguments: dict[str, str | None]  # the default of each argument; None where it is needed
    choices: dict[str, list[str]]  # for each argument for which some are known

    def summary(self) -> str:
        """Return its arguments in a line, those that are needed and those with choices first; empty without any."""
        order = sorted(self.arguments, key=lambda name: (self.arguments[name] is not None, name not in self.choices))
        parts = []
        for name in order:
            default, choices = self.arguments[name], ", ".join(self.choices.get(name, ()))
            part = (
                message("importer.argument_needed", "{name} (needed)", name=name)
                if default is None
                else f"{name}:={default}"
            )
            parts.append(
                message("importer.argument_known", "{part} (known: {choices})", part=part, choices=choices)
                if choices
                else part
            )
        return shortened("; ".join(parts), _LONGEST)


def outline(texts: Iterable[str], find: Callable[[str], Path]) -> Outline:
    """Return what a xacro file offers, of its own text and those it includes; ``find`` gives a package's folder."""
    own, *others = map(_without_comments, texts)
    every = "".join((own, *others))
    tags = list(_tags(every))
    stated = [attributes for tag, attributes in tags if tag == "xacro:arg" and "name" in attributes]
    declared = {attributes["name"]: attributes.get("default", "") for attributes in stated}
    arguments = {**declared, **{name: None for name in _USED.findall(own) if name not in declared}}
    macros = {
        attributes["name"]: ", ".join(part for part in re.split(r"\s+", attributes.get("params", "")) if part)
        for tag, attributes in _tags(own)
        if tag == "xacro:macro" and "name" in attributes
    }
    called = {name: {name, *_other_names(name, tags)} for name in arguments}
    compared, paths = list(_comparisons(every)), list(dict.fromkeys(_PATH.findall(every)))
    choices = {}
    for name, names in called.items():
        found = [text for one, text in compared if one in names and text]
        found += [text for package, path in paths for text in _fitting(package, path, names, find)]
        if found:
            choices[name] = sorted(dict.fromkeys(found))[:_MOST_CHOICES]
    return Outline(macros, arguments, choices)


def callers(macros: Iterable[str], folder: Path) -> list[Path]:
    """Return the xacro files below a folder that call one of some macros and define none."""
    calls = re.compile(rf"<xacro:(?:{'|'.join(map(re.escape, macros))})[\s/>]")
    found = []
    for file in islice(folder.rglob("*.xacro"), _MOST_FILES):
        with suppress(NotRead):
            text = text_of(file)
            if calls.search(text) and "<xacro:macro" not in text:
                found.append(file)
    return sorted(found)


def _without_comments(text: str) -> str:
    end = text.rfind("-->") + 3  # beyond, each comment would be searched for an end that is not there
    return _COMMENT.sub("", text[:end]) + text[end:]


def _tags(text: str) -> Iterator[tuple[str, dict[str, str]]]:
    for tag in _TAG.finditer(text):
        yield tag[1], {name: html.unescape(one or other) for name, one, other in _ATTRIBUTE.findall(tag[2])}


def _other_names(argument: str, tags: Iterable[tuple[str, dict[str, str]]]) -> Iterator[str]:
    """Yield the names of properties, and of parameters of macros, that are given an argument's value."""
    value = f"$(arg {argument})"
    for tag, attributes in tags:
        if tag == "xacro:property" and attributes.get("value") == value:
            yield attributes.get("name", "")
        elif tag not in ("xacro:property", "xacro:arg", "xacro:if", "xacro:unless"):
            yield from (name for name, text in attributes.items() if text == value)


def _comparisons(text: str) -> Iterator[tuple[str, str]]:
    """Yield names, of arguments too, and the texts with which expressions compare them."""
    for dollar, evaluated in islice(_EXPRESSION.findall(text), _MOST_EXPRESSIONS):
        expression = html.unescape(dollar or evaluated).strip()
        with suppress(SyntaxError, ValueError, RecursionError, MemoryError):
            comparisons = (
                node for node in ast.walk(ast.parse(expression, mode="eval")) if isinstance(node, ast.Compare)
            )
            for node in comparisons:
                sides = [part for side in (node.left, *node.comparators) for part in getattr(side, "elts", [side])]
                texts = [part.value for part in sides if isinstance(part, ast.Constant) and isinstance(part.value, str)]
                names = [part.id for part in sides if isinstance(part, ast.Name)]
                names += [name for value in texts for name in _USED.findall(value)]
                yield from ((name, value) for name in names for value in texts if value and "$" not in value)


def _fitting(package: str, path: str, names: set[str], find: Callable[[str], Path]) -> Iterator[str]:
    """Yield what could stand for one of some names in a path, so that there is such a file."""
    own = [(one or other) in names for one, other in _VARIABLE.findall(path)]
    if True not in own or ".." in path or len(own) > _MOST_VARIABLES:
        return
    fixed = _VARIABLE.split(path)[::3]
    slots = [_CHOICE if place == own.index(True) else _ANYTHING for place in range(len(own))] + [""]
    pattern = re.compile("".join(re.escape(part) + slot for part, slot in zip(fixed, slots, strict=True)))
    wild = re.sub(r"\*+", "*", "*".join(re.sub(r"[*?\[\]]", "?", part) for part in fixed))
    with suppress(LookupError, OSError, ValueError, NotImplementedError):
        folder = find(package)
        for file in islice(folder.glob(wild), _MOST_FILES):
            if found := pattern.fullmatch(file.relative_to(folder).as_posix()):
                yield found["choice"]
