"""A first station for a robot of which only the URDF is known: tried already, and its owner's to change."""

import shlex
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter
from simrob_drake.files import ROBOT_FILE
from simrob_drake.frames import Vector, lean, xyz_quaternion_from_transform
from simrob_drake.importer.importing import gains_of, robot_from_file
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.packages import robot_file
from simrob_drake.robots.catalog import RobotModel, load_robot_file
from simrob_drake.stations.clear_start import ClearStart
from simrob_drake.stations.clearance import Clearance
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.import_findings import import_findings
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.loops import LoopsOfRobot
from simrob_drake.stations.plausibility import plausibility_findings
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.stances import Stance, Stances
from simrob_drake.stations.steps import apply_solver, step_findings
from simrob_drake.yaml_files import YAML_SUFFIXES

_MOVE = 1.5  # s
_LOOP_MOVE = np.deg2rad(10.0), 0.01  # travel of each motor of a robot with loops in its first station [rad, m]
_TRIALS = 4  # stances that are tried
_FALLEN = 0.6  # part of its height below which a robot has fallen
_FALLS = 40.0  # deg
_UNSHAPED = "The robot has no shapes that collide, so that nothing could carry it: it is held by its root."

_ARM: dict[str, Any] = {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-2, "max_step": 0.1}
_CREEPS = f"In discrete steps, since {_ARM['scheme']} was tried and creeps: some links are too light for it."
_DISCRETE: dict[str, Any] = {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}
_REPEATED = ("mesh_path", "xacro_arg")  # options that may be given several times
_COUPLED = "By the robot's file these axes follow others, see couplings: {followers}."
_HOLDING = "Fingers ({fingers}) move together, as by one motor, and hold by friction: surfaces, and the solver lagged."
_ORIGINS = ("urdf", "model", "import_options")  # keys of a station that say where its robot comes from
_GRIPS: dict[str, Any] = {
    "contact": {"model": "hydroelastic", "friction": {"static": 0.5, "dynamic": 0.5}},
    "solver": {"kind": "discrete", "scheme": "lagged", "time_step": 5e-3},
}
_HOLDS: dict[str, Any] = {
    "reference": {"kind": "hold"},
    "floor": {"size": 3},
    "contact": {"model": "point"},
    "solver": {"kind": "discrete", "scheme": "sap", "time_step": 2e-3},
}


def draft_station(urdf: Path | str, options: ImportOptions | None = None, *, folder: Path | str | None = None) -> str:
    """Return the YAML text of a first station for a robot's file; its file will be in a folder.

    The file is a URDF, raw or imported, or a YAML file that describes the robot, such as one with a table of
    Denavit-Hartenberg parameters.

    A robot with a fixed base starts clear of the floor and of itself, and moves all joints a little way under joint
    torque, in continuous time if that was tried and found to get through, else in discrete steps. One with a floating
    base is put on its feet, and was tried to stand there; a monitor ends the run if it falls. A robot without inertias
    moves kinematically. Comments say what was looked at, tried and found. Options of the import are written into the
    station, and paths start at its folder. Raises InvalidModel: the robot cannot be imported.
    """
    file, home = robot_file(urdf, "urdf"), None if folder is None else as_path(folder, "folder")
    is_description = file.suffix.lower() in YAML_SUFFIXES
    if is_description and options is not None:
        raise InvalidParameter("options", "given", f"left out: {file.name} describes a robot, and nothing is imported")
    robot = load_robot_file(file) if is_description else robot_from_file(file, options)
    remarks = []
    shaped = robot.element.find("link/collision") is not None
    if robot.base == "floating" and not robot.links_without_inertia and not shaped and not is_description:
        options = (options or ImportOptions()).model_copy(update={"base": "fixed"})
        robot = robot_from_file(file, options)
        remarks.append(_UNSHAPED)
    kinematic = bool(robot.links_without_inertia)
    near = home is not None and file.is_relative_to(home.resolve())
    origin = "model" if is_description else "urdf"
    section: dict[str, Any] = {origin: str(file.relative_to(home.resolve()) if near and home else file)}
    if options is not None:
        section["import_options"] = options.model_dump(mode="json", exclude_defaults=True)
    content: dict[str, Any] = {
        "description": f"{robot.name}: first station",
        "mode": "kinematic" if kinematic else "dynamic",
        "robot": section,
    }
    if robot.followers:
        content["couplings"] = _couplings(robot)
        remarks.append(_COUPLED.format(followers=", ".join(robot.followers)))
    remarks += _losses(robot, content, file)
    if robot.loops and not kinematic and robot.base == "fixed":
        remarks += _looped(robot, content)
        return _written(robot, file, options, kinematic, remarks, content)
    remarks += _held(robot, content) if kinematic or robot.base == "fixed" else _on_feet(robot, content)
    return _written(robot, file, options, kinematic, remarks, content)


def _written(
    robot: RobotModel,
    file: Path,
    options: ImportOptions | None,
    kinematic: bool,
    remarks: list[str],
    content: dict[str, Any],
) -> str:
    """Write the YAML text of a first station: a header, the remarks as comments, and the content of the file."""
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
    return _header(robot, file, options, kinematic) + "".join(f"# {remark}\n" for remark in remarks) + text


def _couplings(robot: RobotModel) -> dict[str, Any]:
    """Make the content of the section ``couplings``: a gear for each axis that follows another axis."""
    couplings = dict[str, Any]()
    for axis, follower in robot.followers.items():
        couplings[f"{axis}_follows"] = {
            "kind": "gear",
            # Nine digits keep the file readable, and adding 0.0 turns -0.0 into 0.0.
            "ratios": {name: float(f"{ratio:.9g}") for name, ratio in follower.ratios(axis).items()},
            "total": float(f"{follower.offset:.9g}") + 0.0,
        }
    return couplings


def _losses(robot: RobotModel, content: Mapping[str, Any], file: Path) -> list[str]:
    """Find mechanics that were lost in the import of the robot's file, and implausible numbers of the robot.

    Returns a comment for each warning; ``content`` is the content of the station, as far as it is known.
    """
    sections = {key: content[key] for key in ("mode", "couplings") if key in content}
    station = resolve(_config(robot, {**sections, "robot": {"initial_deg": _home(robot)}}))
    findings = import_findings(station.config, station.robots[ONLY_ROBOT], source=file)
    findings += plausibility_findings(station.config, station)
    return [f"Warning: {finding.text}" for finding in findings if finding.level == "warning"]


def _held(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Complete the content of a station whose robot has a fixed base or is kinematic. Returns remarks for comments."""
    kinematic = content["mode"] == "kinematic"
    if not kinematic:
        content["servo"] = _servo(robot, "per_joint")
    content["floor"] = {"size": 3}
    at_home_config = _config(robot, {**content, "robot": {"initial_deg": _home(robot)}})
    looked_at = Clearance(at_home_config, trusts_home=False)
    start = ClearStart(looked_at, looked_at.station.robots[ONLY_ROBOT], _MOVE, torque=not kinematic).find()
    if (height := round(start.height, 4)) > 0:
        content["robot"]["base"] = [0.0, 0.0, height, 0.0, 0.0, 0.0]
    _begin(robot, content, start.posture)
    moves = bool((start.target != start.posture).any())
    target = _leading(robot, _in_user_units(robot, start.target))
    move = {"kind": "move", "target_deg": target, "duration": _MOVE}
    content["reference"] = move if moves else {"kind": "hold"}
    remarks = list(start.remarks)
    content["duration"] = 3.0
    if kinematic:
        return remarks
    if robot.fingers:
        return remarks + _grips(robot, content)
    content["servo"]["feedforward"] = "gravity"  # else each joint sags by its weight over its gain
    content["inputs"] = ["reference_velocity"]  # else the damping holds the motion back
    content["solver"] = _ARM
    if not gets_through(_config(robot, content)):
        content["solver"] = _DISCRETE
        content["servo"]["realization"] = "implicit"
        remarks.append(_CREEPS)
    return remarks


def _looped(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Complete the content of a station whose robot has closed kinematic loops. Returns remarks for comments.

    Couplings close the loops. Only as many axes have motors as the loops leave free; the others are passive.

    Raises:
        InvalidParameter: no posture closes the loops.
    """
    loops = LoopsOfRobot(robot)
    posture = loops.closed_posture()
    passive = loops.passive_axes(posture)  # indices
    axes = list(robot.axes)
    content.setdefault("couplings", {}).update(robot.loops)
    content["servo"] = _servo(robot, "implicit")
    for gain in ("kp", "kd"):
        values = np.array(robot.axis_vector(content["servo"][gain], gain))
        values[passive] = 0.0
        content["servo"][gain] = _by_axis(robot, values)
    content["solver"] = _DISCRETE
    _begin(robot, content, posture)
    angle, distance = _LOOP_MOVE
    target = np.clip(posture + np.where(robot.prismatic, distance, angle), *robot.axis_limits)
    named = _named(robot, _in_user_units(robot, target))
    target_of_motors = {axis: value for index, (axis, value) in enumerate(named.items()) if index not in passive}
    content["reference"] = {"kind": "move", "target_deg": target_of_motors, "duration": _MOVE}
    content["duration"] = 3.0
    without_motor = ", ".join(axes[index] for index in passive)
    return [f"Loops are closed by couplings: {', '.join(robot.loops)}.", f"These axes have no motor: {without_motor}."]


def _grips(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Couple fingers, and set servos and contact so that they hold parts by friction. Returns remarks for comments."""
    leader, *others = robot.fingers
    # Travel of each finger between its ends [rad or m]; the gears have the ratios of the travels.
    travels = {place: ends[1] - ends[0] for place, ends in robot.fingers.items()}
    axes = [*robot.axes]
    content["servo"] |= {"realization": "implicit", "feedforward": "inverse_dynamics"}
    couplings = content.setdefault("couplings", {})
    for place in others:
        # Fingers that mimic other axes in the robot's file are coupled already.
        if axes[place] not in robot.followers and axes[leader] not in robot.followers:
            ratio = float(f"{-travels[place] / travels[leader]:.6g}")
            couplings[f"{axes[place]}_follows"] = {"kind": "gear", "ratios": {axes[place]: 1.0, axes[leader]: ratio}}
    content |= _GRIPS
    return [_HOLDING.format(fingers=", ".join(axes[place] for place in robot.fingers))]


def _on_feet(robot: RobotModel, content: dict[str, Any]) -> list[str]:
    """Complete the content of a station whose robot has a floating base. Returns remarks for comments."""
    content |= {"servo": _servo(robot, "implicit"), **_HOLDS, "duration": 3.0}
    looked_at = at_home(robot)
    stances = Stances(looked_at, looked_at.station.robots[ONLY_ROBOT])
    first, outcome = None, ""
    for stance in islice(stances.find(), _TRIALS):
        _stand(robot, content, stance)
        held, outcome = stands(_config(robot, content))
        if held:
            return [f"It stands {_stance_text(stance)}.", f"It was tried: {outcome}."]
        first = first or (stance, outcome)
    if first is not None:
        _stand(robot, content, first[0])
        return [f"By statics it would stand {_stance_text(first[0])}.", f"But when it was tried, {first[1]}."]
    home = stances.as_it_is()
    assert home is not None  # it has shapes
    _stand(robot, content, home)
    _, outcome = stands(_config(robot, content))
    return [
        f"No posture was found in which it stands on its feet. {stances.lacking}",
        f"So it begins at home, and falls or not: when it was tried, {outcome}.",
    ]


def at_home(robot: RobotModel) -> Clearance:
    """Return a robot with a free base at home on a floor, to look at how it may stand."""
    content: dict[str, Any] = {"mode": "dynamic", "servo": _servo(robot, "implicit"), **_HOLDS}
    config = _config(robot, {**content, "robot": {"initial_deg": _home(robot)}})
    return Clearance(config, trusts_home=False)


def _stance_text(stance: Stance) -> str:
    found = stance.standing
    centre = f"the centre of mass is {found.margin * 1e3:.0f} mm inside of the support"
    return f"{stance.how}, on {', '.join(found.ends)}; {centre}"


def _stand(robot: RobotModel, content: dict[str, Any], stance: Stance) -> None:
    content["robot"]["base"] = [0.0, 0.0, round(stance.height, 6), 0.0, 0.0, 0.0]
    _begin(robot, content, stance.posture)
    low = round(_FALLEN * stance.height, 3)
    content["monitors"] = {"fall": {**({"height": low} if low > 0 else {}), "tilt_deg": _FALLS}}


def _begin(robot: RobotModel, content: dict[str, Any], posture: Vector) -> None:
    """Set ``initial_deg`` of a station to a posture, shape (n,) [rad or m]; followers get theirs from the couplings."""
    values = _in_user_units(robot, posture)
    content["robot"].pop("initial_deg", None)
    named = {axis: value for axis, value in _named(robot, values).items() if value and axis not in robot.followers}
    if named:
        content["robot"]["initial_deg"] = named
    elif robot.home.any():
        content["robot"]["initial_deg"] = 0.0  # without initial_deg the robot would begin at home


def _home(robot: RobotModel) -> dict[str, float]:
    """Home posture of a robot by axis name, in the user's units; followers are where their leaders take them."""
    return _named(robot, _in_user_units(robot, robot.home))


def _in_user_units(robot: RobotModel, posture: Vector) -> Vector:
    """Return a posture [deg, or m of prismatic axes], rounded within the limits, shape (n,)."""
    lower, upper = (limit / robot.user_units for limit in robot.axis_limits)
    return np.asarray(np.clip(np.round(posture / robot.user_units, 4), lower, upper)) + 0.0


def _config(robot: RobotModel, content: Mapping[str, Any]) -> StationConfig:
    """The station of a drafted content, with the robot's file by its absolute path."""
    own = {key: value for key, value in content["robot"].items() if key not in _ORIGINS}
    if robot.dh is not None or robot.description_file.name != ROBOT_FILE:
        own["model"] = str(robot.description_file)
    else:
        own["urdf"] = robot.urdf_path
    sections = {key: value for key, value in content.items() if key != "robot"}
    return StationConfig(name=robot.name, robots={ONLY_ROBOT: own}, **sections)


def _header(robot: RobotModel, urdf: Path, options: ImportOptions | None, kinematic: bool) -> str:
    """Write the first comments of a station; those of a kinematic one say how to make a dynamic station instead."""
    text = "# First station of an imported robot; change it as you like, and try `simrob check` on it.\n"
    if kinematic:
        missing = ", ".join(robot.links_without_inertia)
        text += f"# Kinematic, since these links have no inertia: {missing}.\n"
        if urdf.suffix.lower() in YAML_SUFFIXES:
            return f"{text}# For motion by torque give them a mass in {urdf.name}, and begin anew.\n"
        values = {} if options is None else options.model_dump(mode="json", exclude_defaults=True)
        flags = list[str]()
        for key, value in values.items():
            rows = value if key in _REPEATED else [value]
            for row in rows:
                parts = row if isinstance(row, list) else [] if row is True else [row]
                flags += [f"--{key.replace('_', '-')}", *map(str, parts)]
        again = shlex.join(["simrob", "station", str(urdf), "--estimate-inertia", *flags])
        text += f"# For motion by torque begin anew: {again}\n"
    return text


def _servo(robot: RobotModel, realization: str) -> dict[str, Any]:
    gains = gains_of(robot)
    columns = {"kp": gains.kp, "kd": gains.kd, "torque_limit": robot.efforts}
    return {"realization": realization, **{key: _by_axis(robot, values) for key, values in columns.items()}}


def _by_axis(robot: RobotModel, values: Vector) -> float | dict[str, float]:
    """Return one number if it is the same for all axes."""
    return float(values[0]) if len(set(values.tolist())) == 1 else _named(robot, values)


def _leading(robot: RobotModel, values: Vector) -> float | dict[str, float]:
    """Select from values (n,) those of axes that follow no other axis; the couplings give the values of followers."""
    if not robot.followers:
        return _by_axis(robot, values)
    return {axis: value for axis, value in _named(robot, values).items() if axis not in robot.followers}


def _named(robot: RobotModel, values: Vector) -> dict[str, float]:
    return dict(zip(robot.axes, values.tolist(), strict=True))


_WORK = 10_000  # evaluations of the dynamics that a trial may take: about what 3 s in discrete steps of 1 ms cost
_LEANS, _SINKS = 10.0, 0.1  # deg, and part of its height: a robot that leans or sinks more does not stand


def gets_through(config: StationConfig) -> bool:
    """Tell whether a continuous solver brings a station to its end before its evaluations of the dynamics run out.

    One that would lean on a stop too stiff for it is not even tried: it may get through, and be wrong.
    """
    closed = closed_station(resolve(config), sensors=(), monitors=False)
    if any(finding.level == "warning" for finding in step_findings(config, closed.ports.plant, closed.references)):
        return False
    simulator = Simulator(closed.diagram)
    apply_solver(simulator, config)
    integrator = simulator.get_integrator()

    def look(_: Context) -> EventStatus:
        if integrator.get_num_derivative_evaluations() > _WORK:
            return EventStatus.ReachedTermination(closed.diagram, "too much work")
        return EventStatus.DidNothing()

    simulator.set_monitor(look)
    return _advances(simulator, config.duration) and simulator.get_context().get_time() >= config.duration


def _advances(simulator: Simulator, time: float) -> bool:
    """Step up to a time [s], or to where a monitor stops; tell whether it did not diverge."""
    try:
        simulator.AdvanceTo(time)
    except (RuntimeError, SystemExit):  # failed assertions come as SystemExit
        return False
    return True


def stands(config: StationConfig, duration: float = 2.0) -> tuple[bool, str]:
    """Try for a time [s] whether the only robot of a station stands on its own feet, and say what became of it."""
    closed = closed_station(resolve(config), sensors=())
    (robot,), plant = closed.ports.plant.robots.values(), closed.ports.plant.plant
    simulator = Simulator(closed.diagram)
    apply_solver(simulator, config)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    before = robot.root.CalcPoseInWorld(context)
    if not _advances(simulator, duration):
        return False, "it diverged"
    time = simulator.get_context().get_time()
    if time < duration:
        return False, f"it fell at {time:.2f} s"
    after = robot.root.CalcPoseInWorld(context)
    up = before.rotation().inverse().matrix()[:, 2].tolist()
    leaning = float(np.rad2deg(lean(up, *xyz_quaternion_from_transform(after)[3:].tolist())))
    sunk = float((before.translation() - after.translation())[2])
    height = float(before.translation()[2] - closed.ports.plant.ground.beneath(before.translation()[np.newaxis])[0])
    moved = f"{abs(sunk) * 1e3:.0f} mm {'lower' if sunk >= 0 else 'higher'}"
    outcome = f"after {duration:g} s it leans by {leaning:.1f} deg, and its root is {moved} than at the start"
    return leaning < _LEANS and sunk < _SINKS * max(height, 0.1), outcome
