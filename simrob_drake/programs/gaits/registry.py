"""All kinds of gaits, and the gaits of a robot by name.

A new kind of the core is a file in this folder and a name in the list `_CORE`. Installed extensions add further kinds.
Each gait is made for one kind of feet; a robot can use it on other feet that are about as large.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, create_model

from simrob_drake.base.errors import InvalidParameter, SimrobError, Unsuitable
from simrob_drake.base.extension import check_usable, classes_of_extensions, register_core_names
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Strict, validated
from simrob_drake.programs.gaits.biped import BipedWalk, Kick
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.programs.gaits.motion import Gait
from simrob_drake.programs.gaits.quadruped import Crawl, Stand, Trot
from simrob_drake.programs.gaits.sequences import March, Posing
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.walking.getting_up import GettingUp
from simrob_drake.walking.parameters import REACTING, WalkingParameters

_CORE: tuple[type[Gait], ...] = (BipedWalk, Trot, Crawl, March, Stand, Posing, Kick, Climb)
"""Kinds of gaits of the core that are planned before they begin."""
_POINT = "gaits"
"""Extension point at which extensions add kinds of gaits."""
register_core_names(_POINT, lambda: [kind.section for kind in _CORE])
_AS_LARGE = 0.8
"""Part of the length and of the width of a gait's own feet that others have at least: what gaits leave as margin."""

_WALKING = "walking.yaml"
"""Name of the station in a robot's own folder on which it walks by commands, as `simrob legged` writes it."""


class _Gaits(Strict):
    """All gaits of a robot."""

    facing_deg: Number
    """Where the robot looks while its root is not turned, counterclockwise from the world's x [deg]."""
    reacting: WalkingParameters | None = None
    """The walk that is made while it goes: controllers of kind `walk`."""
    get_up: GettingUp | None = None
    """How it gets up where it has fallen: moves and controllers of kind `get_up`."""


@cache
def gait_kinds() -> tuple[type[Gait], ...]:
    """Return all kinds of gaits that are planned before they begin, those of installed extensions last."""
    return (*_CORE, *classes_of_extensions(_POINT, Gait, named_by="section").values())


@cache
def gaits_model() -> type[Strict]:
    """Make the pydantic model of a file `gaits.yaml`: the keys of `_Gaits`, and one section for each kind of gait.

    A section contains the gaits of its kind by name.
    """
    sections: dict[str, Any] = {}
    for kind in gait_kinds():
        described: Any = Field(default_factory=dict, description=f"{kind.__doc__} By name.")
        sections[kind.section] = (dict[str, kind], described)  # type: ignore[valid-type]
    return create_model("Gaits", __base__=_Gaits, __doc__=_Gaits.__doc__, **sections)


def load_gaits(robot: str | RobotModel) -> Any:
    """Return all gaits of a robot, checked: ``walks``, ``trots`` ... by name.

    Raises:
        UnknownName: no such robot; proposes the nearest.
        InvalidParameter: a robot without gaits.
        InvalidConfig: its file has a wrong entry.
        BrokenExtension: its file has a section of a kind that an extension adds, and that cannot be used.
    """
    found = gaits_file(robot)
    for section in found.sections:
        if section not in gaits_model().model_fields:
            check_usable(_POINT, section, Gait, named_by="section")
    return validated(gaits_model(), dict(found.content), found.file)


def gaits_of(robot: str | RobotModel, *, steps: bool) -> dict[str, Gait]:
    """Find the gaits of a robot by name: those that consist of steps, or all others.

    Args:
        robot: name or model of the robot.
        steps: whether to return the gaits with steps, such as walks, or those without, such as postures.

    Raises:
        UnknownName: there is no such robot.
        InvalidParameter: the robot has no gaits at all.
        InvalidConfig: its file of gaits has a wrong entry.
    """
    gaits = load_gaits(robot)
    found: dict[str, Gait] = {}
    for kind in gait_kinds():
        if kind.steps == steps:
            found |= getattr(gaits, kind.section)
    return found


def has_gait(model: RobotModel, kind: type[Gait], name: str) -> bool:
    """Check whether a robot has a gait of a kind, by its name in the robot's `gaits.yaml`."""
    try:
        gaits = load_gaits(model)
    except SimrobError:  # a robot without such a file
        return False
    return name in getattr(gaits, kind.section)


def carries(model: RobotModel, worn: str | None, made: str | None) -> bool:
    """Tell whether a gait that is made for one kind of feet carries on the kind that is worn: the same, or as large."""
    if worn == made or worn is None or made is None:
        return worn == made
    ours, theirs = _sizes(model, worn), _sizes(model, made)
    return ours.keys() == theirs.keys() and all((ours[link] >= _AS_LARGE * theirs[link]).all() for link in ours)


def first_gait(model: RobotModel, worn: str | None, known: Mapping[str, Gait]) -> str:
    """Return the first gait for the feet worn, or for others it has; raises InvalidParameter: none; tells of feet."""
    if not known:
        raise _no_walk(model)
    made = {name: gait.made_for(model) for name, gait in known.items()}
    fitting = [name for name in made if made[name] == worn] or [
        name for name in made if carries(model, worn, made[name])
    ]
    if not fitting:
        kinds = ", ".join(dict.fromkeys(str(kind) for kind in made.values())) or message(
            "programs.another_robot", "another robot"
        )
        raise InvalidParameter(
            message("programs.feet_of", "feet of {model}", model=model.name),
            str(worn),
            message("programs.feet_with_gait", "some that it has a gait for: {kinds} (robot.feet)", kinds=kinds),
        )
    return fitting[0]


def _no_walk(model: RobotModel) -> Unsuitable:
    """Make the error for a robot without any gait with steps. Most of them walk by commands."""
    subject = message("base.robot_called", "robot {name}", name=model.name)
    file = gaits_file(model)
    if not file.section(REACTING):
        problem = message("programs.no_gait_with_steps", "it has no gait with steps")
        remedy = message("programs.use_acts", "use an act, or write a gait into its {file}", file=file.file.name)
        return Unsuitable(subject, problem, remedy)
    problem = message("programs.no_planned_walk", "it has no planned walk, and walks by commands")
    go = message("programs.go_in_program", "{{go: {{ahead: 0.1}}}} in a program")
    station = model.folder / _WALKING
    if not station.is_file():
        return Unsuitable(subject, problem, message("programs.use_go", "use {go}", go=go))
    here = Path.cwd()
    shown = station.relative_to(here) if station.is_relative_to(here) else station
    remedy = message("programs.run_walking_or_go", "type simrob run {file}, or use {go}", file=shown, go=go)
    return Unsuitable(subject, problem, remedy)


def _sizes(model: RobotModel, kind: str) -> dict[str, Vector]:
    """Return length and width of what each foot stands on, by link, shape (2,) [m]."""
    assert model.feet is not None  # it has a kind of feet
    contact = model.feet.kind(kind)
    return {link: np.ptp(contact.support_points(link)[:, :2], axis=0) for link in contact.links}
