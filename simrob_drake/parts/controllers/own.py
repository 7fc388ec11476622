"""A user's own block in a station, wired by the names of its ports, and what outputs of controllers become."""

import importlib
import importlib.util
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from os.path import isfile
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import ConfigDict, Field
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort, PortDataType
from pydrake.systems.primitives import PassThrough

from simrob_drake.base.errors import InvalidParameter, one_of, quoted
from simrob_drake.base.messages import compound, message
from simrob_drake.base.signals import Panel, Signal
from simrob_drake.blocks.block import add_sum
from simrob_drake.parts.captions import wrap_label
from simrob_drake.parts.controllers.section import ControllerSection
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot


def declare_output(
    site: Site,
    name: str,
    port: OutputPort,
    unit: str,
    robot: StationRobot | None = None,
    axes: Collection[str] | None = None,
    *,
    called: str = "",
    components: Sequence[str] = (),
) -> None:
    """Declare an output of a controller, ``<controller>.<output>``, with its result columns and its plot.

    An output with one value for each axis of a robot gets columns named after the axes; otherwise they are numbered.

    Args:
        site: the station under construction.
        name: name of the controller.
        port: port of the output.
        unit: unit of all values, or the unit of each value, separated by commas, such as "m/s, rad/s".
        robot: robot that the controller drives. If it is None, all robots are considered.
        axes: axes whose values become columns. If it is None, all do.
        called: name of the output. If it is empty, the port's name is used.
        components: names of the values in plots, if there are any.
    """
    called = called or port.get_name()
    output = f"{name}.{called}"
    size = port.size()

    # Names of the values: axes of the first robot with as many axes as values, or numbers.
    robots = site.plant.robots.values() if robot is None else [robot]
    axes_of_size = [own_robot.axes for own_robot in robots if len(own_robot.axes) == size]
    entries = axes_of_size[0] if axes_of_size else [str(index) for index in range(size)]

    takes_all = size == 1 or axes is None or not axes_of_size
    indices = tuple(index for index, entry in enumerate(entries) if takes_all or entry in (axes or ()))
    columns = (output,) if size == 1 else tuple(f"{output}.{entries[index]}" for index in indices)
    units = tuple(unit.split(", ")) if ", " in unit else (unit,) * len(columns)
    heading = message("parts.the_block", "the block '{name}'", name=name)
    panel = Panel(f"controller_{name}", heading, called, f"{called} [{unit}]", columns, tuple(components))
    picked = indices if len(indices) < size else None
    site.outputs.add(output, port, Signal(columns, units, "own", output, picked, part=name, panel=panel))


def add_to(builder: DiagramBuilder, site: Site, key: str, added: Sequence[OutputPort], *, name: str) -> None:
    """Add ports to an input of a robot.

    Args:
        builder: builder of the diagram.
        site: the station under construction. Its input becomes the first term of the sum.
        key: name of the input, such as ``feedforward``.
        added: the ports, of the input's size.
        name: suffix of the names of the blocks.
    """
    reference = builder.AddNamedSystem(f"{key}.before_{name}", PassThrough(added[0].size()))
    robot_input = site.inputs[key]
    site.inputs[key] = reference.get_input_port()
    total = add_sum(builder, f"{key}.{name}", reference.get_output_port(), *added)
    builder.Connect(total, robot_input)
    site.picture.draw_nothing(key)


class OwnController(ControllerSection):
    """A block of the user's own, from Python code that is run: only where that is allowed (`--allow-code`).

    Inputs that are named as outputs of the station, or of another controller (`<controller>.<output>`), read those,
    and abstract ones called `image.<sensor>` what a camera sees;
    outputs that are named as its inputs (`reference`, `feedforward` ...) drive those in place of the station's own
    sources. Other outputs are signals.
    """

    model_config = ConfigDict(serialize_by_alias=True)
    runs_code: ClassVar[bool] = True

    kind: Literal["own"]
    class_: str = Field(alias="class", pattern=r"^[^:]+:[A-Za-z_][\w.]*$")
    """The class, a LeafSystem of Drake: `module:Class`, or `path/to/file.py:Class`; paths start at the station's
    file."""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """What its constructor takes."""

    def block(self, key: str) -> LeafSystem:
        """Import the class and make the block; raises InvalidParameter: it cannot be, or is no LeafSystem."""
        place, _, name = self.class_.partition(":")
        try:
            made: Any = _module(place)
            for part in name.split("."):
                made = getattr(made, part)
        except Exception as problem:
            expected = message("parts.an_importable_class", "a class that can be imported ({problem})", problem=problem)
            raise InvalidParameter(f"{key}.class", self.class_, expected) from problem
        if not (isinstance(made, type) and issubclass(made, LeafSystem)):
            raise InvalidParameter(
                f"{key}.class",
                self.class_,
                message("parts.a_subclass_of_leafsystem", "a subclass of pydrake's LeafSystem"),
            )
        try:
            block: LeafSystem = made(**self.parameters)
        except Exception as problem:
            cause = compound("{name}: {problem}", name=type(problem).__name__, problem=problem)
            raise InvalidParameter(
                f"{key}.parameters",
                str(self.parameters),
                message("parts.arguments_it_takes", "what it takes ({cause})", cause=cause),
            ) from problem
        return block

    @classmethod
    def of(cls, block: LeafSystem) -> "OwnController":
        """Return the section of a block given in Python, with its ``parameters`` if it has this mapping."""
        kind, parameters = type(block), getattr(block, "parameters", {})
        return cls.model_validate(
            {
                "kind": "own",
                "class": f"{_place_of(kind)}:{kind.__qualname__.replace('<locals>.', '')}",
                "parameters": dict(parameters) if isinstance(parameters, Mapping) else {},
            }
        )


def own_blocks(controllers: Mapping[str, Any]) -> Mapping[str, LeafSystem]:
    """Make the blocks of the controllers that run the user's own code, by name."""
    own = {name: section for name, section in controllers.items() if section.runs_code}
    return {name: section.block(f"controllers.{name}") for name, section in own.items()}


def named_blocks(blocks: Mapping[str, LeafSystem] | Sequence[LeafSystem]) -> dict[str, LeafSystem]:
    """Return blocks by name, their own or their class's; raises InvalidParameter: no LeafSystem, or a taken name."""
    if isinstance(blocks, Mapping):
        pairs = list(blocks.items())
    elif isinstance(blocks, Sequence) and not isinstance(blocks, str):
        pairs = [(_name_of(block), block) for block in blocks]
    else:
        expected = message("parts.a_list_of_leafsystems", "a list of LeafSystems, or a mapping of names to them")
        raise InvalidParameter("blocks", quoted(blocks), expected)
    named: dict[str, LeafSystem] = {}
    for name, block in pairs:
        if not isinstance(block, LeafSystem):
            expected = message(
                "parts.a_leafsystem",
                "a LeafSystem of Drake (a Diagram that holds a station is run by simulate_diagram())",
            )
            raise InvalidParameter(message("parts.block_called", "blocks: {name}", name=name), quoted(block), expected)
        if any(block is other for other in named.values()):
            raise InvalidParameter(
                message("parts.block_called", "blocks: {name}", name=name),
                message("parts.given_twice", "given twice"),
                message("parts.own_block", "a block of its own"),
            )
        if not (isinstance(name, str) and name.isidentifier()):
            raise InvalidParameter(
                message("parts.name_of_block", "the name of a block"),
                repr(name),
                message("parts.plain_name", "plain: letters, digits and _, no digit first"),
            )
        if name in named:
            raise InvalidParameter(
                "blocks",
                message("parts.two_called", "two called {name}", name=name),
                message("parts.different_names", "of different names: block.set_name(...)"),
            )
        named[name] = block
    return named


def driven_inputs(blocks: Mapping[str, LeafSystem]) -> dict[str, str]:
    """Return outputs' names with the block that has each; raises InvalidParameter: two that could drive one input."""
    drivers: dict[str, str] = {}
    for name, block in blocks.items():
        for port in _outputs(block):
            other = drivers.setdefault(port.get_name(), name)
            if other != name and port.get_name().rpartition(".")[2] in DRIVABLE:
                expected = message("parts.driven_by_one", "driven by one block; {other} drives it, too", other=other)
                raise InvalidParameter(
                    message("parts.input_called", "the input {port}", port=port.get_name()),
                    message("parts.driven_by", "driven by {name}", name=name),
                    expected,
                )
    return drivers


DRIVABLE = (
    "reference",
    "reference_velocity",
    "reference_acceleration",
    "feedforward",
    "external_force",
    "external_torque",
)
"""The inputs of a robot that blocks can drive."""


def with_driven(inputs: Sequence[str], blocks: Mapping[str, LeafSystem]) -> tuple[str, ...]:
    """Return inputs of robots, and those that blocks drive and that a station has only where they are asked for."""
    names = {output.rpartition(".")[2] for output in driven_inputs(blocks)}
    asked = [name for name in DRIVABLE if name in names and name not in ("reference", "reference_acceleration")]
    return tuple(dict.fromkeys([*inputs, *asked]))


def add_own_blocks(builder: DiagramBuilder, site: Site, blocks: Mapping[str, LeafSystem]) -> None:
    """Add blocks, their outputs signals but where they drive the station; raises SimrobError: two drive one input."""
    driven_inputs(blocks)
    site.blocks.update(blocks)
    for name, block in blocks.items():
        builder.AddNamedSystem(f"controller.{name}", block)
        site.outputs.notes[name] = {"kind": type(block).__name__}
        site.picture.draw(f"controller.{name}", "own", f"{wrap_label(name)}\n{type(block).__name__}")
        for port in _outputs(block):
            if port.get_name() not in site.inputs:
                unit, components = (getattr(block, key, {}).get(port.get_name()) for key in ("units", "components"))
                declare_output(site, name, port, str(unit or "1"), components=components or ())


def wire_own_blocks(builder: DiagramBuilder, site: Site, blocks: Mapping[str, LeafSystem]) -> None:
    """Wire added blocks by the names of their ports, above all loops; raises SimrobError: a port that fits nothing."""
    for name, block in blocks.items():
        for port in _outputs(block):
            if port.get_name() in site.inputs:
                target = site.inputs[port.get_name()]
                if target.size() != port.size():
                    sizes = (
                        message("parts.of_size", "of size {size}", size=port.size()),
                        message(
                            "parts.size_of_station_input", "of size {size}, as the station's input", size=target.size()
                        ),
                    )
                    raise InvalidParameter(
                        message(
                            "parts.output_of_block",
                            "the output {port} of the block {name}",
                            port=port.get_name(),
                            name=name,
                        ),
                        *sizes,
                    )
                builder.Connect(port, target)
        for index in range(block.num_input_ports()):
            _read(builder, site, name, block.get_input_port(index))


def _read(builder: DiagramBuilder, site: Site, name: str, port: InputPort) -> None:
    name_of_port = port.get_name()
    if port.get_data_type() != PortDataType.kVectorValued:
        if name_of_port not in site.outputs.images:
            known = ", ".join(site.outputs.images) or "none"
            expected = message(
                "parts.vector_or_image", "a vector, or image.<sensor> of a camera with in_loop ({known})", known=known
            )
            raise InvalidParameter(
                message("parts.input_of_block", "the input {port} of the block {name}", port=name_of_port, name=name),
                "abstract",
                expected,
            )
        builder.Connect(site.outputs.images[name_of_port], port)
        return
    one_of(
        message("parts.output_for_input", "output of the station for the input of the block {name} called", name=name),
        name_of_port,
        site.outputs,
    )
    source = site.port(builder, name_of_port)
    if source.size() != port.size():
        sizes = (
            message("parts.of_size", "of size {size}", size=port.size()),
            message("parts.size_of_station_output", "of size {size}, as the station's output", size=source.size()),
        )
        raise InvalidParameter(
            message("parts.input_of_block", "the input {port} of the block {name}", port=name_of_port, name=name),
            *sizes,
        )
    builder.Connect(source, port)


def _outputs(block: LeafSystem) -> list[OutputPort]:
    ports = [block.get_output_port(index) for index in range(block.num_output_ports())]
    return [port for port in ports if port.get_data_type() == PortDataType.kVectorValued]


def _name_of(block: Any) -> str:
    own = block.get_name() if isinstance(block, LeafSystem) else ""
    return own if own.isidentifier() else re.sub(r"(?<!^)(?=[A-Z])", "_", type(block).__name__).lower()


def class_from(text: str, folder: Path) -> str:
    """Return a station's ``module:Class`` or ``file.py:Class``, found in ``folder`` before Python's search path."""
    place, colon, name = text.partition(":")
    file = folder / (place if place.endswith(".py") else f"{place}.py")
    return f"{file}{colon}{name}" if place.endswith(".py") or isfile(file) else text


def _place_of(kind: Any) -> str:
    """Return where a class is found: the name of its module in a package, else its file."""
    loaded_by_hand = getattr(getattr(kind.__init__, "__code__", None), "co_filename", "")
    file = Path(getattr(sys.modules.get(kind.__module__), "__file__", None) or loaded_by_hand)
    return str(file.resolve()) if "." not in kind.__module__ and file.suffix == ".py" else kind.__module__


def _module(place: str) -> Any:
    """Return a module by its name, or by its file; that may import what lies beside it, as a script may."""
    if not place.endswith(".py"):
        return importlib.import_module(place)
    file = Path(place)
    if not file.is_file():
        raise FileNotFoundError(message("parts.no_file", "there is no file {file}", file=file))
    spec = importlib.util.spec_from_file_location(f"own_code_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None  # a .py file has one
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module
    sys.path.insert(0, str(file.parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(file.parent))
    return module
