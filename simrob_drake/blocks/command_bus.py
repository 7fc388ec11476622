"""Bus between a robot's controller and its servos: commands arrive sampled, rounded and late."""

from typing import TYPE_CHECKING

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import former_names_of
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock


class CommandBus(SampledBlock):
    r"""Pass the commands of n servos on as a digital bus does.

    At sample k, the servos get the reference :math:`q_r` and its velocity :math:`v_r` of d samples before. Positions
    are rounded to the resolution r of their servo:

    .. math:: q_k = r\,\mathrm{round}(q_r(t_{k-d}) / r), \qquad v_k = v_r(t_{k-d}) .

    Ports:
        in  ``reference`` (n) [rad or m] and, if the servos take velocities, ``reference_velocity`` (n) [rad/s or m/s].
        out the same names and sizes.
    """

    def __init__(
        self,
        *,
        period: float,
        delay: int,
        resolution: Vector,
        with_velocity: bool,
    ) -> None:
        """Create the bus of n servos.

        Args:
            period: time between two samples [s].
            delay: delay d of the commands, in samples.
            resolution: smallest step r of each servo's position, shape (n,) [rad or m]; 0 leaves a position unrounded.
            with_velocity: whether the bus also carries velocities.
        """
        names = ("reference", "reference_velocity") if with_velocity else ("reference",)
        count = len(resolution)
        super().__init__(
            period=period,
            reads=dict.fromkeys(names, count),
            memory={name: np.zeros(count) for name in names},
            gives=names,
            delay=delay,
            # Servos compute torques as soon as the run begins: without an early sample, these would be the torques for
            # commands of 0.
            at_once=True,
        )
        self._resolution = resolution

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the commands that enter the bus at this sample, by output. Only positions are rounded.

        They leave the bus d samples later: the base class delays the outputs.
        """
        changes = {name: read[name] for name in self.outputs}
        changes["reference"] = round_to_resolution(read["reference"], self._resolution)
        return changes


def round_to_resolution(values: Vector, resolution: Vector) -> Vector:
    """Round values (k,) to multiples of a resolution (k,), each by its own. A resolution of 0 leaves the value."""
    is_rounded = resolution > 0
    # 1 instead of 0, by which NumPy would divide.
    step = np.where(is_rounded, resolution, 1.0)
    return np.where(is_rounded, np.round(values / step) * step, values)


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"rounded": "round_to_resolution"})
