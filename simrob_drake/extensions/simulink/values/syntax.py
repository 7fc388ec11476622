"""The syntax of MATLAB that is read: statements, sections and functions of code, and expressions.

These are numbers, text, matrices, names, calls, fields, operators.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from simrob_drake.base.messages import message

KEYWORD = re.compile(
    r"(if|elseif|else|end|for|while|switch|case|otherwise|try|catch|function|return|break)\b"
)
_SIGNATURE = re.compile(
    r"function(?:\s+|(?=\[))(?:(?:\[([^\]]*)\]|(\w+))\s*=\s*)?(\w+)\s*(?:\(([^)]*)\))?\s*"
)
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
    code = (
        re.sub(r"(?m)^([ \t]*function\b[^\n(]*\([^)]*\))", r"\1\n", code)
        if "function" in code
        else ""
    )
    return dict(_functions_in(statements(code)))


def _functions_in(lines: list[Statement]) -> Iterator[tuple[str, ScriptFunction]]:
    for line in lines:
        for head, body in line.parts if isinstance(line, Section) else ():
            if signature := _SIGNATURE.match(head):
                several, one, name, inputs = signature.groups()
                yield (
                    name,
                    ScriptFunction(
                        name, names_in(inputs or ""), names_in(several or one or ""), body
                    ),
                )
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
    code = re.sub(
        r"^[ \t]*%\{[ \t]*\n.*?^[ \t]*%\}[ \t]*$", "", code, flags=re.DOTALL | re.MULTILINE
    )
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
    # as some write on one line
    parted = (re.sub(r"^(else|try|otherwise) ", r"\1\n", one) for one in found)
    return _nested([part.strip() for one in parted for part in one.split("\n") if part.strip()])


DEEPEST = 60  # brackets in brackets
LONGEST = 200_000  # letters of one expression


class NotUnderstood(ValueError):
    """An expression outside the subset, or none at all."""


class Expression(NamedTuple):
    """An expression, or a part of one."""

    # what it is, and what of: ``number``, ``imaginary``, ``text`` and ``string``, a text that stays one among others
    # (value), ``name`` (name), ``call`` (target, arguments) for an index or a function, ``field`` (target, name),
    # ``unary`` (operator, operand) with ``'`` behind it, ``binary`` (operator, left, right), ``range`` (start, step or
    # None, stop), ``matrix`` and ``cell`` (rows), ``colon`` for a lone one, all of a dimension, and ``end`` in an index
    kind: str
    parts: tuple[Any, ...] = ()


_TOKEN = re.compile(
    r"(?P<number>(?:\d+(?:\.(?![*/\\^'])\d*)?|\.\d+)(?:[eEdD][-+]?\d+)?(?:[ij]\b)?)"
    r"|(?P<name>[A-Za-z]\w*)"
    r"|(?P<operator>\.\^|\.\*|\./|\.'|==|~=|<=|>=|&&|\|\||[-+*/\\^<>=&|~!:;,.()\[\]{}'])"
)
_QUOTED = re.compile(r"'((?:[^'\n]|'')*)'|\"((?:[^\"\n]|\"\")*)\"")
_SPACE = re.compile(r"(?:[ \t\r]|\.\.\.[^\n]*(?:\n|$))+")
_LEVELS = ("||",), ("&&",), ("|",), ("&",), ("==", "~=", "<", ">", "<=", ">="), (":",), ("+", "-"), (
    "*", "/", "\\", ".*", "./"), ("unary",), ("^", ".^")  # fmt: skip
_BINDS = {
    operator: level for level, operators in enumerate(_LEVELS, start=1) for operator in operators
}
"""How tightly operators bind."""
_SIGNS = "-", "+", "~", "!"


class _Token(NamedTuple):
    """A piece of an expression: its kind is ``number``, ``text``, ``string``, ``name`` or ``operator``."""

    kind: str
    text: str


def _tokens_of(text: str) -> list[_Token]:
    """Return the pieces of an expression; between elements of a matrix that blanks part there is a comma."""
    if len(text) > LONGEST:
        raise NotUnderstood(
            message(
                "simulink.expression_too_long", "is longer than {longest} letters", longest=LONGEST
            )
        )
    tokens, brackets, place, spaced = list[_Token](), "", 0, False
    while place < len(text):
        if text[place] == "\n":
            tokens.append(_Token("operator", ";"))
        space = _SPACE.match(text, place)
        if space or text[place] == "\n":
            place, spaced = space.end() if space else place + 1, True
            continue
        after_value = bool(tokens) and (
            tokens[-1].kind != "operator" or tokens[-1].text in (*")]}'", ".'")
        )
        opens = text[place] == '"' or (text[place] == "'" and (spaced or not after_value))
        if (match := _QUOTED.match(text, place)) and opens:
            text_of, string = match.groups()
            token = _Token("text", text_of.replace("''", "'")) if string is None else _Token(
                "string", string.replace('""', '"'))  # fmt: skip
        elif match := _TOKEN.match(text, place):
            token = _Token(str(match.lastgroup), match[0])
        else:
            raise NotUnderstood(
                message(
                    "simulink.stray_text",
                    "has '{text}', which stands in no expression",
                    text=text[place],
                )
            )
        place = match.end()
        begins = token.kind != "operator" or token.text in ("(", "[", "{", "~", "!") or (
            token.text in ("+", "-") and not _SPACE.match(text, place))  # fmt: skip
        if brackets[-1:] in ("[", "{") and spaced and after_value and begins:
            tokens.append(_Token("operator", ","))
        if token in _BRACKETS:
            brackets = brackets + token.text if token.text in "([{" else brackets[:-1]
        tokens.append(token)
        spaced = False
    return tokens


_BRACKETS = {_Token("operator", bracket) for bracket in "()[]{}"}
_END = _Token("end", "")


def parse(text: str) -> Expression:
    """Return the tree of an expression (raises NotUnderstood: it is outside the subset)."""
    parser = _Parser([*_tokens_of(text.strip()), _END])
    node = parser.expression()
    if parser.here is not _END:
        raise NotUnderstood(
            message(
                "simulink.should_end", "has '{text}' where it should end", text=parser.here.text
            )
        )
    return node


class _Parser:
    def __init__(self, tokens: list[_Token]) -> None:
        self._tokens, self._place, self._depth = tokens, 0, 0

    @property
    def here(self) -> _Token:
        return self._tokens[self._place]

    def _next(self) -> _Token:
        self._place += 1
        return self._tokens[self._place - 1]

    def _stands(self, *operators: str) -> bool:
        return self.here.kind == "operator" and self.here.text in operators

    def expression(self, above: int = 0) -> Expression:
        """Return the expression that begins here, with operators that bind tighter than ``above``."""
        left = self._operand()
        while (
            self._stands(*_BINDS) and _BINDS[self.here.text] > above and not self._is_lone_colon()
        ):
            operator = self._next().text
            right = self.expression(_BINDS[operator])
            if operator != ":":
                left = Expression("binary", (operator, left, right))
            elif left.kind == "range" and left.parts[1] is None:
                left = Expression("range", (left.parts[0], left.parts[2], right))
            else:
                left = Expression("range", (left, None, right))
        return left

    def _is_lone_colon(self) -> bool:
        return self._stands(":") and self._tokens[self._place + 1].text in (",", ")", "}", "")

    def _operand(self) -> Expression:
        """Return a value with its signs before it, and its indices, fields and ``'`` behind it."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise NotUnderstood(
                message(
                    "simulink.brackets_too_deep",
                    "nests brackets more than {deepest} deep",
                    deepest=DEEPEST,
                )
            )
        if self._stands(*_SIGNS):
            sign = self._next().text.replace("!", "~")
            node = Expression("unary", (sign, self.expression(_BINDS["unary"])))
        else:
            node = self._atom()
            while self._stands("(", "'", ".'", ".") or (
                self._stands("{") and node.kind in ("name", "call", "field")
            ):
                if self.here.text in ("(", "{"):
                    node = Expression("call", (node, self._arguments()))
                elif self._next().text != ".":
                    node = Expression("unary", ("'", node))
                elif self.here.kind != "name":
                    raise NotUnderstood(message("simulink.lacks_a_name", "lacks a name"))
                else:
                    node = Expression("field", (node, self._next().text))
        self._depth -= 1
        return node

    def _atom(self) -> Expression:
        token = self._next()
        if token is _END:
            raise NotUnderstood(
                message("simulink.ends_without_value", "ends where a value should stand")
            )
        if token.kind == "number":
            kind = "imaginary" if token.text[-1] in "ij" else "number"
            return Expression(kind, (float(token.text.rstrip("ij").lower().replace("d", "e")),))
        if token.kind == "name" and token.text == "end":
            return Expression("end")
        if token.kind != "operator":
            return Expression(token.kind, (token.text,))
        if token.text == "(":
            node = self.expression()
            self._close(")")
            return node
        if token.text in ("[", "{"):
            kind, closing = ("matrix", "]") if token.text == "[" else ("cell", "}")
            return Expression(kind, (self._rows(closing),))
        raise NotUnderstood(
            message(
                "simulink.token_without_value",
                "has '{token}' where a value should stand",
                token=token.text,
            )
        )

    def _arguments(self) -> tuple[Expression, ...]:
        rows = self._rows(")" if self._next().text == "(" else "}")
        if len(rows) > 1:
            raise NotUnderstood(
                message("simulink.semicolon_in_arguments", "has a ';' among arguments")
            )
        return rows[0] if rows else ()

    def _rows(self, closing: str) -> tuple[tuple[Expression, ...], ...]:
        rows: list[list[Expression]] = [[]]
        while not self._stands(closing):
            if self._is_lone_colon():
                self._next()
                rows[-1].append(Expression("colon"))
            elif self._stands(";", ","):
                rows += [[]] if self._next().text == ";" else []
            else:
                rows[-1].append(self.expression())
                if not self._stands(",", ";", closing):
                    raise NotUnderstood(
                        message("simulink.lacks_a_bracket", "lacks a closing bracket")
                    )
        self._close(closing)
        return tuple(tuple(row) for row in rows if row)

    def _close(self, bracket: str) -> None:
        if not self._stands(bracket):
            raise NotUnderstood(
                message(
                    "simulink.lacks_this_bracket", "lacks a closing '{bracket}'", bracket=bracket
                )
            )
        self._next()


def written(node: Expression) -> str:
    """Return a name or field as it is written."""
    if node.kind == "field":
        return f"{written(node.parts[0])}.{node.parts[1]}"
    return str(node.parts[0]) if node.kind == "name" else "(…)"
