"""Robot stations as Drake Diagrams: build, control, program and watch robots.

The words of the package: a *station* is a closed Drake Diagram (robots, servos, contacts, sensors, monitors), a
*piece* a work object, tool or load, a *servo* the PID and saturation of one joint, a *reference* the desired joint
positions over time, a *monitor* a block that can end a simulation with a reason.
"""

from __future__ import annotations

__version__ = "0.1.0"

from importlib import import_module
from typing import TYPE_CHECKING, Any

from simrob_drake.errors import SimrobError
from simrob_drake.frames import as_transform, three_point_frame
from simrob_drake.results.result import SimulationResult
from simrob_drake.results.state import State
from simrob_drake.simulate import simulate
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_names
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solve import apply_solver
from simrob_drake.stations.station import Station, add_station, build_station

if TYPE_CHECKING:
    from simrob_drake.programs.arm import Arm
    from simrob_drake.programs.legged_robot import LeggedRobot
    from simrob_drake.programs.program import Program
    from simrob_drake.programs.workcell import Workcell

__all__ = [
    "Arm",
    "LeggedRobot",
    "Program",
    "SimrobError",
    "SimulationResult",
    "State",
    "Station",
    "StationConfig",
    "StationPorts",
    "Workcell",
    "__version__",
    "add_station",
    "apply_solver",
    "as_transform",
    "build_station",
    "load_station",
    "simulate",
    "station_names",
    "three_point_frame",
]

_LATE = {
    "Arm": "simrob_drake.programs.arm",
    "LeggedRobot": "simrob_drake.programs.legged_robot",
    "Program": "simrob_drake.programs.program",
    "Workcell": "simrob_drake.programs.workcell",
}
"""What loads scipy, and so is imported when it is first used."""


def __getattr__(name: str) -> Any:
    if name in _LATE:
        return getattr(import_module(_LATE[name]), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
