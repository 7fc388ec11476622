"""What a session says in words of its own, so that pages can say it in their language; errors have their own words."""

from dataclasses import dataclass, field
from typing import Any

NOTICES = {
    "damaged": "{file} is damaged and was kept as it is ({why}); what you teach now goes to {new}",
    "foreign": "{file} is of another robot and was kept as it is ({why}); what you teach now goes to {new}",
    "taken_over": "{file} was taught on {why} and was kept as it is; its moves were taken over into {new}",
    "died": "The simulation broke down ({why}) and was started again; the program is as it was",
    "lost": "The simulation broke down again and again ({why}); change what breaks it, then try again",
    "gone": "There is no simulation; try again",
    "busy": "End the run first",
    "waits": "This is done when what runs has ended",
    "nothing_tested": "There is nothing to add: test a move first",
    "not_stored": "This change is not in the program, since the robot is elsewhere than the program leads it",
    "reset": "The program was erased; undo brings it back",
    "exported": "{file} was written",
}
"""By key; what stands in braces is filled in."""


@dataclass(frozen=True)
class Notice:
    """What is to be told.

    Attributes:
        key: of :data:`NOTICES`; empty for an error, which has words of its own.
        fills: what is filled in; ``text`` alone for an error.
        wrong: whether something went wrong.
    """

    key: str = ""
    fills: dict[str, Any] = field(default_factory=dict)
    wrong: bool = False

    def __str__(self) -> str:
        """Return it in English."""
        return NOTICES[self.key].format(**self.fills) if self.key else str(self.fills.get("text", ""))
