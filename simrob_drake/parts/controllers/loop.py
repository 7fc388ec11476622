"""What the kinds of loop share: whom they drive, what they read, and how several mix."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Annotated, ClassVar, Literal, Protocol

from pydantic import Field
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.blocks.wiring import mapped
from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.parts.sensors.sensor import Sensor
from simrob_drake.parts.site import ResolvedRobot, Site, StationRobot, Surroundings
from simrob_drake.sections import Integer, Number, Positive, Strict


@dataclass(frozen=True)
class Wired:
    """A loop in a diagram: its ports by name, units of its outputs, ``1`` unless named, and names of their numbers."""

    inputs: Mapping[str, InputPort]
    outputs: Mapping[str, OutputPort]
    units: Mapping[str, str]
    components: Mapping[str, Sequence[str]] = field(default_factory=dict)


ASKED = "asked"
"""What an input is called that is the reference as it is below a loop."""

Weight = Annotated[Number, Field(gt=0, le=1)]


class LoopSection(Strict):
    """A section of ``controllers`` that is a loop of the package's.

    A kind has its key ``kind`` and the methods ``axes(robot)``, the names of the axes that it drives, and
    ``block(key, robot, site)``, which makes its :class:`~simrob_drake.blocks.sampled.SampledBlock`. What that block
    gives tells how it drives them: ``offset`` (n) is added to the reference [rad or m], ``target`` (n) takes its place
    while ``active`` is not zero, ``offset_velocity`` (n) is added to the reference's velocity where the station has one
    [rad/s or m/s], ``feedforward`` (n) to the torques [N·m or N]; other outputs are signals.
    An input ``asked`` (n) is the reference as it is below the loop [rad or m].
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ()
    """Inputs of robots that it drives beside the reference."""
    stages: ClassVar[tuple[str, ...]] = ()
    """What it does at each sample, one after the other, as the block picture shows it."""
    uppermost: ClassVar[bool] = False
    """Whether it lies above all others, whatever their priorities."""

    kind: str
    robot: str | None = None
    """Whom it drives; the only robot unless given."""
    rate: Positive = 100.0
    """Samples a second [Hz]."""
    reads: dict[str, str] = Field(default_factory=dict)
    """What it reads in place of the true state, by input: a sensor (`position: encoders`), or any output of the
    station or of another controller."""
    priority: Integer | None = None
    """Its place among the loops of a robot: one of higher priority lies above, and sees what is below driven first."""
    weight: Weight | None = None
    """How much of it shows above what is below it, 0 to 1; all unless given."""

    @property
    def named(self) -> list[str]:
        """What it reads by names of the user's: sensors, outputs, columns."""
        return list(self.reads.values())

    @property
    def layer(self) -> tuple[bool, int]:
        """Its place among the loops of a robot: the higher one lies above."""
        return self.uppermost, self.priority or 0

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before anything is built.

        Raises:
            SimrobError: no such robot or axis, or a station that no loop can drive.
        """
        robot = station.robot(self.robot, key)
        if station.mode != "dynamic":
            raise InvalidParameter(key, "in a kinematic station", "in a dynamic one: there is nothing to be measured")
        if 1 / self.rate < station.time_step * (1 - 1e-9):
            expected = f"at most {1 / station.time_step:g} Hz, one sample in each time_step of the discrete solver"
            raise InvalidParameter(f"{key}.rate", f"{self.rate:g} Hz", expected)
        self.axes(robot)

    def on_feet(self, key: str, station: Surroundings) -> ResolvedRobot:
        """Return whom it drives.

        Raises:
            SimrobError: no such robot, or one that does not stand on feet of its own.
        """
        robot = station.robot(self.robot, key)
        if not robot.floats or robot.feet is None:
            raise InvalidParameter(key, f"{self.kind} of {robot.name}", "of a robot that stands on feet of its own")
        return robot

    def warnings(self, key: str, robot: ResolvedRobot) -> list[str]:
        """Return what will not go as the section says, in words; ``key`` is where that stands."""
        return []

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the names of the axes that it drives."""
        raise NotImplementedError

    def layered(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return those of them whose reference it takes over."""
        return self.axes(robot)

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop; ``key`` is where the section stands, for errors."""
        raise NotImplementedError

    def wire(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site) -> Wired:
        """Add the loop, as a block ``controller.<name>``."""
        block = builder.AddNamedSystem(f"controller.{name}", self.block(f"controllers.{name}", robot, site))
        inputs = [block.get_input_port(index) for index in range(block.num_input_ports())]
        outputs = [block.get_output_port(index) for index in range(block.num_output_ports())]
        return Wired(
            {port.get_name(): port for port in inputs},
            {port.get_name(): port for port in outputs},
            block.units,
            block.components,
        )

    def source(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str) -> OutputPort:
        """Return the output that an input of the loop reads.

        Raises:
            UnknownName: nothing of that name is measured while stepping.
        """
        source = self.reads.get(name, "")
        direct = name if name.startswith(robot.prefix) else f"{robot.prefix}{name}"
        if not source and direct in site.of_state:
            return of_state(builder, site, direct)
        for output in (f"{name}.{source}", source) if source else (f"{robot.prefix}{name}", name):
            if output in site.outputs:
                return site.port(builder, output)
        raise UnknownName(f"sensor or output of the station for {key}.reads.{name}", source or name, site.outputs)


def check_force_is_read(section: LoopSection, key: str) -> None:
    """Check that a loop on a force says which sensor tells it.

    Raises:
        InvalidParameter: it does not.
    """
    if "force" not in section.reads:
        raise InvalidParameter(f"{key}.reads", section.reads, "with a force sensor: reads: {force: <sensor>}")


class Reader(Protocol):
    """A controller that reads signals by names, and drives inputs beside the reference."""

    @property
    def named(self) -> list[str]:
        """What it reads by names."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Inputs of robots that it drives."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check what is known before anything is built."""


def sensors_read(loops: Mapping[str, Reader], sensors: Mapping[str, Sensor]) -> set[str]:
    """Return the names of the sensors that must sample while a station is stepped: loops read them, or such sensors."""
    parts = {part for loop in loops.values() for text in loop.named for part in text.split(".")}
    stepped = {name: sensor for name, sensor in sensors.items() if sensor.stepped or name in parts}
    read = {other for sensor in stepped.values() for other in sensor.read(sensors).values()}
    return {*stepped, *read} & set(sensors)


def of_state(builder: DiagramBuilder, site: Site, output: str) -> OutputPort:
    """Return what the plant's state tells at once, from blocks that need no Python: base poses above all.

    Quaternions are as the state has them: of either sign, and of length one as well as the solver keeps it.
    """
    name = f"{output}.of_state"
    if builder.HasSubsystemNamed(name):
        return builder.GetSubsystemByName(name).get_output_port()
    site.draw_nothing(name)
    return mapped(builder, name, site.of_state[output].matrix, site.state)


def check_loops(station: Surroundings, loops: Mapping[str, LoopSection]) -> None:
    """Check loops one by one, and that those which drive one axis say how they mix.

    Raises:
        InvalidParameter: two loops on one axis, of the same priority and not both with a weight.
    """
    for name, loop in loops.items():
        loop.check(f"controllers.{name}", station)
    for (one, first), (other, second) in combinations(loops.items(), 2):
        robots = [station.robot(loop.robot, "controllers") for loop in (first, second)]
        weighed = first.weight is not None and second.weight is not None
        if robots[0] is not robots[1] or weighed or first.layer != second.layer:
            continue
        shared = [axis for axis in first.axes(robots[0]) if axis in second.axes(robots[0])]
        if shared:
            conflict = f"driving {', '.join(shared[:3])}{' ...' if len(shared) > 3 else ''}, as controllers.{one} is"
            expected = "alone on its axes, or with a priority (or both with a weight), which says how they mix"
            raise InvalidParameter(f"controllers.{other}", conflict, expected)
