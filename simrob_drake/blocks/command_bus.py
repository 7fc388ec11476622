"""A bus that brings servos their commands: sampled, rounded and late."""

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock


class CommandBus(SampledBlock):
    r"""Hand on what servos are to do, as they get it.

    At each sample of period T the servos get what was asked for d samples ago, positions rounded to their resolution r:

    .. math:: q_k = r\,\mathrm{round}(q_r(t_{k-d}) / r), \qquad v_k = v_r(t_{k-d}) .

    Ports:
        in  ``reference`` (n) [rad or m] and, where it is asked for, ``reference_velocity`` (n) [rad/s or m/s].
        out the same.
    """

    def __init__(self, *, period: float, delay: int, resolution: Vector, with_velocity: bool) -> None:
        """Make the bus of n servos: sampled each ``period`` [s], late by ``delay`` samples, with or without velocities.

        The ``resolution`` is r of each, shape (n,) [rad or m]; 0 for none.
        """
        names = ("reference", "reference_velocity") if with_velocity else ("reference",)
        sizes = dict.fromkeys(names, len(resolution))
        memory = {name: np.zeros(len(resolution)) for name in names}
        super().__init__(period=period, reads=sizes, memory=memory, gives=names, delay=delay, at_once=True)
        self._resolution = resolution

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return what the servos are told."""
        return {
            **{name: read[name] for name in self.outputs},
            "reference": rounded(read["reference"], self._resolution),
        }


def rounded(values: Vector, resolution: Vector) -> Vector:
    """Return values (k,) rounded to steps of a resolution each, shape (k,); 0 leaves one as it is."""
    step = np.where(resolution > 0, resolution, 1.0)
    return np.where(resolution > 0, np.round(values / step) * step, values)
