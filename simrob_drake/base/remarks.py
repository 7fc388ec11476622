"""Remarks about a run or a station: sentences with a severity and, where one is known, a remedy.

A verdict, a check and an import give remarks. The command line, the pendant and a notebook show them; each of these
decides only how a severity looks.
"""

from dataclasses import dataclass
from typing import Any, Literal

from simrob_drake.base.messages import Message, message

Severity = Literal["success", "note", "warning", "failure"]
"""How a remark is judged.

``success``: what was asked is reached. ``note``: a fact without a judgement. ``warning``: a value violates its bound,
or a result may be wrong. ``failure``: the run ended early, or an input cannot be used.
"""

SEVERITY_WORDS: dict[Severity, Message] = {
    "success": message("base.severity_ok", "ok"),
    "note": message("base.severity_note", "note"),
    "warning": message("base.severity_warning", "warning"),
    "failure": message("base.severity_failure", "failure"),
}
"""Words for the severities, which tell them apart without colours."""

SEVERITIES: tuple[Severity, ...] = ("success", "note", "warning", "failure")
"""All severities, from the best to the worst."""


@dataclass(frozen=True)
class Remedy:
    """A change that most likely removes the cause of a remark.

    Attributes:
        text: the remedy as a sentence, without a full stop.
        key: dotted key of the station that the remedy sets, such as ``servo.feedforward``. Empty if no key does.
        value: new value of the key. None if there is no key, or if the user chooses the value.
        further: keys that must be set together with the first one, each with its value.
    """

    text: str
    key: str = ""
    value: object = None
    further: tuple[tuple[str, object], ...] = ()

    @property
    def changes(self) -> dict[str, object]:
        """Values to set, by dotted keys of the station. Empty if no key does it, or if the user chooses the value."""
        # A page can offer such a remedy only as text: there is nothing that a button could set.
        if not self.key or self.value is None:
            return {}
        return {self.key: self.value, **dict(self.further)}

    @property
    def settings(self) -> list[str]:
        """The changes as arguments of ``--set``, such as ``servo.feedforward=gravity``."""
        return [f"{key}={value}" for key, value in self.changes.items()]

    @property
    def setting(self) -> str:
        """The first of the settings. Empty if there is none."""
        return next(iter(self.settings), "")


@dataclass(frozen=True)
class Remark:
    """A sentence with its severity.

    Attributes:
        severity: how the remark is judged.
        text: the sentence, without a full stop.
        remedy: what most likely removes the cause. None if nothing is wrong, or if no remedy is known.
    """

    severity: Severity
    text: str
    remedy: Remedy | None = None

    def summary(self) -> dict[str, Any]:
        """Content for ``summary.json``: severity and text and, if there is a remedy, its text and its settings."""
        content: dict[str, Any] = {"severity": self.severity, "text": self.text}
        if self.remedy is not None:
            content["remedy"] = self.remedy.text
            # Readers of the file expect one text under "set", so further changes have a key of their own.
            content["set"] = self.remedy.setting or None
            if self.remedy.further:
                content["set_also"] = self.remedy.settings[1:]
        return content


def worst_severity(remarks: list[Remark]) -> Severity:
    """Worst severity of the remarks, or ``success`` for an empty list."""
    ranks = [SEVERITIES.index(remark.severity) for remark in remarks]
    return SEVERITIES[max(ranks, default=0)]
