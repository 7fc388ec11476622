"""What an import did to a robot: every repair, default and loss, in words."""

from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from simrob_drake.errors import InvalidModel

Deed = Literal["read", "repaired", "defaulted", "dropped", "refused"]
DEEDS: tuple[Deed, ...] = ("read", "repaired", "defaulted", "dropped", "refused")


@dataclass(frozen=True)
class Entry:
    """One thing that was done to one element.

    Attributes:
        kind: what was done: ``read`` as it was (worth knowing), ``repaired``, ``defaulted`` (a figure was made up),
            ``dropped``, or ``refused`` (what the robot can't do, such as move by torque without inertias).
        element: which element, as in ``joint 'elbow' <limit>``; empty for the whole file.
        text: in words, with the old and the new figure.
    """

    kind: Deed
    element: str
    text: str


@dataclass
class ImportReport:
    """All that an import did, in the order it was done.

    Attributes:
        source: the file that was imported.
    """

    source: Path
    entries: list[Entry] = field(default_factory=list)

    def add(self, kind: Deed, element: str, text: str) -> None:
        """Note one thing that was done."""
        self.entries.append(Entry(kind, element, text))

    def refusal(self, element: str, problem: str) -> InvalidModel:
        """Return the error for what can't be repaired; it names file and element."""
        return InvalidModel(self.source, element, problem)

    def of(self, kind: Deed) -> list[Entry]:
        """Return the entries of one kind."""
        return [entry for entry in self.entries if entry.kind == kind]

    @property
    def changed(self) -> bool:
        """Whether anything of the source is different in the result."""
        return any(entry.kind in ("repaired", "defaulted", "dropped") for entry in self.entries)

    def summary(self) -> str:
        """Return the counts in one line, as in ``3 repaired, 6 defaulted``."""
        counts = Counter(entry.kind for entry in self.entries)
        told = [f"{counts[kind]} {kind}" for kind in DEEDS if counts[kind] and kind != "read"]
        return ", ".join(told) or "nothing to repair"

    def as_json(self) -> dict[str, Any]:
        """Return what is written to the report file."""
        return {
            "source": str(self.source),
            "summary": self.summary(),
            "entries": [asdict(entry) for entry in self.entries],
        }
