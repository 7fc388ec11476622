"""Robot stations as Drake Diagrams: build, control, program and watch robots.

The words of the package: a *station* is a closed Drake Diagram (robots, servos, contacts, sensors, monitors), a
*piece* a work object, tool or load, a *servo* the PID and saturation of one joint, a *reference* the desired joint
positions over time, a *monitor* a block that can end a simulation with a reason.
"""

from __future__ import annotations

__version__ = "0.1.0"

from simrob_drake.errors import SimrobError
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulate import simulate
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_names
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.solve import apply_solver
from simrob_drake.stations.station import Station, add_station, build_station

__all__ = [
    "SimrobError",
    "SimulationResult",
    "Station",
    "StationConfig",
    "StationPorts",
    "__version__",
    "add_station",
    "apply_solver",
    "build_station",
    "load_station",
    "simulate",
    "station_names",
]
