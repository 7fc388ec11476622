"""What the package shows; each name is loaded when it is first used, since Drake takes a second to load."""

from .base.errors import SimrobError as SimrobError
from .base.extension import Extension as Extension
from .base.frames import as_transform as as_transform
from .base.frames import three_point_frame as three_point_frame
from .dynamics import Dynamics as Dynamics
from .extensions.linear import LinearModel as LinearModel
from .extensions.linear import linearize as linearize
from .parts.on_plant import JointServos as JointServos
from .parts.on_plant import add_contact_sensor as add_contact_sensor
from .parts.on_plant import add_imu as add_imu
from .parts.on_plant import add_joint_limit_monitor as add_joint_limit_monitor
from .parts.on_plant import add_joint_servos as add_joint_servos
from .parts.on_plant import add_monitor as add_monitor
from .programs.arm import Arm as Arm
from .programs.arm import Workcell as Workcell
from .programs.legged_robot import LeggedRobot as LeggedRobot
from .programs.program import Program as Program
from .results.record.state import State as State
from .results.result import SimulationResult as SimulationResult
from .results.saved import SavedResult as SavedResult
from .results.saved import load_result as load_result
from .results.saved import plot_results as plot_results
from .robots.motors import Motor as Motor
from .simulation import FailedRunWarning as FailedRunWarning
from .simulation import RunBranch as RunBranch
from .simulation import Runner as Runner
from .simulation import simulate as simulate
from .simulation import simulate_diagram as simulate_diagram
from .stations.config import StationConfig as StationConfig
from .stations.hardware_view import HardwareStation as HardwareStation
from .stations.hardware_view import build_hardware_station as build_hardware_station
from .stations.load import load_station as load_station
from .stations.load import station_names as station_names
from .stations.ports import StationPorts as StationPorts
from .stations.station import PlacedStation as PlacedStation
from .stations.station import Station as Station
from .stations.station import add_station as add_station
from .stations.station import add_world as add_world
from .stations.station import build_station as build_station
from .stations.station import place_station as place_station
from .stations.steps import apply_solver as apply_solver

__version__: str
