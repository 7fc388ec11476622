"""A loop around the servos: a sampled block that may take the place of what is asked below it."""

from collections.abc import Collection, Mapping

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, InputPortIndex

from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.frames import Vector
from simrob_drake.lifetime import weakly


class Loop(SampledBlock):
    """What loops share.

    Ports:
        in, out as those of any sampled block; with ``active`` (1) in its memory also ``layer``, an index for Drake's
        PortSwitch: that of its second input while ``active`` is not zero (its first port is the selector itself).
    """

    units: Mapping[str, str]
    """The unit of each output; ``1`` unless named."""

    def __init__(
        self, *, period: float, reads: Mapping[str, int], memory: Mapping[str, Vector], gives: Collection[str]
    ) -> None:
        """Make the block, as any sampled one."""
        super().__init__(period=period, reads=reads, memory=memory, gives=gives)
        if "active" in memory:
            index = AbstractValue.Make(InputPortIndex(1))
            self.DeclareAbstractOutputPort("layer", index.Clone, weakly(self._calc_layer), {self.xd_ticket()})

    def _calc_layer(self, context: Context, output: Value[InputPortIndex]) -> None:
        output.set_value(InputPortIndex(2 if self.remembered(context, "active")[0] else 1))
