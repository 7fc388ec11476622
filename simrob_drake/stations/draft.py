"""Draft of a first station for a robot of which only its own file is known, such as a URDF.

The draft is the text of a YAML file. Its content is a mapping: the sections of the station by their keys. The functions
here complete this content step by step, simulate the station for a moment, and return remarks. Remarks are sentences
for the user: what was chosen, tried and found. They become comments at the top of the file.

A *posture* gives the positions of the robot's n axes, in rad or m. The *user's units* of the file are degrees, or
metres for a prismatic axis. A *follower* is an axis that a coupling moves along with another one, its leader. A
*passive* axis has no motor. A *kinematic* station moves its robot exactly along the reference, a *dynamic* one by
forces.
"""

import shlex
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message, translate
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.importer.gains import gains_of
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.importer.named_robots import read_robot
from simrob_drake.importer.robot_files import robot_file
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.stations.clear_start import ClearStart
from simrob_drake.stations.clearance import Clearance
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.coupled import follower_key
from simrob_drake.stations.draft_trials import gets_through, stands
from simrob_drake.stations.import_findings import estimated_inertias, import_findings
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.loops import LoopsOfRobot
from simrob_drake.stations.plausibility import plausibility_findings
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.stances import Stance, Stances

_MOVE = 1.5  # duration of the first move [s]
_DURATION = 3.0  # duration of the run [s]
_FINGER_MOVE = 1.0  # least duration of closing and of opening fingers [s]
_FINGER_MARGIN = 2.0  # by which that time exceeds what a finger needs at its largest speed: smooth moves peak at 1.9
# Share of their travel at which closing fingers stop, so that they do not press on each other.
_FINGER_GAP = 0.1
# Travel of each motor in the first move of a robot with closed loops.
_LOOP_ANGLE = np.deg2rad(10.0)  # [rad]
_LOOP_DISTANCE = 0.01  # [m]
_TRIALS = 4  # count of stances that are tried

# Monitor of a robot on its feet: it has fallen if its root is lower than this share of its first height, or leans more.
_FALLEN_SHARE = 0.6
_FALLEN_LEAN_DEG = 40.0  # [deg]

# Options of the command line that may be given several times.
_REPEATED_OPTIONS = ("mesh_path", "packages", "xacro_arg")
# Keys of a station that say where its robot comes from.
_ORIGINS = ("urdf", "model", "import_options")

# Sections of drafted stations: the solver of an arm, and that of an arm for which it takes too long.
_CONTINUOUS: dict[str, Any] = {
    "kind": "continuous",
    "scheme": "radau3",
    "accuracy": 1e-2,
    "max_step": 0.1,
}
_DISCRETE: dict[str, Any] = {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}
# Sections of a station whose robot has fingers: surfaces in contact hold a part more steadily than points.
_WITH_FINGERS: dict[str, Any] = {
    "contact": {"model": "hydroelastic", "friction": {"static": 0.5, "dynamic": 0.5}},
    "solver": {"kind": "discrete", "scheme": "lagged", "time_step": 5e-3},
}
# Sections of a station whose robot stands on its feet.
_ON_FEET: dict[str, Any] = {
    "reference": {"kind": "hold"},
    "floor": {"size": 3},
    "contact": {"model": "point"},
    "solver": {"kind": "discrete", "scheme": "sap", "time_step": 2e-3},
}


def draft_station(
    urdf: Path | str,
    options: ImportOptions | None = None,
    *,
    folder: Path | str | None = None,
) -> str:
    """Write the YAML text of a first station for a robot.

    A robot with a fixed base starts clear of the floor and of itself if such a start is found, and moves its joints a
    little way under joint torque, in continuous time if a trial run gets to its end quickly enough, otherwise in
    discrete steps. If it has fingers, a program closes and opens them after this move, in discrete steps. If it has
    closed kinematic loops, it begins in a posture that closes them, which is not checked for collisions, and moves in
    discrete steps. A robot with a floating base is put on its feet in a posture in which it stands in a trial run, if
    one is found; a monitor ends the run if it falls. The root of an imported robot without collision shapes, on which
    it could stand, is fixed. A robot with moving links without inertia moves kinematically. Comments in the file list
    what was checked, tried and found.

    Args:
        urdf: the robot's file: a URDF, raw or imported, or a YAML file that describes the robot, such as one with a
            table of Denavit-Hartenberg parameters.
        options: options of the import, which are written into the station. A robot of a YAML file has none.
        folder: folder in which the station's file will be. The path of the robot's file is relative to it if the file
            is inside.

    Raises:
        SimrobError: there is no such robot, or its file has a defect.
        InvalidParameter: an argument is no path, or no posture within the limits closes the robot's kinematic loops.
        Unsuitable: options are given for a YAML file, or a YAML file describes a robot with a floating base that has no
            collision shapes.
    """
    file = robot_file(urdf, "urdf")
    own_folder = None if folder is None else as_path(folder, "folder")
    is_description = is_yaml_name(file)
    if is_description and options is not None:
        raise Unsuitable(
            "options",
            message(
                "stations.describes_a_robot",
                "{file} describes a robot and is not imported, so options of an import have no effect",
                file=file.name,
            ),
        )
    robot = read_robot(file, options)
    remarks = list[str]()
    if is_description:
        _check_floating_base(robot, file)
    elif _falls_through(robot):
        # Imported again, with a fixed root in place of the floating one.
        options = (options or ImportOptions()).model_copy(update={"base": "fixed"})
        robot = robot_from_file(file, options)
        reason = message(
            "stations.drafted_unshaped",
            "The root is fixed, since the robot has no collision shapes on which it could stand.",
        )
        remarks.append(reason)

    is_kinematic = bool(robot.links_without_inertia)
    section: dict[str, Any] = {"model" if is_description else "urdf": _path_text(file, own_folder)}
    if options is not None:
        section["import_options"] = options.model_dump(mode="json", exclude_defaults=True)
    content: dict[str, Any] = {
        "description": f"{robot.name}: first station",
        "mode": "kinematic" if is_kinematic else "dynamic",
        "robot": section,
    }
    if robot.followers:
        content["couplings"] = _couplings(robot)
    remarks += _remarks_on_axes(robot)
    remarks += _import_warnings(robot, content, file)
    estimated = estimated_inertias(robot, file)
    if estimated is not None:
        remarks.append(compound("{text}.", text=estimated.as_sentence()))
    # A robot with links without inertia can only be moved kinematically, whatever base and loops it has.
    if is_kinematic:
        remarks += _complete_with_fixed_base(robot, content)
    elif robot.base == "floating":
        remarks += _complete_on_feet(robot, content)
    elif robot.loops:
        remarks += _complete_with_loops(robot, content)
    else:
        remarks += _complete_with_fixed_base(robot, content)

    header = _header(robot, file, options) if is_kinematic else [_FIRST_LINE]
    # Comments are in the language of the output: a user reads them on the screen and in the file.
    comments = "".join(f"# {translate(remark)}\n" for remark in (*header, *remarks))
    text = yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None
    )
    return comments + text


def _falls_through(robot: RobotModel) -> bool:
    """Whether a robot has a free base but no collision shapes, so that nothing could carry it in a dynamic station."""
    has_shapes = robot.element.find("link/collision") is not None
    is_dynamic = not robot.links_without_inertia
    return robot.base == "floating" and is_dynamic and not has_shapes


def _remarks_on_axes(robot: RobotModel) -> list[str]:
    """Write remarks on axes that follow others, and on axes without a motor in a dynamic station.

    The list is empty if there are no such axes.
    """
    remarks = list[str]()
    if robot.followers:
        coupled = message(
            "stations.drafted_followers",
            "In the robot's file these axes follow others; see the section couplings: {followers}.",
            followers=", ".join(robot.followers),
        )
        remarks.append(coupled)
    is_kinematic = bool(robot.links_without_inertia)
    if robot.passive_axes and not is_kinematic:
        without_motor = message(
            "stations.drafted_without_motor",
            "In the robot's file these axes have no motor: {axes}. To give them motors, add `passive: "
            "[]` and their `torque_limit` to servo.",
            axes=", ".join(robot.passive_axes),
        )
        remarks.append(without_motor)
    return remarks


def _check_floating_base(robot: RobotModel, file: Path) -> None:
    """Check that a robot of a YAML file whose base is floating has something to stand on.

    The base of an imported robot is fixed in this case, but that of a described robot is the user's choice.

    Raises:
        Unsuitable: nothing could carry the robot.
    """
    if _falls_through(robot):
        raise Unsuitable(
            compound("{file}: {key}", file=file.name, key="base"),
            message(
                "stations.floating_unshaped",
                "the base is floating, but no link has a collision shape to stand on",
            ),
            message(
                "stations.give_shapes_or_fix",
                "give the feet collision shapes, or write base: fixed",
            ),
        )


def _path_text(file: Path, folder: Path | None) -> str:
    """Write the path of a robot's file, relative to the folder of the station's file if it is inside of this folder."""
    if folder is not None and file.is_relative_to(folder.resolve()):
        return str(file.relative_to(folder.resolve()))
    return str(file)


def _couplings(robot: RobotModel) -> dict[str, Any]:
    """Make the content of the section ``couplings``: a gear for each axis that follows another axis.

    The equation of such a gear is 1 follower - factor leader = total, with the total in rad or m, as gears have it, and
    not in degrees.
    """
    couplings = dict[str, Any]()
    for axis, follower in robot.followers.items():
        couplings[follower_key(axis)] = {
            "kind": "gear",
            # Nine digits keep the file readable, and adding 0.0 turns -0.0 into 0.0.
            "ratios": {
                name: float(f"{ratio:.9g}") for name, ratio in follower.ratios(axis).items()
            },
            "total": float(f"{follower.offset:.9g}") + 0.0,
        }
    return couplings


def _import_warnings(
    robot: RobotModel,
    content: Mapping[str, Any],
    file: Path,
) -> list[str]:
    """Find mechanics of the robot's file that the station does not simulate, and implausible numbers of the robot.

    Args:
        robot: the robot.
        content: content of the station as far as it is complete.
        file: the robot's file.

    Returns:
        a remark for each warning.
    """
    # The checks need the mode and the couplings. They do not depend on the posture: `_home` is within the limits, so
    # that every station accepts it.
    sections = {key: content[key] for key in ("mode", "couplings") if key in content}
    station = resolve(_config(robot, {**sections, "robot": {"initial_deg": _home(robot)}}))
    findings = import_findings(station.config, station.robots[ONLY_ROBOT], source=file)
    findings += plausibility_findings(station.config, station)
    return [
        message("stations.drafted_warning", "Warning: {text}", text=finding.text)
        for finding in findings
        if finding.level == "warning"
    ]


def _complete_with_fixed_base(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Complete the content of a station whose robot is held by its root, or is kinematic. Returns remarks.

    Args:
        robot: the robot.
        content: content of the station, which is changed. The sections that follow from the robot alone are there.
    """
    is_kinematic = content["mode"] == "kinematic"
    if not is_kinematic:
        content["servo"] = _servo(robot, "per_joint")
    content["floor"] = {"size": 3}
    config_at_home = _config(robot, {**content, "robot": {"initial_deg": _home(robot)}})
    # Contacts of links at home count here: the search judges the home posture itself.
    clearance = Clearance(config_at_home, trusts_home=False)
    search = ClearStart(
        clearance, clearance.station.robots[ONLY_ROBOT], _MOVE, torque=not is_kinematic
    )
    start = search.find()
    height = round(start.height, 4)
    if height > 0:
        content["robot"]["base"] = [0.0, 0.0, height, 0.0, 0.0, 0.0]
    _set_initial_posture(robot, content, start.posture)
    # A number for all axes, or a mapping by axis, which is empty if all axes are passive or followers.
    target = _targets_of_motors(robot, _in_user_units(robot, start.target))
    has_target = target != {}
    # The target is the posture itself if no move from it is clear.
    content["reference"] = {"kind": "hold"}
    if has_target and (start.target != start.posture).any():
        content["reference"] = {"kind": "move", "target_deg": target, "duration": _MOVE}
    content["duration"] = _DURATION
    remarks = list(start.remarks)
    if is_kinematic:
        return remarks
    if robot.fingers:
        return remarks + _complete_fingers(robot, content)
    return remarks + _complete_arm(robot, content)


def _complete_arm(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Add the servo's model terms and the solver to the content of an arm's station. Returns remarks.

    The solver is continuous if it suits the station (see `gets_through`), otherwise discrete.
    """
    # Without a feedforward, each joint sags by its weight over its gain.
    content["servo"]["feedforward"] = "gravity"
    # Without a desired velocity, the damping of the servos delays the motion.
    content["inputs"] = ["reference_velocity"]
    content["solver"] = _CONTINUOUS
    if gets_through(_config(robot, content)):
        return []
    content["solver"] = _DISCRETE
    # Servos as blocks act once a step, which makes stiff ones unstable.
    content["servo"]["realization"] = "implicit"
    text = message(
        "stations.drafted_discrete",
        "The solver is discrete: radau3 would need too many steps here, most likely since some links are very light.",
    )
    return [text]


def _complete_with_loops(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Complete the content of a station whose robot has closed kinematic loops. Returns remarks.

    Couplings close the loops. Passive are the axes that the loops move, and those without a motor in the robot's file.
    So at most as many axes have motors as the loops leave free.

    Args:
        robot: a robot with at least one loop.
        content: content of the station, which is changed.

    Raises:
        InvalidParameter: no posture closes the loops.
    """
    loops = LoopsOfRobot(robot)
    posture = loops.closed_posture()
    without_motor = np.flatnonzero(robot.passive).tolist()
    passive = sorted({*loops.passive_axes(posture), *without_motor})  # indices
    content.setdefault("couplings", {}).update(robot.loops)
    content["servo"] = _servo(robot, "implicit")
    # The servo of an axis that the loops move gets gains of zero, even if the axis has a motor in the robot's file.
    gains = gains_of(robot)
    for key, values in (("kp", gains.kp), ("kd", gains.kd)):
        values[passive] = 0.0
        content["servo"][key] = _of_motors(robot, values)
    # Discrete solvers hold couplings of bodies as constraints; a continuous one would need very stiff springs.
    content["solver"] = _DISCRETE
    _set_initial_posture(robot, content, posture)

    travel = np.where(robot.prismatic, _LOOP_DISTANCE, _LOOP_ANGLE)
    target = np.clip(posture + travel, *robot.axis_limits)
    target_deg = _by_axis(robot, _in_user_units(robot, target))
    names_of_passive = [list(robot.axes)[index] for index in passive]
    for name in names_of_passive:
        del target_deg[name]  # the loops take a passive axis along
    content["reference"] = {"kind": "move", "target_deg": target_deg, "duration": _MOVE}
    content["duration"] = _DURATION
    return [
        message(
            "stations.drafted_loops",
            "These couplings close the kinematic loops: {loops}.",
            loops=", ".join(robot.loops),
        ),
        message(
            "stations.drafted_passive",
            "These axes have no motor: {axes}.",
            axes=", ".join(names_of_passive),
        ),
    ]


def _complete_fingers(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Couple fingers, set servos and contact so that they hold parts by friction, and add a first program.

    The first finger leads the others. A gear makes each other finger move by the same share of its own travel. There is
    no such gear for fingers that the robot's file couples already.

    The program replaces the reference: the arm goes to the target of the reference if it has one, then the fingers
    close almost, and open again. The reference becomes ``hold``.

    Args:
        robot: a robot with fingers.
        content: content of the station with the sections ``servo`` and ``reference``; it is changed.

    Returns:
        remarks for the user.
    """
    leader, *others = robot.fingers
    # Travel of each finger between its ends [rad or m], by the index of its axis.
    travels = {index: ends[1] - ends[0] for index, ends in robot.fingers.items()}
    axes = list(robot.axes)
    content["servo"] |= {"realization": "implicit", "feedforward": "inverse_dynamics"}
    couplings = content.setdefault("couplings", {})
    for index in others:
        finger = axes[index]
        # Fingers that mimic other axes in the robot's file are coupled already.
        if finger in robot.followers or axes[leader] in robot.followers:
            continue
        # The gear keeps position - travel / (travel of the leader) * (position of the leader) constant. Without its key
        # `total`, the constant is the value in the initial posture.
        ratio = float(f"{-travels[index] / travels[leader]:.6g}")
        couplings[follower_key(finger)] = {
            "kind": "gear",
            "ratios": {finger: 1.0, axes[leader]: ratio},
        }
    content |= _WITH_FINGERS
    content["program"] = {"moves": _first_moves(robot, content.pop("reference"))}
    content["reference"] = {"kind": "hold"}
    holding = message(
        "stations.drafted_fingers",
        "Couplings move the fingers ({fingers}) together, as one motor does. Hydroelastic contact "
        "and the solver lagged hold pieces by friction.",
        fingers=", ".join(axes[index] for index in robot.fingers),
    )
    gripping = message(
        "stations.drafted_grip",
        "In the program, `grip: {{force: 20}}` [N] grips a piece, and `open: {{}}` releases it; see "
        "docs/arms.md.",
    )
    remarks: list[str] = [holding, gripping]
    if any(robot.prismatic):
        sliding = message(
            "stations.drafted_sliding",
            "These axes are prismatic, so their values under target_deg and initial_deg are in metres: {axes}.",
            axes=", ".join(np.array(axes)[np.array(robot.prismatic)]),
        )
        remarks.append(sliding)
    return remarks


def _first_moves(robot: RobotModel, reference: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Make the first program of a robot with fingers: its arm moves, then its fingers close and open.

    Args:
        robot: the robot.
        reference: the station's section ``reference``, of which the targets of the arm's axes are used; the fingers
            stay where they are during that move.

    Returns:
        the moves, as they are written in the station's file. The first one is left out if the reference has no target.
    """
    leader = next(iter(robot.fingers))
    closed, opened = robot.fingers[leader]  # positions [rad or m]
    almost_closed = closed + _FINGER_GAP * (opened - closed)
    axes = list(robot.axes)
    fingers = {axes[index] for index in robot.fingers}
    # The target is a mapping by axis, or one number for all axes.
    target = reference.get("target_deg", {})
    target_by_axis = target if isinstance(target, Mapping) else dict.fromkeys(axes, target)
    arm_target = {axis: value for axis, value in target_by_axis.items() if axis not in fingers}
    moves: list[dict[str, Any]] = []
    if arm_target:
        moves.append({"target_deg": arm_target, "duration": _MOVE})
    stroke_time = abs(opened - almost_closed) / robot.speed_limits[leader]
    # Duration of a move of the fingers [s].
    duration = max(_FINGER_MOVE, float(np.ceil(10 * _FINGER_MARGIN * stroke_time) / 10))
    # Only the leader has a target: couplings take the other fingers along.
    for position in (almost_closed, opened):
        in_user_units = float(f"{position / robot.user_units[leader]:.6g}")
        moves.append({"target_deg": {axes[leader]: in_user_units}, "duration": duration})
    return moves


def _complete_on_feet(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Complete the content of a station whose robot has a floating base, in place. Returns remarks.

    Stances (postures in which the robot stands by statics) are tried in short runs. If the robot does not stand in any
    of them, it begins in the first one, or at home if there is none.
    """
    content |= {"servo": _servo(robot, "implicit"), **_ON_FEET, "duration": _DURATION}
    clearance = at_home(robot)
    stances = Stances(clearance, clearance.station.robots[ONLY_ROBOT])
    first_stance: Stance | None = None
    first_outcome = ""
    # The stances are computed one by one, so that no more of them are searched than are tried.
    for stance in islice(stances.find(), _TRIALS):
        _set_stance(robot, content, stance)
        trial = stands(_config(robot, content))
        if trial.is_standing:
            return [
                message(
                    "stations.drafted_stands",
                    "The robot stands {stance}.",
                    stance=_stance_text(stance),
                ),
                message(
                    "stations.drafted_tried", "In a trial run, {outcome}.", outcome=trial.outcome
                ),
            ]
        if first_stance is None:
            first_stance = stance
            first_outcome = trial.outcome
    if first_stance is not None:
        _set_stance(robot, content, first_stance)
        return [
            message(
                "stations.drafted_by_statics",
                "By statics, the robot stands {stance}.",
                stance=_stance_text(first_stance),
            ),
            message(
                "stations.drafted_but", "But in a trial run, {outcome}.", outcome=first_outcome
            ),
        ]
    home = stances.as_it_is()
    assert home is not None  # it has shapes
    _set_stance(robot, content, home)
    trial = stands(_config(robot, content))
    return [
        message(
            "stations.drafted_no_stance",
            "No posture was found in which the robot stands on its feet. {lacking}",
            lacking=stances.lacking,
        ),
        message(
            "stations.drafted_at_home",
            "The robot begins in its home posture, and may fall: in a trial run, {outcome}.",
            outcome=trial.outcome,
        ),
    ]


def at_home(robot: RobotModel) -> Clearance:
    """Pose a robot with a free base at home on a floor, to find out how it may stand. Returns the posed station."""
    content: dict[str, Any] = {"mode": "dynamic", "servo": _servo(robot, "implicit"), **_ON_FEET}
    config = _config(robot, {**content, "robot": {"initial_deg": _home(robot)}})
    return Clearance(config, trusts_home=False)


def _stance_text(stance: Stance) -> str:
    """Describe a stance that was found: its posture, the links that carry, and the centre of mass.

    The text says that the centre of mass is inside of the support area, which is true of all stances that
    `Stances.find` yields.
    """
    found = stance.standing
    return message(
        "stations.drafted_stance",
        "{stance}, on {links}; the centre of mass is {margin:.0f} mm inside the support area",
        stance=stance.how,
        links=", ".join(found.carrying_links),
        margin=found.margin * 1e3,
    )


def _set_stance(robot: RobotModel, content: dict[str, Any], stance: Stance) -> None:
    """Write a stance into the content of a station: base, initial posture, and the monitor that detects a fall.

    The monitor judges the height of the root only if the root is above the floor.
    """
    # Rounding to micrometres neither lifts the feet off the floor nor presses them into it.
    content["robot"]["base"] = [0.0, 0.0, round(stance.height, 6), 0.0, 0.0, 0.0]
    _set_initial_posture(robot, content, stance.posture)
    fall = dict[str, float]()
    # The frame of the root may be at the feet, and then its height says nothing about a fall.
    lowest_height = round(_FALLEN_SHARE * stance.height, 3)
    if lowest_height > 0:
        fall["height"] = lowest_height
    fall["tilt_deg"] = _FALLEN_LEAN_DEG
    content["monitors"] = {"fall": fall}


def _set_initial_posture(
    robot: RobotModel,
    content: dict[str, Any],
    posture: Vector,
) -> None:
    """Write a posture (n,) [rad or m] into the content of a station, as ``initial_deg``.

    Axes at 0 and followers are left out: they begin at 0, and where the couplings take them.
    """
    # A stance that was tried before may have left its posture.
    content["robot"].pop("initial_deg", None)
    positions = _by_axis(robot, _in_user_units(robot, posture))
    initial = {
        axis: value for axis, value in positions.items() if value and axis not in robot.followers
    }
    if initial:
        content["robot"]["initial_deg"] = initial
    elif robot.home.any():
        # Without initial_deg the robot would begin at home.
        content["robot"]["initial_deg"] = 0.0


def _home(robot: RobotModel) -> dict[str, float]:
    """Map axis names to the home posture [deg, or m of prismatic axes]; followers are where their leaders take them."""
    return _by_axis(robot, _in_user_units(robot, robot.home))


def _in_user_units(robot: RobotModel, posture: Vector) -> Vector:
    """Convert a posture (n,) from rad or m to deg, or m of prismatic axes; four decimals, and within the limits."""
    lower, upper = (limit / robot.user_units for limit in robot.axis_limits)
    rounded = np.round(posture / robot.user_units, 4)
    # The sum turns -0.0 into 0.0.
    return np.asarray(np.clip(rounded, lower, upper)) + 0.0


def _config(robot: RobotModel, content: Mapping[str, Any]) -> StationConfig:
    """Make the configuration of a drafted content, with the robot's file by its absolute path."""
    # The robot is imported already, so its import options are left out.
    section = {key: value for key, value in content["robot"].items() if key not in _ORIGINS}
    # The path of a URDF is enough if the description is the robot.yaml in its folder, which is found from there, or if
    # there is no description: `description_file` has the name robot.yaml then, too. A description of another name, or
    # with a table of Denavit-Hartenberg parameters in place of a URDF, is given by its own path.
    needs_description = robot.dh is not None or robot.description_file.name != ROBOT_FILE
    if needs_description:
        section["model"] = str(robot.description_file)
    else:
        section["urdf"] = robot.urdf_path
    others = {key: value for key, value in content.items() if key != "robot"}
    unchecked: dict[str, Any] = {"name": robot.name, "robots": {ONLY_ROBOT: section}, **others}
    return StationConfig(**unchecked)


_FIRST_LINE = message(
    "stations.drafted_first_station",
    "First station of an imported robot. Change it as needed, and run `simrob check` on it.",
)


def _header(robot: RobotModel, file: Path, options: ImportOptions | None) -> list[str]:
    """Write the first comments of a kinematic station: why it is kinematic, and how to make a dynamic one instead.

    Args:
        robot: the robot, some links of which have no inertia.
        file: the robot's file.
        options: options of its import, or None.
    """
    missing = ", ".join(robot.links_without_inertia)
    reason = message(
        "stations.drafted_kinematic",
        "The station is kinematic, since these links have no inertia: {links}.",
        links=missing,
    )
    if is_yaml_name(file):
        remedy = message(
            "stations.drafted_give_mass",
            "For a dynamic station, give these links a mass in {file}, and draft the station again.",
            file=file.name,
        )
    else:
        command = shlex.join(
            ["simrob", "station", str(file), "--estimate-inertia", *_command_options(options)]
        )
        remedy = message(
            "stations.drafted_estimate",
            "For a dynamic station, run: {command}",
            command=command,
        )
    return [_FIRST_LINE, reason, remedy]


def _command_options(options: ImportOptions | None) -> list[str]:
    """Write options of an import as words of the command line; without those that have their default values."""
    values = {} if options is None else options.model_dump(mode="json", exclude_defaults=True)
    words = list[str]()
    for key, value in values.items():
        # An option that may be repeated is written once for each of its values, any other one once.
        occurrences = value if key in _REPEATED_OPTIONS else [value]
        for occurrence in occurrences:
            words.append(f"--{key.replace('_', '-')}")
            # An option with several numbers, such as a pose.
            if isinstance(occurrence, list):
                words += [str(number) for number in occurrence]
            elif occurrence is not True:  # a switch that is on has no value
                words.append(str(occurrence))
    return words


def _servo(robot: RobotModel, realization: str) -> dict[str, Any]:
    """Make the content of the section ``servo`` with gains that hold the robot; see `ServoConfig` for realizations."""
    gains = gains_of(robot)
    return {
        "realization": realization,
        "kp": _of_motors(robot, gains.kp),
        "kd": _of_motors(robot, gains.kd),
        "torque_limit": _of_motors(robot, robot.efforts),
    }


def _of_motors(robot: RobotModel, values: Vector) -> float | dict[str, float]:
    """Write values of all axes (n,) for a key of the servos.

    Returns:
        a mapping by axis, without the axes that have no motor in the robot's file. If all axes have a motor and all
        values are equal, it is one number instead.
    """
    if not robot.passive.any():
        return _number_or_mapping(robot, values)
    return {
        axis: value
        for axis, value in _by_axis(robot, values).items()
        if axis not in robot.passive_axes
    }


def _number_or_mapping(robot: RobotModel, values: Vector) -> float | dict[str, float]:
    """Write the values of all axes (n,) as one number if they are equal, otherwise as a mapping by axis name."""
    is_same = len(set(values.tolist())) == 1
    return float(values[0]) if is_same else _by_axis(robot, values)


def _targets_of_motors(robot: RobotModel, values: Vector) -> float | dict[str, float]:
    """Write the targets of axes (n,) without those of followers, which the couplings move, and of passive axes.

    Returns:
        a mapping by axis. If no axis is left out and all values are equal, it is one number instead.
    """
    left_out = {*robot.followers, *robot.passive_axes}
    if not left_out:
        return _number_or_mapping(robot, values)
    return {axis: value for axis, value in _by_axis(robot, values).items() if axis not in left_out}


def _by_axis(robot: RobotModel, values: Vector) -> dict[str, float]:
    """Map the names of a robot's axes to values (n,)."""
    return dict(zip(robot.axes, values.tolist(), strict=True))
