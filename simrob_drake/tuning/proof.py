"""Prove a winner: run it, and what it is to beat, under doubts that no search has seen; and say what came of it."""

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidConfig
from simrob_drake.folders import written_at_once
from simrob_drake.sections import Integer, Strict
from simrob_drake.tuning.conclusion import START, THOUGHT, WON, conclusion
from simrob_drake.tuning.doubts import KINDS, MOVES, UNKNOWN, doubts, moves
from simrob_drake.tuning.journal import Journal, columns_of, read_spec, run
from simrob_drake.tuning.proof_page import page
from simrob_drake.tuning.rollout import Case, Margin
from simrob_drake.tuning.scene import Scene
from simrob_drake.tuning.study import Parameters, Study, named
from simrob_drake.tuning.study_folder import STUDY, winner_of
from simrob_drake.tuning.table import write_rows
from simrob_drake.tuning.trial import Row, table

PROVE, TABLE, PAGE = "prove.yaml", "prove.csv", "prove.html"
_ASKED = re.compile(r"(^|\.)(reference|gait|program|commands)(\.|$)")
"""Keys that say what is asked."""


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
        """Return what is to be proven of the folder of a study that has ended, or of a station.

        Raises:
            InvalidConfig: a folder without a winner.
        """
        folder = Path(place)
        if not (folder / STUDY).is_file():
            return cls(station=place, parameters={WON: {}}, conditions=[{}], seeds=seeds)
        study = read_spec(folder, STUDY, Study).located(folder / STUDY)
        if study.proof is None:
            expected = (
                "is not there; a winner is proven under cases that its search has not seen: other moves, loads, floors"
            )
            raise InvalidConfig(folder / STUDY, "proof", expected)
        conditions = [{**study.overrides, **case} for case in study.proof.every.values()]
        compared = {START: study.start, WON: winner_of(folder, study)}
        return cls(station=study.station, parameters=compared, conditions=conditions, seeds=seeds, study=study)

    def cases(self) -> list[Case]:
        """Return all runs, numbered from 1: the same draws for all that is compared."""
        return [
            Case(number, self.station, overrides, {"of": of, "doubt": kind, "draw": draw}, draw, margin=self._margin)
            for number, (of, kind, draw, overrides) in enumerate(self._runs(), start=1)
        ]

    @property
    def _margin(self) -> Margin | None:
        return self.study.margin if self.study else None

    def _runs(self) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
        every = self.parameters.items()
        bases = {of: [{**under, **own} for under in self.conditions] for of, own in every}
        drawn = {of: [doubts(Scene.of(self.station, base), self.seeds) for base in some] for of, some in bases.items()}
        shared = [kind for kind in KINDS if all(kind in one for some in drawn.values() for one in some)]
        for kind in (THOUGHT, *shared):
            for draw in range(max(len(drawn[WON][0][kind]), len(self.conditions))):
                place = draw % len(self.conditions)
                for of in self.parameters:
                    base, changes = bases[of][place], drawn[of][place][kind]
                    change = changes[draw % len(changes)]
                    kept = {key: value for key, value in base.items() if key not in change}
                    yield of, kind, draw, {**kept, **change}  # what is doubted comes last, as it is to hold

    def undoubted(self, doubted: Collection[str]) -> list[str]:
        """Return what neither its doubts, of these kinds, nor its own conditions change."""
        own = " ".join(self.study.proof.keys if self.study and self.study.proof else ())
        return [kind for kind in (*KINDS, *UNKNOWN) if kind not in doubted and kind not in own]

    def moved(self, doubted: Collection[str]) -> bool:
        """Tell whether there are other moves than the search's, among its doubts or in its own conditions.

        A station that is asked for none has none.
        """
        own = self.study.proof.keys if self.study and self.study.proof else ()
        if MOVES in doubted or any(_ASKED.search(key) for key in own):
            return True
        return not moves(Scene.of(self.station, {**self.conditions[0], **self.parameters[WON]}))


class ProofFolder:
    """A proof and its runs, in a folder.

    Attributes:
        folder: where they stand.
        proof: what is proven.
        cases: all of its runs.
        journal: those that are made.
    """

    def __init__(self, folder: Path | str, proof: Proof, *, force: bool = False) -> None:
        """Begin a proof in a new folder, or go on with the same one.

        Raises:
            SimrobError: a station that cannot be, or has changed since; a folder that holds something else.
        """
        self.folder, self.proof, self.cases = as_path(folder, "folder"), proof, proof.cases()
        digest = self.cases[0].scene().digest
        self.journal = Journal(self.folder, PROVE, proof, digest, columns=columns_of(self.cases), force=force)

    def run(
        self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True
    ) -> tuple[bool, list[str]]:
        """Make the runs that are not made yet; write table and page; return whether it is proven, and why in words.

        Args and errors are those of :func:`simrob_drake.tuning.journal.run`.
        """
        rows = table(run(self.journal, self.cases, workers=workers, scheduler=scheduler, progress=progress))
        judged = [{**row, **self._judged(row)} for row in rows]
        write_rows(self.folder / TABLE, judged)
        doubted = {row["doubt"] for row in judged}
        proven, words = conclusion(judged, self.proof.undoubted(doubted), moved=self.proof.moved(doubted))
        title = f"{Path(self.proof.station).stem}: {len(judged)} runs"
        written_at_once(self.folder / PAGE, page(title, proven, words, judged, self.proof.parameters))
        return proven, words

    def _judged(self, row: Row) -> Mapping[str, Any]:
        study = self.proof.study
        if study is None:
            return {}
        costs, over = study.judged(row)
        return {**named(costs), "over_limits": over}
