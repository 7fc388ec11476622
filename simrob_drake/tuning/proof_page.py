"""The page of a proof: conclusion, table and plots in one file of HTML that needs nothing else."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from io import BytesIO
from statistics import median
from string import Template

from matplotlib.figure import Figure

from simrob_drake.results.colours import BAD, COLOURS, GOOD
from simrob_drake.results.plots.grid import style
from simrob_drake.tuning.conclusion import START, WON, cost_columns
from simrob_drake.tuning.measures import UNITS, measured
from simrob_drake.tuning.study import Parameters, in_table
from simrob_drake.tuning.trial import COMPLETED, Row

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title><style>
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
td, th { padding: .2rem .8rem; border-bottom: 1px solid #ddd; text-align: right }
td:first-child, th:first-child { text-align: left }
.conclusion { border-left: .4rem solid $colour; padding: .2rem 1rem; background: #f6f6f6 }
img { max-width: 100% }
</style></head><body>
<h1>$title</h1>
<div class="conclusion">$conclusion</div>
<h2>Under which doubt</h2>$doubts
<h2>What was measured</h2>$measures<img alt="what was measured, by doubt" src="data:image/png;base64,$plot">
<h2>What is compared</h2>$compared
</body></html>
""")
_WIDTH, _HEIGHT, _COLUMNS, _DPI = 4.6, 2.8, 3, 100  # inches of a frame, and frames in a row
_ASIDE = 0.15  # of the two that are compared, so that their dots stand side by side


def page(title: str, proven: bool, words: Sequence[str], rows: Sequence[Row], of: Mapping[str, Parameters]) -> str:
    """Return the page.

    Args:
        title: what is proven.
        proven: the conclusion.
        words: the conclusion in sentences, the shortest first.
        rows: the runs, each with ``of`` and ``doubt``.
        of: the parameters of what is compared.
    """
    first, *others = (escape(words[0]), *(f"<p>{escape(sentence)}</p>" for sentence in words[1:]))
    return _PAGE.substitute(
        title=escape(title),
        colour=GOOD if proven else BAD,
        conclusion=f"<p><strong>{first}</strong></p>{''.join(others)}",
        doubts=_table(_by_doubt(rows)),
        measures=_table(_by_measure(rows)),
        plot=b64encode(_plot(rows)).decode(),
        compared=_table(_of_parameters(of)),
    )


def _by_doubt(rows: Sequence[Row]) -> list[list[str]]:
    """Return for each doubt how many runs went to their ends and stayed within bounds, and their median costs."""
    names = ("to the end", "within bounds", *cost_columns(rows[0]))
    lines = [["doubt", *(f"{name}, {of}" for name in names for of in _compared(rows))]]
    for doubt in dict.fromkeys(row["doubt"] for row in rows):
        some = [[row for row in rows if (row["doubt"], row["of"]) == (doubt, of)] for of in _compared(rows)]
        ends = [f"{sum(row['ended'] == COMPLETED for row in own)} of {len(own)}" for own in some]
        within = [f"{sum(not row.get('beyond') for row in own)} of {len(own)}" for own in some]
        lines.append([doubt, *ends, *within, *(_median(own, name) for name in cost_columns(rows[0]) for own in some)])
    return lines


def _by_measure(rows: Sequence[Row]) -> list[list[str]]:
    """Return the medians of what was measured in all runs."""
    lines = [["median of all runs", *_compared(rows), "unit"]]
    for name in measured(rows):
        medians = [_median([row for row in rows if row["of"] == of], name) for of in _compared(rows)]
        lines.append([name, *medians, UNITS[name.rpartition(".")[2]]])
    return lines


def _of_parameters(parameters: Mapping[str, Parameters]) -> list[list[str]]:
    keys = list(parameters[WON])
    lines = [[key, *(in_table(own.get(key)) for own in parameters.values())] for key in keys]
    return [["", *parameters], *lines] if lines else [["the station as it is"]]


def _compared(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row["of"] for row in rows))


def _median(rows: Sequence[Row], name: str) -> str:
    known = [row[name] for row in rows if row.get(name) is not None and row["ended"] == COMPLETED]
    return f"{median(known):.4g}" if known else "–"


def _table(lines: Sequence[Sequence[str]]) -> str:
    def line(cells: Sequence[str], kind: str) -> str:
        return f"<tr>{''.join(f'<{kind}>{escape(cell)}</{kind}>' for cell in cells)}</tr>"

    head, *body = lines
    return f"<table>{line(head, 'th')}{''.join(line(cells, 'td') for cells in body)}</table>"


def _plot(rows: Sequence[Row]) -> bytes:
    """Return a picture: a frame for each measure, the runs as dots over the doubts."""
    names, doubts = [*cost_columns(rows[0]), *measured(rows)], list(dict.fromkeys(row["doubt"] for row in rows))
    lines = -(-len(names) // _COLUMNS)
    figure = Figure(figsize=(_WIDTH * _COLUMNS, _HEIGHT * max(lines, 1)), layout="constrained")
    blue, orange, *_ = COLOURS
    for place, name in enumerate(names, start=1):
        axes = figure.add_subplot(lines, _COLUMNS, place)
        unit = UNITS.get(name.rpartition(".")[2])
        style(axes, f"{name} [{unit}]" if unit else name)
        for of, colour, aside in ((START, orange, -_ASIDE), (WON, blue, _ASIDE)):
            own = [r for r in rows if r["of"] == of and r.get(name) is not None and r["ended"] == COMPLETED]
            if own:
                at = [doubts.index(row["doubt"]) + aside for row in own]
                axes.plot(at, [row[name] for row in own], "o", color=colour, alpha=0.5, markersize=4, label=of)
        axes.set_xticks(range(len(doubts)), doubts, rotation=30, ha="right", fontsize=8)
        if place == 1:
            axes.legend(fontsize=8, frameon=False)
    content = BytesIO()
    figure.savefig(content, dpi=_DPI, format="png")
    return content.getvalue()
