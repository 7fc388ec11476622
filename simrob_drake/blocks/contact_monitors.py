"""Monitors of sensors: contact and contact force."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Context

from simrob_drake.blocks.monitor import Monitor
from simrob_drake.errors import InvalidParameter


class ContactMonitor(Monitor):
    """End the run when two things touch, as the proximity switch of the Simulink library does.

    Ports:
        in  ``distance`` (1): signed distance [m].
        out ``excess`` (1): how far the distance is below the threshold [m].
    """

    def __init__(self, *, names: str, threshold: float = 0.0, hold: float = 0.0, after: float = 0.0) -> None:
        """Watch the distance between two things, called ``names`` together, down to ``threshold`` [m]."""
        super().__init__(hold=hold, after=after)
        if not (np.isfinite(threshold) and threshold >= 0):
            raise InvalidParameter("threshold", threshold, "a distance, not negative [m]")
        self._names, self._threshold = names, threshold
        self._distance = self.watch("distance", 1)

    def excess(self, context: Context) -> float:
        """Return how far the distance is below the threshold [m]; one that is not a number counts as contact."""
        excess = self._threshold - float(self._distance.Eval(context)[0])
        return np.inf if np.isnan(excess) else excess

    def why(self, context: Context) -> str:
        """Say what touches what."""
        if self._threshold == 0:
            return f"{self._names} touch"
        return f"{self._names} are nearer than {1e3 * self._threshold:g} mm"


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
        self._force = self.watch("force", 3)

    def excess(self, context: Context) -> float:
        """Return the size of the force over the limit [N]; one that is not a number counts as infinite."""
        excess = float(np.linalg.norm(self._force.Eval(context))) - self._limit
        return np.inf if np.isnan(excess) else excess

    def why(self, context: Context) -> str:
        """Say what feels how much."""
        limit = f"{self._limit:g} N" + (f" of {self._region.replace('_', ' ')}" if self._region else "")
        lasting = f" for {self.hold:g} s" if self.hold > 0 else ""
        return f"the force on {self._names} reached the limit of {limit}{lasting}"
