"""What bodies may come to that ends a run: touching, being pressed, falling, leaving a box."""

import math
from functools import cache
from typing import Literal

import numpy as np
from pydantic import model_validator

from simrob_drake.blocks.monitor import Condition
from simrob_drake.errors import one_of
from simrob_drake.files import models_root
from simrob_drake.frames import Vector, lean
from simrob_drake.parts.monitors.monitor import PoseMonitorSection, SensorMonitorSection, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import NotNegative, Positive, Strict, Triple, validated
from simrob_drake.yaml_files import read_yaml


class Contact(SensorMonitorSection):
    """End the run when two things touch: a distance sensor reads 0."""

    kind: Literal["contact"]
    distance: NotNegative = 0.0
    """Distance that counts as contact [m]."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run, as the proximity switch of the Simulink library does; its excess is in metres."""
        sensor = self.watched_sensor(name, station, "distance")
        names = f"{station.sensors[sensor].body} and {station.sensors[sensor].other}"
        why = f"{names} are nearer than {1e3 * self.distance:g} mm" if self.distance else f"{names} touch"
        return worst({f"distance.{sensor}": 1}, lambda distance: self.distance - distance, lambda *_: why)


class ForceLimit(SensorMonitorSection):
    """End the run when the force at a force sensor is too large."""

    kind: Literal["force_limit"]
    limit: Positive | str
    """Largest force [N], or a body region of ISO/TS 15066 such as `hands_and_fingers`."""

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the size of the force over the limit [N]."""
        sensor = self.watched_sensor(name, station, "force")
        body, limit = station.sensors[sensor].body, force_limit(self.limit)
        region = f" of {self.limit.replace('_', ' ')}" if isinstance(self.limit, str) else ""
        why = f"the force on {body} reached the limit of {limit:g} N{region}{self.lasting}"
        return worst({f"force.{sensor}": 3}, lambda force: np.array([np.linalg.norm(force) - limit]), lambda *_: why)


class _Table(Strict):
    source: str
    unit: str
    quasi_static_force: dict[str, Positive]


@cache
def quasi_static_limits() -> dict[str, float]:
    """Return the largest quasi-static forces [N] by body region."""
    file = models_root() / "limits" / "iso_ts_15066.yaml"
    return dict(validated(_Table, read_yaml(file), file).quasi_static_force)


def force_limit(limit: float | str) -> float:
    """Return a limit [N]: a number as it is, a body region's from the table; raises UnknownName: no such region."""
    regions = quasi_static_limits()
    return regions[one_of("body region", limit, regions)] if isinstance(limit, str) else limit


class Fall(PoseMonitorSection):
    """End the run when a robot's base, or a free piece, is too low or leans too far."""

    kind: Literal["fall"]
    height: Positive | None = None
    """Height of its origin over the ground beneath, below which it has fallen [m]."""
    tilt_deg: Positive | None = None
    """Angle from how it stood at the start beyond which it has fallen."""

    @model_validator(mode="after")
    def _some_bound(self) -> "Fall":
        if self.height is None and self.tilt_deg is None:
            raise ValueError("a fall needs a bound: height or tilt_deg")
        return self

    def faller(self, only_robot: str | None) -> str | None:
        """Return the robot that it watches, of a station with one robot or several; None if it watches a piece."""
        return None if self.piece is not None else self.robot or only_robot

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is the larger part of a bound by which it is exceeded."""
        who, watched, start = self.watched_pose(name, station, "base_pose")
        ground = station.ground
        tilt = None if self.tilt_deg is None else math.radians(self.tilt_deg)
        up: list[float] = (start.rotation().inverse() @ np.array([0.0, 0.0, 1.0])).tolist()

        def parts(pose: Vector) -> tuple[float, float]:
            """Return the parts by which height and tilt exceed their bounds, -1 for a bound that is not given."""
            _, _, _, *quaternion = pose.tolist()
            low = -1.0 if self.height is None else 1 - ground.height(pose) / self.height
            return low, -1.0 if tilt is None else lean(up, *quaternion) / tilt - 1

        def excess(pose: Vector) -> float:
            found = parts(pose)
            return max(found) if all(map(math.isfinite, found)) else math.inf

        def why(pose: Vector) -> str:
            low, leaning = parts(pose)
            if not (math.isfinite(low) and math.isfinite(leaning)):
                return f"{who} is nowhere"
            if tilt is None or low >= leaning:
                return f"{who} fell: its height is below {self.height:g} m"
            return f"{who} fell: it leans by more than {self.tilt_deg:g} deg"

        return Condition(watched, excess, why)


_XYZ = "xyz"


class Workspace(PoseMonitorSection):
    """End the run when the tool, or a free piece, leaves a box."""

    kind: Literal["workspace"]
    lower: Triple
    """Smallest x, y and z in the world [m]."""
    upper: Triple
    """Largest x, y and z in the world [m]."""
    tool: str | None = None
    """The robot's tool that is watched; its `tcp` unless given."""

    @model_validator(mode="after")
    def _not_empty(self) -> "Workspace":
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"lower must be below upper, {list(self.upper)}")
        return self

    def condition(self, name: str, station: Surroundings) -> Condition:
        """Return what ends a run; its excess is how far outside the origin of the pose is [m]."""
        who, watched, _ = self.watched_pose(name, station, f"tcp_pose.{self.tool}" if self.tool else "tcp_pose")

        def overshoots(pose: Vector) -> Vector:
            return np.concatenate([pose[:3] - self.upper, self.lower - pose[:3]])

        def why(index: int, _: float) -> str:
            axis = index % len(_XYZ)
            side, bound = ("above", self.upper[axis]) if index < len(_XYZ) else ("below", self.lower[axis])
            return f"{who} left its workspace: {_XYZ[axis]} {side} {bound:g} m"

        return worst(watched, overshoots, why)
