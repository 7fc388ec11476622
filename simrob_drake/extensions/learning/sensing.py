"""What a policy may observe and ask for, as spaces of Gymnasium; and what encoders and IMUs of k robots tell it."""

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.frames import Vector, rotate_vectors
from simrob_drake.base.messages import message
from simrob_drake.blocks.command_bus import round_to_resolution
from simrob_drake.extensions.learning.policy import Policy
from simrob_drake.parts.sensors.frames import Imu
from simrob_drake.parts.sensors.joints import Encoders
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.stations.config import StationConfig

with importing_extra("learning", "rl"):
    import gymnasium

Places = npt.NDArray[np.intp]  # of some of the robots among all
Value = Callable[[str, Vector], Vector]
"""Gives an output of the robot, shape (m, size), by motions (m, nq + nv) of the plant."""
Sensor = TypeVar("Sensor", Encoders, Imu)


class PolicySensors:
    """The sensors that a policy reads, of k robots.

    Attributes:
        position, velocity: what encoders told last, shape (k, n) [rad, rad/s].
        orientation: what IMUs told last, shape (k, 4), qw qx qy qz.
        angular_velocity: likewise, shape (k, 3) [rad/s].
    """

    def __init__(
        self, count: int, policy: Policy, config: StationConfig, robot: StationRobot, value: Value
    ) -> None:
        """Take the sensors that the policy names; raises InvalidParameter: of another kind, or one that is late."""
        self._policy, self._config, self._robot, self._value = policy, config, robot, value
        self.encoders = self._section("position", Encoders) or self._section("velocity", Encoders)
        self.imu = self._section("orientation", Imu) or self._section("angular_velocity", Imu)
        axes = len(robot.axes)
        self.position, self.velocity = np.zeros((count, axes)), np.zeros((count, axes))
        self.orientation, self.angular_velocity = np.zeros((count, 4)), np.zeros((count, 3))
        self._bias, self._chance = np.zeros((count, 3)), np.random.default_rng()

    @property
    def rates(self) -> dict[str, float]:
        """Samples a second, by kind [Hz]."""
        return {own.kind: own.rate for own in (self.encoders, self.imu) if own is not None}

    def seed(self, seed: list[int] | None) -> None:
        """Let all noise follow from a seed."""
        self._chance = np.random.default_rng(seed)

    def begin(self, places: Places, motion: Vector) -> None:
        """Take the first samples of robots whose episodes begin, by their motions (m, nq + nv)."""
        if self.imu is not None:
            self._bias[places] = self.imu.gyroscope_bias * self._chance.standard_normal(
                (len(places), 3)
            )
            self._turn(self.imu, places, motion)
        if self.encoders is not None:
            self.position[places], self.velocity[places] = (
                self._measured(self.encoders, motion),
                0.0,
            )

    def sample(
        self, motion_at: Callable[[Places, float], Vector], times: tuple[Vector, float]
    ) -> None:
        """Take all samples of a control period, from times (k,) on, but that at its end, and the very first.

        ``motion_at`` gives motions of some robots (m, nq + nv) so long after the period, ``times[1]`` [s] long, began.
        """
        begins, period = times
        for own in filter(None, (self.encoders, self.imu)):
            for after in np.arange(0.0, period - 1e-9, 1 / own.rate).tolist():
                some = np.flatnonzero(begins >= (0 if after else period / 2))
                motion = motion_at(some, after)
                if isinstance(own, Encoders):
                    position = self._measured(own, motion)
                    speed = (position - self.position[some]) * own.rate
                    self.velocity[some] += (speed - self.velocity[some]) / (
                        1 + own.smoothing * own.rate
                    )
                    self.position[some] = position
                elif isinstance(own, Imu):
                    self._turn(own, some, motion)

    def _measured(self, own: Encoders, motion: Vector) -> Vector:
        units, true = self._robot.model.user_units, self._value("position", motion)
        noise = own.noise_deg * units * self._chance.standard_normal(true.shape)
        return round_to_resolution(true + noise, units * own.resolution(self._robot))

    def _turn(self, own: Imu, places: Places, motion: Vector) -> None:
        self.orientation[places] = orientation = self._value("base_pose", motion)[:, 3:]
        spin = rotate_vectors(orientation, self._value("base_velocity", motion)[:, 3:], -1.0)
        noise = own.gyroscope_noise * self._chance.standard_normal(spin.shape)
        self.angular_velocity[places] = spin + self._bias[places] + noise

    def _section(self, reads: str, kind: type[Sensor]) -> Sensor | None:
        """Return the section of a sensor that the policy reads; None where it reads what is true."""
        name = self._policy.reads.get(reads)
        if name is None:
            return None
        sensor, key = self._config.sensors[name], f"sensors.{name}"
        if not isinstance(sensor, kind):
            raise InvalidParameter(
                f"{key}.kind",
                sensor.kind,
                message("learning.encoders_or_imu", "encoders or imu: nothing else is told here"),
            )
        if sensor.delay_samples:
            raise InvalidParameter(
                f"{key}.delay",
                sensor.delay,
                message("learning.nothing_late", "0: nothing is told late here"),
            )
        return sensor


_FAR = 1e4  # beyond any rate, goal or force that a robot bears [rad/s, m, N]


def spaces(
    section: Policy, robot: StationRobot, sizes: Mapping[str, int]
) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Return the spaces of observations and of actions of one robot; ``sizes`` are of all that is observed, by name.

    Positions lie within the axes' limits, which a robot may pass by π; what lies beyond a bound is seen as the bound.
    """
    lower, upper = robot.model.axis_limits
    bounds = {name: (np.full(size, -_FAR), np.full(size, _FAR)) for name, size in sizes.items()}
    turns = np.pi * np.array([1.0, 0.5, 1.0])
    for name, most in (
        ("attitude", turns),
        ("lean", turns[:2]),
        ("heading_error", np.pi),
        ("action", 1.0),
        ("clock", 1.0),
    ):
        if name in bounds:
            bounds[name] = (0 * bounds[name][0] - most, 0 * bounds[name][1] + most)
    low, high = (np.clip(limit - robot.initial, -_FAR, _FAR) for limit in (lower, upper))
    bounds["position"] = (low - np.pi, high + np.pi)
    least, most = (
        np.concatenate([bounds[name][end] for name in section.observes]) for end in (0, 1)
    )
    observations = gymnasium.spaces.Box(
        least.astype(np.float32), most.astype(np.float32), dtype=np.float32
    )
    return observations, gymnasium.spaces.Box(-1.0, 1.0, (sizes["action"],), np.float32)
