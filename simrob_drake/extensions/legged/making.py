"""From a robot's tree to a robot that walks: a folder with its description, its gait, its stations and a report."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.folders import filled_at_once
from simrob_drake.base.messages import compound, message
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.legged.anatomy import Anatomy, anatomy_of
from simrob_drake.extensions.legged.report import (
    REPORT,
    TRIALS,
    Attempt,
    Made,
    attempt,
    attempt_climb,
    attempt_kick,
    reason_of,
    save_report,
)
from simrob_drake.extensions.legged.root_frame import height_of_hips, is_root_low, raise_root_frame
from simrob_drake.extensions.legged.scaling import (
    EXAMPLES,
    LAG,
    Build,
    Example,
    asked_speed,
    build_of,
    climb_of,
    gains,
    kick_of,
    walk_of,
)
from simrob_drake.extensions.legged.soles import FootSole, feet_section, soles_of, write_soles
from simrob_drake.importer.importing import write_robot
from simrob_drake.importer.robot_files import robot_file
from simrob_drake.programs.gaits.biped import Kick
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.programs.gaits.legs import ROWS
from simrob_drake.programs.gaits.motion import Gait
from simrob_drake.robots.catalog import RobotModel, load_robot_file
from simrob_drake.robots.gaits_file import GAITS_FILE
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.stations.draft import at_home, draft_station
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.stances import Stance, Stances
from simrob_drake.walking.parameters import REACTING

STAND, WALK = "standing.yaml", "walking.yaml"
_BENT = {2: (0.9, 0.85, 0.8), 4: (0.78, 0.7, 0.85, 0.9), 6: (0.78, 0.7, 0.85, 0.6)}
"""Parts of their length to which legs are bent, by their number, in the order of trial."""
_PARTS = 1.0, 0.5, 0.25  # of the speed that a first walk is asked for
_WAYS = 2  # of standing, that are tried for walking
_STIFFER = 1.0, 2.0  # factors of the gains
_SLOWER = (
    1.25,
    1.5,
    2.0,
)  # factors of the time of a step, tried where joints are faster than their motors
_INWARD = (
    0.5,
    0.25,
    0.75,
    1.0,
)  # parts of how far the weight stays inside in the walk, that are tried for a kick
_FALLEN, _TILT = 0.55, 60.0  # part of the height of the root, deg
_STEP: dict[str, Any] = {
    "kind": "continuous", "scheme": "cenic", "accuracy": 1.0e-3, "max_step": 0.01, "error_control": False,
}  # fmt: skip


def make_legged(
    source: Path | str,
    folder: Path | str,
    options: ImportOptions | None = None,
    *,
    force: bool = False,
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
        report = ImportReport(source)
        robot = write_robot(source, work, options, report)
        if robot.links_without_inertia:
            estimates = ImportReport(source)
            robot = write_robot(
                source, work, options.model_copy(update={"estimate_inertia": True}), estimates
            )
            known = {(entry.element, entry.text) for entry in report.entries}
            new = [entry for entry in estimates.entries if (entry.element, entry.text) not in known]
            made.assumed.extend(
                compound("{element}: {entry}", element=entry.element, entry=entry.text)
                for entry in new
            )
        made.name = robot.name
        try:
            if robot.feet is not None:
                what = message(
                    "legged.own_feet",
                    "{robot} has feet of its own in the {file} beside {source}",
                    robot=robot.name,
                    file=ROBOT_FILE,
                    source=source.name,
                )
                remedy = message(
                    "legged.feet_from_urdf",
                    "here they are found from the URDF alone: give it in a folder without that file",
                )
                raise SimrobError(compound("{what}; {remedy}", what=what, remedy=remedy))
            _Making(work, robot, made).run()
        # What was made until here is kept, with the reason, whatever the error is: Drake raises many classes.
        except Exception as problem:
            made.problem = reason_of(problem) + _shapes_lost(report)
            if not (work / STAND).is_file():
                (work / STAND).write_text(
                    draft_station(robot.urdf_path, folder=work), encoding="utf-8"
                )
        made.rename_folder(work, folder)
        save_report(made, work)
    return made


def _shapes_lost(report: ImportReport) -> str:
    """Return which shapes to touch with an import has dropped, which may be why a robot cannot stand; '' without."""
    lost = [entry for entry in report.of("dropped") if "<collision>" in entry.element]
    return (
        message(
            "legged.shapes_not_read",
            "; {count} collision shapes were not read, the first: {element}: {text}",
            count=len(lost),
            element=lost[0].element,
            text=lost[0].text,
        )
        if lost
        else ""
    )


class _Standing(NamedTuple):
    """A stance, its soles and its build."""

    stance: Stance
    soles: list[FootSole]
    build: Build


class _Choice(NamedTuple):
    """One choice that is tried: a posture, the walk of an example, and how that walk is changed."""

    way: _Standing
    example: Example
    stiffer: float = 1.0
    part: float = 1.0
    quick: bool = False
    slower: float = 1.0  # factor of the time of a step


def _anatomy(robot: RobotModel) -> Anatomy:
    """Find the limbs of a robot; raises SimrobError if it has no legs."""
    clearance = at_home(robot)
    return anatomy_of(clearance, clearance.station.robots[ONLY_ROBOT])


class _Making:
    """One robot's way from its tree to its walk."""

    def __init__(self, work: Path, robot: RobotModel, made: Made) -> None:
        """Find the limbs of a robot that was written into a folder.

        Raises:
            SimrobError: it has no legs.
        """
        self._work, self._made = work, made
        self._anatomy = _anatomy(robot)
        if is_root_low(self._anatomy):
            height = height_of_hips(self._anatomy)
            raise_root_frame(robot.urdf_path, height)
            made.found.append(
                message(
                    "legged.root_raised",
                    "the frame of the root {root} is {height:.3f} m below the hips in the source; here it is level "
                    "with them",
                    root=robot.root,
                    height=height,
                )
            )
            robot = load_robot_file(work / ROBOT_FILE)
            self._anatomy = _anatomy(robot)
        self._robot = robot
        self._stances = Stances(self._anatomy.clearance, self._anatomy.robot)
        self._soles = list[str]()

    def run(self) -> None:
        """Write all that can be, and try it; raises SimrobError: why not all could be."""
        anatomy, made, name = self._anatomy, self._made, self._robot.name
        made.found += list(_anatomy_texts(anatomy))
        examples, count = EXAMPLES[min(len(anatomy.legs), 4)], len(anatomy.legs)
        ways = [way for part in _BENT[count] if (way := self._standing(part)) is not None]
        if not ways:
            raise SimrobError(
                message(
                    "legged.no_posture",
                    "{name} has no posture in which it stands. {lacking}",
                    name=name,
                    lacking=self._stances.lacking,
                ).strip()
            )
        self._soles = write_soles(self._robot.urdf_path, anatomy, ways[0].soles)
        made.found += [_mass_text(ways[0].build), _soles_text(ways[0])]
        stands = self._first(
            [_Choice(way, examples[0], stiffer) for stiffer, way in product(_STIFFER, ways)],
            TRIALS[0],
        )
        made.attempts.append(stands[0])
        choices = product(_PARTS, (False, True), _STIFFER, ways[:_WAYS], examples)
        tried = [_Choice(way, of, by, part, quick) for part, quick, by, way, of in choices]
        walks, choice = self._slow_enough(*self._first(tried, TRIALS[3]))
        made.assumed += list(_assumption_texts(choice))
        if walks.result is not None:
            made.attempts += [attempt(self._work / WALK, trial) for trial in TRIALS[1:3]]
        made.attempts.append(walks)
        if not walks.done:
            raise SimrobError(
                message(
                    "legged.does_not_walk",
                    "{name} does not walk: {outcome}",
                    name=name,
                    outcome=walks.outcome,
                )
            )
        build, walk = choice.way.build, read_yaml(self._work / GAITS_FILE)[REACTING]
        joints = len(anatomy.legs[0].leg.axes)
        if count == 2 and joints in ROWS:
            kicks = (
                kick_of(build, walk, inward, part) for part, inward in product(_PARTS[:2], _INWARD)
            )
            made.attempts.append(self._adds(Kick, kicks, attempt_kick))
        if (count == 2 and joints == 6 and choice.way.soles[0].flat) or (
            count == 4 and joints in ROWS
        ):
            step = partial(
                attempt_climb, height=build.height, facing_deg=float(np.rad2deg(anatomy.facing))
            )
            made.attempts.append(
                self._adds(Climb, (climb_of(build, walk, part) for part in _PARTS), step)
            )

    def _adds(
        self, kind: type[Gait], gaits: Iterable[dict[str, Any]], tried: Callable[[Path], Attempt]
    ) -> Attempt:
        """Add the first gait of a kind that the robot can do to its file; return what became of it, or of the last."""
        known = read_yaml(self._work / GAITS_FILE)
        for gait in gaits:
            self._yaml(GAITS_FILE, {**known, kind.section: {kind.usual: gait}})
            if (found := tried(self._work / STAND)).done:
                return found
        self._yaml(GAITS_FILE, known)
        return found

    def _standing(self, part: float) -> _Standing | None:
        """Return how the robot stands with its legs bent to a part of their length; None if it cannot."""
        anatomy = self._anatomy
        for stance in self._stances.bent_stances([limb.leg for limb in anatomy.legs], (part,)):
            if (
                len(anatomy.legs) > 2
                or not anatomy.has_soles
                or anatomy.knees_ahead(stance.posture)
            ):
                soles = soles_of(anatomy, stance)
                return _Standing(stance, soles, build_of(anatomy, stance, soles))
        return None

    def _first(self, choices: Sequence[_Choice], trial: str) -> tuple[Attempt, _Choice]:
        """Return the first choice with which a trial is passed, else that which came farthest; it is written."""
        tried = list[tuple[Attempt, _Choice]]()
        for choice in choices:
            tried.append((attempt(*self._write(choice, trial)), choice))
            if tried[-1][0].done or tried[-1][0].result is None:
                break
        best = max(tried, key=lambda one: (one[0].done, one[0].lasted, one[0].ahead))
        self._write(best[1], trial)
        return best

    def _slow_enough(self, walks: Attempt, choice: _Choice) -> tuple[Attempt, _Choice]:
        """Try slower steps for a walk whose joints turn faster than their motors can.

        Returns:
            the first walk with slower steps that the motors can follow, or else the given one, and its choice. It is
            written.
        """
        if not walks.done or walks.fastest is None or walks.fastest.share <= 1:
            return walks, choice
        for factor in _SLOWER:
            slower = choice._replace(slower=factor)
            found = attempt(*self._write(slower, TRIALS[3]))
            if found.done and found.fastest is not None and found.fastest.share <= 1:
                return found, slower
        self._write(choice, TRIALS[3])
        return walks, choice

    def _write(self, choice: _Choice, trial: str) -> tuple[Path, str, float]:
        """Write robot and gait, and the station of a trial; return that, the trial, and the speed asked for [m/s]."""
        anatomy, (way, example, stiffer, part, quick, slower) = self._anatomy, choice
        signs = anatomy.signs(way.stance.posture)
        units = np.where(self._robot.prismatic, 1.0, np.rad2deg(1.0)) * signs
        values = [round(float(value), 3) + 0.0 for value in units * way.stance.posture]
        posture = dict(zip(anatomy.names, values, strict=True))
        servo = {
            key: float(f"{value * stiffer:.3g}") for key, value in gains(way.build, example).items()
        }
        stands: Any = {"height": way.stance.height, "groups": anatomy.groups, "posture": posture}
        walk = walk_of(way.build, example, **stands, quick=quick)
        walk["step_time"] = float(f"{slower * walk['step_time']:.3g}")
        speed = asked_speed(walk, part)
        own = {
            "servo": servo,
            "feet": feet_section(way.soles, self._soles, way.build.load / way.build.height**2),
        }
        self._yaml(ROBOT_FILE, {**self._description(signs), "home_deg": posture, **own})
        self._yaml(
            GAITS_FILE, {"facing_deg": round(float(np.rad2deg(anatomy.facing)), 3), REACTING: walk}
        )
        station = self._station(way.stance.height, posture, servo)
        if trial == TRIALS[0]:
            return self._yaml(STAND, {**station, "reference": {"kind": "hold"}}), trial, speed
        loop = {"walk": {"kind": "walk", "commands": [{"time": 0.5, "ahead": speed}]}}
        station |= {
            "description": f"{self._robot.name} walks by commands",
            "inputs": ["reference_velocity"],
        }
        return self._yaml(WALK, {**station, "controllers": loop}), trial, speed

    def _description(self, signs: Sequence[int]) -> dict[str, Any]:
        """Return what of ``robot.yaml`` does not depend on how the robot stands."""
        robot, anatomy = self._robot, self._anatomy
        axes = dict[str, Any]()
        for name, axis, sign in zip(anatomy.names, robot.axes.values(), signs, strict=True):
            aliases = {"aliases": [axis.joint]} if name != axis.joint else {}
            axes[name] = {"joint": axis.joint, "sign": axis.sign * sign, **aliases}
        feet = {limb.foot: name for limb, name in zip(anatomy.legs, self._soles, strict=True)}
        return {
            "description": f"{robot.name}, {len(anatomy.legs)} legs of {len(anatomy.legs[0].leg.axes)} joints",
            "urdf": robot.urdf,
            "base": "floating",
            "root": robot.root,
            "axes": axes,
            "tools": {
                **feet,
                **{tool: link for tool, link in robot.tools.items() if tool not in feet},
            },
        }

    def _station(
        self, height: float, posture: Mapping[str, float], servo: Mapping[str, float]
    ) -> dict[str, Any]:
        """Return a station in which the robot stands in a posture [deg], watched by a monitor."""
        base = [0.0, 0.0, round(height, 5), 0.0, 0.0, 0.0]
        return {
            "description": f"{self._robot.name} stands",
            "robot": {"model": ROBOT_FILE, "base": base, "initial_deg": dict(posture)},
            "servo": {"realization": "implicit", **servo},
            "floor": {"size": 8},
            "contact": {"model": "point"},
            "monitors": {"fall": {"height": round(_FALLEN * height, 3), "tilt_deg": _TILT}},
            "solver": _STEP,
            "duration": 10.0,
        }

    def _yaml(self, name: str, content: Mapping[str, Any]) -> Path:
        text = yaml.safe_dump(
            dict(content), sort_keys=False, allow_unicode=True, width=110, default_flow_style=None
        )
        (self._work / name).write_text(text, encoding="utf-8")
        return self._work / name


def _anatomy_texts(anatomy: Anatomy) -> Iterator[str]:
    """Yield a text for each limb that was found in the tree, and one for the direction of the front."""
    for limb in anatomy.legs:
        axes = [f"{anatomy.names[axis]} ({anatomy.robot.axes[axis]})" for axis in limb.leg.axes]
        yield message(
            "legged.leg",
            "leg {name} to {foot}: {axes}",
            name=limb.name,
            foot=limb.leg.foot.name(),
            axes=", ".join(axes),
        )
    yield message(
        "legged.facing",
        "its front is at {angle:g} deg from the x axis of {root}",
        angle=round(float(np.rad2deg(anatomy.facing)), 1),
        root=anatomy.robot.model.root,
    )
    for arm in anatomy.arms:
        yield message("legged.arm", "arm: {axes}", axes=_axis_names(anatomy, arm))
    if anatomy.head:
        yield message(
            "legged.head", "head and trunk: {axes}", axes=_axis_names(anatomy, anatomy.head)
        )


def _axis_names(anatomy: Anatomy, axes: Iterable[int]) -> str:
    """List the names that the robot's axes get, by their indices."""
    return ", ".join(anatomy.names[axis] for axis in axes)


def _mass_text(build: Build) -> str:
    """Mass of the robot and the height of its centre of mass, in words."""
    return message(
        "legged.mass",
        "mass: {mass:.3g} kg; as it stands, its centre of mass is {height:.3f} m above the ground",
        mass=build.mass,
        height=build.height,
    )


def _soles_text(way: _Standing) -> str:
    sole, build = way.soles[0], way.build
    radius = sole.radius * 1e3
    if not sole.flat:
        return message(
            "legged.ball_feet",
            "feet: balls of radius {radius:.1f} mm, {spread:.3f} m apart",
            radius=radius,
            spread=build.spread,
        )
    return message(
        "legged.sole_feet",
        "feet: soles of {length:.3f} x {width:.3f} m with spheres of radius {radius:.1f} mm at the corners, "
        "{spread:.3f} m apart",
        length=build.sole[0],
        width=build.sole[1],
        radius=radius,
        spread=build.spread,
    )


def _assumption_texts(choice: _Choice) -> Iterator[str]:
    """Yield a text for each choice that the tree does not determine: posture, walk, servos, and changes of the walk."""
    (stance, _, build), example, stiffer, part, quick, slower = choice
    yield message("legged.posture", "posture: {how}", how=stance.how)
    yield message(
        "legged.walk_of",
        "walk: that of {example}, its lengths multiplied by {scale:.2f}",
        example=example.name,
        scale=build.height / example.build.height,
    )
    yield message(
        "legged.servos",
        "servos: stiffness {stiffness:.3g} m g h per radian on all axes, damping over {lag:g} sqrt(h / g)",
        stiffness=stiffer * example.stiffness,
        lag=LAG,
    )
    if quick:
        yield message(
            "legged.quick_steps",
            "steps: as quick and as low as those of the smaller robot, since it fell with longer ones",
        )
    if slower > 1:
        yield message(
            "legged.step_time",
            "step time: {slower:g} times as long as scaled; with shorter steps joints were faster than their motors",
            slower=slower,
        )
    if part < 1:
        yield message(
            "legged.walk_speed",
            "speed: {part:.0%} of that of the scaled walk; at higher speeds the robot fell",
            part=part,
        )
