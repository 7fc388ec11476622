"""RAPID modules as trees of syntax, by the grammar in `rapid.lark`, and what they declare: types, data, routines."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import SimrobError, shorten
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.files import NotRead, content_of, text_of
from simrob_drake.base.messages import compound, message
from simrob_drake.extensions.rapid.repairs import Repair, find_missing_end
from simrob_drake.extensions.rapid.values import Types, Value, WrongType

SUFFIXES = (
    ".mod",
    ".modx",
    ".prg",
    ".sys",
    ".sysx",
)  # of modules; a `.pgf` lists those of a program
_LARGEST = 4_000_000  # bytes; offline programming writes one target after the other
_MOST_STATEMENTS = 10_000
"""Largest count of statements (semicolons) of a file. Reading takes about 2 ms for each, planning of a move 20 ms
more."""
_HERE = Path(__file__).parent
_MOST_FAULTS = 20  # of one module, before it is taken for something else

Node = Any  # a tree or a token of lark, which has no types for what it holds


class RapidError(SimrobError):
    """A module that cannot be understood or done; the message names the file and the line."""

    def __init__(self, where: str, problem: str) -> None:
        super().__init__(compound("{where}: {problem}", where=where, problem=problem))


@dataclass(frozen=True)
class LineRemark:
    """Something about a module that its user should know."""

    file: str  # its name
    line: int  # counted from 1
    text: str  # what it is
    lost: bool = True  # whether something was not understood, and so is not done

    def __str__(self) -> str:
        return message(
            "rapid.file_line_text",
            "{file}: line {line}: {text}",
            file=self.file,
            line=self.line,
            text=self.text,
        )


@dataclass(frozen=True)
class Module:
    """A module as its file has it: its name, its declarations, and what of the file was not understood."""

    file: str
    name: str
    declarations: tuple[Node, ...]
    faults: tuple[LineRemark, ...] = ()


def read_modules(file: Path) -> list[Module]:
    """Return the modules of a file, or of all that a `.pgf` lists; raises RapidError: unreadable, or no module."""
    if file.suffix.lower() != ".pgf":
        return modules_of(_text(file), file.name)
    listed = re.findall(r"<Module>\s*([^<]+?)\s*</Module>", _text(file))
    if not listed:
        raise RapidError(file.name, message("rapid.lists_no_module", "lists no <Module>"))
    return [module for name in listed for module in read_modules(file.parent / Path(name).name)]


def modules_of(text: str, file: str) -> list[Module]:
    """Read the modules of a text. Parts of it that are not understood are left out, and are faults of the first module.

    Args:
        text: text of a file.
        file: name of the file, for messages.

    Raises:
        RapidError: there is no module, too little is understood, or there are too many statements.
    """
    _check_size(text, file)
    parsed = _parse(text, file)
    faults = sorted(parsed.faults, key=lambda fault: fault.line)
    if not parsed.trees:
        if faults:
            raise _error_of(faults[0])
        raise RapidError(
            message("rapid.first_line", "{file}: line 1", file=file),
            message("rapid.no_module", "there is no MODULE ... ENDMODULE"),
        )
    modules = []
    for index, tree in enumerate(parsed.trees):
        # The children of a module's tree are its name, its attributes (or nothing) and its declarations.
        name = str(tree.children[0])
        module_faults = tuple(faults) if index == 0 else ()
        modules.append(Module(file, name, tuple(tree.children[2:]), module_faults))
    return modules


class _ParsedText(NamedTuple):
    """Result of parsing a text.

    Attributes:
        trees: one tree of the parser for each module.
        faults: what was not understood, in the order in which it was found.
    """

    trees: list[Node]
    faults: list[LineRemark]


def _parse(text: str, file: str) -> _ParsedText:
    """Parse a text. At each fault the text is repaired, or the faulty statement is blanked, and parsed again.

    Raises:
        RapidError: there are too many faults, or a fault after which nothing can be read.
    """
    with importing_extra("RAPID", "rapid"):
        from lark.exceptions import UnexpectedInput

    faults: list[LineRemark] = []
    readable = text
    while True:
        try:
            return _ParsedText(_parser().parse(readable).children, faults)
        except UnexpectedInput as problem:
            if len(faults) == _MOST_FAULTS:
                raise _error_of(faults[0]) from None
            repair = find_missing_end(problem, readable) or _without_statement(problem, readable)
            faults.append(LineRemark(file, repair.line, repair.problem))
            readable = repair.text
            if not readable:
                raise _error_of(faults[0]) from None


def _error_of(fault: LineRemark) -> RapidError:
    """Make the error of a text that cannot be read because of a fault."""
    return RapidError(
        message("rapid.at_line", "{file}: line {line}", file=fault.file, line=fault.line),
        fault.text,
    )


def _without_statement(problem: Any, text: str) -> Repair:
    """Replace the statement at which the parser stopped by blanks.

    Args:
        problem: error of the parser.
        text: the whole text.

    Returns:
        the repair; its text is empty if there is nothing to replace.
    """
    begin, end = _statement_at(text, problem.pos_in_stream)
    # Editors and controllers ignore what is copied behind the last module, so all of that is replaced.
    modules_end = _after_all(text)
    if modules_end <= begin:
        begin = modules_end
        end = len(text)
    blanked = re.sub(r"[^\n]", " ", text[begin:end])
    fault = _fault(problem, text)
    return Repair(
        fault.line, fault.text, f"{text[:begin]}{blanked}{text[end:]}" if begin < end else ""
    )


def nodes(tree: Node, *kinds: str) -> Iterator[Node]:
    """Yield the nodes of some kinds in a tree, in order of the text."""
    yield from (node for node in tree.iter_subtrees_topdown() if node.data in kinds)


def _check_size(text: str, file: str) -> None:
    """Check that a text can be read in a time that a user waits.

    Raises:
        RapidError: the text has too many statements.
    """
    statements = text.count(";")
    if statements > _MOST_STATEMENTS:
        raise RapidError(
            file,
            message(
                "rapid.too_many_statements",
                "has {count} statements, more than {most}: split it into modules",
                count=statements,
                most=_MOST_STATEMENTS,
            ),
        )


@cache
def _parser() -> Any:
    from lark import Lark

    return Lark(text_of(_HERE / "rapid.lark"), parser="lalr", propagate_positions=True)


@cache
def predefined() -> Module:
    """Return the module of what every program knows."""
    return modules_of(text_of(_HERE / "predefined.sys"), "predefined.sys")[0]


def expression(text: str) -> Node:
    """Return a text as an expression; raises RapidError: it is none."""
    (module,) = modules_of(f"MODULE a\nCONST num b:={text};\nENDMODULE", "text")
    parts = [
        item.children[2]
        for node in module.declarations
        if node.data == "data"
        for item in node.children[3:]
    ]
    if module.faults or len(parts) != 1:
        raise RapidError(
            "text", message("rapid.no_value", "'{text}' is no value", text=shorten(text, 60))
        )
    return parts[0]


def _text(file: Path) -> str:
    try:
        content = content_of(file, _LARGEST)
    except NotRead as problem:
        raise RapidError(str(file), str(problem)) from problem
    try:
        return content.decode()
    except UnicodeDecodeError:  # what older controllers write
        return content.decode("latin-1")


class _Fault(NamedTuple):
    """A place where the parser stopped: its line, counted from 1, and the fault in words."""

    line: int
    text: str


def _fault(problem: Any, text: str) -> _Fault:
    """Describe the place where the parser stopped, by the text from there to the end of its line."""
    # At the end of the text, the parser has no place.
    has_place = problem.pos_in_stream is not None and problem.line > 0
    place = problem.pos_in_stream if has_place else len(text.rstrip())
    line = text.count("\n", 0, place) + 1
    rest_of_line = text[place:].partition("\n")[0].strip()
    if not rest_of_line:
        return _Fault(line, message("rapid.ends_before_whole", "ends before it is whole"))
    return _Fault(
        line,
        message(
            "rapid.not_understood",
            "'{text}' is not understood here",
            text=shorten(rest_of_line, 60),
        ),
    )


def _after_all(text: str) -> int:
    """Return where the last module of a text ends; its own end without one."""
    ends = [
        found.end()
        for found in re.finditer(r"^[^!\n]*\bENDMODULE\b", text, re.IGNORECASE | re.MULTILINE)
    ]
    return ends[-1] if ends else len(text)


def _statement_at(text: str, place: int | None) -> tuple[int, int]:
    """Return where the statement around a place begins and ends, within its line at most."""
    if place is None or place < 0:
        return 0, 0
    begin = max(text.rfind("\n", 0, place), text.rfind(";", 0, place)) + 1
    ends = [end for end in (text.find(";", place) + 1, text.find("\n", place)) if end > 0]
    return begin, min(ends, default=len(text))


@dataclass
class Datum:
    """Data with its type; what it holds at first is worked out when somebody asks."""

    kind: str
    dimensions: int = 0
    first: "Callable[[], Value] | None" = None
    held: "Value | None" = None
    constant: bool = False

    @property
    def value(self) -> Any:
        """What it holds; raises WrongType: its first value depends on itself."""
        if self.held is None:
            if self.first is None:
                raise WrongType(
                    message("rapid.depends_on_itself", "data whose value depends on itself")
                )
            first, self.first = self.first, None
            try:
                self.held = first()
            except WrongType:
                self.first = first
                raise
        return self.held


@dataclass(frozen=True)
class RoutineParameter:
    """A parameter of a routine."""

    name: str
    kind: str
    dimensions: int
    optional: bool
    shared: bool  # what is assigned to it, its caller sees


@dataclass(frozen=True)
class Routine:
    """A procedure, or a function if it gives something."""

    name: str
    scope: "Scope"
    parameters: tuple[RoutineParameter, ...]
    body: Node
    gives: str = ""


@dataclass
class Scope:
    """The names that are known in a module: its own, and those of all modules; in lower case."""

    file: str
    shared: dict[str, Any]
    own: dict[str, Any] = field(default_factory=dict)

    def names(self) -> list[Any]:
        """Return what the module itself declares for all: data and routines."""
        shared = [
            one for one in self.shared.values() if isinstance(one, Routine) and one.scope is self
        ]
        return [*shared, *self.own.values()]

    def find(self, name: str) -> Any:
        """Return what a name stands for: a Datum or a Routine; None if nothing."""
        key = name.lower()
        return self.own.get(key, self.shared.get(key))


def declared(
    modules: Iterable[Module], make: Callable[[Scope, Node], tuple[str, Datum]]
) -> tuple[Types, Scope, list[LineRemark]]:
    """Return the types that modules declare, the names that the last one knows, and what was not understood.

    Data are as ``make`` gives them with their names.
    """
    types, shared, faults = Types(), dict[str, Any](), list[LineRemark]()
    whole = [predefined(), *modules]
    for node in (node for module in whole for node in module.declarations):
        if node.data == "alias":
            types.aliases[node.children[2].lower()] = node.children[1].lower()
        elif node.data == "record":
            parts = [part.children for part in node.children[2:]]
            types.records[node.children[1].lower()] = [
                (str(kind).lower(), str(name).lower()) for kind, name in parts
            ]
    for module in whole:
        scope = Scope(module.file, shared)
        faults += module.faults
        for node in module.declarations:
            names = scope.own if str(node.children[0] or "").lower() == "local" else shared
            kind: Node = node.children[2] if node.data == "data" else None
            if node.data in ("routine", "function"):
                routine = _routine(scope, node)
                names[routine.name.lower()] = routine
            elif node.data == "data" and not types.known(kind):
                faults.append(
                    LineRemark(
                        scope.file,
                        kind.line,
                        message("rapid.unknown_type", "the type {kind} is not known", kind=kind),
                    )
                )
            elif node.data == "data":
                made = (make(scope, (node.children, item)) for item in node.children[3:])
                names |= {name.lower(): datum for name, datum in made}
    return types, scope, faults


def _routine(scope: Scope, node: Node) -> Routine:
    gives = str(node.children[1]).lower() if node.data == "function" else ""
    name = node.children[2 if gives else 1]
    parameters = tuple(one for part in nodes(node, "parameter") for one in _parameters(part))
    return Routine(str(name), scope, parameters, node.children[-1], gives)


def _parameters(node: Node) -> Iterable[RoutineParameter]:
    """Yield the parameters of a node, several where only one of them is given."""
    optional, mode, *rest = node.children
    words = [str(token) for token in rest if token is not None and token.type == "NAME"]
    stars = sum(token is not None and token.type == "STAR" for token in rest)
    for kind, name in zip(words[::2], words[1::2], strict=True):
        yield RoutineParameter(
            name.lower(), kind.lower(), stars, optional is not None, mode is not None
        )


_FOLDERS = (
    "PROGMOD",
    "SYSMOD",
)  # of a task, side by side, as a controller and RobotStudio keep modules
_MOST = 60  # files that are looked at


def neighbours(
    files: Sequence[Path], modules: Sequence[Module]
) -> tuple[list[Module], list[LineRemark]]:
    """Return modules of files near those of a program that declare names which it lacks, and a remark on each.

    Another program, which has a main of its own, and what cannot be read are no such neighbours.
    """
    known = {name for module in modules for name in _declared(module)}
    wanting = {word.lower() for module in modules for word in _words(module)} - known
    found, remarks = list[Module](), list[LineRemark]()
    for file in _near(files):
        for module in _read(file):
            names = {name for name in _declared(module) if name in wanting}
            if names and "main" not in _declared(module):
                found.append(module)
                wanting -= names
                what = message(
                    "rapid.read_too",
                    "{file} near it is read, too, for {names}",
                    file=file.name,
                    names=", ".join(sorted(names)),
                )
                remarks.append(LineRemark(modules[-1].file, 1, what, lost=False))
    return found, remarks


def _read(file: Path) -> list[Module]:
    try:
        return read_modules(file)
    except RapidError:
        return []


def _near(files: Sequence[Path]) -> Iterator[Path]:
    """Yield the modules' files in the folders of a program's files, and in those of the same task."""
    own = {file.resolve() for file in files}
    folders = dict.fromkeys(file.parent for file in own)
    for folder in [*folders]:
        if folder.name.upper() in _FOLDERS:
            others = (other for other in folder.parent.iterdir() if other.is_dir())
            folders |= dict.fromkeys(other for other in others if other.name.upper() in _FOLDERS)
    rows = [
        file
        for folder in folders
        for file in sorted(folder.iterdir())
        if file.suffix.lower() in SUFFIXES
    ]
    yield from [file for file in rows if file.resolve() not in own][:_MOST]


def _declared(module: Module) -> list[str]:
    """Return the names of a module's data and routines, in lower case."""
    found = list[str]()
    for node in module.declarations:
        if node.data == "data":
            found += [str(item.children[0]).lower() for item in node.children[3:]]
        elif node.data in ("routine", "function"):
            found.append(str(node.children[1 if node.data == "routine" else 2]).lower())
    return found


def _words(module: Module) -> Iterator[str]:
    """Yield all names in a module; without recursion, since expressions may be nested as deeply as they like."""
    left = [*module.declarations]
    while left:
        node = left.pop()
        if getattr(node, "type", "") == "NAME":
            yield str(node)
        left += getattr(node, "children", ())
