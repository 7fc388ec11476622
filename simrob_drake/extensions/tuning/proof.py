"""Prove a winner: run it, and what it is to beat, under doubts that no search has seen; and say what came of it."""

import re
from base64 import b64encode
from collections.abc import Collection, Iterator, Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from statistics import median
from string import Template
from typing import Any

from matplotlib.figure import Figure
from pydantic import Field

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.files import text_of
from simrob_drake.base.folders import written_at_once
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Integer, Strict
from simrob_drake.extensions.tuning.conclusion import START, THOUGHT, WON, conclusion, cost_columns
from simrob_drake.extensions.tuning.doubts import KINDS, MOVES, UNKNOWN, doubts, moves
from simrob_drake.extensions.tuning.journal import (
    COMPLETED,
    Row,
    TrialFolder,
    read_spec,
    write_rows,
)
from simrob_drake.extensions.tuning.rollout import UNITS, Case, measured
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.extensions.tuning.study import Parameters, Study, in_table, named
from simrob_drake.extensions.tuning.study_folder import STUDY, winner_of
from simrob_drake.results.colours import BAD, COLOURS, GOOD
from simrob_drake.results.html import html_table
from simrob_drake.results.plots.grid import style

PROVE, TABLE, PAGE = "prove.yaml", "prove.csv", "prove.html"
_ASKED = re.compile(r"(^|\.)(reference|gait|program|commands)(\.|$)")  # keys that say what is asked


class Proof(Strict):
    """What is to be proven."""

    station: str
    """A name or a file."""
    parameters: dict[str, Parameters]
    """What is compared: the figures of the winner, and those that it is to beat if there are any."""
    conditions: list[dict[str, Any]]
    """Changes of the station; each draw of a doubt comes with the next of them."""
    seeds: Integer = Field(default=10, ge=1, le=1000)
    """Draws of each doubt."""
    study: Study | None = None
    """What tells what a run costs."""

    @classmethod
    def of(cls, place: str, seeds: int) -> "Proof":
        """Return what is to be proven of a finished study's folder, or a station; raises InvalidConfig: no winner."""
        folder = Path(place)
        if not (folder / STUDY).is_file():
            return cls(station=place, parameters={WON: {}}, conditions=[{}], seeds=seeds)
        study = read_spec(folder, STUDY, Study).located(folder / STUDY)
        if study.proof is None:
            expected = message(
                "tuning.cases_of_proof",
                "is not there; a winner is proven under cases that its search has not seen: other moves, loads, floors",
            )
            raise InvalidConfig(folder / STUDY, "proof", expected)
        conditions = [{**study.overrides, **case} for case in study.proof.every.values()]
        compared = {START: study.start, WON: winner_of(folder, study)}
        return cls(
            station=study.station,
            parameters=compared,
            conditions=conditions,
            seeds=seeds,
            study=study,
        )

    def cases(self) -> list[Case]:
        """Return all runs, numbered from 1: the same draws for all that is compared."""
        margin = self.study.margin if self.study else None
        return [
            Case(
                number,
                self.station,
                overrides,
                {"of": of, "doubt": kind, "draw": draw},
                draw,
                margin=margin,
            )
            for number, (of, kind, draw, overrides) in enumerate(self._runs(), start=1)
        ]

    def _runs(self) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
        every = self.parameters.items()
        bases = {of: [{**under, **own} for under in self.conditions] for of, own in every}
        drawn = {
            of: [doubts(Scene.of(self.station, base), self.seeds) for base in some]
            for of, some in bases.items()
        }
        shared = [
            kind for kind in KINDS if all(kind in one for some in drawn.values() for one in some)
        ]
        for kind in (THOUGHT, *shared):
            for draw in range(max(len(drawn[WON][0][kind]), len(self.conditions))):
                place = draw % len(self.conditions)
                for of in self.parameters:
                    base, changes = bases[of][place], drawn[of][place][kind]
                    change = changes[draw % len(changes)]
                    kept = {key: value for key, value in base.items() if key not in change}
                    # what is doubted comes last, as it is to hold
                    yield (
                        of,
                        kind,
                        draw,
                        {**kept, **change},
                    )

    def undoubted(self, doubted: Collection[str]) -> list[str]:
        """Return what neither its doubts, of these kinds, nor its own conditions change."""
        own = " ".join(self.study.proof.keys if self.study and self.study.proof else ())
        return [kind for kind in (*KINDS, *UNKNOWN) if kind not in doubted and kind not in own]

    def moved(self, doubted: Collection[str]) -> bool:
        """Tell whether doubts or own conditions have other moves than the search's; a station without any has none."""
        own = self.study.proof.keys if self.study and self.study.proof else ()
        if MOVES in doubted or any(_ASKED.search(key) for key in own):
            return True
        return not moves(Scene.of(self.station, {**self.conditions[0], **self.parameters[WON]}))


class ProofFolder(TrialFolder[Case]):
    """A proof and its runs, in a folder."""

    def __init__(self, folder: Path | str, proof: Proof, *, force: bool = False) -> None:
        """Begin a proof in a new folder, or go on; raises SimrobError: no station, a changed one, other content."""
        self.proof, cases = proof, proof.cases()
        super().__init__(folder, PROVE, proof, cases, cases[0].scene().digest, force=force)

    def run(
        self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True
    ) -> tuple[bool, list[str]]:
        """Make runs as :meth:`made`, write table and page; return proven or not, and why."""
        rows = self.made(workers=workers, scheduler=scheduler, progress=progress)
        if self.proof.study is not None:
            for row in rows:
                costs, over = self.proof.study.judged(row)
                row |= {**named(costs), "over_limits": over}
        write_rows(self.folder / TABLE, rows)
        doubted = {row["doubt"] for row in rows}
        proven, words = conclusion(
            rows, self.proof.undoubted(doubted), moved=self.proof.moved(doubted)
        )
        title = f"{Path(self.proof.station).stem}: {len(rows)} runs"
        written_at_once(self.folder / PAGE, page(title, proven, words, rows, self.proof.parameters))
        return proven, words


_WIDTH, _HEIGHT, _COLUMNS, _DPI = 4.6, 2.8, 3, 100  # inches of a frame, and frames in a row
_ASIDE = 0.15  # of the two that are compared, so that their dots stand side by side


def page(
    title: str,
    proven: bool,
    words: Sequence[str],
    rows: Sequence[Row],
    of: Mapping[str, Parameters],
) -> str:
    """Return the page: the conclusion, its sentences, the shortest first, the runs, and what is compared."""
    first, *others = (escape(words[0]), *(f"<p>{escape(sentence)}</p>" for sentence in words[1:]))
    return Template(text_of(Path(__file__).with_suffix(".html"))).substitute(
        title=escape(title),
        colour=GOOD if proven else BAD,
        conclusion=f"<p><strong>{first}</strong></p>{''.join(others)}",
        doubts=html_table(_by_doubt(rows)),
        measures=html_table(_by_measure(rows)),
        plot=b64encode(_plot(rows)).decode(),
        compared=html_table(_of_parameters(of)),
    )


def _by_doubt(rows: Sequence[Row]) -> list[list[str]]:
    """Return for each doubt how many runs went to their ends and stayed within bounds, and their median costs."""
    names = ("to the end", "within bounds", *cost_columns(rows[0]))
    lines = [["doubt", *(f"{name}, {of}" for name in names for of in _compared(rows))]]
    for doubt in dict.fromkeys(row["doubt"] for row in rows):
        some = [
            [row for row in rows if (row["doubt"], row["of"]) == (doubt, of)]
            for of in _compared(rows)
        ]
        ends = [f"{sum(row['ended'] == COMPLETED for row in own)} of {len(own)}" for own in some]
        within = [f"{sum(not row.get('beyond') for row in own)} of {len(own)}" for own in some]
        lines.append(
            [
                doubt,
                *ends,
                *within,
                *(_median(own, name) for name in cost_columns(rows[0]) for own in some),
            ]
        )
    return lines


def _by_measure(rows: Sequence[Row]) -> list[list[str]]:
    """Return the medians of what was measured in all runs."""
    lines = [["median of all runs", *_compared(rows), "unit"]]
    for name in measured(rows):
        medians = [
            _median([row for row in rows if row["of"] == of], name) for of in _compared(rows)
        ]
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


def _plot(rows: Sequence[Row]) -> bytes:
    """Return a picture: a frame for each measure, the runs as dots over the doubts."""
    names, doubts = (
        [*cost_columns(rows[0]), *measured(rows)],
        list(dict.fromkeys(row["doubt"] for row in rows)),
    )
    lines = -(-len(names) // _COLUMNS)
    figure = Figure(figsize=(_WIDTH * _COLUMNS, _HEIGHT * max(lines, 1)), layout="constrained")
    blue, orange, *_ = COLOURS
    for place, name in enumerate(names, start=1):
        axes = figure.add_subplot(lines, _COLUMNS, place)
        unit = UNITS.get(name.rpartition(".")[2])
        style(axes, f"{name} [{unit}]" if unit else name)
        for of, colour, aside in ((START, orange, -_ASIDE), (WON, blue, _ASIDE)):
            own = [
                r
                for r in rows
                if r["of"] == of and r.get(name) is not None and r["ended"] == COMPLETED
            ]
            if own:
                at = [doubts.index(row["doubt"]) + aside for row in own]
                axes.plot(
                    at,
                    [row[name] for row in own],
                    "o",
                    color=colour,
                    alpha=0.5,
                    markersize=4,
                    label=of,
                )
        axes.set_xticks(range(len(doubts)), doubts, rotation=30, ha="right", fontsize=8)
        if place == 1:
            axes.legend(fontsize=8, frameon=False)
    content = BytesIO()
    figure.savefig(content, dpi=_DPI, format="png")
    return content.getvalue()
