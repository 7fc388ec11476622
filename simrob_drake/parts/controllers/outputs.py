"""What outputs of controllers become: signals of the station, and parts of what its robots are given."""

from collections.abc import Collection, Sequence

from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import PassThrough

from simrob_drake.blocks.block import summed
from simrob_drake.parts.site import Site, StationRobot
from simrob_drake.signals import Panel, Signal


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
    """Declare an output of a controller as a signal, ``<controller>.<output>``; by axis where it has one value each.

    Of a robot's axes those are told that are named. It is called as its port is unless said. Units that differ are
    told one by one, as "m/s, rad/s". Pictures call its numbers by the names of its components, if there are any.
    """
    called = called or port.get_name()
    output, size = f"{name}.{called}", port.size()
    robots = site.plant.robots.values() if robot is None else [robot]
    by_axis = next((each.axes for each in robots if len(each.axes) == size), None)
    entries = by_axis or [str(index) for index in range(size)]
    every = size == 1 or axes is None or by_axis is None
    indices = tuple(index for index, entry in enumerate(entries) if every or entry in (axes or ()))
    names = (output,) if size == 1 else tuple(f"{output}.{entries[index]}" for index in indices)
    panel = Panel(f"controller_{name}", f"the block '{name}'", called, f"{called} [{unit}]", names, tuple(components))
    picked = indices if len(indices) < size else None
    units = tuple(unit.split(", ")) if ", " in unit else (unit,) * len(names)
    site.add(output, port, Signal(names, units, "own", output, picked, part=name, panel=panel))


def add_to(builder: DiagramBuilder, site: Site, key: str, added: Sequence[OutputPort], *, name: str) -> None:
    """Add ports to what an input of a robot is given, by blocks of a ``name``; its input stands before them."""
    reference = builder.AddNamedSystem(f"{key}.before_{name}", PassThrough(added[0].size()))
    inner, site.inputs[key] = site.inputs[key], reference.get_input_port()
    builder.Connect(summed(builder, f"{key}.{name}", reference.get_output_port(), *added), inner)
    site.draw_nothing(key)
