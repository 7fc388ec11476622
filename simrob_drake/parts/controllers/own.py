"""Blocks of the user's own in a station, and the declaration of controllers' outputs.

An *own block* is a LeafSystem of Drake from the user's Python code. It is wired by the names of its ports: an input
that is named as an output of the station reads this output, and an output that is named as an input of the station
drives this input. The class :class:`OwnController` is the section in a station file that names such code.
"""

import importlib
import importlib.util
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import ConfigDict, Field
from pydrake.systems.framework import (
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
    PortDataType,
)
from pydrake.systems.primitives import PassThrough

from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of, quote_value
from simrob_drake.base.messages import compound, message
from simrob_drake.base.renaming import former_names_of
from simrob_drake.base.signals import Panel, Signal
from simrob_drake.blocks.block import add_sum
from simrob_drake.parts.captions import wrap_label
from simrob_drake.parts.controllers.section import ControllerSection
from simrob_drake.parts.inputs import LISTABLE
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

    A single value has the output's name. Several values, as many as a robot has axes, get columns named after the axes.
    Otherwise the columns are numbered from 0.

    Args:
        site: the station under construction.
        name: name of the controller.
        port: port of the output.
        unit: unit of all values, or the unit of each value, separated by commas, such as "m/s, rad/s".
        robot: robot that the controller drives, whose axes may name the values. If it is None, the first robot with as
            many axes as values names them.
        axes: axes whose values become columns. All values become columns if it is None, or if they are not values of
            axes.
        called: name of the output. If it is empty, the port's name is used.
        components: names of the values in plots, if there are any.
    """
    called = called or port.get_name()
    output = f"{name}.{called}"
    size = port.size()

    # Names of the values: axes of the first robot with as many axes as values, or numbers. A block need not be of one
    # robot, so its size is all that says to which axes its values belong.
    robots = site.plant.robots.values() if robot is None else [robot]
    axes_of_size = [own_robot.axes for own_robot in robots if len(own_robot.axes) == size]
    value_names = axes_of_size[0] if axes_of_size else [str(index) for index in range(size)]

    # Indices of the values that become columns. Values without axis names, and a single value, always do.
    indices = tuple(range(size))
    if size > 1 and axes is not None and axes_of_size:
        indices = tuple(index for index in indices if value_names[index] in axes)
    columns = (
        (output,) if size == 1 else tuple(f"{output}.{value_names[index]}" for index in indices)
    )
    # One unit for all columns, or one for each of them.
    units = tuple(unit.split(", ")) if ", " in unit else (unit,) * len(columns)

    heading = message("parts.the_block", "the block '{name}'", name=name)
    panel = Panel(
        figure=f"controller_{name}",
        heading=heading,
        title=called,
        label=f"{called} [{unit}]",
        columns=columns,
        components=tuple(components),
    )
    signal = Signal(
        names=columns,
        units=units,
        role="own",
        output=output,
        entries=indices if len(indices) < size else None,
        part=name,
        panel=panel,
    )
    site.outputs.add(output, port, signal)


def add_to(
    builder: DiagramBuilder, site: Site, key: str, added: Sequence[OutputPort], *, name: str
) -> None:
    """Add the values of ports to an input of a robot. The source that drives the input keeps acting: all are added up.

    Args:
        builder: builder of the diagram.
        site: the station under construction. Its input of this name becomes the first term of the sum.
        key: name of the input with the robot's prefix, such as ``feedforward`` or ``left.feedforward``.
        added: the ports, of the input's size.
        name: suffix of the names of the two blocks that are added.
    """
    # The sum takes the robot's input, so the station needs a new port for the source that would drive this input: the
    # port of a block that passes the values on.
    pass_through = PassThrough(added[0].size())
    builder.AddNamedSystem(f"{key}.before_{name}", pass_through)
    robot_input = site.inputs[key]
    site.inputs[key] = pass_through.get_input_port()
    total = add_sum(builder, f"{key}.{name}", pass_through.get_output_port(), *added)
    builder.Connect(total, robot_input)
    # The block picture leaves out the systems whose names begin with the key: it draws arrows in their place.
    site.picture.draw_nothing(key)


class OwnController(ControllerSection):
    """A block of the user's own, from Python code that is run: only if that is allowed (`--allow-code`).

    An input that is named as an output of the station, or of another controller (`<controller>.<output>`), reads this
    output; an abstract input called `image.<sensor>` reads the images of a camera. An output that is named as an input
    of the station (`reference`, `feedforward` ...) drives this input in place of the station's own source. Other
    outputs are signals.
    """

    model_config = ConfigDict(serialize_by_alias=True)
    runs_code: ClassVar[bool] = True

    kind: Literal["own"]
    class_: str = Field(alias="class", pattern=r"^[^:]+:[A-Za-z_][\w.]*$")
    """The class, a LeafSystem of Drake: `module:Class`, or `path/to/file.py:Class`; paths start at the station's
    file."""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """Arguments of its constructor, by name."""

    def block(self, key: str) -> LeafSystem:
        """Import the class and create the block.

        Args:
            key: key of the section in the station file, for errors.

        Raises:
            InvalidParameter: the class cannot be imported, is not a LeafSystem, or does not take the parameters.
        """
        block_class = self._import_class(key)
        try:
            return block_class(**self.parameters)
        # The user's code can raise anything.
        except Exception as problem:
            cause = compound("{name}: {problem}", name=type(problem).__name__, problem=problem)
            raise InvalidParameter(
                f"{key}.parameters",
                str(self.parameters),
                message(
                    "parts.arguments_it_takes",
                    "a mapping of arguments that the class accepts ({cause})",
                    cause=cause,
                ),
            ) from problem

    def _import_class(self, key: str) -> type[LeafSystem]:
        """Import the class of the block.

        Args:
            key: key of the section in the station file, for errors.

        Raises:
            InvalidParameter: the class cannot be imported, or is not a LeafSystem.
        """
        module, _, name = self.class_.partition(":")
        try:
            found: Any = _import_module(module)
            # The name may have dots, if the class is in another class.
            for part in name.split("."):
                found = getattr(found, part)
        # Importing the user's code runs it, and it can raise anything.
        except Exception as problem:
            expected = message(
                "parts.an_importable_class",
                "a class that can be imported ({problem})",
                problem=problem,
            )
            raise InvalidParameter(f"{key}.class", self.class_, expected) from problem
        if not (isinstance(found, type) and issubclass(found, LeafSystem)):
            raise InvalidParameter(
                f"{key}.class",
                self.class_,
                message("parts.a_subclass_of_leafsystem", "a subclass of pydrake's LeafSystem"),
            )
        return found

    @classmethod
    def of(cls, block: LeafSystem) -> "OwnController":
        """Make the section that describes a block given in Python, so that a run of a station can be saved with it.

        Args:
            block: the block. If it has an attribute ``parameters`` that is a mapping, the section contains these
                parameters.
        """
        block_class = type(block)
        # The name of a class that is defined in a function contains "<locals>.", which the pattern of `class_` refuses.
        # Without it the run can be saved. The saved file cannot import such a class, whatever its name.
        class_name = block_class.__qualname__.replace("<locals>.", "")
        parameters = getattr(block, "parameters", {})
        content = {
            "kind": "own",
            "class": f"{_module_or_file_of(block_class)}:{class_name}",
            "parameters": dict(parameters) if isinstance(parameters, Mapping) else {},
        }
        return cls.model_validate(content)


def own_blocks(controllers: Mapping[str, Any]) -> Mapping[str, LeafSystem]:
    """Create the blocks of the controllers that run the user's own code, by name.

    Raises:
        InvalidParameter: a class cannot be imported, is not a LeafSystem, or does not take its parameters.
    """
    own = {name: section for name, section in controllers.items() if section.runs_code}
    return {name: section.block(f"controllers.{name}") for name, section in own.items()}


def named_blocks(blocks: Mapping[str, LeafSystem] | Sequence[LeafSystem]) -> dict[str, LeafSystem]:
    """Check the blocks that a user gives to a run, and return them by name.

    Args:
        blocks: blocks by name, or a list of blocks. A block of a list has its own name (``get_name()``) or, if this is
            no identifier, the name of its class, such as ``my_block`` for ``MyBlock``.

    Raises:
        InvalidParameter: ``blocks`` is neither a mapping nor a list, a block is not a LeafSystem or is given twice, or
            a name is no identifier or is given twice.
    """
    if isinstance(blocks, Mapping):
        pairs = list(blocks.items())
    elif isinstance(blocks, Sequence) and not isinstance(blocks, str):
        pairs = [(_name_of(block), block) for block in blocks]
    else:
        expected = message(
            "parts.a_list_of_leafsystems",
            "a list of LeafSystems, or a mapping of names to LeafSystems",
        )
        raise InvalidParameter("blocks", quote_value(blocks), expected)
    accepted: dict[str, LeafSystem] = {}
    for name, block in pairs:
        _check_block(name, block, accepted)
        accepted[name] = block
    return accepted


def _check_block(name: Any, block: Any, accepted: Mapping[str, LeafSystem]) -> None:
    """Check a block that a user gives, and its name.

    Args:
        name: name of the block, whatever the user has written.
        block: the block, whatever the user has written.
        accepted: the blocks before it, by name.

    Raises:
        InvalidParameter: the block is not a LeafSystem or is one of the others, or the name is no identifier or is
            that of another one.
    """
    if not isinstance(block, LeafSystem):
        expected = message(
            "parts.a_leafsystem",
            "a Drake LeafSystem (to run a Diagram that contains a station, use simulate_diagram())",
        )
        raise InvalidParameter(
            message("parts.block_called", "blocks: {name}", name=name), quote_value(block), expected
        )
    # Drake would refuse a system that is added twice, without its name.
    if any(block is other for other in accepted.values()):
        raise Unsuitable(
            message("parts.block_called", "blocks: {name}", name=name),
            message("parts.given_twice", "the same block is given twice"),
            message("parts.own_block", "create a block for each name"),
        )
    # Dots would be taken as the separators of output names.
    if not (isinstance(name, str) and name.isidentifier()):
        raise InvalidParameter(
            message("parts.name_of_block", "the name of a block"),
            repr(name),
            message(
                "parts.plain_name",
                "a name of letters, digits and _ that does not begin with a digit",
            ),
        )
    if name in accepted:
        raise Unsuitable(
            "blocks",
            message("parts.two_called", "two blocks have the name {name}", name=name),
            message("parts.different_names", "give them different names by block.set_name(...)"),
        )


def output_owners(
    blocks: Mapping[str, LeafSystem], station_inputs: Collection[str] = ()
) -> dict[str, str]:
    """Find which block has each output, and check that no two blocks drive the same input.

    The inputs are those of robots in `DRIVABLE`, and the given ones.

    Args:
        blocks: own blocks by name.
        station_inputs: names of further inputs, such as those of signal flows, with the prefixes of robots.

    Returns:
        The name of the first block that has an output, by the name of the output.

    Raises:
        InvalidParameter: two blocks have outputs of the same name, which is that of an input.
    """
    owners: dict[str, str] = {}
    for name, block in blocks.items():
        for port in _vector_outputs(block):
            output = port.get_name()
            owner = owners.setdefault(output, name)
            # Without a prefix, or with that of a robot: ``left.reference`` drives the reference of the robot ``left``.
            # Other outputs may have equal names, since they become signals with the names of their blocks.
            is_drivable = output in station_inputs or output.rpartition(".")[2] in DRIVABLE
            if owner != name and is_drivable:
                raise Unsuitable(
                    message("parts.input_called", "the input {port}", port=output),
                    message(
                        "parts.driven_by_two",
                        "the blocks {other} and {name} both drive it",
                        other=owner,
                        name=name,
                    ),
                    message(
                        "parts.driven_by_one",
                        "let only one of them have an output {port}",
                        port=output,
                    ),
                )
    return owners


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
    """Complete the list of inputs that a station makes for its robots by those that own blocks drive.

    Only names in `LISTABLE` are added: a station cannot list other inputs, such as ``reference``, which it has anyway.

    Args:
        inputs: key ``inputs`` of the station.
        blocks: own blocks by name.

    Returns:
        The inputs, each one once.

    Raises:
        InvalidParameter: two blocks drive the same one of the inputs in `DRIVABLE`.
    """
    # The names without the prefixes of robots: a station makes an input for all of its robots.
    names = {output.rpartition(".")[2] for output in output_owners(blocks)}
    driven = [name for name in DRIVABLE if name in names and name in LISTABLE]
    return tuple(dict.fromkeys([*inputs, *driven]))


def add_own_blocks(builder: DiagramBuilder, site: Site, blocks: Mapping[str, LeafSystem]) -> None:
    """Add own blocks to the diagram, and declare their outputs, except those that drive an input of the station.

    Args:
        builder: builder of the diagram.
        site: the station under construction, which lists the blocks afterwards.
        blocks: the blocks by name.

    Raises:
        InvalidParameter: two blocks drive the same input.
    """
    # It raises an error if two blocks drive the same input.
    output_owners(blocks, site.inputs)
    site.blocks.update(blocks)
    for name, block in blocks.items():
        # An own block has no kind as other controllers have: results name its class instead.
        class_name = type(block).__name__
        builder.AddNamedSystem(f"controller.{name}", block)
        site.outputs.notes[name] = {"kind": class_name}
        site.picture.draw(f"controller.{name}", "own", f"{wrap_label(name)}\n{class_name}")
        # A block may declare units and names of its outputs' values, in mappings by the output's name.
        units = getattr(block, "units", {})
        components = getattr(block, "components", {})
        for port in _vector_outputs(block):
            output = port.get_name()
            if output not in site.inputs:
                unit = str(units.get(output) or "1")
                declare_output(site, name, port, unit, components=components.get(output) or ())


def wire_own_blocks(builder: DiagramBuilder, site: Site, blocks: Mapping[str, LeafSystem]) -> None:
    """Connect own blocks that have been added, by the names of their ports.

    It is called after all loops have been added: a block that drives the reference is then the source of the loops.

    Args:
        builder: builder of the diagram.
        site: the station under construction.
        blocks: the blocks by name.

    Raises:
        SimrobError: an input has no source of its name and size, or an output has another size than the input of the
            station that it drives.
    """
    for name, block in blocks.items():
        for port in _vector_outputs(block):
            if port.get_name() in site.inputs:
                _drive_input(builder, site, name, port)
        for index in range(block.num_input_ports()):
            _connect_input(builder, site, name, block.get_input_port(index))


def _drive_input(builder: DiagramBuilder, site: Site, name: str, port: OutputPort) -> None:
    """Connect an output of a block to the input of the station that has the same name as the output.

    Args:
        builder: builder of the diagram.
        site: the station under construction, which has such an input.
        name: name of the block, for errors.
        port: the output.

    Raises:
        InvalidParameter: the output and the input have different sizes.
    """
    target = site.inputs[port.get_name()]
    # Drake's own error would name neither the block nor the input of the station.
    if target.size() != port.size():
        raise InvalidParameter(
            message(
                "parts.output_of_block",
                "the output {port} of the block {name}",
                port=port.get_name(),
                name=name,
            ),
            message("parts.of_size", "of size {size}", size=port.size()),
            message(
                "parts.size_of_station_input",
                "of size {size}, like the station's input",
                size=target.size(),
            ),
        )
    builder.Connect(port, target)


def _connect_input(builder: DiagramBuilder, site: Site, name: str, port: InputPort) -> None:
    """Connect an input of a block to the output or the camera of the station that the input is named after.

    Args:
        builder: builder of the diagram. The block of the station that gives the output may be added.
        site: the station under construction.
        name: name of the block, for errors.
        port: the input.

    Raises:
        SimrobError: there is no such output or camera, or the sizes differ.
    """
    input_name = port.get_name()
    # An abstract input can only read images.
    if port.get_data_type() != PortDataType.kVectorValued:
        if input_name not in site.outputs.images:
            known = ", ".join(site.outputs.images) or message("parts.none_known", "none")
            expected = message(
                "parts.vector_or_image",
                "a vector, or be named image.<sensor> after a camera with in_loop; known: {known}",
                known=known,
            )
            raise InvalidParameter(_input_words(name, input_name), "abstract", expected)
        builder.Connect(site.outputs.images[input_name], port)
        return

    what = message(
        "parts.output_for_input",
        "output of the station for the input of the block {name} called",
        name=name,
    )
    one_of(what, input_name, site.outputs)
    source = site.port(builder, input_name)
    if source.size() != port.size():
        raise InvalidParameter(
            _input_words(name, input_name),
            message("parts.of_size", "of size {size}", size=port.size()),
            message(
                "parts.size_of_station_output",
                "of size {size}, like the station's output",
                size=source.size(),
            ),
        )
    builder.Connect(source, port)


def _input_words(block: str, port: str) -> str:
    """Words for an input of a block, for errors."""
    return message(
        "parts.input_of_block", "the input {port} of the block {name}", port=port, name=block
    )


def _vector_outputs(block: LeafSystem) -> list[OutputPort]:
    """Find the output ports of a block that are vectors. Only these can be recorded, or drive an input."""
    ports = [block.get_output_port(index) for index in range(block.num_output_ports())]
    return [port for port in ports if port.get_data_type() == PortDataType.kVectorValued]


def _name_of(block: Any) -> str:
    """Name of a block that is given without one: its own name, or else its class's, as ``my_block`` for ``MyBlock``."""
    own_name = block.get_name() if isinstance(block, LeafSystem) else ""
    if own_name.isidentifier():
        return own_name
    # An underscore before each capital letter but the first.
    return re.sub(r"(?<!^)(?=[A-Z])", "_", type(block).__name__).lower()


def class_from(text: str, folder: Path) -> str:
    """Complete the key ``class`` of a station file with the folder of the file, if the class is in a file there.

    Args:
        text: ``module:Class`` or ``path/to/file.py:Class``. A module that is a file of the folder is preferred to one
            that Python would find itself.
        folder: folder of the station file.

    Returns:
        ``<folder>/file.py:Class``, or the text itself if it names a module elsewhere.
    """
    # Paths in a file are relative to that file, wherever the program is started.
    module, colon, name = text.partition(":")
    is_file_name = module.endswith(".py")
    file = folder / (module if is_file_name else f"{module}.py")
    if is_file_name or isfile(file):
        return f"{file}{colon}{name}"
    return text


def _module_or_file_of(block_class: Any) -> str:
    """Find how a class can be imported again: by the path of its file, or by the name of its module.

    A module of a package is given by its name. So is a module without a file, which cannot be imported in another way.
    """
    module = block_class.__module__
    # A module that was loaded by a test or a notebook may have no file: then the code of the constructor names it.
    file_of_code = getattr(getattr(block_class.__init__, "__code__", None), "co_filename", "")
    file = Path(getattr(sys.modules.get(module), "__file__", None) or file_of_code)
    # The code of a notebook's cell has the name of a file that does not exist: its classes are those of `__main__`.
    is_single_file = "." not in module and file.suffix == ".py" and file.is_file()
    return str(file.resolve()) if is_single_file else module


def _import_module(module: str) -> Any:
    """Import a module by its name, or by its file if the text ends with ``.py``.

    While a file is imported, its folder is the first of Python's search path, so that it can import files next to it as
    a script can.

    Raises:
        FileNotFoundError: there is no such file.
        ImportError: there is no such module. The code that is imported may raise any other error.
    """
    if not module.endswith(".py"):
        return importlib.import_module(module)
    file = Path(module)
    if not file.is_file():
        raise FileNotFoundError(message("parts.no_file", "there is no file {file}", file=file))
    # A name of its own, so that the file does not replace an installed module of the same name.
    spec = importlib.util.spec_from_file_location(f"own_code_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None  # a .py file has a loader
    imported = importlib.util.module_from_spec(spec)
    # Python's own import does the same before it runs a module; dataclasses, for example, look for their module there.
    sys.modules[imported.__name__] = imported
    sys.path.insert(0, str(file.parent))
    try:
        spec.loader.exec_module(imported)
    finally:
        # Later imports of the program must not find files next to the user's by accident.
        sys.path.remove(str(file.parent))
    return imported


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"driven_inputs": "output_owners"})
