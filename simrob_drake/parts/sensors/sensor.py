"""Base classes of sensors, and the replay of sensors after a run.

A sensor that a controller reads, itself or by another sensor, is a block of the diagram, and takes its samples while
the station is stepped. Any other sensor would only cost the solver time, so its values are computed after the run from
the recorded states. For this, the block of a sampled sensor is *replayed* outside of the diagram: it takes all samples
of the run.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ZeroOrderHold

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import release_with
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.base.sections import Boolean, NotNegative, Positive, Strict
from simrob_drake.base.signals import Compute, Recorded, Signal
from simrob_drake.blocks.block import add_and_connect
from simrob_drake.parts.resolved import StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import check_frame


class Sensor(Strict, ABC):
    """Base class of the sections under ``sensors`` of a station."""

    takes_images: ClassVar[bool] = False
    """Whether the sensor is a camera, whose images a result can save."""
    measures_shapes: ClassVar[bool] = False
    """Whether the sensor measures collision shapes of robots and pieces. A kinematic station then gets these shapes."""

    kind: str

    def check(self, key: str, station: StationContents) -> None:
        """Check before anything is built that the sensor's robot and frame exist.

        Args:
            key: key of the sensor in the station, such as ``sensors.foot``.
            station: robots, pieces and other contents of the station.

        Raises:
            SimrobError: the robot or the frame does not exist, or no robot is named and the station does not have
                exactly one; the message names the key.
        """
        # Kinds of sensor declare a field ``robot`` or ``frame`` if they need one.
        if hasattr(self, "robot"):
            station.robot(self.robot, key)
        if hasattr(self, "frame"):
            check_frame(station, f"{key}.frame", self.frame)

    @abstractmethod
    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add the sensor's blocks to the diagram, and declare its outputs.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
        """

    @property
    def samples_while_stepping(self) -> bool:
        """Whether the sensor takes samples while the station is stepped.

        A run leaves other sensors out of the diagram that it steps, unless a controller reads them, itself or by
        another sensor: a block that nothing reads still costs a solver time at every evaluation of the diagram. Their
        values are computed from the recorded states: those that monitors need at each recorded step, others after the
        run.
        """
        return False

    def read(self, sensors: Mapping[str, Any]) -> dict[str, str]:
        """Find the other sensors that this sensor reads.

        Args:
            sensors: sections of the station's sensors, by name.

        Returns:
            The names of the sensors, by the purpose for which they are read.
        """
        return {}


keep_former_attributes(Sensor, stepped="samples_while_stepping")


class ShapeSensor(Sensor):
    """Base class of sensors at the collision shapes of a body."""

    body: str
    """Body at which it measures: a robot, a link, a piece, or a shape of a piece (`<piece>.<shape>`)."""
    rate: Positive | None = None
    """Samples a second that a loop or a monitor gets [Hz]; if it is left out, they get the present value."""

    @property
    def samples_while_stepping(self) -> bool:
        """Whether the sensor takes samples, which it does while the station is stepped."""
        return self.rate is not None


def check_contact(key: str, sensor: str, station: StationContents) -> None:
    """Check that a station has the contact section that a sensor needs.

    Args:
        key: key of the sensor in the station, such as ``sensors.foot``.
        sensor: the kind of the sensor, in words.
        station: contents of the station.

    Raises:
        Unsuitable: the station has no contact section.
    """
    if not station.has_contact:
        raise Unsuitable(
            key,
            message(
                "parts.contact_section_needed", "{sensor} needs the section contact", sensor=sensor
            ),
            message("parts.add_contact", "add contact: {{}}, which takes its defaults"),
        )


def add_sample_and_hold(
    builder: DiagramBuilder, name: str, port: OutputPort, rate: float | None
) -> OutputPort:
    """Add a block that samples a port and holds its value between samples.

    Args:
        builder: builder of the diagram.
        name: name of the block.
        port: the port.
        rate: sampling rate [Hz]. If it is None, the port is returned itself, without a block.
    """
    if rate is None:
        return port
    return add_and_connect(builder, name, ZeroOrderHold(1 / rate, port.size()), port)


def axis_names(signal: str, sensor: str, axes: Sequence[str] = "xyz") -> tuple[str, ...]:
    """Make the names of the result columns of a sensor's signal: ``<signal>.<sensor>.<axis>``.

    A text in place of a list of axes stands for its letters: "xyz" for x, y and z.
    """
    return tuple(f"{signal}.{sensor}.{axis}" for axis in axes)


def sensor_label(kind: str, name: str, rate: float | None = None) -> str:
    """Make the label of a sensor's block in the block picture: its kind, its name and, if needed, "sampled".

    Kinds of sensors that are always sampled need no such word.

    Args:
        kind: words for the kind of the sensor.
        name: name of the sensor.
        rate: sampling rate of a sensor whose kind can also be continuous [Hz]. The label does not show the number. If
            it is None, the label does not say "sampled".
    """
    if rate is None:
        return compound("{kind}\n{name}", kind=kind, name=name)
    return message("parts.block_sampled", "{kind}\n{name}, sampled", kind=kind, name=name)


class SampledSensor(Sensor):
    """Base class of sensors whose block is a `LeafSystem` with one periodic discrete update."""

    rate: Positive = 200.0
    """Samples a second [Hz]."""
    in_loop: Boolean = False
    """Sample while stepping, so that blocks can read it; otherwise it is computed after the run and costs nothing."""

    delay: NotNegative = 0.0
    """Delay of its values [s], rounded to whole samples."""

    @property
    def delay_samples(self) -> int:
        """Delay of the sensor, in samples."""
        return round(self.delay * self.rate)

    @property
    def samples_while_stepping(self) -> bool:
        """Whether the sensor takes samples while the station is stepped."""
        return self.in_loop

    def _add_block(
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
        """Add the sensor's block to the diagram, or arrange that it is replayed after the run; declare its outputs.

        Each output port of the block becomes the station's output ``<port>.<sensor>``. It is a port only if the block
        is in the diagram, and otherwise a function that computes the values after the run.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
            block: the block.
            title: words for the kind of the sensor, in the block picture.
            inputs: source of each input port of the block, by the port's name: a port, or a function that computes
                the input after the run (only for a sensor that is not in a loop).
            signals: declaration of each output port of the block, by the port's name.
            robot: robot in whose part of the block picture the block is drawn, or None.
        """
        if not self.in_loop:
            # No diagram owns the block, so it is kept as long as the plant. All of its outputs share one replay, see
            # `_compute_after_run`.
            release_with(site.plant.plant, block)
            for port, signal in signals.items():
                compute = partial(_compute_after_run, block=block, inputs=inputs, output=port)
                site.outputs.after_run[f"{port}.{name}"] = compute
                site.outputs.signals.append(replace(signal, compute=compute))
            return

        builder.AddNamedSystem(f"sensor.{name}", block)
        site.picture.draw(f"sensor.{name}", "sensor", sensor_label(title, name), robot)
        for port, source in inputs.items():
            # Sensors that a sensor in a loop reads are in the loop, too.
            assert isinstance(source, OutputPort)
            builder.Connect(source, block.GetInputPort(port))
        for port, signal in signals.items():
            output = f"{port}.{name}"
            site.outputs.add(output, block.GetOutputPort(port), replace(signal, output=output))


keep_former_attributes(SampledSensor, late_samples="delay_samples")


# The cache is for the constant bias of a sensor, which is drawn again at each of its samples.
@lru_cache(maxsize=16)
def normal_noise(seed: int, number: int, size: int) -> Vector:
    """Draw values (size,) of the standard normal distribution.

    Each number of a seed has a random generator of its own, so that no block has to keep the state of a generator.
    Equal arguments give equal values.

    Args:
        seed: seed of the sensor.
        number: number of the draw, such as that of the sample.
        size: count of values.
    """
    values = np.random.default_rng([seed, number]).standard_normal(size)
    # All callers with equal arguments get this array: none may change it.
    values.setflags(write=False)
    return values


# A time that is earlier than a sample by less than this part of a period is the time of the sample [1].
_SAME_SAMPLE = 1e-9


class Replay(NamedTuple):
    """Samples of a block that was replayed after a run.

    Attributes:
        period: time between two samples [s].
        outputs: values of each output port at the samples, shape (k, size), by the port's name.
    """

    period: float
    outputs: dict[str, Vector]


def _compute_after_run(
    recorded: Recorded,
    times: Vector,
    *,
    block: LeafSystem,
    inputs: Mapping[str, OutputPort | Compute],
    output: str,
) -> Vector:
    """Compute an output of a sampled block at times of a run that is over.

    Args:
        recorded: the run. The replay of the block is kept in its ``memo``, for the block's other outputs.
        times: the times, shape (m,) [s].
        block: the block.
        inputs: source of each input port of the block, by the port's name.
        output: name of the output port.

    Returns:
        The values at the last sample that is not later than each of the times, shape (m, size). For times before the
        first sample of the run, they are the values at that sample.
    """
    if block not in recorded.memo:
        recorded.memo[block] = replay(recorded, block=block, inputs=inputs)
    # Between two samples the values of the earlier one hold.
    replayed: Replay = recorded.memo[block]
    values = replayed.outputs[output]
    # Number of the last sample at each time, counted from the time 0.
    samples = (times / replayed.period + _SAME_SAMPLE).astype(int)
    # A run that goes on from another one does not begin at the sample 0.
    rows = samples - _first_sample(recorded, replayed.period)
    return np.asarray(values[np.clip(rows, 0, len(values) - 1)])


def _first_sample(recorded: Recorded, period: float) -> int:
    """Number of the first sample from the start of a run on, counted from the time 0, so it is at number * ``period``.

    It is 0 for a run that begins at 0, and may be after the end of a run that is shorter than a period.
    """
    return int(np.ceil(recorded.step_times[0] / period - _SAME_SAMPLE))


def replay(
    recorded: Recorded, *, block: LeafSystem, inputs: Mapping[str, OutputPort | Compute]
) -> Replay:
    """Update a sampled block, outside of the diagram, at all its samples of a run that is over.

    If there is no sample within the run, it takes one at the start of the run.

    Args:
        recorded: the run.
        block: the block.
        inputs: source of each input port of the block, by the port's name: a port of the diagram, or a function that
            computes the input from the run at times.

    Returns:
        The period and the outputs of the block at all k samples.
    """
    period = block.GetUniquePeriodicDiscreteUpdateAttribute().period_sec()
    # Number after that of the last sample in the run.
    end_sample = int(np.floor(recorded.step_times[-1] / period + _SAME_SAMPLE)) + 1
    sample_times = period * np.arange(_first_sample(recorded, period), end_sample)
    if sample_times.size == 0:
        # A run that does not begin at 0, and is shorter than a period, may have no sample: it gets one at its start.
        sample_times = recorded.step_times[:1]

    # Values of the inputs at all samples, shape (k, size), by port. Ports are evaluated together, which is faster.
    ports = {name: source for name, source in inputs.items() if isinstance(source, OutputPort)}
    values = dict(zip(ports, recorded.sample(list(ports.values()), sample_times), strict=True))
    # While stepping, a sensor that reads another one gets the other's last sample. So does the replay: inputs that are
    # computed are those of the sample before, or of the begin of the run.
    times_before = np.maximum(sample_times - period, recorded.step_times[0])
    for name, source in inputs.items():
        if not isinstance(source, OutputPort):
            values[name] = source(recorded, times_before)

    # The block starts with its initial memory, as it does in a run.
    context = block.CreateDefaultContext()
    output_ports = [block.get_output_port(index) for index in range(block.num_output_ports())]
    outputs = {port.get_name(): np.empty((len(sample_times), port.size())) for port in output_ports}
    # The same as a simulator does: at each sample the update sees the inputs, and the outputs follow from its result.
    for row, time in enumerate(sample_times):
        context.SetTime(time)
        for name, input_values in values.items():
            block.GetInputPort(name).FixValue(context, input_values[row])
        update = block.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(update)
        for port in output_ports:
            outputs[port.get_name()][row] = port.Eval(context)
    return Replay(period=period, outputs=outputs)


if not TYPE_CHECKING:
    __getattr__ = former_names_of(
        __name__, {"sampled": "add_sample_and_hold", "normal": "normal_noise", "replayed": "replay"}
    )
