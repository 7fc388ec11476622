"""One run of many: a station with some keys changed, and the row of a table that becomes of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from pydantic import Field, model_validator

from simrob_drake.errors import SimrobError
from simrob_drake.quantities import Positive
from simrob_drake.tuning.doubts import drawn
from simrob_drake.tuning.measures import measures
from simrob_drake.tuning.scene import Scene
from simrob_drake.yaml_files import Strict

Row = dict[str, Any]
REFUSED, KILLED = "refused", "killed"
"""How cases end that never ran to an end: their station could not be, or their process was killed."""


class Margin(Strict):
    """How hard a push of the station may become: what is asked for the measure ``margin``."""

    push: str
    """A push under ``forces``, whose force is one."""
    sizes: list[Positive] = Field(min_length=1, max_length=1000)
    """So many times as hard, the smallest first; the largest that is withstood is found by bisection."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if any(later <= one for one, later in zip(self.sizes, self.sizes[1:], strict=False)):
            raise ValueError("sizes must grow")
        return self


@dataclass(frozen=True)
class Case:
    """A run to be made.

    Attributes:
        number: of the case, from 1.
        station: a name or a file.
        overrides: what is changed in it, in its robot's gait or in the program; see
            :mod:`simrob_drake.tuning.scene`.
        shown: what the table tells of the case, by column.
        seed: the seed of its noise.
        drawn: whether it is of that seed's robot and floor, too: of its posture, masses and friction.
        allow_code: whether the station may name Python code.
        margin: what is asked beside the run, if anything; the run itself is then without that push.
    """

    number: int
    station: str
    overrides: Mapping[str, Any]
    shown: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    drawn: bool = False
    allow_code: bool = False
    margin: Margin | None = None

    def scene(self) -> Scene:
        """Return what is run.

        Raises:
            SimrobError: what cannot be.
        """
        scene = Scene.of(self.station, self.overrides, allow_code=self.allow_code)
        if not self.drawn:
            return scene
        changes = {**drawn(scene.config, self.seed), **self.overrides}
        return Scene.of(self.station, changes, allow_code=self.allow_code)

    def row(self, ended: str, message: str, **figures: Any) -> Row:
        """Return the case and its end as a row."""
        return {"number": self.number, **self.shown, "seed": self.seed, "ended": ended, **figures, "message": message}


def rollout(case: Case) -> Row:
    """Run a case and return its row, whatever becomes of it."""
    try:
        scene = case.scene()
        result = (scene if case.margin is None else scene.pushed(case.margin.push, 0.0)).run()
        figures = measures(result)
        if case.margin is not None and result.ending == "completed":
            figures["margin"] = _withstood(scene, case.margin)
    except SimrobError as problem:
        return case.row(REFUSED, str(problem))
    times = {"duration": result.config.duration, "stop_time": result.stop_time}
    return case.row(result.stopped_by or result.ending, result.message, **times, **figures)


def killed(case: Case) -> Row:
    """Return the row of a case whose process was killed, and once more when it was alone."""
    return case.row(KILLED, "its process was killed, twice")


def _withstood(scene: Scene, margin: Margin) -> float:
    """Return the largest size of a push after which a run still goes to its end; 0 where none does."""
    stood, fell = 0, len(margin.sizes) + 1  # places of sizes, from 1
    while fell - stood > 1:
        middle = (stood + fell) // 2
        completed = scene.pushed(margin.push, margin.sizes[middle - 1]).run().ending == "completed"
        stood, fell = (middle, fell) if completed else (stood, middle)
    return margin.sizes[stood - 1] if stood else 0.0
