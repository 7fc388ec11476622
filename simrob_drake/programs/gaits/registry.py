"""Every gait of a robot under its name: what plans it, and what it needs.

Each is made for one kind of feet, and carries on others as large.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.parameters import load_gaits
from simrob_drake.programs.gaits.quadruped import crawl, three_legs, trot
from simrob_drake.programs.gaits.sequences import march, posing
from simrob_drake.robots.catalog import RobotModel


@dataclass(frozen=True)
class Section:
    """What the gaits of a section of ``gaits.yaml`` have in common.

    Attributes:
        plan: makes the motion of the robot's model, the steps if any, the gait's name, and changed parameters.
        steps: whether it goes steps: it is then told how many, and how large they are (``amplitude``).
        on_feet: whether it is for a robot that stands on the feet that it is made for.
    """

    plan: Callable[..., JointMotion]
    steps: bool = False
    on_feet: bool = True


SECTIONS: Mapping[str, Section] = {
    "walks": Section(walk, steps=True),
    "trots": Section(trot, steps=True),
    "crawls": Section(crawl, steps=True),
    "marches": Section(march, steps=True),
    "stands": Section(three_legs),
    "sequences": Section(posing, on_feet=False),
}
"""By section of ``gaits.yaml``; a robot's gaits all have different names."""
_AS_LARGE = 0.8
"""Part of the length and of the width of a gait's own feet that others have at least: what gaits leave as margin."""


def gaits_of(robot: str | RobotModel, *, steps: bool) -> dict[str, tuple[Section, Any]]:
    """Return the gaits of a robot that go some steps, or the others: by name, their section and their parameters.

    Raises:
        InvalidParameter: a robot without gaits.
    """
    gaits = load_gaits(robot)
    fitting = {key: section for key, section in SECTIONS.items() if section.steps == steps}
    return {name: (section, own) for key, section in fitting.items() for name, own in getattr(gaits, key).items()}


def made_for(model: RobotModel, gait: Any) -> str | None:
    """Return the kind of feet that a gait is made for: what it names, else the robot's default one."""
    named: str | None = getattr(gait, "feet", None)
    return named or (model.feet.default if model.feet else None)


def carries(model: RobotModel, worn: str | None, made: str | None) -> bool:
    """Tell whether a gait that is made for one kind of feet carries on the kind that is worn: the same, or as large."""
    if worn == made or worn is None or made is None:
        return worn == made
    ours, theirs = _sizes(model, worn), _sizes(model, made)
    return ours.keys() == theirs.keys() and all((ours[link] >= _AS_LARGE * theirs[link]).all() for link in ours)


def first_gait(model: RobotModel, worn: str | None, known: Mapping[str, tuple[Section, Any]]) -> str:
    """Return the name of the first gait that is made for the feet worn, else of the first that they carry.

    Raises:
        InvalidParameter: there is none; tells which feet have one.
    """
    made = {name: made_for(model, gait) for name, (_, gait) in known.items()}
    fitting = [name for name in made if made[name] == worn] or [
        name for name in made if carries(model, worn, made[name])
    ]
    if not fitting:
        kinds = ", ".join(dict.fromkeys(str(kind) for kind in made.values())) or "another robot"
        raise InvalidParameter(f"feet of {model.name}", str(worn), f"some that it has a gait for: {kinds} (robot.feet)")
    return fitting[0]


def _sizes(model: RobotModel, kind: str) -> dict[str, Vector]:
    """Return length and width of what each foot stands on, by link, shape (2,) [m]."""
    assert model.feet is not None  # it has a kind of feet
    contact = model.feet.kind(kind)
    return {link: np.ptp(contact.support_points(link)[:, :2], axis=0) for link in contact.links}
