"""From a robot's tree to a robot that walks: a folder with its description, its gait, its stations and a report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from simrob_drake.arguments import as_path
from simrob_drake.errors import SimrobError
from simrob_drake.files import ROBOT_FILE
from simrob_drake.folders import filled_at_once
from simrob_drake.importer.importing import write_robot
from simrob_drake.importer.options import ImportOptions, ImportReport
from simrob_drake.importer.packages import robot_file
from simrob_drake.legged.anatomy import Anatomy, anatomy_of
from simrob_drake.legged.report import REPORT, Made, save_report
from simrob_drake.legged.scaling import EXAMPLES, Build, Example, asked_speed, build_of, gains, walk_of
from simrob_drake.legged.soles import FootSole, feet_section, soles_of, write_soles
from simrob_drake.legged.trials import TRIALS, Attempt, attempt
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import GAITS_FILE
from simrob_drake.stations.draft import at_home, draft_station
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.stances import Stance, Stances
from simrob_drake.walking.parameters import REACTING

STAND, WALK = "standing.yaml", "walking.yaml"
_BENT = {2: (0.9, 0.85, 0.8), 4: (0.78, 0.7, 0.85, 0.9), 6: (0.78, 0.7, 0.85, 0.6)}
"""Parts of their length to which legs are bent, by their number, in the order of trial."""
_PARTS = 1.0, 0.5, 0.25  # of the speed that a first walk is asked for
_STIFFER = 1.0, 2.0  # factors of the gains
_FALLEN, _TILT = 0.55, 60.0  # part of the height of the root, deg
_STEP: dict[str, Any] = {
    "kind": "continuous", "scheme": "cenic", "accuracy": 1.0e-3, "max_step": 0.01, "error_control": False,
}  # fmt: skip
_NO_MODEL = "{count} legs: what walks here has two, four or six"


def make_legged(
    source: Path | str, folder: Path | str, options: ImportOptions | None = None, *, force: bool = False
) -> Made:
    """Make a robot of a URDF ready to stand and to walk: from its tree alone.

    Args:
        source: a URDF or xacro file.
        folder: where to; it appears at once, when everything is in it.
        options: of the import; the base floats unless they say otherwise.
        force: replace what was made before.

    Returns:
        what was found and assumed, and what the robot can do. The parts that could be done are there even so.

    Raises:
        InvalidModel: a defect that no import can repair.
        OutputError: the folder cannot be written.
    """
    source, folder = robot_file(source, "source"), as_path(folder, "folder")
    options = options or ImportOptions()
    if options.base == "auto":
        options = options.model_copy(update={"base": "floating"})
    made = Made(folder)
    with filled_at_once(folder, marker=REPORT, force=force) as work:
        robot = write_robot(source, work, options, ImportReport(source))
        made.name = robot.name
        try:
            _Making(work, robot, made).run()
        except SimrobError as problem:
            made.problem = str(problem)
            if not (work / STAND).is_file():
                (work / STAND).write_text(draft_station(robot.urdf_path, folder=work), encoding="utf-8")
        save_report(made, work)
    return made


@dataclass(frozen=True)
class _Standing:
    """A stance, its soles and its build."""

    stance: Stance
    soles: list[FootSole]
    build: Build


class _Making:
    """One robot's way from its tree to its walk."""

    def __init__(self, work: Path, robot: RobotModel, made: Made) -> None:
        """Look at a robot that was written into a folder."""
        self._work, self._robot, self._made = work, robot, made
        self._clearance = at_home(robot)
        self._own = self._clearance.station.robots[ONLY_ROBOT]
        self._stances = Stances(self._clearance, self._own)

    def run(self) -> None:
        """Write all that can be, and try it.

        Raises:
            SimrobError: why not all could be.
        """
        anatomy, made = anatomy_of(self._clearance, self._own), self._made
        made.found += list(_described(anatomy))
        models = EXAMPLES.get(min(len(anatomy.legs), 4), ())
        count = len(anatomy.legs)
        ways = [self._standing(anatomy, part) for part in _BENT[count]]
        good = [way for way in ways if way is not None]
        if not good:
            raise SimrobError(f"{self._robot.name} has no posture in which it stands. {self._stances.lacking}")
        first = good[0]
        names = write_soles(self._robot.urdf_path, anatomy, first.soles)
        made.found += [_soles_text(first)]
        self._write(anatomy, first, names, models[0], 1.0)
        made.attempts.append(attempt(self._work / STAND, TRIALS[0]))
        best: tuple[float, Attempt, tuple[Any, ...]] | None = None
        for part, stiffer, way, model in product(_PARTS, _STIFFER, good, models):
            speed = self._write(anatomy, way, names, model, stiffer, part)
            tried = attempt(self._work / WALK, TRIALS[3], speed)
            worth = tried.ahead if tried.done else -1.0 / (1.0 + (tried.result.stop_time if tried.result else 0.0))
            if best is None or worth > best[0]:
                best = worth, tried, (way, model, stiffer, part)
            if tried.done or tried.result is None:
                break
        assert best is not None
        way, model, stiffer, part = best[2]
        self._write(anatomy, way, names, model, stiffer, part)
        made.assumed += list(_assumed(way, model, stiffer, part))
        if best[1].result is not None:
            made.attempts += [attempt(self._work / WALK, trial) for trial in TRIALS[1:3]]
        made.attempts.append(best[1])
        if not best[1].done:
            raise SimrobError(f"{self._robot.name} does not walk: it {best[1].outcome}")

    def _standing(self, anatomy: Anatomy, part: float) -> _Standing | None:
        """Return how a robot stands with its legs bent to a part of their length; None if it cannot."""
        for stance in self._stances.bent([limb.leg for limb in anatomy.legs], (part,)):
            if len(anatomy.legs) > 2 or not anatomy.has_soles or anatomy.knees_ahead(stance.posture):
                soles = soles_of(anatomy, stance)
                return _Standing(stance, soles, build_of(anatomy, stance, soles))
        return None

    def _write(
        self, anatomy: Anatomy, way: _Standing, names: list[str], model: Example, stiffer: float, part: float = 1.0
    ) -> float:
        """Write robot, gait and stations; return the speed that is asked for [m/s]."""
        robot, stance, build = self._robot, way.stance, way.build
        signs = anatomy.signs(stance.posture)
        units = np.where(robot.prismatic, 1.0, np.rad2deg(1.0)) * signs
        posture = {
            name: round(float(q), 3) + 0.0 for name, q in zip(anatomy.names, units * stance.posture, strict=True)
        }
        axes = {
            name: {
                "joint": axis.joint,
                "sign": axis.sign * sign,
                **({"aliases": [axis.joint]} if name != axis.joint else {}),
            }
            for name, axis, sign in zip(anatomy.names, robot.axes.values(), signs, strict=True)
        }
        servo = {key: float(f"{value * stiffer:.3g}") for key, value in gains(build, model).items()}
        feet = {limb.foot: name for limb, name in zip(anatomy.legs, names, strict=True)}
        description = {
            "description": f"{robot.name}, {len(anatomy.legs)} legs of {len(anatomy.legs[0].leg.axes)} joints",
            "source": robot.urdf,
            "urdf": robot.urdf,
            "base": "floating",
            "root": robot.root,
            "axes": axes,
            "tools": {**feet, **{tool: link for tool, link in robot.tools.items() if tool not in feet}},
            "home_deg": posture,
            "servo": servo,
            "feet": feet_section(way.soles, names, build.load / build.height**2),
        }
        walk = walk_of(build, model, height=stance.height, groups=anatomy.groups, posture=posture)
        speed = asked_speed(walk, part)
        station: dict[str, Any] = {
            "description": f"{robot.name} stands",
            "robot": {
                "model": ROBOT_FILE,
                "base": [0.0, 0.0, round(stance.height, 5), 0.0, 0.0, 0.0],
                "initial_deg": posture,
            },
            "servo": {"realization": "implicit", **servo},
            "inputs": ["reference_velocity"],
            "floor": {"size": 8},
            "contact": {"model": "point"},
            "monitors": {"fall": {"height": round(_FALLEN * stance.height, 3), "tilt_deg": _TILT}},
            "solver": _STEP,
            "duration": 10.0,
        }
        loop = {"walk": {"kind": "walk", "commands": [{"time": 0.5, "ahead": speed}]}}
        facing = round(float(np.rad2deg(anatomy.facing)), 3)
        self._yaml(ROBOT_FILE, description)
        self._yaml(GAITS_FILE, {"facing_deg": facing, REACTING: walk})
        self._yaml(STAND, {**station, "inputs": [], "reference": {"kind": "hold"}})
        self._yaml(WALK, {**station, "description": f"{robot.name} walks by commands", "controllers": loop})
        return speed

    def _yaml(self, name: str, content: Mapping[str, Any]) -> None:
        text = yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
        (self._work / name).write_text(text, encoding="utf-8")


def _described(anatomy: Anatomy) -> Iterator[str]:
    """Yield what was seen of the limbs, in words."""
    for limb in anatomy.legs:
        axes = [f"{anatomy.names[axis]} ({anatomy.robot.axes[axis]})" for axis in limb.leg.axes]
        yield f"{limb.name} leg to {limb.leg.foot.name()}: {', '.join(axes)}"
    yield f"it looks {round(float(np.rad2deg(anatomy.facing)), 1):g} deg from the x axis of {anatomy.robot.model.root}"
    for arm in anatomy.arms:
        yield f"arm: {', '.join(anatomy.names[axis] for axis in arm)}"
    if anatomy.head:
        yield f"head and trunk: {', '.join(anatomy.names[axis] for axis in anatomy.head)}"


def _soles_text(way: _Standing) -> str:
    sole, build = way.soles[0], way.build
    kind = f"soles of {build.sole[0]:.3f} x {build.sole[1]:.3f} m between spheres" if sole.flat else "balls"
    return f"feet: {kind} of radius {sole.radius * 1e3:.1f} mm, {build.spread:.3f} m apart"


def _assumed(way: _Standing, model: Example, stiffer: float, part: float) -> Iterator[str]:
    """Yield what was made up, in words."""
    yield f"posture: {way.stance.how}"
    yield f"walk: figures of {model.name}, scaled by {way.build.height / model.build.height:.2f} in length"
    yield f"servos: {stiffer * model.stiffness:.3g} times m g h a radian on all axes, damped over {0.14:g} sqrt(h / g)"
    if part < 1:
        yield f"speed: {part:g} of what such a robot would be asked for; it fell faster"
