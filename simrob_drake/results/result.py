"""What a simulation returns, and the folder it can be saved to."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydrake.multibody.plant import ContactResults
from pydrake.trajectories import Trajectory

import simrob_drake
from simrob_drake.errors import UnknownName
from simrob_drake.frames import XYZ_QUATERNION_NAMES, Vector, pose_from_transform, transform_from_xyz_quaternion
from simrob_drake.results.locomotion import legged_robots, locomotion
from simrob_drake.results.state import State
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.free_pieces import VELOCITY_NAMES
from simrob_drake.stations.names import named
from simrob_drake.stations.plant import StationPlant
from simrob_drake.stations.references import Samples
from simrob_drake.stations.robots import StationRobot
from simrob_drake.stations.sensor_config import Force
from simrob_drake.stations.sensors import tangential_source

Ending = Literal["completed", "monitor", "diverged", "interrupted"]
DIVERGED, INTERRUPTED = "diverged", "interrupted"
"""What stands for a monitor's name where none ended the run."""


def pose_vector(pose: Vector) -> list[float]:
    """Return x y z qw qx qy qz as a pose vector [x y z Rz Ry Rx]."""
    return [float(value) for value in pose_from_transform(transform_from_xyz_quaternion(pose))]


@dataclass(frozen=True)
class SimulationResult:
    """A run: its signals, how it ended and how fast it was. One exists however the run ended.

    Attributes:
        config: the station as it was run.
        plant: the station's plant, for its robots' figures.
        ending: ``completed``, ``monitor``, ``diverged`` or ``interrupted``.
        stopped_by: the name of the monitor that ended the run, "diverged", "interrupted" (by the user), or None.
        message: how the run ended, in words.
        names: the columns of ``values``.
        times: of the samples, shape (m,) [s]; evenly spaced, with the end of the run last.
        values: the signals, shape (m, k), SI units and radians.
        step_times: ends of the accepted steps [s].
        positions_at: positions of the whole plant at any times of the run: (k,) to (k, nq); others are refused.
        stepping_time, signal_time: wall-clock seconds spent on each.
        warnings: why the result may be wrong though the run went to its end, in words.
        final_state: where the station was at the end, for another run to begin there.
        start: where it began; None at the configuration's initial posture.
        contacts_at: Drake's contact results at any times of the run; None in a station without contact.
        references: what was given to simulate() in place of the configuration's references, by robot.
    """

    config: StationConfig
    plant: StationPlant
    ending: Ending
    stopped_by: str | None
    message: str
    names: list[str]
    times: Vector
    values: Vector
    step_times: Vector
    positions_at: Callable[[Vector], Vector]
    stepping_time: float
    signal_time: float
    final_state: State
    start: State | None = None
    references: dict[str, Trajectory | Samples] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    contacts_at: Callable[[Vector], Iterator[ContactResults]] | None = None

    def __getitem__(self, name: str) -> Vector:
        """Return a signal by its column's name, such as ``q.joint_2``, shape (m,)."""
        if name not in self.names:
            raise UnknownName("signal", name, self.names)
        return self.values[:, self.names.index(name)]

    def axes(self, signal: str, robot: str | None = None) -> Vector:
        """Return a signal of all axes of a robot, shape (m, n): ``q_ref``, ``q``, ``v`` or ``tau``.

        Args:
            signal: the column's name before the axis.
            robot: needed where the station has several.

        Raises:
            UnknownName: no such signal or robot.
            InvalidParameter: no robot named, and the station has not just one.
        """
        station_robot = self._robot(robot)
        return np.column_stack([self[f"{station_robot.prefix}{signal}.{axis}"] for axis in station_robot.axes])

    def pose(self, signal: str, robot: str | None = None) -> Vector:
        """Return a pose signal, ``base`` or ``tcp``, shape (m, 7): x y z qw qx qy qz; names as in :meth:`axes`."""
        station_robot = self._robot(robot)
        return np.column_stack([self[f"{station_robot.prefix}{signal}.{part}"] for part in XYZ_QUATERNION_NAMES])

    def piece_pose(self, piece: str) -> Vector:
        """Return where a free piece was, shape (m, 7): x y z qw qx qy qz."""
        return np.column_stack([self[f"piece.{piece}.{part}"] for part in XYZ_QUATERNION_NAMES])

    def piece_velocity(self, piece: str) -> Vector:
        """Return how a free piece moved, shape (m, 6): vx vy vz [m/s] wx wy wz [rad/s], in the world's axes."""
        return np.column_stack([self[f"piece.{piece}.{part}"] for part in VELOCITY_NAMES])

    def vector(self, signal: str) -> Vector:
        """Return a signal of three columns, such as ``force.<sensor>``, shape (m, 3)."""
        return np.column_stack([self[f"{signal}.{axis}"] for axis in "xyz"])

    @property
    def stop_time(self) -> float:
        """When the run ended, in simulated time [s]."""
        return float(self.times[-1])

    @property
    def wall_time(self) -> float:
        """Wall-clock seconds of stepping and signals."""
        return self.stepping_time + self.signal_time

    @property
    def realtime_rate(self) -> float:
        """Simulated over wall-clock time of stepping and signals."""
        return self.stop_time / self.wall_time if self.wall_time > 0 else 0.0

    def save(
        self, folder: Path | str | None = None, *, force: bool = False, recording: bool = True, video: bool = False
    ) -> Path:
        """Write the result to a folder, ``runs/<station>-<time>`` unless given, and return it.

        See :func:`simrob_drake.results.files.save_result`.
        """
        from simrob_drake.results.files import default_folder, save_result  # files.py knows results, not the reverse

        target = default_folder(self.config.name) if folder is None else Path(folder)
        return save_result(self, target, force=force, recording=recording, video=video)

    def summary(self) -> dict[str, Any]:
        """Return what ``summary.json`` holds."""
        robots = self.plant.robots
        only = self.config.only_robot
        names = {name: robot.model.name for name, robot in robots.items()}
        return {
            "station": self.config.name,
            "robot": names.get(only) if only else names or None,
            "duration": self.config.duration,
            "stopped_by": self.stopped_by,
            "stop_time": self.stop_time,
            "message": self.message,
            "warnings": self.warnings,
            "solver": self.config.solver.model_dump() if self.config.mode == "dynamic" else None,
            "steps": len(self.step_times) - 1,
            "wall_time": self.wall_time,
            "realtime_rate": self.realtime_rate,
            "final": {
                "joint_position": self._by_axis("q", -1),
                "joint_torque": self._by_axis("tau", -1),
                "base_pose": self._final_pose("base"),
                "tcp_pose": self._final_pose("tcp"),
                "piece_pose": {piece: pose_vector(self.piece_pose(piece)[-1]) for piece in self.config.free_pieces},
            },
            "peak": {"joint_torque": self._peaks("tau"), "force": self._peak_forces()},
            "locomotion": self._locomotion(),
            "sensors": {name: self._sensor_note(name) for name in self.config.sensors},
            "versions": {
                "simrob_drake": simrob_drake.__version__,
                "drake": version("drake"),
                "numpy": version("numpy"),
                "python": platform.python_version(),
            },
        }

    def _robot(self, name: str | None) -> StationRobot:
        return self.plant.robots[named(name, list(self.plant.robots))]

    def _locomotion(self) -> dict[str, Any] | None:
        """Return how the legged robots walked, by robot where there are several; None where nothing could be told."""
        walkers = [] if self.ending == DIVERGED else legged_robots(self)
        found = {name: asdict(locomotion(self, name)) for name in walkers}
        return found.get(self.config.only_robot) if self.config.only_robot else found or None

    def _peak_forces(self) -> dict[str, float]:
        """Return the largest size of every contact force [N] by sensor."""
        sensors = [name for name, sensor in self.config.sensors.items() if sensor.kind == "force"]
        return {name: float(np.linalg.norm(self.vector(f"force.{name}"), axis=1).max()) for name in sensors}

    def _sensor_note(self, name: str) -> dict[str, str]:
        """Return what a sensor is, and how it was computed."""
        sensor = self.config.sensors[name]
        note: dict[str, str] = {"kind": sensor.kind}
        if isinstance(sensor, Force):
            note["tangential"] = tangential_source(self.plant, self.config, sensor)
        return note

    def _columns(self, signal: str) -> dict[str, Vector]:
        return {
            f"{robot.prefix}{axis}": self[f"{robot.prefix}{signal}.{axis}"]
            for robot in self.plant.robots.values()
            for axis in robot.axes
        }

    def _by_axis(self, signal: str, row: int) -> dict[str, float]:
        return {axis: float(values[row]) for axis, values in self._columns(signal).items()}

    def _peaks(self, signal: str) -> dict[str, float]:
        """Return the value of largest size of a signal, with its sign, by axis."""
        return {axis: float(values[np.argmax(np.abs(values))]) for axis, values in self._columns(signal).items()}

    def _final_pose(self, signal: str) -> Any:
        poses = {
            name: pose_vector(self.pose(signal, name)[-1])
            for name, robot in self.plant.robots.items()
            if f"{robot.prefix}{signal}.x" in self.names
        }
        return poses.get(self.config.only_robot) if self.config.only_robot else poses
