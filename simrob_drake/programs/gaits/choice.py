"""Which gaits go with the feet that a robot wears: each is made for one kind, and carries on others as large."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.programs.gaits.registry import Section
from simrob_drake.robots.catalog import RobotModel

_AS_LARGE = 0.8
"""Part of the length and of the width of a gait's own feet that others have at least: what gaits leave as margin."""


def made_for(model: RobotModel, figures: Any) -> str | None:
    """Return the kind of feet that a gait is made for: what it names, else the robot's default one."""
    named: str | None = getattr(figures, "feet", None)
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
    made = {name: made_for(model, figures) for name, (_, figures) in known.items()}
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
