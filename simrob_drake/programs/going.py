"""A legged robot that goes by commands from where it stands, with the walk that is made while it goes."""

import math
from typing import Any

from simrob_drake.blocks.references import hold
from simrob_drake.parts.controllers.walk import Walk
from simrob_drake.programs.gaits.motion import short_steps
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.moves import Go
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import check_parts, resolve
from simrob_drake.walking.commands import Commanded

_BESIDE = 1.0  # floor beyond the way that a robot goes [m]


def going(config: StationConfig, robot: str, go: Go, *, here: float = 0.0) -> StationConfig:
    """Return a station on which a robot goes by a command.

    The walk is that of the station if it has one for the robot; its name stays the same from run to run, so its state
    does, and the robot goes on in the middle of a step.

    Args:
        config: the station.
        robot: who goes.
        go: what it is asked for.
        here: how far from the world's origin [m].

    Raises:
        SimrobError: a robot that does not stand on feet of its own, or has no walk; a station that is kinematic.
    """
    known = {name: section for name, section in config.controllers.items() if isinstance(section, Walk)}
    own = [name for name, section in known.items() if (section.robot or config.only_robot) == robot]
    name = own[0] if own else f"{robot}_walk" if "walk" in config.controllers else "walk"
    command = Commanded(ahead=go.ahead, sideways=go.sideways, turn_deg=go.turn_deg)
    walk = known[name] if own else Walk(kind="walk", robot=robot)
    asked = {"commands": (command,), "path": None, "strict": go.strict}
    changes: dict[str, Any] = {
        "controllers": {**config.controllers, name: walk.model_copy(update=asked)},
        "inputs": tuple(dict.fromkeys((*config.inputs, "reference_velocity"))),
        "solver": short_steps(config.solver),
    }
    if config.floor is not None:
        way = here + math.hypot(go.ahead, go.sideways) * go.duration + _BESIDE
        changes["floor"] = config.floor.model_copy(update={"size": max(config.floor.size, math.ceil(2.0 * way))})
    changed = config.model_copy(update=changes)
    check_parts(resolve(changed))
    return changed


def perform_go(robot: LeggedGeometry, go: Go) -> SimulationResult:
    """Let a robot go, and return the run; the floor stays as large as it had to become."""
    cell, own = robot.cell, robot.cell.config
    here = abs(robot.base_pose.translation()[:2]).max()
    changed = going(own, robot.name, go, here=float(here))
    cell.change(changed)
    try:
        return cell.follow({robot.name: hold(robot.reference)}, go.duration)
    finally:
        cell.change(own.model_copy(update={"floor": changed.floor}))
