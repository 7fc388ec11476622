"""MATLAB code in pieces: its statements, the branches of a section, the functions of a script."""

import re
from typing import NamedTuple

KEYWORD = re.compile(r"(if|elseif|else|end|for|while|switch|case|otherwise|try|catch|function|return|break)\b")
_SIGNATURE = re.compile(r"function(?:\s+|(?=\[))(?:(?:\[([^\]]*)\]|(\w+))\s*=\s*)?(\w+)\s*(?:\(([^)]*)\))?\s*")
OPENS = "if", "for", "while", "switch", "try", "function"


class ScriptFunction(NamedTuple):
    """A function of a script: its name, its inputs and outputs by name, and its statements."""

    name: str
    inputs: list[str]
    outputs: list[str]
    body: list[str]


def functions_of(code: str) -> dict[str, ScriptFunction]:
    """Return the functions of a script by name, the first of them first; none of a script without."""
    lines = statements(re.sub(r"(function[^\n(]*\([^)]*\))", r"\1\n", code)) if "function" in code else []
    words = [match[1] if (match := KEYWORD.match(line)) else "" for line in lines]
    ended = words.count("end") == sum(word in OPENS for word in words)  # whether functions have an end of their own
    found: dict[str, ScriptFunction] = {}
    around: list[tuple[ScriptFunction, int]] = []  # those that a line is in, and the sections that each has open
    for line, word in zip(lines, words, strict=True):
        if word == "function" and (signature := _SIGNATURE.match(line)):
            several, one, name, inputs = signature.groups()
            function = ScriptFunction(name, split(inputs or ""), names_in(several or one or ""), [])
            found[name] = function
            around = [*(around if ended else ()), (function, 0)]
        elif around:
            function, depth = around.pop()
            depth += (word in OPENS) - (word == "end")
            if depth >= 0:
                function.body.append(line)
                around.append((function, depth))
    return found


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


def branches(lines: list[str], keywords: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Split a section at its own keywords, not at those of sections within."""
    ways: list[tuple[str, list[str]]] = []
    place = 0
    while place < len(lines):
        match = KEYWORD.match(lines[place])
        if match and match[1] in keywords and (not ways or match[1] != keywords[0]):
            ways.append((lines[place], []))
            place += 1
            continue
        stop = closing(lines, place) if match and match[1] in OPENS else place + 1
        ways[-1][1].extend(lines[place:stop])
        place = stop
    return ways


def closing(lines: list[str], start: int) -> int:
    """Return the place behind the ``end`` of the section that begins at a line."""
    depth = 0
    for place in range(start, len(lines)):
        match = KEYWORD.match(lines[place])
        if match and match[1] in OPENS:
            depth += 1
        elif match and match[1] == "end":
            depth -= 1
            if depth == 0:
                return place + 1
    return len(lines)


def statements(code: str) -> list[str]:
    """Split code into statements: at line ends, ``;`` and ``,`` outside brackets and texts; comments go."""
    code = re.sub(r"\.\.\.[^\n]*(?:\n|$)", " ", code.replace("\r", ""))
    code = re.sub(r"^[ \t]*%\{[ \t]*\n.*?^[ \t]*%\}[ \t]*$", "", code, flags=re.DOTALL | re.MULTILINE)
    found: list[str] = []
    current, depth, quote = "", 0, ""
    last = ""
    comment = False
    for letter in code + "\n":
        if comment and letter != "\n":
            continue
        comment = False
        if quote:
            quote = "" if letter in (quote, "\n") else quote
        elif letter == '"' or (letter == "'" and not (last.isalnum() or last in ")]}'._")):
            quote = letter
        elif letter == "%":
            comment = True
            continue
        elif letter in "([{":
            depth += 1
        elif letter in ")]}":
            depth = max(0, depth - 1)
        if letter == "\n" and depth and not quote:
            current += ";" if current.rstrip()[-1:] not in (";", ",", "[", "(", "{") else " "
        elif (letter == "\n" or letter in ";,") and not quote and not depth:
            found.append(current.strip())
            current = ""
        else:
            current += letter
        last = letter
    return [part for statement in found for part in _without_else(statement) if part]


def _without_else(statement: str) -> list[str]:
    """Split ``else x = 1``, which some write on one line."""
    for keyword in ("else", "try", "otherwise"):
        if statement.startswith(keyword + " "):
            return [keyword, statement[len(keyword) :].strip()]
    return [statement]
