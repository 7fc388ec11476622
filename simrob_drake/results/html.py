"""Parts of pages of HTML, as notebooks and reports show them: tables, and the verdict on a run."""

from collections.abc import Sequence
from html import escape

from simrob_drake.base.remarks import Remark, Severity
from simrob_drake.results.verdict.words import capitalize

SEVERITY_COLOURS: dict[Severity, str] = {
    "success": "#0b7a6b",
    "note": "inherit",
    "warning": "#9a5b00",
    "failure": "#b2182b",
}
"""Colour of the text of each severity, on white. The contrast of each is at least 4.5 : 1, as WCAG asks for text."""


def html_table(rows: Sequence[Sequence[str]]) -> str:
    """Write rows of cells as an HTML table. The first row, which must exist, has the headings. Texts are escaped."""
    headings, *body = rows
    lines = [_table_row(headings, "th"), *(_table_row(cells, "td") for cells in body)]
    return f"<table>{''.join(lines)}</table>"


def html_of_remarks(sentence: str, remarks: Sequence[Remark], rows: Sequence[Sequence[str]]) -> str:
    """Write a verdict in HTML: a sentence, the further remarks with their remedies, and the table of criteria.

    The table is left out if there are no further remarks.

    Args:
        sentence: the sentence that sums the run up; it is left out if it is empty.
        remarks: remarks of the verdict, at least one. The first gives the severity, and so the colour, of the sentence;
            the others are warnings and notes.
        rows: rows of the table of criteria, with its headings first.
    """
    summary, *further = remarks
    lines = [_colour_text(capitalize(sentence), summary.severity)]
    for remark in further:
        # Colour alone would not show the severity to people who do not see colours.
        text = f"{remark.severity}: {remark.text}"
        if remark.remedy is not None:
            text += f". {capitalize(remark.remedy.text)}"
            settings = ", ".join(remark.remedy.settings)
            text += f" ({settings})" if settings else ""
        lines.append(_colour_text(text, remark.severity))
    page = f"<p>{'<br>'.join(line for line in lines if line)}</p>"
    # The table of a run without further remarks would only repeat that all is within bounds.
    return page + html_table(rows) if further else page


def _table_row(cells: Sequence[str], tag: str) -> str:
    """Write one row of an HTML table, with cells of a tag: ``th`` or ``td``."""
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def _colour_text(text: str, severity: Severity) -> str:
    """Write a text as HTML, escaped and in the colour of a severity. Returns an empty text unchanged."""
    if not text:
        return ""
    return f'<span style="color: {SEVERITY_COLOURS[severity]}">{escape(text)}</span>'
