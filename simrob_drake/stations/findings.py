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
        torque_share: for a finding about the holding torque of one axis that holds, the largest torque as a share of
            the axis's limit. None for other findings, for a warning that an axis does not hold, and for a robot with a
            floating base also for a warning that a motor gets too warm.
    """

    level: Level
    subject: str
    text: str
    torque_share: float | None = None

    @property
    def severity(self) -> Severity:
        """The level as the severity that remarks about runs have, too."""
        return "success" if self.level == "ok" else self.level
