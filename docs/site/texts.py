"""Docstrings of the package as Markdown: formulas become MathML, which needs no script, and roles become links."""

import re
from inspect import cleandoc
from typing import NamedTuple

from latex2mathml.converter import convert

_BLOCK = re.compile(r"^( *)\.\. math::[ \t]*([^\n]*(?:\n(?:\1 {2,}[^\n]*|[ \t]*(?=\n\1 {2,})))*)", re.MULTILINE)
_INLINE = re.compile(r":math:`([^`]+)`")
_ROLE = re.compile(r":(?:class|func|meth|mod|attr|data|exc):`~?\.?([\w.]+)`")


class Page(NamedTuple):
    """A page that is made: its path below ``docs/``, and its text."""

    path: str
    text: str


def formula(latex: str, display: str = "inline") -> str:
    """Return a formula in LaTeX as MathML in one line; an inline one stands in a span, else it would break its line."""
    maths = convert(" ".join(latex.split()), display=display)
    return f'<div class="formula">{maths}</div>' if display == "block" else f"<span>{maths}</span>"


def _role(match: re.Match[str]) -> str:
    shown = f"<code>{match[1].rpartition('.')[2]}</code>"
    return f'<autoref identifier="{match[1]}" optional>{shown}</autoref>' if "simrob_drake." in match[1] else shown


def markdown(docstring: str) -> str:
    """Return a docstring, which has roles and formulas of reStructuredText, as Markdown."""
    parts = cleandoc(docstring).replace("``", "`").split("`")
    text = "`".join(part if index % 2 else part.replace("<", "&lt;") for index, part in enumerate(parts))
    text = _BLOCK.sub(lambda match: f"\n{match[1]}{formula(match[2], 'block')}\n", text)
    return _ROLE.sub(_role, _INLINE.sub(lambda match: formula(match[1]), text))


def cell(text: str) -> str:
    """Return Markdown as a cell of a table."""
    return " ".join(markdown(text).split()).replace("|", "\\|")


def sentence(docstring: str) -> str:
    """Return the first paragraph of a docstring as a cell of a table."""
    return cell(cleandoc(docstring).partition("\n\n")[0])


def table(columns: list[str], rows: list[list[str]]) -> str:
    """Return a table of cells that are Markdown already."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
