"""Kinds of gaits that are planned before they begin, and the gaits of a robot by name.

A kind of gait is a class such as `BipedWalk`; a gait is an entry in a robot's file ``gaits.yaml``, which has a section
for each kind. A new kind of the core is a file in this folder and a name in the list `_CORE`; installed extensions add
further kinds.

A robot may have several kinds of feet, such as spheres and soles. The kind that it has in a station is *worn*. Each
gait is *made* for one kind; a robot can use it on other feet that are about as large.
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
from simrob_drake.base.sections import Number, Strict, validate_section
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
_WALKING = "walking.yaml"
"""Name of the station in a robot's own folder on which it walks by commands, as `simrob legged` writes it."""
_LEAST_SIZE = 0.8
"""Least length and width of other feet over those of the feet that a gait is made for [1].

Gaits keep the zero-moment point about so far inside the feet.
"""


class _Gaits(Strict):
    """Gaits of a robot."""

    facing_deg: Number
    """Direction in which the robot looks while its root is not turned, counterclockwise from the world's x [deg]."""
    reacting: WalkingParameters | None = None
    """Parameters of the walk that reacts to measurements: of controllers of kind `walk`."""
    get_up: GettingUp | None = None
    """Parameters of getting up after a fall: of moves and controllers of kind `get_up`."""


@cache
def gait_kinds() -> tuple[type[Gait], ...]:
    """Kinds of gaits that are planned before they begin: those of the core, then those of installed extensions."""
    return (*_CORE, *classes_of_extensions(_POINT, Gait, named_by="section").values())


@cache
def gaits_model() -> type[Strict]:
    """Make the pydantic model of a file `gaits.yaml`: the keys of `_Gaits`, and one section for each kind of gait.

    A section contains the gaits of its kind by name.
    """
    sections: dict[str, Any] = {}
    # Sections of extensions become keys of the model, so that their files are checked as strictly as the others.
    for kind in gait_kinds():
        described: Any = Field(default_factory=dict, description=f"{kind.__doc__} By name.")
        sections[kind.section] = (dict[str, kind], described)  # type: ignore[valid-type]
    return create_model("Gaits", __base__=_Gaits, __doc__=_Gaits.__doc__, **sections)


def load_gaits(robot: str | RobotModel) -> Any:
    """Read and check all gaits of a robot.

    Args:
        robot: name or model of the robot.

    Returns:
        An object of :func:`gaits_model`: its attributes, such as ``walks``, are dicts of gaits by name.

    Raises:
        UnknownName: there is no such robot. The message proposes the nearest name.
        InvalidParameter: the robot has no gaits.
        InvalidConfig: its file of gaits has a wrong entry.
        BrokenExtension: its file has a section of a kind that an extension adds, and this extension cannot be used.
    """
    file = gaits_file(robot)
    for section in file.sections:
        # A section that no kind has may belong to an extension that failed to load: that error explains more.
        if section not in gaits_model().model_fields:
            check_usable(_POINT, section, Gait, named_by="section")
    return validate_section(gaits_model(), dict(file.content), file.file)


def gaits_of(robot: str | RobotModel, *, steps: bool) -> dict[str, Gait]:
    """Find the gaits of a robot by name: those that consist of steps, or all others.

    If two kinds have a gait of the same name, only that of the later kind is returned.

    Args:
        robot: name or model of the robot.
        steps: whether to return the gaits with steps, such as walks, or those without, such as postures.

    Raises:
        UnknownName, InvalidParameter, InvalidConfig, BrokenExtension: see :func:`load_gaits`.
    """
    gaits = load_gaits(robot)
    by_name: dict[str, Gait] = {}
    for kind in gait_kinds():
        if kind.steps == steps:
            by_name |= getattr(gaits, kind.section)
    return by_name


def has_gait(model: RobotModel, kind: type[Gait], name: str) -> bool:
    """Check whether a robot has a gait of a kind, by its name in the robot's `gaits.yaml`.

    It is False, too, if the robot has no such file, or one that cannot be read.
    """
    try:
        gaits = load_gaits(model)
    except SimrobError:
        return False
    return name in getattr(gaits, kind.section)


def carries(model: RobotModel, worn: str | None, made: str | None) -> bool:
    """Check whether a robot can use a gait on its feet: on those for which it is made, or on others on the same links.

    Each of the other feet has to be at least 0.8 times as long and as wide as that for which the gait is made.

    Args:
        model: the robot.
        worn: kind of feet that the robot has in its station, or None if it has no feet.
        made: kind of feet for which the gait is made, see :meth:`Gait.made_for`; None if neither the gait nor the robot
            has any.
    """
    # If one of the two is None, the other one has to be None, too.
    if worn == made or worn is None or made is None:
        return worn == made
    worn_sizes = _foot_sizes(model, worn)
    made_sizes = _foot_sizes(model, made)
    # Sizes of feet on different links cannot be compared.
    if worn_sizes.keys() != made_sizes.keys():
        return False
    return all((worn_sizes[link] >= _LEAST_SIZE * made_sizes[link]).all() for link in worn_sizes)


def first_gait(model: RobotModel, worn: str | None, known: Mapping[str, Gait]) -> str:
    """Find the name of the first gait for the feet that a robot has, in the order of `known`.

    Gaits that are made for these feet come before those that are made for others about as large.

    Args:
        model: the robot.
        worn: kind of feet that the robot has in its station, or None if it has no feet.
        known: gaits to choose from, by name.

    Raises:
        InvalidParameter: there is no gait for these feet. The message names the feet for which there is one.
        Unsuitable: there are no gaits. The message has the way in which the robot walks instead.
    """
    if not known:
        raise _no_walk(model)
    made_for = {name: gait.made_for(model) for name, gait in known.items()}
    exact = [name for name, made in made_for.items() if made == worn]
    fitting = exact or [name for name, made in made_for.items() if carries(model, worn, made)]
    if fitting:
        return fitting[0]
    kinds = ", ".join(dict.fromkeys(str(made) for made in made_for.values()))  # each kind once
    raise InvalidParameter(
        message("programs.feet_of", "kind of feet of {model}", model=model.name),
        str(worn),
        message(
            "programs.feet_with_gait",
            "a kind for which it has a gait: {kinds} (robot.feet)",
            kinds=kinds,
        ),
    )


def _no_walk(model: RobotModel) -> Unsuitable:
    """Make the error for a robot without any gait with steps. Its message says how the robot can walk or move instead.

    Most of these robots walk by commands: their file of gaits has a section for a walk that reacts to measurements.
    """
    subject = message("base.robot_called", "robot {name}", name=model.name)
    file = gaits_file(model)
    if not file.section(REACTING):
        problem = message("programs.no_gait_with_steps", "its file of gaits has no gait with steps")
        remedy = message(
            "programs.use_acts", "use an act, or add a gait to its {file}", file=file.file.name
        )
        return Unsuitable(subject, problem, remedy)
    problem = message("programs.no_planned_walk", "it has no planned walk: it walks by commands")
    go = message("programs.go_in_program", "{{go: {{ahead: 0.1}}}} in a program")
    station = model.folder / _WALKING
    if not station.is_file():
        return Unsuitable(subject, problem, message("programs.use_go", "use {go}", go=go))
    # The command in the message shall work as it is typed, and be as short as possible.
    here = Path.cwd()
    shown = station.relative_to(here) if station.is_relative_to(here) else station
    remedy = message(
        "programs.run_walking_or_go", "run `simrob run {file}`, or use {go}", file=shown, go=go
    )
    return Unsuitable(subject, problem, remedy)


def _foot_sizes(model: RobotModel, kind: str) -> dict[str, Vector]:
    """Length and width of the contact of each foot of a kind, by the name of its link, shape (2,) [m].

    They are measured along x and y of the link.
    """
    assert model.feet is not None  # a robot with a kind of feet has feet
    contact = model.feet.kind(kind)
    return {link: np.ptp(contact.support_points(link)[:, :2], axis=0) for link in contact.links}
