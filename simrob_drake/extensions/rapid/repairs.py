"""Find what is missing in a RAPID module that cannot be read: its first fault is reported, and the rest is still read.

RAPID is the language of ABB's robot programs. A module contains routines (PROC, FUNC, TRAP), and these contain blocks,
such as WHILE ... ENDWHILE. The parser (lark) stops at the first token that is not allowed. Its stack then holds what it
has read but not yet completed: tokens, such as WHILE, and trees of what is complete within them.
"""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from simrob_drake.base.errors import shorten
from simrob_drake.base.messages import message

Node = Any
"""A token or a tree of the parser's stack. The library lark has no types for their attributes."""

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
"""The words that end a block, from the innermost blocks to the outermost, with the words that begin it."""

_ROUTINES = ("PROC", "FUNC", "TRAP")
"""The words that begin a routine."""

_OUTSIDE_ROUTINES = {*_ROUTINES, "SCOPE", "RECORD", "ALIAS", "ENDMODULE", "MODULE", "$END"}
"""Types of the tokens that stand outside of routines; ``$END`` is the end of the file."""

_BLOCK_LINE = re.compile(r"[ \t]*(?:LOCAL[ \t]+)?(PROC|FUNC|TRAP|END[A-Z]+)\b", re.IGNORECASE)
"""Beginning of a line that begins or ends a block. Where no block can begin or end, the parser takes the word for a
name."""


class Repair(NamedTuple):
    """A fault of a text, with what repairs it.

    Attributes:
        line: line of the fault, counted from 1.
        problem: the fault in words.
        text: the whole text, repaired without a change of its line numbers; empty if it ends within its module.
    """

    line: int
    problem: str
    text: str


def find_missing_end(problem: Any, text: str) -> Repair | None:
    """Find what is missing before the token at which the parser stopped.

    This is the end of a block, or the semicolon of the line before.

    Args:
        problem: error of the parser.
        text: the whole text.

    Returns:
        the repair; None if something else is wrong.
    """
    from lark.exceptions import UnexpectedToken

    if not isinstance(problem, UnexpectedToken):
        return None
    stack = problem.interactive_parser.parser_state.value_stack
    end = _end_of_last(stack)
    if end is None:
        return None
    # A semicolon is tried first: where it is allowed, the parser has just read a statement.
    if "SEMICOLON" in problem.accepts:
        repair = _missing_semicolon(problem.token, stack, end, text)
        if repair is not None:
            return repair
    if problem.token.type in {*_BLOCKS, *_OUTSIDE_ROUTINES}:
        return _missing_block_end(problem, stack, end, text)
    return None


def _missing_semicolon(token: Node, stack: Sequence[Node], end: int, text: str) -> Repair | None:
    """Find the fault at a place where the parser expects a semicolon.

    The last statement has no semicolon, or it is no statement: a word that cannot stand there, such as PROC within a
    procedure, looks to the parser like a name.

    Args:
        token: token at which the parser stopped.
        stack: stack of the parser.
        end: index in the text at which the last readable part ends.
        text: the whole text.

    Returns:
        the repair; None if the fault is within a line, or the statement has its semicolon.
    """
    line_begin = text.rfind("\n", 0, end) + 1
    block_line = _BLOCK_LINE.match(text, line_begin)
    if block_line is not None:
        return _misplaced_word(block_line, stack, text)
    # A token in the same line is a fault within the statement, which a semicolon would not repair.
    line = text.count("\n", 0, end) + 1
    is_next_line = token.type == "$END" or token.line > line
    if not is_next_line or text[end - 1] == ";":
        return None
    statement = shorten(text[line_begin:end].strip(), 60)
    return Repair(
        line,
        message(
            "rapid.semicolon_missing", "a ';' is missing after '{statement}'", statement=statement
        ),
        f"{text[:end]};{text[end:]}",
    )


def _missing_block_end(problem: Any, stack: Sequence[Node], end: int, text: str) -> Repair | None:
    """Explain a token that ends a block or stands outside of routines, at a place where it is not allowed.

    Either no block of its kind is open: then the token is replaced by blanks. Or an inner block is still open: then the
    missing end of this block is inserted.

    Args:
        problem: error of the parser.
        stack: stack of the parser.
        end: index in the text at which the last readable part ends.
        text: the whole text.

    Returns:
        the repair. None if no end of a block is missing.
    """
    token = problem.token
    if token.type in _BLOCKS and not _tokens_of(stack, _BLOCKS[token.type]):
        return _needless_word(str(token), token.line, token.start_pos, text)
    missing_end = _expected_block_end(problem)
    if missing_end is None:
        return None
    found = (
        message("rapid.end_of_file", "the end of the file")
        if token.type == "$END"
        else message(
            "rapid.token_in_line", "'{token}' in line {line}", token=token, line=token.line
        )
    )
    # A module that is not ended is complete without its end: nothing after it can be read.
    repaired = "" if missing_end == "ENDMODULE" else f"{text[:end]} {missing_end} {text[end:]}"
    # The parser may have completed a part of the block, with the token that begins it.
    begin_tokens = _tokens_of(stack, _BLOCKS[missing_end])
    if not begin_tokens:
        line = text.count("\n", 0, end) + 1
        return Repair(
            line,
            message(
                "rapid.end_missing", "{end} is missing before {found}", end=missing_end, found=found
            ),
            repaired,
        )
    line = begin_tokens[-1].line  # of the innermost block
    return Repair(
        line,
        message(
            "rapid.block_without_end",
            "the {block} of line {line} has no {end} before {found}",
            block=_BLOCKS[missing_end],
            line=line,
            end=missing_end,
            found=found,
        ),
        repaired,
    )


def _expected_block_end(problem: Any) -> str | None:
    """Word by which the parser would end the innermost open block. Returns None if no word can end one.

    The word at which the parser stopped does not count, as it is not what is missing.
    """
    for block_end in _BLOCKS:  # the innermost blocks are first
        if block_end in problem.accepts and block_end != problem.token.type:
            return block_end
    return None


def _misplaced_word(block_line: re.Match[str], stack: Sequence[Node], text: str) -> Repair:
    """Explain a word that begins a routine within another routine, or ends a block that was not begun.

    In the first case the end of the outer routine is inserted, in the second case the word is replaced by blanks.

    Args:
        block_line: beginning of the word's line; its group 1 is the word.
        stack: stack of the parser.
        text: the whole text.
    """
    word = block_line.group(1)
    line = text.count("\n", 0, block_line.start(1)) + 1
    routines = _tokens_of(stack, *_ROUTINES)
    if word.upper() in _ROUTINES and routines:
        # RAPID has no routines within routines, so the outer one was not ended.
        outer = routines[-1]
        repaired = f"{text[: block_line.start()]} END{outer.type} {text[block_line.start() :]}"
        problem = message(
            "rapid.routine_without_end",
            "the {kind} of line {line} has no END{kind} before line {next}",
            kind=outer.type,
            line=outer.line,
            next=line,
        )
        return Repair(outer.line, problem, repaired)
    return _needless_word(word, line, block_line.start(1), text)


def _needless_word(word: str, line: int, begin: int, text: str) -> Repair:
    """Replace a word that ends no open block by blanks.

    Args:
        word: the word.
        line: its line, counted from 1.
        begin: index of its first letter in the text.
        text: the whole text.
    """
    # Blanks keep the places of all that follows, for later messages.
    repaired = text[:begin] + " " * len(word) + text[begin + len(word) :]
    return Repair(
        line,
        message("rapid.ends_nothing", "{word} ends nothing that was begun", word=word),
        repaired,
    )


def _tokens_of(stack: Sequence[Node], *types: str) -> list[Node]:
    """Tokens of some types on the parser's stack, the innermost last. Trees have no type."""
    return [node for node in stack if getattr(node, "type", "") in types]


def _end_of_last(stack: Sequence[Node]) -> int | None:
    """Index in the text at which the last token or tree on the parser's stack ends.

    Returns None if nothing on the stack has a place in the text.
    """
    for node in reversed(stack):
        end = _end_of(node)
        if end is not None:
            return end
    return None


def _end_of(node: Node) -> int | None:
    """Index in the text at which a token or a tree of the parser's stack ends.

    Returns None for an empty tree, which has no place in the text.
    """
    end: int | None = getattr(node, "end_pos", None)
    if end is None and hasattr(node, "meta"):
        end = getattr(node.meta, "end_pos", None)
    return end
