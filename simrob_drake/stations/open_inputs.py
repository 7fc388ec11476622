"""Find inputs of a user's diagram that nothing feeds.

Drake accepts an open input as long as no block reads it, and some blocks give a default value in its place. The inputs
of a station are such blocks: a robot whose reference is forgotten would go to zero on all axes.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, InputPort, InputPortIndex, System

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message

_CHECKED_PACKAGES_OF_DRAKE = ("pydrake.systems.primitives", "pydrake.systems.controllers")
"""Drake's packages with blocks that need all of their inputs. Those of others, such as visualizers, may be optional."""

_MOST_NAMES = 6  # count of open inputs that an error lists


def check_inputs(
    diagram: Diagram,
    inputs: Mapping[str, InputPort],
    *,
    may_be_exported: bool,
) -> None:
    """Check that every input in a diagram is connected.

    Inputs that may be open pass: those of plants and scene graphs, those of all blocks of Drake that are not in
    _CHECKED_PACKAGES_OF_DRAKE, and those that a block of the user's own names in an attribute ``optional_inputs``.

    Args:
        diagram: the diagram that is run.
        inputs: input ports of the station in it, by name.
        may_be_exported: whether an input of the diagram itself may be open, since its value is fixed in a context.

    Raises:
        SimrobError: an input is open; the message lists the open inputs, and states how to connect or export them.
    """
    # A port has a value only in a context; values that are fixed in another context are not known
    # here.
    context = diagram.CreateDefaultContext()
    names_of_station = {_key(port): name for name, port in inputs.items()}
    found = list(_open_inputs_within(diagram, context, names_of_station.get))
    if not may_be_exported:
        found = [*_open_inputs_of(diagram, context, names_of_station.get), *found]
    if not found:
        return
    listed = ", ".join(found[:_MOST_NAMES]) + (" ..." if len(found) > _MOST_NAMES else "")
    # The remedy names a port that the user can copy: the station's ports are known by name.
    own = next((name for name in found if name in inputs), None)
    port = "port" if own is None else f'ports.inputs["{own}"]'
    size = "n" if own is None else inputs[own].size()
    raise SimrobError(
        message(
            "stations.open_inputs",
            "{count} {count:input is|inputs are} not connected: {inputs}; before Build(), connect each "
            "with builder.Connect(output, {port}), where the output of a "
            "ConstantVectorSource(numpy.zeros({size})) is a constant, or export it with "
            "builder.ExportInput({port})",
            count=len(found),
            inputs=listed,
            port=port,
            size=size,
        )
    )


_Names = Callable[[tuple[int, int]], "str | None"]
"""Finds the name of an input of the station by the key of its port."""


def _open_inputs_within(
    diagram: Diagram,
    context: Context,
    name_of: _Names,
) -> Iterator[str]:
    """Yield the names of open inputs of the systems in a diagram, but for those that it exports.

    Args:
        diagram: the diagram, or one within it.
        context: context of the root diagram.
        name_of: finds names of the station's inputs.
    """
    # The inputs of systems that are exported as inputs of this diagram, as pairs of a system's id and an index.
    exported = set[tuple[int, int]]()
    for index in range(diagram.num_input_ports()):
        for system, port_index in diagram.GetInputPortLocators(InputPortIndex(index)):
            exported.add((id(system), int(port_index)))
    # An exported input is an input of the diagram around, where it is looked at again.
    for system in diagram.GetSystems():
        for index in range(system.num_input_ports()):
            if (id(system), index) not in exported and _is_open(system, index, context):
                yield _name(system, system.get_input_port(index), name_of)
        if isinstance(system, Diagram):
            yield from _open_inputs_within(system, context, name_of)


def _open_inputs_of(diagram: Diagram, context: Context, name_of: _Names) -> Iterator[str]:
    """Yield the names of open inputs of the root diagram: nothing outside of it can feed them.

    If an input of the diagram feeds an input of the station, the name of the station's input is yielded.

    Args:
        diagram: the root diagram.
        context: its context.
        name_of: finds names of the station's inputs.
    """
    for index in range(diagram.num_input_ports()):
        port = diagram.get_input_port(index)
        if not port.HasValue(context):
            # The inputs of systems inside that this input of the diagram feeds.
            known = list[str]()
            for system, port_index in diagram.GetInputPortLocators(InputPortIndex(index)):
                name = name_of(_key(system.get_input_port(port_index)))
                if name is not None:
                    known.append(name)
            own_name = message(
                "stations.input_of_diagram", "{port} of the diagram", port=port.get_name()
            )
            yield known[0] if known else own_name


def _is_open(system: System, index: int, context: Context) -> bool:
    """Whether an input must be connected and is not.

    Args:
        system: a system within the diagram.
        index: index of its input.
        context: context of the root diagram.
    """
    if isinstance(system, (MultibodyPlant, SceneGraph)):
        return False  # what is not connected to a plant does not act
    # Blocks of the user's own are checked, too; Drake's others may have inputs that are optional.
    module = type(system).__module__
    is_of_drake = module.startswith("pydrake") and not isinstance(system, Diagram)
    if is_of_drake and not module.startswith(_CHECKED_PACKAGES_OF_DRAKE):
        return False
    port = system.get_input_port(index)
    if port.get_name() in getattr(system, "optional_inputs", ()):
        return False
    try:
        return not port.HasValue(system.GetMyContextFromRoot(context))
    except RuntimeError:
        # The input is connected, to an output that needs an input whose value is fixed later.
        return False


def _name(system: System, port: InputPort, name_of: _Names) -> str:
    """Name of an input for the error: as the station's input, or with the name of its system."""
    return name_of(_key(port)) or f"{system.get_name()}.{port.get_name()}"


def _key(port: Any) -> tuple[int, int]:
    """Key by which an input port is found again; Python's objects of ports are made anew each time."""
    return id(port.get_system()), int(port.get_index())
