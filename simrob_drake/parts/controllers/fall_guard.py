"""A loop that takes a protective posture when its robot begins to fall (the thesis, p. 108 and 109)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.frames import Vector, lean
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.site import ResolvedRobot, Site, StationRobot
from simrob_drake.quantities import NotNegative, Positive
from simrob_drake.yaml_files import Number


class FallGuard(LoopSection):
    """Move axes to a posture, such as arms forward, once the base is too low or leans too far; it stays until reset.

    It drives the axes of its posture alone.
    """

    kind: Literal["fall_guard"]
    height: Positive | None = None
    """Height of the base over the ground beneath, below which it acts [m]."""
    tilt_deg: Positive | None = None
    """Angle from how the base stood at the start beyond which it acts."""
    posture_deg: dict[str, Number] = Field(min_length=1)
    """Where axes go then, by name."""
    duration: NotNegative = 0.2
    """How long they take [s]."""
    reset_after: Positive | None = None
    """How long all must be well again before it lets go [s]; never unless given."""

    @model_validator(mode="after")
    def _some_bound(self) -> FallGuard:
        if self.height is None and self.tilt_deg is None:
            raise ValueError("a fall guard needs a threshold: height or tilt_deg")
        return self

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes of the posture."""
        return [robot.axes[robot.model.axis_index(axis, "posture_deg")] for axis in self.posture_deg]

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop."""
        return ProtectivePosture(
            period=1 / self.rate,
            posture=robot.model.user_units * robot.model.axis_vector(dict(self.posture_deg), f"{key}.posture_deg"),
            duration=self.duration,
            height=-math.inf if self.height is None else self.height,
            tilt=math.inf if self.tilt_deg is None else math.radians(self.tilt_deg),
            ground=site.plant.ground,
            up=robot.base.rotation().inverse() @ np.array([0.0, 0.0, 1.0]),
            reset_after=math.inf if self.reset_after is None else self.reset_after,
        )


class ProtectivePosture(SampledBlock):
    """Ramp to a posture from where the robot is asked to be, once the base falls.

    Ports:
        in  ``base_pose`` (7): x y z [m] and a quaternion; ``reference`` (n) [rad]: where the ramp begins.
        out ``target`` (n) [rad]; ``active`` (1): 1 while it acts.
    """

    def __init__(
        self,
        *,
        period: float,
        posture: Vector,
        duration: float,
        height: float,
        tilt: float,
        up: Vector,
        ground: Ground | None = None,
        reset_after: float = math.inf,
    ) -> None:
        """Make the block.

        Args:
            period: between samples [s].
            posture: where all axes go, shape (n,) [rad].
            duration: of the way there [s].
            height: of the base over the ground below which it acts [m].
            tilt: angle from upright beyond which it acts [rad].
            up: what of the base points up while it stands upright, shape (3,).
            ground: beneath it; the plane z = 0 unless given.
            reset_after: how long all must be well before it lets go [s].
        """
        self.units = {"target": "rad"}
        self._posture, self._duration = posture, duration
        self._height, self._tilt, self._up, self._reset_after = height, tilt, up.tolist(), reset_after
        self._ground = ground or Ground()
        zero = np.zeros(len(posture))
        memory = {"target": zero, "active": np.zeros(1), "elapsed": np.zeros(1), "origin": zero, "well": np.zeros(1)}
        reads = {"base_pose": 7, "reference": len(posture)}
        super().__init__(period=period, reads=reads, memory=memory, gives=("target", "active"))

    def falls(self, base_pose: Vector) -> bool:
        """Tell whether a pose of the base (7,) is beyond a threshold."""
        _, _, _, *quaternion = base_pose.tolist()
        return bool(self._ground.height(base_pose) < self._height or lean(self._up, *quaternion) > self._tilt)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the next point of the way to the posture, if the robot falls or has fallen."""
        falls = self.falls(read["base_pose"])
        if not memory["active"][0]:
            if not falls:
                return {}
            return {"active": 1.0, "target": read["reference"], "origin": read["reference"], "elapsed": 0.0}
        well = 0.0 if falls else memory["well"][0] + self.period
        if well >= self._reset_after:
            return {"active": 0.0, "well": 0.0}
        elapsed = memory["elapsed"][0] + self.period
        part = min(elapsed / self._duration, 1.0) if self._duration > 0 else 1.0
        target = memory["origin"] + part * (self._posture - memory["origin"])
        return {"target": target, "elapsed": elapsed, "well": well}
