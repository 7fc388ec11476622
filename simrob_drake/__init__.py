"""Robot stations as Drake Diagrams: build, control, program and watch robots.

The words of the package: a *station* is a closed Drake Diagram (robots, servos, contacts, sensors, monitors), a
*piece* a work object, tool or load, a *servo* the PID and saturation of one joint, a *reference* the desired joint
positions over time, a *monitor* a block that can end a simulation with a reason.
"""

from __future__ import annotations

__version__ = "0.1.0"

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simrob_drake.errors import SimrobError
    from simrob_drake.frames import as_transform, three_point_frame
    from simrob_drake.programs.arm import Arm
    from simrob_drake.programs.legged_robot import LeggedRobot
    from simrob_drake.programs.program import Program
    from simrob_drake.programs.workcell import Workcell
    from simrob_drake.results.result import SimulationResult
    from simrob_drake.results.state import State
    from simrob_drake.simulate import simulate
    from simrob_drake.stations.config import StationConfig
    from simrob_drake.stations.load import load_station, station_names
    from simrob_drake.stations.ports import StationPorts
    from simrob_drake.stations.solve import apply_solver
    from simrob_drake.stations.station import Station, add_station, build_station

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

_PLACES = {
    "Arm": "programs.arm",
    "LeggedRobot": "programs.legged_robot",
    "Program": "programs.program",
    "SimrobError": "errors",
    "SimulationResult": "results.result",
    "State": "results.state",
    "Station": "stations.station",
    "StationConfig": "stations.config",
    "StationPorts": "stations.ports",
    "Workcell": "programs.workcell",
    "add_station": "stations.station",
    "apply_solver": "stations.solve",
    "as_transform": "frames",
    "build_station": "stations.station",
    "load_station": "stations.load",
    "simulate": "simulate",
    "station_names": "stations.load",
    "three_point_frame": "frames",
}
"""Where names come from when they are first used: Drake takes a second to load, and the command line must be able to
say so before."""


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """This package: its ``simulate`` is the function, also once the module of that name is loaded."""

    def __setattr__(self, name: str, value: Any) -> None:
        is_module = name == "simulate" and isinstance(value, ModuleType)
        super().__setattr__(name, value.simulate if is_module else value)


sys.modules[__name__].__class__ = _Package
