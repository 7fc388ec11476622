"""What the kinds of sensor share; samples are taken while stepping where something reads them, else afterwards."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, ClassVar

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ZeroOrderHold

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import release_with
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Boolean, NotNegative, Positive, Strict
from simrob_drake.base.signals import Compute, Recorded, Signal
from simrob_drake.blocks.block import add_and_connect
from simrob_drake.parts.resolved import Surroundings
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import check_frame


class Sensor(Strict, ABC):
    """A section of ``sensors``."""

    takes_images: ClassVar[bool] = False
    """Whether it is a camera, whose images a result can save."""
    measures_shapes: ClassVar[bool] = False
    """Whether it measures the collision shapes of robots and pieces, which a kinematic station then has."""

    kind: str

    def check(self, key: str, station: Surroundings) -> None:
        """Check before anything is built, that its robot and its frame exist; raises SimrobError: what is wrong."""
        if hasattr(self, "robot"):
            station.robot(self.robot, key)
        if hasattr(self, "frame"):
            check_frame(station, f"{key}.frame", self.frame)

    @abstractmethod
    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add its systems, and declare its outputs."""

    @property
    def stepped(self) -> bool:
        """Whether it takes samples while the station is stepped; others are wired after the run unless something reads.

        A block that nothing reads still costs a solver time at every look at the diagram.
        """
        return False

    def read(self, sensors: Mapping[str, Any]) -> dict[str, str]:
        """Return which of a station's other sensors it reads, if they are there, by what it reads them for."""
        return {}


class ShapeSensor(Sensor):
    """What sensors at the collision shapes of a body share."""

    body: str
    """What it is at: a robot, a link, a piece, or a shape of a piece (`<piece>.<shape>`)."""
    rate: Positive | None = None
    """Samples a second that a loop or a monitor gets [Hz]; it may always look unless given."""

    @property
    def stepped(self) -> bool:
        """Whether it takes samples."""
        return self.rate is not None


def check_contact(key: str, sensor: str, station: Surroundings) -> None:
    """Check that a station has the contact section that a sensor needs.

    Args:
        key: key of the sensor in the station, such as ``sensors.foot``.
        sensor: what it is, in words.
        station: what the station has.

    Raises:
        InvalidParameter: it has none.
    """
    if not station.has_contact:
        raise InvalidParameter(
            key,
            sensor,
            message("parts.contact_section_needed", "in a station with a contact: section ({{}} takes its defaults)"),
        )


def sampled(builder: DiagramBuilder, name: str, port: OutputPort, rate: float | None) -> OutputPort:
    """Hold a port's value between samples, ``rate`` a second [Hz]; as it is where that is None."""
    return port if rate is None else add_and_connect(builder, name, ZeroOrderHold(1 / rate, port.size()), port)


def axis_names(signal: str, sensor: str, axes: Sequence[str] = "xyz") -> tuple[str, ...]:
    """Return the columns of a sensor's signal: ``<signal>.<sensor>.<axis>``."""
    return tuple(f"{signal}.{sensor}.{axis}" for axis in axes)


def sensor_label(kind: str, name: str, rate: float | None = None) -> str:
    """Label of a sensor's block in the picture.

    Args:
        kind: words for the kind of the sensor.
        name: name of the sensor.
        rate: rate of its samples [Hz]. None if it is not sampled, or if its kind always is.
    """
    if rate is None:
        return compound("{kind}\n{name}", kind=kind, name=name)
    return message("parts.block_sampled", "{kind}\n{name}, sampled", kind=kind, name=name)


class SampledSensor(Sensor):
    """What sensors whose block has one periodic discrete update share."""

    rate: Positive = 200.0
    """Samples a second [Hz]."""
    in_loop: Boolean = False
    """Sample while stepping, so that blocks can read it; otherwise it is computed after the run and costs nothing."""

    delay: NotNegative = 0.0
    """How late its figures are told [s], to the nearest sample."""

    @property
    def late_samples(self) -> int:
        """By how many samples its figures are late."""
        return round(self.delay * self.rate)

    @property
    def stepped(self) -> bool:
        """Whether it samples while stepping."""
        return self.in_loop

    def _give(
        self,
        builder: DiagramBuilder,
        site: Site,
        name: str,
        *,
        block: LeafSystem,
        title: str,
        inputs: Mapping[str, OutputPort | Compute],
        signals: Mapping[str, Signal],
        robot: StationRobot | None = None,
    ) -> None:
        """Add the outputs ``<port>.<sensor>`` of a block, or what computes them after the run.

        ``inputs`` tells, by the names of the block's ports, what they read: ports, or after the run what gives it
        then; ``signals`` what its outputs are.
        """
        if self.in_loop:
            builder.AddNamedSystem(f"sensor.{name}", block)
            site.picture.draw(f"sensor.{name}", "sensor", sensor_label(title, name), robot)
            for port, source in inputs.items():
                assert isinstance(source, OutputPort)  # what is read while stepping samples then, too
                builder.Connect(source, block.GetInputPort(port))
        else:
            release_with(site.plant.plant, block)
        for port, signal in signals.items():
            if self.in_loop:
                output = f"{port}.{name}"
                site.outputs.add(output, block.GetOutputPort(port), replace(signal, output=output))
            else:
                compute = partial(_after_the_run, block=block, inputs=inputs, output=port)
                site.outputs.later[f"{port}.{name}"] = compute
                site.outputs.signals.append(replace(signal, compute=compute))


@lru_cache(maxsize=16)  # the bias of a sensor is drawn at each of its samples
def normal(seed: int, number: int, size: int) -> Vector:
    """Return figures (size,) of the standard normal distribution; a generator each, so that nothing remembers one."""
    return np.random.default_rng([seed, number]).standard_normal(size)


def _after_the_run(
    recorded: Recorded, times: Vector, *, block: LeafSystem, inputs: Mapping[str, OutputPort | Compute], output: str
) -> Vector:
    """Return an output of a block at the last sample before each of the times (m,) [s], shape (m, size)."""
    if block not in recorded.memo:
        recorded.memo[block] = replayed(recorded, block=block, inputs=inputs)
    period, rows = recorded.memo[block]
    first_tick = _first_tick(recorded, period)
    return np.asarray(rows[output][np.clip((times / period + 1e-9).astype(int) - first_tick, 0, len(rows[output]) - 1)])


def _first_tick(recorded: Recorded, period: float) -> int:
    """Number of the first sample within a run, at the time number * ``period``: 0 for a run that begins at 0."""
    return int(np.ceil(recorded.step_times[0] / period - 1e-9))


def replayed(
    recorded: Recorded, *, block: LeafSystem, inputs: Mapping[str, OutputPort | Compute]
) -> tuple[float, dict[str, Vector]]:
    """Let a sampled block go through a past run; return its period [s], and its outputs at each sample, (k, size)."""
    period = block.GetUniquePeriodicDiscreteUpdateAttribute().period_sec()
    end_tick = int(np.floor(recorded.step_times[-1] / period + 1e-9)) + 1
    ticks = period * np.arange(_first_tick(recorded, period), end_tick)
    ports = {name: source for name, source in inputs.items() if isinstance(source, OutputPort)}
    values = dict(zip(ports, recorded.sample(list(ports.values()), ticks), strict=True))
    before = np.maximum(
        ticks - period, recorded.step_times[0]
    )  # while stepping, sensors that sample together see each other's last
    values |= {name: source(recorded, before) for name, source in inputs.items() if not isinstance(source, OutputPort)}
    context = block.CreateDefaultContext()
    outputs = [block.get_output_port(index) for index in range(block.num_output_ports())]
    rows = {port.get_name(): np.empty((len(ticks), port.size())) for port in outputs}
    for tick, time in enumerate(ticks):
        context.SetTime(time)
        for name, row in values.items():
            block.GetInputPort(name).FixValue(context, row[tick])
        update = block.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(update)
        for port in outputs:
            rows[port.get_name()][tick] = port.Eval(context)
    return period, rows
