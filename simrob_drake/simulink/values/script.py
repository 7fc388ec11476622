"""MATLAB code in pieces: its statements, sections of these, the functions of a script."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

KEYWORD = re.compile(r"(if|elseif|else|end|for|while|switch|case|otherwise|try|catch|function|return|break)\b")
_SIGNATURE = re.compile(r"function(?:\s+|(?=\[))(?:(?:\[([^\]]*)\]|(\w+))\s*=\s*)?(\w+)\s*(?:\(([^)]*)\))?\s*")
_OPENS = "if", "for", "while", "switch", "try", "function"
_PARTS = "elseif", "else", "case", "otherwise", "catch"
_PIECE = re.compile(r"""\"[^"\n]*"?|(?<![\w)\]}'.])'[^'\n]*'?|%[^\n]*|.""", re.DOTALL)
"""A text, a comment, or a letter of code."""
_EQUALS = re.compile(r"(?<![=~<>!])=(?!=)")


class Section(NamedTuple):
    """Statements from a keyword to its ``end``, in the parts that further keywords make of them."""

    keyword: str
    parts: list[tuple[str, list[Statement]]]  # the line of each part's keyword, and what follows


Statement = str | Section


class ScriptFunction(NamedTuple):
    """A function of a script: its name, its inputs and outputs by name, and its statements."""

    name: str
    inputs: list[str]
    outputs: list[str]
    body: list[Statement]


def functions_of(code: str) -> dict[str, ScriptFunction]:
    """Return the functions of a script by name, the first of them first; none of a script without."""
    code = re.sub(r"(?m)^([ \t]*function\b[^\n(]*\([^)]*\))", r"\1\n", code) if "function" in code else ""
    return dict(_functions_in(statements(code)))


def _functions_in(lines: list[Statement]) -> Iterator[tuple[str, ScriptFunction]]:
    for line in lines:
        for head, body in line.parts if isinstance(line, Section) else ():
            if signature := _SIGNATURE.match(head):
                several, one, name, inputs = signature.groups()
                yield name, ScriptFunction(name, split(inputs or ""), names_in(several or one or ""), body)
            yield from _functions_in(body)


def lines_of(statement: Statement) -> Iterator[str]:
    """Return the lines of a statement, and of all that is in it."""
    if isinstance(statement, str):
        yield statement
        return
    for head, body in statement.parts:
        yield head
        for inner in body:
            yield from lines_of(inner)


def sides(text: str) -> tuple[str, str]:
    """Return what is left and right of the ``=`` of an assignment; nothing is left of a statement without."""
    for match in _EQUALS.finditer(text):
        before = text[: match.start()]
        if sum(map(before.count, "([{")) == sum(map(before.count, ")]}")):
            return before.strip(), text[match.end() :].strip()
    return "", text


def names_in(text: str) -> list[str]:
    """Return the names of a list."""
    return [name for name in re.split(r"[\s,]+", text) if name]


def split(text: str) -> list[str]:
    """Split at commas outside brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def _nested(lines: list[str]) -> list[Statement]:
    """Put the lines of sections together; functions end where the next begins where they have no end of their own."""
    words = [match[1] if (match := KEYWORD.match(line)) else "" for line in lines]
    ended = words.count("end") == sum(word in _OPENS for word in words)
    around = [Section("", [("", [])])]
    for line, word in zip(lines, words, strict=True):
        if word == "function" and not ended:
            del around[1:]
        if word in _OPENS:
            section = Section(word, [(line, [])])
            around[-1].parts[-1][1].append(section)
            around.append(section)
        elif word == "end":
            del around[max(1, len(around) - 1) :]
        elif word in _PARTS and len(around) > 1:
            around[-1].parts.append((line, []))
        else:
            around[-1].parts[-1][1].append(line)
    return around[0].parts[0][1]


def statements(code: str) -> list[Statement]:
    """Split code into statements: at line ends, ``;`` and ``,`` outside brackets and texts; comments go."""
    code = re.sub(r"\.\.\.[^\n]*(?:\n|$)", " ", code.replace("\r", ""))
    code = re.sub(r"^[ \t]*%\{[ \t]*\n.*?^[ \t]*%\}[ \t]*$", "", code, flags=re.DOTALL | re.MULTILINE)
    found, current, depth = list[str](), "", 0
    for piece in (match[0] for match in _PIECE.finditer(code + "\n") if match[0][0] != "%"):
        depth = max(0, depth + (piece in ("(", "[", "{")) - (piece in (")", "]", "}")))
        if piece == "\n" and depth:
            current += ";" if current.rstrip()[-1:] not in (";", ",", "[", "(", "{") else " "
        elif piece in ("\n", ";", ",") and not depth:
            found.append(current.strip())
            current = ""
        else:
            current += piece
    return _nested([part for statement in found for part in _without_else(statement) if part])


def _without_else(statement: str) -> list[str]:
    """Split ``else x = 1``, which some write on one line."""
    for keyword in ("else", "try", "otherwise"):
        if statement.startswith(keyword + " "):
            return [keyword, statement[len(keyword) :].strip()]
    return [statement]
