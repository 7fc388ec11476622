"""What was taught step by step, for undo and redo: no longer than it may be, and as the text of a file."""

from __future__ import annotations

from pydantic import ValidationError

from simrob_drake.errors import SimrobError
from simrob_drake.teach.taught import Taught

MOST_STEPS, MOST_LETTERS = 200, 2_000_000
"""What is kept to go back to; the oldest is forgotten first."""


class History:
    """What is taught now, with what undo goes back to and what redo brings back."""

    def __init__(self, taught: Taught | None = None) -> None:
        """Begin with what is taught already."""
        self._steps = [_as_step(Taught() if taught is None else taught)]
        self._at = 0
        self._label = ""

    @property
    def present(self) -> Taught:
        """What is taught now."""
        return self._steps[self._at][0]

    @property
    def can_undo(self) -> bool:
        """Whether there is something to go back to."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is something to bring back."""
        return self._at < len(self._steps) - 1

    def record(self, taught: Taught, label: str = "") -> None:
        """Take a step, if something is new; what was undone before is forgotten.

        Args:
            taught: what is taught from now on.
            label: of a step that goes on with the last one if that had the same, as a slider that is still moved.
        """
        if taught == self.present:
            return
        keep = self._at + (0 if label and label == self._label and self._at > 0 else 1)
        self._steps[keep:] = [_as_step(taught)]
        self._at, self._label = len(self._steps) - 1, label
        letters = sum(len(text) for _, text in self._steps)
        while len(self._steps) > MOST_STEPS or (letters > MOST_LETTERS and len(self._steps) > 1):
            letters -= len(self._steps.pop(0)[1])
            self._at -= 1

    def withdraw(self) -> None:
        """Forget the last step, which came to nothing."""
        if self.can_undo:
            self.undo()
            del self._steps[self._at + 1 :]

    def undo(self) -> None:
        """Go back a step."""
        self._at, self._label = max(self._at - 1, 0), ""

    def redo(self) -> None:
        """Bring a step back."""
        self._at, self._label = min(self._at + 1, len(self._steps) - 1), ""

    def text(self) -> str:
        """Return all of it: the number of the present step, and one line for each."""
        return "\n".join([str(self._at), *(text for _, text in self._steps)]) + "\n"

    @classmethod
    def of_text(cls, text: str) -> History | None:
        """Return what :meth:`text` gave; None of anything else."""
        at, *lines = text.removesuffix("\n").split("\n")
        history = cls()
        try:
            history._steps = [(Taught.model_validate_json(line), line) for line in lines]
            history._at = range(len(lines))[int(at)]
        except (ValidationError, SimrobError, ValueError, IndexError):
            return None
        return history


def _as_step(taught: Taught) -> tuple[Taught, str]:
    return taught, taught.model_dump_json()
