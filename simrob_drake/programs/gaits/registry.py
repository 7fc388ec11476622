"""Every gait of a robot under its name: what plans it, and what it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.quadruped import crawl, three_legs, trot
from simrob_drake.programs.gaits.sequences import march, posing
from simrob_drake.programs.gaits.walk import walk
from simrob_drake.robots.catalog import RobotModel


@dataclass(frozen=True)
class Kind:
    """What the gaits of a section of ``gaits.yaml`` have in common.

    Attributes:
        plan: makes the motion of the robot's model, the steps if there are any, the gait's name, and changed figures.
        steps: whether it is told how many steps to go, and how large they are (``amplitude``).
        on_feet: whether it is for a robot that stands on the feet that it is made for.
    """

    plan: Callable[..., JointMotion]
    steps: bool
    on_feet: bool = True


KINDS: Mapping[str, Kind] = {
    "walks": Kind(walk, steps=True),
    "trots": Kind(trot, steps=True),
    "crawls": Kind(crawl, steps=True),
    "marches": Kind(march, steps=True),
    "stands": Kind(three_legs, steps=False),
    "sequences": Kind(posing, steps=False, on_feet=False),
}
"""By section of ``gaits.yaml``; a robot's gaits all have different names."""


def gaits_of(robot: str | RobotModel, *, steps: bool) -> dict[str, tuple[Kind, Any]]:
    """Return the gaits of a robot that go some steps, or the others: by name, their kind and their figures.

    Raises:
        InvalidParameter: a robot without gaits.
    """
    gaits = load_gaits(robot)
    kinds = {section: kind for section, kind in KINDS.items() if kind.steps == steps}
    return {name: (kind, own) for section, kind in kinds.items() for name, own in getattr(gaits, section).items()}
