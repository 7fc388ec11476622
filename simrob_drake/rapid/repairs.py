"""What is missing in a RAPID module that cannot be read: its first fault is named, and the rest is still read."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from simrob_drake.errors import shortened

Node = Any  # a tree or a token of lark, which has no types for what it holds

_BLOCKS = {
    "ENDWHILE": "WHILE",
    "ENDFOR": "FOR",
    "ENDIF": "IF",
    "ENDTEST": "TEST",
    "ENDRECORD": "RECORD",
    "ENDPROC": "PROC",
    "ENDFUNC": "FUNC",
    "ENDTRAP": "TRAP",
    "ENDMODULE": "MODULE",
}
"""The words that end a block, from the innermost kinds to the outermost, with those that begin it."""

_OUTSIDE_ROUTINES = {"PROC", "FUNC", "TRAP", "SCOPE", "RECORD", "ALIAS", "ENDMODULE", "MODULE", "$END"}
"""Tokens that stand outside of routines."""


class Repair(NamedTuple):
    """A fault of a text, with what repairs it.

    Attributes:
        line: of the fault, counted from 1.
        problem: the fault in words.
        text: the whole text, repaired on the same lines; empty if it ends within its module.
    """

    line: int
    problem: str
    text: str


def find_missing_end(problem: Any, text: str) -> Repair | None:
    """Find what is missing before a token: the end of a block, or the semicolon of the line before.

    Returns None if something else is wrong.
    """
    from lark.exceptions import UnexpectedToken

    if not isinstance(problem, UnexpectedToken):
        return None
    stack = problem.interactive_parser.parser_state.value_stack
    place = next((end for node in reversed(stack) if (end := _end_of(node)) is not None), None)
    if place is None:
        return None
    if "SEMICOLON" in problem.accepts:
        repair = _missing_semicolon(problem.token, stack, place, text)
        if repair is not None:
            return repair
    if problem.token.type in {*_BLOCKS, *_OUTSIDE_ROUTINES}:
        return _missing_block_end(problem, stack, place, text)
    return None


def _missing_semicolon(token: Node, stack: Sequence[Node], place: int, text: str) -> Repair | None:
    """Find the statement before a token that has no semicolon, where one could stand.

    A word that cannot stand there, such as PROC within a procedure, looks like such a statement as well.
    """
    begin = text.rfind("\n", 0, place) + 1
    word = _MISPLACED.match(text, begin)
    if word is not None:
        return _misplaced(word, stack, text)
    line = text.count("\n", 0, place) + 1
    is_next_line = token.type == "$END" or token.line > line
    if not is_next_line or text[place - 1] == ";":
        return None
    statement = shortened(text[begin:place].strip(), 60)
    return Repair(line, f"a ';' is missing after '{statement}'", f"{text[:place]};{text[place:]}")


def _missing_block_end(problem: Any, stack: Sequence[Node], place: int, text: str) -> Repair | None:
    """Explain a token that ends a block or stands outside of routines, at a place where it is not allowed.

    Either no block of its kind is open: then the token is replaced by blanks. Or an inner block is still open: then the
    missing end of this block is inserted at ``place``.

    Args:
        problem: the parser's error.
        stack: what the parser has read and not yet completed.
        place: where the last readable part of the text ends.
        text: the whole text.

    Returns:
        the repair. None if no end of a block is missing.
    """
    token = problem.token
    kinds = {getattr(node, "type", "") for node in stack}
    if token.type in _BLOCKS and _BLOCKS[token.type] not in kinds:
        without = text[: token.start_pos] + " " * len(token) + text[token.end_pos :]
        return Repair(token.line, f"{token} ends nothing that was begun", without)
    # The ends are in the order of blocks from the innermost kinds outward. The token itself is not what is missing.
    end = next((end for end in _BLOCKS if end in problem.accepts and end != token.type), None)
    if end is None:
        return None
    begun = [node.line for node in stack if getattr(node, "type", "") == _BLOCKS[end]]
    line = begun[-1] if begun else text.count("\n", 0, place) + 1
    found = "the end of the file" if token.type == "$END" else f"'{token}' in line {token.line}"
    repaired = "" if end == "ENDMODULE" else f"{text[:place]} {end} {text[place:]}"
    return Repair(line, f"the {_BLOCKS[end]} of line {line} has no {end} before {found}", repaired)


_MISPLACED = re.compile(r"[ \t]*(?:LOCAL[ \t]+)?(PROC|FUNC|TRAP|END[A-Z]+)\b", re.IGNORECASE)
"""A line that begins or ends a block. Where no block can begin or end, the parser takes the word for a name."""


def _misplaced(word: re.Match[str], stack: Sequence[Node], text: str) -> Repair:
    """Explain a word that begins a routine within another one, or ends a block that was not begun.

    What is missing is put in, or the word is left out.
    """
    line = text.count("\n", 0, word.start(1)) + 1
    name = word.group(1).upper()
    around = [node for node in stack if getattr(node, "type", "") in ("PROC", "FUNC", "TRAP")]
    if name in ("PROC", "FUNC", "TRAP") and around:
        kind = around[-1].type
        begun = around[-1].line
        repaired = f"{text[: word.start()]} END{kind} {text[word.start() :]}"
        return Repair(begun, f"the {kind} of line {begun} has no END{kind} before line {line}", repaired)
    blank = " " * len(word.group(1))
    without = text[: word.start(1)] + blank + text[word.end(1) :]
    return Repair(line, f"{word.group(1)} ends nothing that was begun", without)


def _end_of(node: Node) -> int | None:
    """Place in the text where a token or a tree of the parser's stack ends. Returns None if it has no place."""
    place: int | None = getattr(node, "end_pos", None)
    if place is None and hasattr(node, "meta"):
        place = getattr(node.meta, "end_pos", None)
    return place
