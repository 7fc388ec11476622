"""What the kinds of sensor share: their samples, while stepping or after the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ZeroOrderHold

from simrob_drake.blocks.wiring import fed
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.site import Surroundings
from simrob_drake.signals import Recorded
from simrob_drake.yaml_files import Strict


class Sensor(Strict):
    """A section of ``sensors``.

    A kind has its key ``kind``, and the methods ``check(key, station)``, which raises what is wrong with it before
    anything is built, and ``wire(builder, site, name)``, which adds its systems and declares its outputs.
    """

    @property
    def stepped(self) -> bool:
        """Whether it takes samples while the station is stepped; others are wired after the run unless something reads.

        A block that nothing reads still costs a solver time at every look at the diagram.
        """
        return False


def check_contact(key: str, sensor: str, station: Surroundings) -> None:
    """Check that a station has the contact section that a sensor needs."""
    if not station.has_contact:
        raise InvalidParameter(key, sensor, "in a station with a contact: section ({} takes its defaults)")


def sampled(builder: DiagramBuilder, name: str, port: OutputPort, rate: float | None) -> OutputPort:
    """Hold a port's value between samples, ``rate`` a second [Hz]; as it is where that is None."""
    return port if rate is None else fed(builder, name, ZeroOrderHold(1 / rate, port.size()), port)


def replayed(
    recorded: Recorded,
    times: Vector,
    *,
    block: LeafSystem,
    inputs: Mapping[str, OutputPort],
    output: str,
) -> Vector:
    """Let a sampled block go through a run that is over, as it would have while stepping.

    The block has one periodic discrete update and is part of no diagram; ``inputs`` tells, by the names of its ports,
    what they read.

    Returns:
        its output at the last sample before each of the times (m,) [s], shape (m, size).
    """
    attribute = block.GetUniquePeriodicDiscreteUpdateAttribute()
    period = attribute.period_sec()
    ticks = period * np.arange(int(np.floor(recorded.step_times[-1] / period + 1e-9)) + 1)
    held = np.clip((times / period + 1e-9).astype(int), 0, len(ticks) - 1)
    values = dict(zip(inputs, recorded.sample(list(inputs.values()), ticks), strict=True))
    context, port = block.CreateDefaultContext(), block.GetOutputPort(output)
    wanted, rows = set(held.tolist()), np.empty((len(ticks), port.size()))
    for tick, time in enumerate(ticks):
        context.SetTime(time)
        for name, row in values.items():
            block.GetInputPort(name).FixValue(context, row[tick])
        update = block.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(update)
        if tick in wanted:
            rows[tick] = port.Eval(context)
    return np.asarray(rows[held])


def axis_names(signal: str, sensor: str, axes: Sequence[str] = "xyz") -> tuple[str, ...]:
    """Return the columns of a sensor's signal: ``<signal>.<sensor>.<axis>``."""
    return tuple(f"{signal}.{sensor}.{axis}" for axis in axes)


def sensor_label(kind: str, name: str, rate: float | None = None) -> str:
    """Return what a sensor's block says in the picture."""
    return f"{kind}\n{name}" + (", sampled" if rate is not None else "")
