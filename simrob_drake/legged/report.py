"""The report on a robot on legs: what was found, what was assumed, what it can do, and what to tune."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from simrob_drake.legged.trials import Attempt
from simrob_drake.results.animation.pictures import save_film_strip

REPORT, PICTURE = "legged.md", "legged.png"
_TUNE = {
    "stands": "`servo.kp`, `servo.kd` and `home_deg` in robot.yaml",
    "shifts its weight": "`zmp_inward` and `step_time` in gaits.yaml",
    "steps": "`lift`, `widen` and `double_support` in gaits.yaml",
    "walks": "`step_time`, `bearing.height` and `zmp_inward` in gaits.yaml",
}
"""What to change first where a trial fails."""


@dataclass
class Made:
    """What was made of a robot.

    Attributes:
        folder: where it stands.
        name: of the robot.
        found: what was seen in its tree, in words.
        assumed: what was made up, in words.
        attempts: what became of the trials.
        problem: why something could not be done, in words; empty if all was.
    """

    folder: Path
    name: str = ""
    found: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    attempts: list[Attempt] = field(default_factory=list)
    problem: str = ""

    def can(self, trial: str) -> bool:
        """Whether the robot passed a trial."""
        return any(one.done for one in self.attempts if one.trial == trial)


def save_report(made: Made, folder: Path) -> None:
    """Write the report into a folder, and a picture of the last run that there is."""
    runs = [one.result for one in made.attempts if one.result is not None]
    if runs:
        save_film_strip(runs[-1], folder / PICTURE)
    (folder / REPORT).write_text("\n".join(_lines(made, bool(runs))) + "\n", encoding="utf-8")


def _lines(made: Made, picture: bool) -> Iterator[str]:
    yield from (f"# {made.name}", "", "## Found", "", *(f"- {line}" for line in made.found or ["nothing"]), "")
    yield from ("## Assumed", "", *(f"- {line}" for line in made.assumed or ["nothing"]), "")
    yield from ("## Tried", "", "| trial | done | what happened |", "|---|---|---|")
    yield from (f"| {one.trial} | {'yes' if one.done else 'no'} | {one.outcome} |" for one in made.attempts)
    failed = next((one.trial for one in made.attempts if not one.done), None)
    yield from ("", "## Next", "")
    yield f"- {made.problem}" if made.problem else "- nothing failed"
    yield f"- to be tuned first: {_TUNE[failed or 'walks']}"
    if picture:
        yield from ("", f"![the last run]({PICTURE})")
