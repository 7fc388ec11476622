"""A contact force that is too large; limits by body region are in ``models/limits/iso_ts_15066.yaml``."""

from functools import cache
from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Condition
from simrob_drake.errors import UnknownName
from simrob_drake.files import models_root
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import SensorMonitorSection, worst
from simrob_drake.parts.site import Surroundings
from simrob_drake.sections import Positive, Strict, validated
from simrob_drake.yaml_files import read_yaml


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

        def size(force: Vector) -> Vector:
            return np.array([np.linalg.norm(force) - limit])

        def why(*_: float) -> str:
            return f"the force on {body} reached the limit of {limit:g} N{region}{self.lasting}"

        return worst({f"force.{sensor}": 3}, size, why)


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
    """Return a limit [N]: a number as it is, a body region's from the table.

    Raises:
        UnknownName: no such region.
    """
    if not isinstance(limit, str):
        return limit
    regions = quasi_static_limits()
    if limit not in regions:
        raise UnknownName("body region", limit, regions)
    return regions[limit]
