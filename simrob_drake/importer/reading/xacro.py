"""Expand xacro files, and find what a xacro file offers to its users: macros and arguments.

The package xacro expands a file in a confined process, which gets only the files that it may read.

An outline of a file contains its macros, its arguments, and known values of each argument. Known values come from the
file and those that it includes: from the texts with which expressions compare an argument, and from the names of files
that fit a path with the argument, such as ``$(find arms)/config/$(arg type)/limits.yaml``.
"""

import ast
import errno
import fnmatch
import html
import importlib.util
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from os.path import exists  # unlike Path's method, it is false for names that no file can have
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import InvalidModel, shorten
from simrob_drake.base.extras import lacking
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.messages import as_data, compound, join_texts, message, message_of
from simrob_drake.base.packages import Border, OutsideBorder, sorted_entries
from simrob_drake.importer.meshes.places import unknown_package
from simrob_drake.importer.reading.child import ChildFailed, in_child
from simrob_drake.importer.reading.xml_file import read_included, xml_text
from simrob_drake.robots.imports import ImportOptions, ImportReport

XACRO = "xacro:"
"""Prefix of the names of xacro's elements."""

TIME_LIMIT = 20.0
"""Longest time of an expansion [s]. A xacro file can call itself without end."""

_EXPANSION = "simrob_drake.importer.reading.expansion"
"""Module that expands a file in the confined process."""

_UNDEFINED = re.compile(r"Undefined substitution argument '?([\w.-]+)")
"""Error of xacro for an argument without a value."""

_LINK = re.compile(r"<link[\s/>]")

# The process may ask for `**/*`: the answer must be bounded as all others are.
_MOST_LISTED = 200
"""Largest count of files that a pattern with wildcards finds."""


class _Attempt(NamedTuple):
    """One expansion of a file.

    Attributes:
        result: its URDF under ``urdf`` and its messages under ``messages``; empty if it failed.
        problem: the reason why it failed; empty if it succeeded.
    """

    result: dict[str, Any]
    problem: str


def expand_xacro(path: Path, text: str, options: ImportOptions, report: ImportReport) -> str:
    """Expand a xacro file.

    Args:
        path: the file.
        text: its content.
        options: options of the import, with the values of arguments and the folders that may be read.
        report: gets entries for the arguments of the file and for its messages.

    Returns:
        the URDF.

    Raises:
        InvalidModel: the package xacro is missing, an argument of the options is not of the form NAME:=VALUE, or the
            file cannot be expanded or contains macros only.
    """
    package = importlib.util.find_spec("xacro")
    # A folder named xacro in the working folder is found, too, but has no origin.
    if package is None or package.origin is None:
        raise report.refusal(
            "", lacking(message("importer.is_xacro", "is a xacro file, which"), "xacro")
        )
    # The confined process has no working folder that would give a relative path a meaning.
    path = path.absolute()
    border = Border(path, options.mesh_path, options.package_folders)
    files = _Files({str(path): text}, border, report)
    arguments = _arguments(options, report)

    # An argument may be used before it is declared, which xacro refuses. It then gets the default that follows later.
    # Each turn gives one more argument a value, so the loop ends.
    while True:
        attempt = _try_expansion(path, arguments, files)
        offers = outline(files.texts.values(), files.package)
        late_argument = _argument_declared_late(attempt.problem, offers)
        if not late_argument or late_argument in arguments:
            break
        arguments[late_argument] = str(offers.arguments[late_argument])
        sentence = message(
            "importer.declared_after_use",
            "{argument}:={value}; the file declares this default after the first use of the argument",
            argument=late_argument,
            value=arguments[late_argument],
        )
        report.add("defaulted", message("importer.xacro_argument", "xacro argument"), sentence)

    summary = ""
    if offers.arguments:
        summary = message(
            "importer.xacro_arguments",
            "arguments, which --xacro-arg NAME:=VALUE sets: {summary}",
            summary=offers.summary(),
        )
    if attempt.problem:
        refusal: str = message(
            "importer.xacro_cannot_expand",
            "xacro cannot expand the file: {problem}",
            problem=attempt.problem,
        )
        raise report.refusal("", join_texts([refusal, summary], "; ") if summary else refusal)
    urdf = str(attempt.result["urdf"])
    # A file of macros alone expands to an empty robot. The user needs the file that calls them.
    if offers.macros and not _LINK.search(urdf):
        raise report.refusal("", _only_macros(offers.macros, files.border.root))
    if summary:
        report.add("read", "", summary)
    # The sentences come from the file, and may be of any length.
    for sentence in attempt.result["messages"]:
        report.add(
            "read",
            "",
            message(
                "importer.file_says", "message of the file: {text}", text=shorten(sentence, 400)
            ),
        )
    return urdf


def _try_expansion(path: Path, arguments: dict[str, str], files: "_Files") -> _Attempt:
    """Expand a xacro file with values of arguments, in a process of its own."""
    job = {"file": str(path), "arguments": arguments}
    try:
        # xacro runs where a file cannot do any harm, even if it gets around the checks of its expressions.
        result = in_child(_EXPANSION, job, files.answer, files.report, seconds=TIME_LIMIT)
    except ChildFailed as failure:
        return _Attempt({}, message_of(failure))
    return _Attempt(result, "")


def _argument_declared_late(problem: str, offers: "Outline") -> str:
    """Name of an argument without a value, if the file declares a default for it later on; else empty.

    Args:
        problem: the error of xacro; empty if there is none.
        offers: outline of the file.
    """
    found = _UNDEFINED.match(problem)
    if found is None:
        return ""
    # The argument may be declared after its use, and then has a default here.
    default = offers.arguments.get(found[1])
    # A default with $ has to be expanded itself, which only xacro can do.
    return found[1] if default is not None and "$" not in default else ""


@dataclass(frozen=True)
class _Files:
    """Answers the requests of an expansion for files and packages.

    Attributes:
        texts: the XML files read so far, by their paths, the expanded file first.
        border: the folders from which files may be read.
        report: gets an entry for each repair of a file.
    """

    texts: dict[str, str]
    border: Border
    report: ImportReport

    def answer(self, asked: str, about: str) -> dict[str, Any]:
        """Answer a request.

        Args:
            asked: kind of the request: ``package`` for its folder, ``files`` for those that fit a pattern, ``yaml`` or
                ``xml`` for the text of a file.
            about: name of the package, pattern, or path of the file.

        Returns:
            the value under ``found``, or a reason under ``missing`` if a file does not exist, or under ``refused`` if
            it may not or cannot be read.
        """
        # A request of any other kind is refused by a KeyError: the file may control the process.
        finders = {
            "package": lambda name: str(self.package(name)),
            "files": self._matching_files,
            "yaml": lambda name: text_of(self._file(name)),
            "xml": self._xml,
        }
        try:
            return {"found": finders[asked](about)}
        # Not refused: xacro continues without a missing file if its include is optional.
        except FileNotFoundError as problem:
            return {"missing": problem.strerror}
        except (LookupError, InvalidModel) as problem:  # their messages contain the name already
            return {"refused": as_data(message_of(problem))}
        except (OutsideBorder, NotRead) as problem:
            return {
                "refused": as_data(compound("{about}: {problem}", about=about, problem=problem))
            }

    def package(self, name: str) -> Path:
        """Folder of a package.

        Raises:
            LookupError: there is no such package in the folders that may be read.
        """
        folder = self.border.package(name)
        if folder is None:
            raise LookupError(unknown_package(name))
        return folder

    def _file(self, name: str) -> Path:
        """Path of a file that exists and may be read.

        Raises:
            OutsideBorder: it may not be read.
            FileNotFoundError: it does not exist.
        """
        # The border is checked before the existence, so that a file cannot find out what exists elsewhere.
        path = self.border.readable(Path(name))
        if not exists(path):
            raise FileNotFoundError(errno.ENOENT, "No such file or directory")
        return path

    def _xml(self, name: str) -> str:
        """Text of an XML file. It is kept, because the outline of the xacro file is made from it."""
        # A file may be included many times. Its repairs are reported once.
        if name not in self.texts:
            self.texts[name] = read_included(xml_text, self._file(name), self.report)
        return self.texts[name]

    def _matching_files(self, pattern: str) -> list[str]:
        """Paths of the files in one folder whose names fit a pattern with wildcards: the first 200 of them."""
        # Only the name may have wildcards. The folder is checked as it is.
        folder, name_pattern = os.path.split(pattern)
        names = fnmatch.filter(sorted_entries(self.border.readable(Path(folder))), name_pattern)
        return [os.path.join(folder, name) for name in names[:_MOST_LISTED]]


def _arguments(options: ImportOptions, report: ImportReport) -> dict[str, str]:
    """Values of arguments that the user gives, by their names.

    Raises:
        InvalidModel: one is not of the form NAME:=VALUE.
    """
    values = {}
    for text in options.xacro_arg:
        name, separator, value = text.partition(":=")
        if not (name.strip() and separator):
            raise report.refusal(
                "",
                message(
                    "importer.odd_xacro_argument",
                    "--xacro-arg '{text}' is not of the form NAME:=VALUE",
                    text=shorten(text),
                ),
            )
        values[name.strip()] = value.strip()
    return values


def _only_macros(macros: Mapping[str, str], package: Path) -> str:
    """Sentence about a file with macros but without a robot, and about the files that call its macros.

    Args:
        macros: parameters of the macros, by their names.
        package: folder in which callers are searched.
    """
    listed = ", ".join(f"{name}({parameters})" for name, parameters in macros.items())
    summary: str = message(
        "importer.macros_for_others",
        "contains no robot, only macros for other files: {macros}",
        macros=shorten(listed, 900),
    )
    found = [str(file.relative_to(package)) for file in callers(macros, package)]
    if not found:
        return summary
    return message(
        "importer.called_by",
        "{summary}; files that call these macros: {found}",
        summary=summary,
        found=shorten(", ".join(found), 300),
    )


# The outline is found by regular expressions, as files with errors or unusual parts have one, too.
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_TAG = re.compile(r"""<(xacro:[\w.:-]+)((?:\s+[\w:]+\s*=\s*(?:"[^"]*"|'[^']*'))*)""")
"""An element of xacro: its name, and its attributes."""

_ATTRIBUTE = re.compile(r"""([\w:]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
"""An attribute: its name, and its value between double or single quotes."""

_USED_ARGUMENT = re.compile(r"\$\(arg\s+([\w.-]+)\s*\)")
# Bounded lengths keep the time of the search proportional to the length of the file.
_EXPRESSION = re.compile(r"\$\{([^}]{1,500})\}|\$\(eval ([^)]{1,500})\)")
_PATH = re.compile(r"""\$\(find\s+([\w.-]+)\s*\)/([^"'<>]*)""")
"""A path in a package: the name of the package, and the path from there."""

_VARIABLE = re.compile(r"\$\(arg\s+([\w.-]+)\s*\)|\$\{\s*(\w+)\s*\}|\$\{[^}]*\}|\$\([^)]*\)")
"""A variable part of a path, with the name of the argument or of the property. Other expressions have neither."""

_CHOICE = "(?P<choice>[^/]+)"
_ANYTHING = "[^/]*"
_MOST_CHOICES = 30
"""Largest count of known values of an argument."""

# Limits of the search in a file and in its package. The search is a help for the user, and must not take long.
_MOST_VARIABLES = 3
"""Largest count of variable parts in a path. Each of them multiplies the files to look at."""

_MOST_FILES = 1000
"""Largest count of files of a package that are looked at."""

_MOST_EXPRESSIONS = 20_000
"""Largest count of expressions that are searched for comparisons."""

_LONGEST_SUMMARY = 900
"""Largest count of characters of the summary of arguments."""


class _Element(NamedTuple):
    """A start tag of a xacro element, with its attributes by their names."""

    tag: str
    attributes: dict[str, str]


class _Comparison(NamedTuple):
    """A comparison in an expression: the name of an argument or a property, and a text with which it is compared."""

    name: str
    text: str


class _PackagePath(NamedTuple):
    """A path in a package, which may contain variable parts."""

    package: str
    path: str


@dataclass(frozen=True)
class Outline:
    """The macros and arguments of a xacro file.

    Attributes:
        macros: parameters of each macro that the file defines, by the name of the macro.
        arguments: default of each argument; None if the user has to give a value.
        choices: known values of arguments. An argument without known values is left out.
    """

    macros: dict[str, str]
    arguments: dict[str, str | None]
    choices: dict[str, list[str]]

    def summary(self) -> str:
        """List the arguments in one line, first those without a default, then those with known values.

        Returns an empty text if there are no arguments.
        """

        def rank(name: str) -> tuple[bool, bool]:
            # False sorts before True: an argument that must be given comes first.
            has_default = self.arguments[name] is not None
            return has_default, name not in self.choices

        parts = []
        for name in sorted(self.arguments, key=rank):
            default = self.arguments[name]
            part = f"{name}:={default}"
            if default is None:
                part = message("importer.argument_needed", "{name} (required)", name=name)
            if name in self.choices:
                choices = ", ".join(self.choices[name])
                part = message(
                    "importer.argument_known",
                    "{part} (known values: {choices})",
                    part=part,
                    choices=choices,
                )
            parts.append(part)
        return shorten("; ".join(parts), _LONGEST_SUMMARY)


def outline(texts: Iterable[str], find: Callable[[str], Path]) -> Outline:
    """Find the macros and arguments of a xacro file.

    Args:
        texts: texts of the file and of the files that it includes, its own first.
        find: function that returns the folder of a package, or raises LookupError.
    """
    # An element in a comment is not there for xacro either.
    own_text, *included_texts = map(_without_comments, texts)
    whole_text = "".join((own_text, *included_texts))
    elements = list(_elements(whole_text))

    # Arguments may be declared in included files. Of those without declaration, only the file's own count.
    arguments: dict[str, str | None] = {}
    for element in elements:
        if element.tag == "xacro:arg" and "name" in element.attributes:
            arguments[element.attributes["name"]] = element.attributes.get("default", "")
    # An argument that is used and declared nowhere has no default: the user must give it.
    for name in _USED_ARGUMENT.findall(own_text):
        arguments.setdefault(name, None)

    macros = {}
    # Macros of included files are not what this file offers.
    for element in _elements(own_text):
        if element.tag == "xacro:macro" and "name" in element.attributes:
            macros[element.attributes["name"]] = ", ".join(
                element.attributes.get("params", "").split()
            )

    comparisons = list(_comparisons(whole_text))
    paths = [_PackagePath(*found) for found in dict.fromkeys(_PATH.findall(whole_text))]
    choices = {}
    for argument in arguments:
        names = {argument, *_other_names(argument, elements)}
        values = [comparison.text for comparison in comparisons if comparison.name in names]
        for path in paths:
            values += _values_in_path(path, names, find)
        if values:
            # Sorted, so that the same file always gives the same text.
            choices[argument] = sorted(dict.fromkeys(values))[:_MOST_CHOICES]
    return Outline(macros, arguments, choices)


def callers(macros: Iterable[str], folder: Path) -> list[Path]:
    """Find the xacro files in a folder and below that call one of some macros and define no macros themselves.

    Of a large folder, only the first `_MOST_FILES` xacro files are looked at.
    """
    # A macro is called by an element of its name.
    calls = re.compile(rf"<xacro:(?:{'|'.join(map(re.escape, macros))})[\s/>]")
    found = []
    for file in islice(folder.rglob("*.xacro"), _MOST_FILES):
        with suppress(NotRead):
            text = text_of(file)
            # A file with macros of its own is likely a part of a robot, too.
            if calls.search(text) and "<xacro:macro" not in text:
                found.append(file)
    return sorted(found)


def _without_comments(text: str) -> str:
    """Remove the comments of an XML text."""
    # After the last end of a comment, the search from each beginning would run to the end of the text in vain.
    end = text.rfind("-->") + 3
    return _COMMENT.sub("", text[:end]) + text[end:]


def _elements(text: str) -> Iterator[_Element]:
    """Yield the xacro elements of a text, which need not be valid XML."""
    for tag in _TAG.finditer(text):
        attributes = {}
        for name, double_quoted, single_quoted in _ATTRIBUTE.findall(tag[2]):
            # In XML, quotes and & within an attribute are written as &quot; and &amp;.
            attributes[name] = html.unescape(double_quoted or single_quoted)
        yield _Element(tag[1], attributes)


def _other_names(argument: str, elements: Iterable[_Element]) -> Iterator[str]:
    """Yield the names of properties and of parameters of macros that get the value of an argument."""
    value = f"$(arg {argument})"
    for tag, attributes in elements:
        if tag == "xacro:property" and attributes.get("value") == value:
            yield attributes.get("name", "")
        elif tag not in ("xacro:property", "xacro:arg", "xacro:if", "xacro:unless"):
            # Other elements call macros: their attributes are the parameters.
            yield from (name for name, text in attributes.items() if text == value)


def _comparisons(text: str) -> Iterator[_Comparison]:
    """Yield the comparisons of names with texts in the expressions of a xacro file."""
    for bracket_text, eval_text in islice(_EXPRESSION.findall(text), _MOST_EXPRESSIONS):
        # One of the two texts is empty, as the expression has one form or the other.
        expression = html.unescape(bracket_text or eval_text).strip()
        # Expressions that are not valid are reported by xacro itself.
        with suppress(SyntaxError, ValueError, RecursionError, MemoryError):
            for node in ast.walk(ast.parse(expression, mode="eval")):
                if isinstance(node, ast.Compare):
                    yield from _comparisons_of(node)


def _comparisons_of(node: ast.Compare) -> Iterator[_Comparison]:
    """Yield each pair of a name and a text in one comparison, such as ``type == 'a'`` or ``type in ['a', 'b']``."""
    names = []
    texts = []
    for side in (node.left, *node.comparators):
        for part in getattr(side, "elts", [side]):  # the entries of a list, or the side itself
            if isinstance(part, ast.Name):
                names.append(part.id)
            elif isinstance(part, ast.Constant) and isinstance(part.value, str):
                texts.append(part.value)
    # In '$(arg type)' == 'a' the argument is part of a text.
    for text in texts:
        names += _USED_ARGUMENT.findall(text)
    fixed_texts = [text for text in texts if text and "$" not in text]
    for name in names:
        for text in fixed_texts:
            yield _Comparison(name, text)


def _values_in_path(
    path: _PackagePath, names: set[str], find: Callable[[str], Path]
) -> Iterator[str]:
    """Yield what stands for a variable part in the paths of existing files; other variable parts may be anything.

    If the variable occurs several times in the path, its first occurrence counts. A path with ``..`` or with more than
    `_MOST_VARIABLES` variable parts gives no values.

    Args:
        path: the path.
        names: names of the variable part: an argument, and the properties and parameters that get its value.
        find: function that returns the folder of a package, or raises LookupError.
    """
    # For each variable part of the path: whether it is the one whose values are sought.
    is_sought = [(argument or name) in names for argument, name in _VARIABLE.findall(path.path)]
    # A path with ".." leaves the package, and may leave the folders that may be read.
    if True not in is_sought or ".." in path.path or len(is_sought) > _MOST_VARIABLES:
        return
    # The expression has two groups, so a split returns a fixed part, two names, the next fixed part, and so on.
    fixed_parts = _VARIABLE.split(path.path)[::3]
    slots = [_ANYTHING] * len(is_sought)
    slots[is_sought.index(True)] = _CHOICE
    # There is one fixed part more than variable parts.
    pairs = zip(fixed_parts, [*slots, ""], strict=True)
    pattern = re.compile("".join(re.escape(part) + slot for part, slot in pairs))
    # In the pattern for the search of files, "?" stands for characters that have a meaning in such patterns.
    wildcards = "*".join(re.sub(r"[*?\[\]]", "?", part) for part in fixed_parts)
    # Two variable parts without a text between them would become "**", which means all folders below.
    wildcards = re.sub(r"\*+", "*", wildcards)
    with suppress(LookupError, OSError, ValueError, NotImplementedError):
        folder = find(path.package)
        for file in islice(folder.glob(wildcards), _MOST_FILES):
            found = pattern.fullmatch(file.relative_to(folder).as_posix())
            if found:
                yield found["choice"]
