"""A first station for a robot of which only the URDF is known: one that runs at once, to be changed by its owner."""

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.geometry import Role

from simrob_drake.blocks.distance_sensor import lowest_points, shape_corners
from simrob_drake.frames import Vector
from simrob_drake.given import as_path
from simrob_drake.importer.cache import robot_from_file
from simrob_drake.importer.gains import first_gains
from simrob_drake.importer.options import ImportOptions
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.parse import lone_robot
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.trial import gets_through

_STEP = 20.0, 0.05  # how far the first move goes: deg, and m of a prismatic axis
_ROOM = 0.4  # and at most this part of the way to the joint's limit

_ARM: dict[str, Any] = {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-2, "max_step": 0.1}
_CREEPS = f"# In discrete steps, since {_ARM['scheme']} was tried and creeps: some links are too light for it.\n"
_DISCRETE: dict[str, Any] = {"kind": "discrete", "scheme": "sap", "time_step": 1e-3}
_ON_FEET: dict[str, Any] = {"kind": "discrete", "scheme": "sap", "time_step": 2e-3}


def draft_station(urdf: Path | str, options: ImportOptions | None = None, *, folder: Path | str | None = None) -> str:
    """Return the YAML text of a first station for a URDF, raw or imported; its file will be in a folder.

    A robot with a fixed base moves all joints a little way under joint torque, in continuous time if that was tried
    and found to get through, else in discrete steps. One with a floating base is put on a floor and holds its posture.
    A robot without inertias moves kinematically. Options of the import are written into the station, and paths start
    at its folder.

    Raises:
        InvalidModel: the robot cannot be imported.
    """
    file, home = as_path(urdf, "urdf"), None if folder is None else as_path(folder, "folder")
    robot = robot_from_file(file, options)
    kinematic = bool(robot.links_without_inertia)
    floating = robot.base == "floating" and not kinematic
    content: dict[str, Any] = {
        "description": f"{robot.name}: first station",
        "mode": "kinematic" if kinematic else "dynamic",
        "robot": _robot(robot, file.resolve(), options, home),
    }
    if not kinematic:
        content["servo"] = _servo(robot, "implicit" if floating else "per_joint")
    content["reference"] = {"kind": "hold"} if floating else _first_move(robot)
    if not kinematic and not floating:
        content["inputs"] = ["reference_velocity"]  # else the damping holds the motion back
    content["floor"] = {"size": 3}
    if floating:
        content["robot"]["base"] = [0.0, 0.0, _height(robot), 0.0, 0.0, 0.0]
        content["contact"] = {"model": "point"}
    if not kinematic:
        content["solver"] = _ON_FEET if floating else _ARM
    content["duration"] = 3.0
    creeps = not kinematic and not floating and not gets_through(_config(content, file))
    if creeps:
        content["solver"] = _DISCRETE
        content["servo"]["realization"] = "implicit"
    return (
        _header(robot, file, kinematic)
        + _CREEPS * creeps
        + yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
    )


def _config(content: dict[str, Any], urdf: Path) -> StationConfig:
    sections = {key: value for key, value in content.items() if key != "robot"}
    return StationConfig(name=urdf.stem, robots={ONLY_ROBOT: {**content["robot"], "urdf": urdf}}, **sections)


def _header(robot: RobotModel, urdf: Path, kinematic: bool) -> str:
    text = "# First station of an imported robot; change it as you like, and try `simrob check` on it.\n"
    if kinematic:
        missing = ", ".join(robot.links_without_inertia)
        text += f"# Kinematic, since these links have no inertia: {missing}.\n"
        text += f"# For motion by torque begin anew: simrob station {shlex.quote(str(urdf))} --estimate-inertia\n"
    return text


def _robot(robot: RobotModel, urdf: Path, options: ImportOptions | None, folder: Path | None) -> dict[str, Any]:
    near = folder is not None and urdf.is_relative_to(folder.resolve())
    section: dict[str, Any] = {"urdf": str(urdf.relative_to(folder.resolve()) if near and folder else urdf)}
    if options is not None:
        section["import_options"] = options.model_dump(mode="json", exclude_defaults=True)
    if robot.home_deg:
        section["initial_deg"] = robot.home_deg
    return section


def _servo(robot: RobotModel, realization: str) -> dict[str, Any]:
    gains = first_gains(robot)
    figures = {"kp": gains.kp, "kd": gains.kd, "torque_limit": robot.efforts}
    return {"realization": realization, **{key: _by_axis(robot, values) for key, values in figures.items()}}


def _by_axis(robot: RobotModel, values: Vector) -> float | dict[str, float]:
    """Return one number if it is the same for all axes."""
    if len(set(values.tolist())) == 1:
        return float(values[0])
    return dict(zip(robot.axes, values.tolist(), strict=True))


def _first_move(robot: RobotModel) -> dict[str, Any]:
    """Return a move of every axis to the side where it has more room."""
    home = robot.axis_vector(robot.home_deg, "home_deg")
    lower, upper = (limit / robot.user_units for limit in robot.axis_limits)
    room = np.where(upper - home >= home - lower, upper - home, lower - home)
    step = np.where(robot.prismatic, _STEP[1], _STEP[0])
    target = home + np.sign(room) * np.minimum(step, _ROOM * np.abs(room))
    return {"kind": "move", "target_deg": _by_axis(robot, np.round(target, 4)), "duration": 1.5}


def _height(robot: RobotModel) -> float:
    """Return how high the root link is above the robot's lowest point at home [m]."""
    lone = lone_robot(robot)
    context = lone.plant.CreateDefaultContext()
    inspector = lone.scene_graph.model_inspector()
    lowest = 0.0
    for role in (Role.kProximity, Role.kIllustration):
        for geometry in inspector.GetAllGeometryIds(role):
            body = lone.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            pose = lone.plant.EvalBodyPoseInWorld(context, body) @ inspector.GetPoseInFrame(geometry)
            points = lowest_points(inspector.GetShape(geometry), pose, shape_corners(inspector, geometry))
            lowest = min(lowest, float(points[:, 2].min()))
        if lowest < 0:
            break  # what collides is what stands
    return round(-lowest, 6)
