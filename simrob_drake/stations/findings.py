"""What a look at a station finds: in order, a warning, or a fact."""

from dataclasses import dataclass
from typing import Literal

Level = Literal["ok", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that a check found.

    Attributes:
        level: ``ok`` if it is in order, ``warning`` if it is not, ``note`` for a fact that is not judged.
        subject: what it is about, such as ``contact`` or ``torque of joint_2``.
        text: the finding in words, with its remedy if it is a warning.
    """

    level: Level
    subject: str
    text: str
