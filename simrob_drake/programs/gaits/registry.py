"""Every gait of a robot under its name: what plans it, and what it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.quadruped import FEWEST_LEGS, crawl, three_legs, trot
from simrob_drake.programs.gaits.sequences import march, posing
from simrob_drake.programs.gaits.stepping import FEWEST_STEPS
from simrob_drake.programs.gaits.walk import walk
from simrob_drake.robots.catalog import RobotModel


@dataclass(frozen=True)
class Section:
    """What the gaits of a section of ``gaits.yaml`` have in common.

    Attributes:
        plan: makes the motion of the robot's model, the steps if there are any, the gait's name, and changed figures.
        fewest: steps that it goes; 0 for gaits that go none. Those that do are told how many, and how large they are
            (``amplitude``).
        on_feet: whether it is for a robot that stands on the feet that it is made for.
    """

    plan: Callable[..., JointMotion]
    fewest: int = 0
    on_feet: bool = True


SECTIONS: Mapping[str, Section] = {
    "walks": Section(walk, FEWEST_STEPS),
    "trots": Section(trot, FEWEST_STEPS),
    "crawls": Section(crawl, FEWEST_LEGS),
    "marches": Section(march, FEWEST_STEPS),
    "stands": Section(three_legs),
    "sequences": Section(posing, on_feet=False),
}
"""By section of ``gaits.yaml``; a robot's gaits all have different names."""


def gaits_of(robot: str | RobotModel, *, steps: bool) -> dict[str, tuple[Section, Any]]:
    """Return the gaits of a robot that go some steps, or the others: by name, their section and their figures.

    Raises:
        InvalidParameter: a robot without gaits.
    """
    gaits = load_gaits(robot)
    fitting = {key: section for key, section in SECTIONS.items() if (section.fewest > 0) == steps}
    return {name: (section, own) for key, section in fitting.items() for name, own in getattr(gaits, key).items()}
