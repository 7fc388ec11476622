"""The syntax of the MATLAB expressions that are read: numbers, text, matrices, names, calls, fields, operators."""

import re
from typing import Any, NamedTuple

DEEPEST = 60  # brackets in brackets
LONGEST = 200_000  # letters of one expression


class NotUnderstood(ValueError):
    """An expression outside the subset, or none at all."""


class Expression(NamedTuple):
    """An expression, or a part of one."""

    # what it is, and what of: ``number`` and ``text`` (value), ``name`` (name), ``call`` (target, arguments) for an
    # index or a function, ``field`` (target, name), ``unary`` (operator, operand) with ``'`` behind it, ``binary``
    # (operator, left, right), ``range`` (start, step or None, stop), ``matrix`` (rows), ``colon`` for a lone one, all
    # of a dimension, and ``end`` in an index
    kind: str
    parts: tuple[Any, ...] = ()


class Token(NamedTuple):
    """A piece of an expression, and whether white space stands before and behind it."""

    kind: str
    text: str
    spaced: bool
    then_space: bool


_TOKEN = re.compile(
    r"(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?)"
    r"|(?P<name>[A-Za-z]\w*)"
    r"|(?P<operator>\.\^|\.\*|\./|\.'|==|~=|<=|>=|&&|\|\||[-+*/\\^<>=&|~!:;,.()\[\]{}'])"
)
_QUOTED = re.compile(r"'((?:[^'\n]|'')*)'|\"((?:[^\"\n]|\"\")*)\"")
_SPACE = re.compile(r"(?:[ \t\r]|\.\.\.[^\n]*\n)+")
_LEVELS = (("||",), ("&&",), ("|",), ("&",), ("==", "~=", "<", ">", "<=", ">="), (":",), ("+", "-"))
_PRODUCTS = "*", "/", "\\", ".*", "./"


def tokens_of(text: str) -> list[Token]:
    """Return the pieces of an expression.

    Raises:
        NotUnderstood: a letter that no expression has.
    """
    if len(text) > LONGEST:
        raise NotUnderstood(f"is longer than {LONGEST} letters")
    tokens: list[Token] = []
    place, spaced = 0, False
    while place < len(text):
        space = _SPACE.match(text, place)
        if space or text[place] == "\n":
            place = space.end() if space else place + 1
            if not space:
                tokens.append(Token("operator", ";", spaced, True))
            if tokens:
                tokens[-1] = tokens[-1]._replace(then_space=True)
            spaced = True
            continue
        match = _QUOTED.match(text, place) if _quote_opens(tokens, text[place], spaced) else None
        if match:
            word = (match[1] or "").replace("''", "'") if match[1] is not None else match[2].replace('""', '"')
            tokens.append(Token("text", word, spaced, False))
        else:
            match = _TOKEN.match(text, place)
            if match is None:
                raise NotUnderstood(f"has '{text[place]}', which stands in no expression")
            tokens.append(Token(str(match.lastgroup), match[0], spaced, False))
        place, spaced = match.end(), False
    return tokens


def _quote_opens(tokens: list[Token], letter: str, spaced: bool) -> bool:
    """Tell a text's quote from the one that transposes."""
    if letter == '"':
        return True
    if letter != "'":
        return False
    if not tokens or spaced:
        return True
    last = tokens[-1]
    return not (last.kind in ("number", "name", "text") or last.text in (")", "]", "}", "'", ".'"))


def parse(text: str) -> Expression:
    """Return the tree of an expression.

    Raises:
        NotUnderstood: it is outside the subset.
    """
    parser = Parser(tokens_of(text.strip()))
    node = parser.expression()
    if parser.tokens[parser.place :]:
        raise NotUnderstood(f"has '{parser.tokens[parser.place].text}' where it should end")
    return node


class Parser:
    """Walks over tokens, tightest operators innermost."""

    def __init__(self, tokens: list[Token]) -> None:
        self.tokens, self.place = tokens, 0
        self._depth = 0
        self._in_matrix = False

    def expression(self, level: int = 0) -> Expression:
        """Return the expression that begins here."""
        if level == len(_LEVELS):
            return self._product()
        operators = _LEVELS[level]
        left = self.expression(level + 1)
        while (token := self._operator(operators)) is not None:
            right = self.expression(level + 1)
            if token != ":":
                left = Expression("binary", (token, left, right))
            elif left.kind == "range" and left.parts[1] is None:
                left = Expression("range", (left.parts[0], left.parts[2], right))
            else:
                left = Expression("range", (left, None, right))
        return left

    def _operator(self, operators: tuple[str, ...]) -> str | None:
        """Take one of these operators if it stands here; in a matrix ``a -b`` are two elements."""
        if self.place >= len(self.tokens):
            return None
        token = self.tokens[self.place]
        if token.kind != "operator" or token.text not in operators:
            return None
        if self._in_matrix and token.spaced and not token.then_space and token.text in ("+", "-"):
            return None
        if token.text == ":" and self._next_closes():
            return None
        self.place += 1
        return token.text

    def _next_closes(self) -> bool:
        following = self.tokens[self.place + 1 : self.place + 2]
        return not following or following[0].text in (",", ")")

    def _product(self) -> Expression:
        left = self._unary()
        while (token := self._operator(_PRODUCTS)) is not None:
            left = Expression("binary", (token, left, self._unary()))
        return left

    def _unary(self) -> Expression:
        for sign in ("-", "+", "~", "!"):
            if self._peek() == sign:
                self.place += 1
                self._deeper()
                node = Expression("unary", ("~" if sign == "!" else sign, self._unary()))
                self._depth -= 1
                return node
        return self._power()

    def _power(self) -> Expression:
        left = self._postfix()
        while self._peek() in ("^", ".^"):
            operator = self.tokens[self.place].text
            self.place += 1
            right = self._unary() if self._peek() in ("-", "+", "~") else self._postfix()
            left = Expression("binary", (operator, left, right))
        return left

    def _postfix(self) -> Expression:
        node = self._atom()
        while self.place < len(self.tokens):
            token = self.tokens[self.place]
            if self._in_matrix and token.spaced:
                break
            if token.text == "(" and token.kind == "operator":
                node = Expression("call", (node, self._arguments()))
            elif token.text in ("'", ".'") and token.kind == "operator":
                self.place += 1
                node = Expression("unary", ("'", node))
            elif token.text == "." and token.kind == "operator":
                self.place += 1
                node = Expression("field", (node, self._take("name")))
            else:
                break
        return node

    def _atom(self) -> Expression:
        if self.place >= len(self.tokens):
            raise NotUnderstood("ends where a value should stand")
        token = self.tokens[self.place]
        self.place += 1
        if token.kind == "number":
            return Expression("number", (float(token.text.lower().replace("d", "e")),))
        if token.kind == "text":
            return Expression("text", (token.text,))
        if token.kind == "name":
            return Expression("end") if token.text == "end" else Expression("name", (token.text,))
        if token.text == "(":
            self._deeper()
            outside, self._in_matrix = self._in_matrix, False
            node = self.expression()
            self._in_matrix = outside
            self._close(")")
            return node
        if token.text == "[":
            return self._matrix()
        raise NotUnderstood(f"has '{token.text}' where a value should stand")

    def _arguments(self) -> tuple[Expression, ...]:
        self._deeper()
        self.place += 1
        outside, self._in_matrix = self._in_matrix, False
        found: list[Expression] = []
        while self._peek() != ")":
            if self._peek() == ":" and self._next_closes():
                self.place += 1
                found.append(Expression("colon"))
            else:
                found.append(self.expression())
            if self._peek() == ",":
                self.place += 1
            elif self._peek() != ")":
                raise NotUnderstood("lacks a closing bracket")
        self._in_matrix = outside
        self._close(")")
        return tuple(found)

    def _matrix(self) -> Expression:
        self._deeper()
        outside, self._in_matrix = self._in_matrix, True
        rows: list[tuple[Expression, ...]] = []
        row: list[Expression] = []
        while self._peek() != "]":
            if self._peek() == ";":
                self.place += 1
                rows.append(tuple(row))
                row = []
            elif self._peek() == ",":
                self.place += 1
            else:
                row.append(self.expression())
        self._in_matrix = outside
        self._close("]")
        return Expression("matrix", (tuple(part for part in (*rows, tuple(row)) if part),))

    def _peek(self) -> str | None:
        """Return the operator that stands here, if one does."""
        if self.place >= len(self.tokens) or self.tokens[self.place].kind != "operator":
            return None if self.place < len(self.tokens) else ""
        return self.tokens[self.place].text

    def _take(self, kind: str) -> str:
        if self.place >= len(self.tokens) or self.tokens[self.place].kind != kind:
            raise NotUnderstood(f"lacks a {kind}")
        self.place += 1
        return self.tokens[self.place - 1].text

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > DEEPEST:
            raise NotUnderstood(f"nests brackets more than {DEEPEST} deep")

    def _close(self, bracket: str) -> None:
        if self._peek() != bracket:
            raise NotUnderstood(f"lacks a closing '{bracket}'")
        self.place += 1
        self._depth -= 1
