"""A contact force that is too large; limits by body region are in ``models/limits/iso_ts_15066.yaml``."""

from __future__ import annotations

from functools import cache
from typing import Literal

import numpy as np

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import Vector
from simrob_drake.parts.monitors.monitor import Made
from simrob_drake.parts.monitors.of_sensors import SensorMonitorSection
from simrob_drake.parts.site import Site, Surroundings
from simrob_drake.paths import models_root
from simrob_drake.quantities import Positive
from simrob_drake.yaml_files import Strict, read_yaml, validated


class ForceLimit(SensorMonitorSection):
    """End the run when the force at a force sensor is too large."""

    kind: Literal["force_limit"]
    limit: Positive | str
    """Largest force [N], or a body region of ISO/TS 15066 such as `hands_and_fingers`."""

    def check(self, name: str, station: Surroundings) -> None:
        """Check that there is a force sensor, and such a body region."""
        super().check(name, station)
        self.watched_sensor(name, station, "force")
        force_limit(self.limit)

    def made(self, name: str, site: Site) -> Made:
        """Return the block."""
        sensor, region = self.watched_sensor(name, site.station, "force"), str(self.limit)
        monitor = ForceLimitMonitor(
            names=site.station.sensors[sensor].body,
            limit=force_limit(self.limit),
            region=region if isinstance(self.limit, str) else "",
            **self.times,
        )
        return monitor, {"force": f"force.{sensor}"}


class ForceLimitMonitor(Monitor):
    """End the run when a contact force has been too large for too long.

    Ports:
        in  ``force`` (3): [N].
        out ``excess`` (1): size of the force over the limit [N].
    """

    def __init__(self, *, names: str, limit: float, region: str = "", hold: float = 0.0, after: float = 0.0) -> None:
        """Watch the force on what is called ``names`` up to ``limit`` [N], which a body ``region`` may have given."""
        super().__init__(hold=hold, after=after)
        if not (np.isfinite(limit) and limit > 0):
            raise InvalidParameter("limit", limit, "a positive force [N]")
        self._names, self._limit, self._region = names, limit, region
        self.watch(force=3)

    def excess(self, *values: Vector) -> float:
        """Return the size of the force over the limit [N]; one that is not a number counts as infinite."""
        (force,) = values
        excess = float(np.linalg.norm(force)) - self._limit
        return np.inf if np.isnan(excess) else excess

    def why(self, *values: Vector) -> str:
        """Say what feels how much."""
        limit = f"{self._limit:g} N" + (f" of {self._region.replace('_', ' ')}" if self._region else "")
        lasting = f" for {self.hold:g} s" if self.hold > 0 else ""
        return f"the force on {self._names} reached the limit of {limit}{lasting}"


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
