"""Findings: the results of the checks of a station, which ``simrob check`` prints."""

from dataclasses import dataclass
from typing import Literal

from simrob_drake.base.remarks import Severity

Level = Literal["ok", "warning", "note"]
"""How a finding is judged: ``ok`` if nothing is wrong, ``warning`` if something is, ``note`` for a fact without
a judgement."""


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Attributes:
        level: how the finding is judged.
        subject: short title, such as ``contact`` or ``torque of joint_2``.
        text: the finding in words. The text of a warning contains the remedy.
    """

    level: Level
    subject: str
    text: str

    @property
    def severity(self) -> Severity:
        """The level as the severity that remarks about runs have, too."""
        return "success" if self.level == "ok" else self.level
