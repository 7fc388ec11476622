"""Parts of pages of HTML, as notebooks and reports show them: tables, and the verdict on a run."""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from simrob_drake.base.remarks import Severity
from simrob_drake.results.verdict.words import capitalised

if TYPE_CHECKING:  # this import would be circular: a verdict shows itself in a notebook
    from simrob_drake.results.verdict.verdict import Verdict

SEVERITY_COLOURS: dict[Severity, str] = {
    "success": "#0b7a6b",
    "note": "inherit",
    "warning": "#9a5b00",
    "failure": "#b2182b",
}
"""Colour of the text of each severity, on white. The contrast of each is at least 4.5 : 1, as WCAG asks for text."""


def html_table(rows: Sequence[Sequence[str]]) -> str:
    """Write rows of cells as a table. The first row has the headings."""
    headings, *body = rows
    lines = [_table_row(headings, "th"), *(_table_row(cells, "td") for cells in body)]
    return f"<table>{''.join(lines)}</table>"


def html_of_verdict(verdict: "Verdict", *, with_end: bool = True) -> str:
    """Write a verdict: its sentence, the warnings with their remedies, and the table of criteria if one is violated.

    Args:
        verdict: the verdict.
        with_end: whether the sentence says how the run ended.
    """
    summary, *further = verdict.remarks
    sentence = verdict.sentence if with_end else verdict.judgement
    lines = [_coloured(capitalised(sentence), summary.severity)]
    for remark in further:
        text = f"{remark.severity}: {remark.text}"
        if remark.remedy is not None:
            text += f". {capitalised(remark.remedy.text)}"
            text += f" ({remark.remedy.setting})" if remark.remedy.setting else ""
        lines.append(_coloured(text, remark.severity))
    page = f"<p>{'<br>'.join(line for line in lines if line)}</p>"
    if not further:
        return page
    return page + html_table([verdict.headings, *verdict.cells])


def _table_row(cells: Sequence[str], tag: str) -> str:
    """Write one row of a table, with cells of a tag: ``th`` or ``td``."""
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def _coloured(text: str, severity: Severity) -> str:
    """Write a text in the colour of a severity. Returns an empty text unchanged."""
    if not text:
        return ""
    return f'<span style="color: {SEVERITY_COLOURS[severity]}">{escape(text)}</span>'
