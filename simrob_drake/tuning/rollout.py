"""One run of many: a station with some keys changed, and the row of a table that becomes of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from pydantic import Field, model_validator

from simrob_drake.sections import Positive, Strict
from simrob_drake.tuning.doubts import drawn
from simrob_drake.tuning.measures import measures
from simrob_drake.tuning.scene import Scene
from simrob_drake.tuning.trial import COMPLETED, Row, Trial


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
class Case(Trial):
    """A run to be made.

    Attributes:
        station: a name or a file.
        overrides: what is changed in it, in its robot's gait or in the program; see
            :mod:`simrob_drake.tuning.scene`.
        shown: what the table tells of the case, by column.
        seed: the seed of its noise.
        drawn: whether it is of that seed's robot and floor, too: of its posture, masses and friction.
        allow_code: whether the station may name Python code.
        margin: what is asked beside the run, if anything; the run itself is then without that push.
    """

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

    @property
    def columns(self) -> list[Row]:
        """What the table tells of it, and its seed."""
        return [{**self.shown, "seed": self.seed}]

    def measured(self) -> list[Row]:
        """Return how it ended, and its :func:`~simrob_drake.tuning.measures.measures`."""
        scene = self.scene()
        result = (scene if self.margin is None else scene.pushed(self.margin.push, 0.0)).run()
        row = {"ended": result.stopped_by or result.ending, "duration": result.config.duration}
        row |= {"stop_time": result.stop_time, **measures(result), "beyond": " ".join(result.verdict.beyond)}
        if self.margin is not None and result.ending == COMPLETED:
            row["margin"] = _withstood(scene, self.margin)
        return [{**row, "message": result.message}]


def _withstood(scene: Scene, margin: Margin) -> float:
    """Return the largest size of a push after which a run still goes to its end; 0 where none does."""
    stood, fell = 0, len(margin.sizes) + 1  # places of sizes, from 1
    while fell - stood > 1:
        middle = (stood + fell) // 2
        completed = scene.pushed(margin.push, margin.sizes[middle - 1]).run().ending == COMPLETED
        stood, fell = (middle, fell) if completed else (stood, middle)
    return margin.sizes[stood - 1] if stood else 0.0
