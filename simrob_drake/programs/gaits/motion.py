"""What a planner hands to a simulation: joint angles over time, and the pose that the robot begins in."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.trajectories import Trajectory

from simrob_drake.blocks.references import hermite
from simrob_drake.files import ROBOT_FILE, models_root
from simrob_drake.frames import Vector, poses_from_matrices
from simrob_drake.parts.monitors.places import Fall
from simrob_drake.robots.axis_map import AxisValues
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import ServoConfig, StationConfig
from simrob_drake.stations.load import ONLY_ROBOT, load_station
from simrob_drake.stations.solver_config import ContinuousSolver, SolverConfig

MAX_STEP = 0.005
"""Of the scheme `cenic` [s]: references stand still over a step. Steps of this length are as good as longer ones with
error control, which work out each step thrice, and take half to three quarters of their time."""
_FLOOR_AROUND = 1.0  # floor beyond the way that a motion goes [m]


@dataclass(frozen=True)
class JointMotion:
    """A planned motion of a robot.

    Attributes:
        model: of the robot.
        feet: the kind of feet it is planned for; the default one if None.
        times: shape (m,) [s].
        positions: of the axes, shape (m, n) [rad].
        root: planned poses of the root in the world, shape (m, 4, 4).
        servo: gains of the servos for it, in place of the station's: kp, kd.
        feed_velocity: whether the servos are told the reference's velocity, too.
        falls: whether it ends on the floor, as it shall.
    """

    model: RobotModel
    feet: str | None
    times: Vector
    positions: Vector
    root: Vector
    servo: Mapping[str, AxisValues] = field(default_factory=dict)
    feed_velocity: bool = True
    falls: bool = False

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    @property
    def velocities(self) -> Vector:
        """Of the axes, shape (m, n) [rad/s]; zero at both ends."""
        rates = np.gradient(self.positions, self.times, axis=0)
        rates[[0, -1]] = 0.0
        return np.asarray(rates)

    def trajectory(self) -> Trajectory:
        """Return the angles as a smooth curve through the samples (cubics with their velocities)."""
        return hermite(self.times, self.positions, self.velocities)

    def station(self, overrides: Mapping[str, Any] | None = None, *, name: str | None = None) -> StationConfig:
        """Return the robot's dynamic station, set to begin this motion; its trajectory is the reference to give it.

        Args:
            overrides: further changes, as of ``load_station``; what they say is not adapted to the motion.
            name: of the station; ``<robot>_dynamic`` unless given.
        """
        settings: dict[str, Any] = {
            "robot.base": poses_from_matrices(self.root)[0].tolist(),
            "robot.initial_deg": np.rad2deg(self.positions[0]).tolist(),
            "duration": self.duration,
            "program": None,
        }
        if self.feet is not None:
            settings["robot.feet"] = self.feet
        if self.model.folder != models_root() / self.model.name:
            settings["robot.model"] = str(self.model.folder / ROBOT_FILE)
        changes = overrides or {}
        config = load_station(name or f"{self.model.name}_dynamic", {**settings, **changes})
        nested = {f"{key}.{inner}" for key, value in changes.items() if isinstance(value, Mapping) for inner in value}
        return self.adapted(config, ONLY_ROBOT, changed={*changes, *nested})

    def adapted(
        self, config: StationConfig, robot: str, *, start: float = 0.0, changed: Collection[str] = ()
    ) -> StationConfig:
        """Return a station on which a robot can perform the motion; a kinematic one is as it was.

        Its servos have the motion's gains, and are told the velocity if it feeds it; the floor is large enough
        wherever the robot goes; steps of `cenic` are short enough for servos to follow, and of one length unless
        the station says `error_control` itself. If the robot shall fall, no monitor of its fall is left.

        Args:
            config: the station.
            robot: who performs.
            start: how far from the world's origin [m].
            changed: dotted keys of what stays as it is.
        """
        if config.mode == "kinematic":
            return config
        gains = {key: value for key, value in self.servo.items() if f"servo.{key}" not in changed}
        servo = ServoConfig(**{**config.servo_of(robot).model_dump(exclude_unset=True), **gains})
        entry = config.robots[robot].model_copy(update={"servo": servo})
        changes: dict[str, Any] = {"robots": {**config.robots, robot: entry}}
        if config.floor is not None and "floor.size" not in changed:
            way = np.linalg.norm(self.root[:, :2, 3] - self.root[0, :2, 3], axis=1).max()
            size = max(config.floor.size, float(np.ceil(2.0 * (start + way + _FLOOR_AROUND))))
            changes["floor"] = config.floor.model_copy(update={"size": size})
        if self.feed_velocity and "inputs" not in changed:
            changes["inputs"] = tuple(dict.fromkeys((*config.inputs, "reference_velocity")))
        if self.falls and "monitors" not in changed:
            changes["monitors"] = unwatched(config, robot)
        return config.model_copy(update={**changes, "solver": short_steps(config.solver, changed)})


def unwatched(config: StationConfig, robot: str) -> dict[str, Any]:
    """Return the monitors of a station without those of a robot's fall, by name."""
    return {
        name: each
        for name, each in config.monitors.items()
        if not (isinstance(each, Fall) and each.faller(config.only_robot) == robot)
    }


def short_steps(solver: SolverConfig, changed: Collection[str] = ()) -> SolverConfig:
    """Return a solver of steps short enough for servos to follow, without ``changed`` keys; `cenic` stays as it is."""
    if not isinstance(solver, ContinuousSolver) or solver.scheme != "cenic":
        return solver
    steps: dict[str, Any] = {}
    if "solver.max_step" not in changed:
        steps["max_step"] = min(solver.max_step, MAX_STEP)
    if "solver.accuracy" not in changed and "error_control" not in solver.model_fields_set:
        steps["error_control"] = False
    return solver.model_copy(update=steps)
