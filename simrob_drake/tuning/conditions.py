"""Under which conditions figures are judged: cases that are listed, cases that are drawn, and seeds."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field

from simrob_drake.distributions import AnyDistribution, Choice, Values
from simrob_drake.importer.packages import Border
from simrob_drake.sampling import Draws, distinct
from simrob_drake.sections import Boolean
from simrob_drake.stations.located import located_changes


class Conditions(Draws):
    """Changes of a station under which it is run for one figure of cost: every case, with every draw and every seed."""

    cases: list[dict[str, Any]] = Field(default=[{}], min_length=1)
    """Changes of the station, such as other loads, moves and pushes."""
    seeds: list[Annotated[int, Field(strict=True)]] = Field(default=[0], min_length=1)
    """Of all that is random in it."""
    drawn: Boolean = False
    """Whether each seed is another robot on another floor, too: joints 0.5° beside, other masses, other friction."""

    @property
    def every(self) -> dict[str, Values]:
        """All changes, by what errors call them: each case with each draw of what varies."""
        if not self.vary:
            return {f"cases.{place}": case for place, case in enumerate(self.cases)}
        draws = list(enumerate(self.draws(), start=1))
        every = enumerate(self.cases)
        return {f"cases.{place}, draw {number}": {**case, **draw} for place, case in every for number, draw in draws}

    @property
    def keys(self) -> list[str]:
        """All keys that are changed in some case."""
        return distinct([*(key for case in self.cases for key in case), *self.vary])

    def located(self, folder: Path, border: Border) -> Self:
        """Return them with absolute paths.

        Raises:
            InvalidConfig: one that may not be read.
        """
        cases = [located_changes(case, folder, border) for case in self.cases]
        return self.model_copy(update={"cases": cases, "vary": located_space(self.vary, folder, border)})


def located_space(space: Mapping[str, AnyDistribution], folder: Path, border: Border) -> dict[str, AnyDistribution]:
    """Return distributions with absolute paths in what is chosen from; as :func:`located_changes` does."""
    found = dict(space)
    for key, one in space.items():
        if isinstance(one, Choice):
            values = [located_changes({key: value}, folder, border)[key] for value in one.values]
            found[key] = one if values == one.values else Choice(values=values, when=one.when)
    return found
