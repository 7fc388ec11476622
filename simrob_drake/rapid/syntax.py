"""The text of RAPID modules as trees of syntax, by the grammar in `rapid.lark`; what no grammar takes, by its line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from simrob_drake.errors import SimrobError, shortened
from simrob_drake.extras import needed
from simrob_drake.files import NotRead, content_of, text_of

SUFFIXES = (".mod", ".modx", ".prg", ".sys", ".sysx")
"""Of modules; a `.pgf` lists those of a program."""
_LARGEST = 4_000_000  # bytes; offline programming writes one target after the other
_HERE = Path(__file__).parent
_MOST_FAULTS = 20  # of one module, before it is taken for something else

Node = Any
"""A tree or a token of lark, which has no types for what it holds."""


class RapidError(SimrobError):
    """A module that cannot be understood or done; the message names the file and the line."""

    def __init__(self, where: str, problem: str) -> None:
        """Say where and what."""
        super().__init__(f"{where}: {problem}")


@dataclass(frozen=True)
class Remark:
    """Something about a module that its user should know."""

    file: str  # its name
    line: int  # counted from 1
    text: str  # what it is
    lost: bool = True  # whether something was not understood, and so is not done

    def __str__(self) -> str:
        return f"{self.file}: line {self.line}: {self.text}"


@dataclass(frozen=True)
class Module:
    """A module as its file has it: its name, its declarations, and what of the file was not understood."""

    file: str
    name: str
    declarations: tuple[Node, ...]
    faults: tuple[Remark, ...] = ()


def read_modules(file: Path) -> list[Module]:
    """Return the modules of a file, or of all files that a `.pgf` lists.

    Raises:
        RapidError: a file that cannot be read, or is no module.
    """
    if file.suffix.lower() != ".pgf":
        return modules_of(_text(file), file.name)
    listed = re.findall(r"<Module>\s*([^<]+?)\s*</Module>", _text(file))
    if not listed:
        raise RapidError(file.name, "lists no <Module>")
    return [module for name in listed for module in read_modules(file.parent / Path(name).name)]


def modules_of(text: str, file: str) -> list[Module]:
    """Return the modules of a text; statements that are none are left out and named.

    Raises:
        RapidError: no module, or one of which too much is not understood.
    """
    with needed("RAPID", "rapid"):
        from lark.exceptions import UnexpectedInput

    faults: list[Remark] = []
    while True:
        try:
            found = _parser().parse(text).children
            break
        except UnexpectedInput as problem:
            faults.append(_fault(problem, text, file))
            begin, end = _statement_at(text, problem.pos_in_stream)
            if begin == end or len(faults) == _MOST_FAULTS:
                raise RapidError(f"{file}: line {faults[0].line}", faults[0].text) from None
            text = text[:begin] + re.sub(r"[^\n]", " ", text[begin:end]) + text[end:]
    if not found:
        line = faults[0].line if faults else 1
        raise RapidError(f"{file}: line {line}", "there is no MODULE ... ENDMODULE")
    return [
        Module(file, str(tree.children[0]), tuple(tree.children[2:]), tuple(faults) if tree is found[0] else ())
        for tree in found
    ]


def nodes(tree: Node, *kinds: str) -> Iterator[Node]:
    """Yield the nodes of some kinds in a tree, in order of the text."""
    yield from (node for node in tree.iter_subtrees_topdown() if node.data in kinds)


@cache
def _parser() -> Any:
    from lark import Lark

    return Lark(text_of(_HERE / "rapid.lark"), parser="lalr", propagate_positions=True)


@cache
def predefined() -> Module:
    """Return the module of what every program knows."""
    return modules_of(text_of(_HERE / "predefined.sys"), "predefined.sys")[0]


def _text(file: Path) -> str:
    try:
        content = content_of(file, _LARGEST)
    except NotRead as problem:
        raise RapidError(str(file), str(problem)) from problem
    try:
        return content.decode()
    except UnicodeDecodeError:  # what older controllers write
        return content.decode("latin-1")


def _fault(problem: Any, text: str, file: str) -> Remark:
    """Return what the parser stumbled over: the text from there to the end of its line."""
    place = problem.pos_in_stream if problem.pos_in_stream is not None and problem.line > 0 else len(text.rstrip())
    line = text.count("\n", 0, place) + 1
    here = text[place:].partition("\n")[0].strip()
    return Remark(file, line, f"'{shortened(here, 60)}' is not understood here" if here else "ends before it is whole")


def _statement_at(text: str, place: int | None) -> tuple[int, int]:
    """Return where the statement around a place begins and ends, within its line at most."""
    if place is None or place < 0:
        return 0, 0
    begin = max(text.rfind("\n", 0, place), text.rfind(";", 0, place)) + 1
    ends = [end for end in (text.find(";", place) + 1, text.find("\n", place)) if end > 0]
    return begin, min(ends, default=len(text))
