"""Read the blocks and arrows of a station's block picture from its Diagram, and write them as text.

Each system of the Diagram is drawn in a block, or it is *wiring*: then it is a part of the arrows. When a part of the
station is built, it declares in which block each of its systems is drawn: a :class:`simrob_drake.parts.captions.Drawn`,
or None for wiring (:meth:`simrob_drake.parts.site.Site.draw`). Systems without a declaration are wiring, bars and sums
between these parts, or blocks of the user's own. A *robot's prefix* is the beginning of the names of its systems and
ports: its name and a dot, or nothing if the station has a single robot.

The text formats are that of Graphviz, and Mermaid flowcharts, which GitHub and many editors draw in Markdown.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydrake.systems.framework import Diagram, InputPort, LeafSystem, OutputPort, System
from pydrake.systems.primitives import (
    Adder,
    Demultiplexer,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Selector,
)

from simrob_drake.base.files import description_message, station_files
from simrob_drake.base.messages import message, translate
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.blocks.monitor import EventTimes, SteadySteps
from simrob_drake.parts.captions import BlockRole, Drawn, Shape, wrap_label
from simrob_drake.results.block_diagram.graph import BARS, ROLES, Arrow, BlockGraph, DrawnBlock
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts

_LOOKS = read_yaml(Path(__file__).with_name("looks.yaml"))

_SYMBOLS: dict[str, str] = _LOOKS["symbols"]
"""Symbols of the signals of a robot's ports, such as "q", by the name of the port without the robot's prefix."""

_PORT_SYMBOLS: dict[str, str] = _LOOKS["port_symbols"]
"""Symbols of the signals at ports that Drake's own systems have, by the name of the port."""

_STATE = ("q", "v")
"""Symbols of the state of the plant: positions and velocities."""

_ORDER = list(_SYMBOLS.values())
"""Order of the symbols in the text of an arrow. Other names follow."""

_SILENT = (PassThrough, Demultiplexer, EventTimes, SteadySteps)
"""Systems without a block of their own: they pass values on, or only set where the steps of the solver end."""


class BlockColours(NamedTuple):
    """Colours of the blocks of a role, "#rrggbb": the inside, and the edge with the text in the same colour."""

    fill: str
    line: str


COLOURS: dict[BlockRole, BlockColours] = {
    role: BlockColours(*pair) for role, pair in _LOOKS["colours"].items()
}
"""Colours of the blocks by their role."""

WIRE = "#444444"
"""Colour of arrows and bars."""

TITLES: dict[BlockRole, str] = {
    "reference": message("results.blocks_reference", "reference"),
    "loop": message("results.blocks_loop", "outer loops"),
    "own": message("results.blocks_own", "own blocks"),
    "servo": message("results.blocks_servo", "servos"),
    "force": message("results.blocks_force", "forces"),
    "robot": message("results.blocks_robot", "robot"),
    "scene": message("results.blocks_scene", "scene"),
    "sensor": message("results.blocks_sensor", "sensors and outputs"),
}
"""Titles of the groups of blocks by their role."""

Signals = tuple[str, ...]
"""Symbols or names of signals that an arrow carries. They are empty if the signals have no names."""

Side = Literal["in", "out"]
"""Kind of a port: input or output."""


class _PortId(NamedTuple):
    """Identity of a port: the name of its system, whether it is an input or an output, and its index."""

    system: str
    side: Side
    port_index: int


class _InputId(NamedTuple):
    """Identity of an input port: the name of its system, and its index."""

    system: str
    port_index: int


class _OutputId(NamedTuple):
    """Identity of an output port: the name of its system, and its index."""

    system: str
    port_index: int


class _Origin(NamedTuple):
    """A block from which signals come, by its key, and the symbols of the signals."""

    block: str
    signals: Signals


def read_blocks(diagram: Diagram, ports: StationPorts) -> BlockGraph:
    """Read the blocks and arrows of a station from its Diagram.

    Every system is drawn, alone or with the systems with which it shares a block, or it is wiring. Wiring is a part of
    the arrows, or a bar where it joins or distributes the signals of several blocks.

    Args:
        diagram: the Diagram that contains the systems of the station, without Diagrams inside, and perhaps systems of
            the user's own.
        ports: the station's ports, with its configuration and the labels of its blocks.
    """
    return _Reader(diagram, ports).graph


class _Reader:
    """Reader of one Diagram.

    Attributes:
        graph: the blocks and arrows, complete once the reader is made.
    """

    def __init__(self, diagram: Diagram, ports: StationPorts) -> None:
        """Read a Diagram, as :func:`read_blocks`."""
        config = ports.config
        self._ports = ports
        self._symbols = _symbols_of_ports(ports)
        self._systems: dict[str, System] = {
            system.get_name(): system for system in diagram.GetSystems()
        }
        self._feeds: dict[_InputId, _OutputId] = {}  # output that feeds each input
        for (target, input_index), (source, output_index) in diagram.connection_map().items():
            fed_input = _InputId(target.get_name(), int(input_index))
            self._feeds[fed_input] = _OutputId(source.get_name(), int(output_index))
        # Block in which each system is drawn, None for wiring.
        self._drawings = {
            name: drawing_of(name, system, ports) for name, system in self._systems.items()
        }

        self.graph = BlockGraph(
            config.name, translate(station_description(config)), list(config.robots)
        )
        # All blocks first: an arrow needs both.
        for name, drawing in self._drawings.items():
            if drawing is not None:
                self._draw(name, drawing)
        for name, drawing in self._drawings.items():
            if drawing is not None:
                self._connect(name, drawing)
        self._draw_outputs()
        self.graph.dissolve_bars()
        for signals in self.graph.arrows.values():
            # In the order in which formulas have the symbols, whatever the order of Drake's connections.
            signals.sort(key=_rank_of_signal)

    def _draw(self, name: str, drawing: Drawn) -> None:
        """Add the block of a system to the graph, unless another system has the same block.

        Args:
            name: name of the system.
            drawing: the block, or a net of blocks.
        """
        if drawing.net:
            self._draw_net(name, drawing)
            return
        new = DrawnBlock(
            key=drawing.key,
            role=drawing.role,
            robot=drawing.robot,
            label=drawing.label,
            shape=drawing.shape,
            inside=drawing.inside,
            within=drawing.within,
        )
        # Systems that share a block, such as the servos of all axes, declare it with the same key.
        block = self.graph.blocks.setdefault(drawing.key, new)
        if drawing.within:
            # The system of another block does the work, such as the plant for a servo in its actuators. The Diagram
            # has no connections between the two.
            self.graph.connect(drawing.key, drawing.within, ["τ"])
            self.graph.connect(drawing.within, drawing.key, _STATE)
        else:
            block.systems.append(name)

    def _draw_net(self, name: str, drawing: Drawn) -> None:
        """Add the blocks of a net that Drake has as a single system, such as a controller of several formulas.

        Arrows between these blocks are added, too.

        Args:
            name: name of the system.
            drawing: the net: parts of the system, each with its label and the parts that feed it.
        """
        for part, inner in drawing.net.items():
            key = f"{drawing.key}.{part}"
            block = DrawnBlock(key, drawing.role, drawing.robot, inner.label)
            self.graph.blocks.setdefault(key, block)
            for source in inner.sources:
                self.graph.connect(f"{drawing.key}.{source}", key, [])
        # The systems of a block are those that a search finds there. This one is found at the first block only.
        first_part = next(iter(drawing.net))
        self.graph.blocks[f"{drawing.key}.{first_part}"].systems.append(name)

    def _connect(self, name: str, drawing: Drawn) -> None:
        """Add the arrows that lead to the block of a system. Inputs that nothing feeds have none.

        Args:
            name: name of the system.
            drawing: the block, or a net of blocks.
        """
        if drawing.net:
            self._connect_net(drawing)
            return
        for index in range(self._systems[name].num_input_ports()):
            feed = self._feeds.get(_InputId(name, index))
            if feed is None:
                continue
            for origin in self._origins(feed):
                signals = self._signals_at(_PortId(name, "in", index)) or origin.signals
                # A force reads the poses of bodies from the plant to find its point of application. An arrow would
                # suggest a feedback, and is not drawn.
                is_pose_for_force = (
                    drawing.role == "force" and self.graph.blocks[origin.block].role == "robot"
                )
                if signals or not is_pose_for_force:
                    self.graph.connect(origin.block, drawing.key, signals)

    def _connect_net(self, drawing: Drawn) -> None:
        """Add the arrows that lead to the blocks of a net from outputs of the station."""
        for part, inner in drawing.net.items():
            for output in inner.reads:
                port = _port_id(self._ports.outputs[output])
                for origin in self._origins(_OutputId(port.system, port.port_index)):
                    self.graph.connect(
                        origin.block, f"{drawing.key}.{part}", origin.signals or [output]
                    )

    def _origins(self, output: _OutputId) -> list[_Origin]:
        """Find the blocks from which the values of an output come.

        If the output's system is wiring, the search continues at its inputs. An input that nothing feeds is drawn as an
        input of the station. The symbols are those of the port nearest to the output.
        """
        name = output.system
        drawing = self._drawings[name]
        signals_here = self._signals_at(_PortId(name, "out", output.port_index))
        if drawing is not None:
            key = drawing.key
            if drawing.net:
                parts = list(drawing.net)
                # The outputs of such a system are in the order of its parts.
                key = f"{drawing.key}.{parts[output.port_index]}"
            return [_Origin(key, signals_here)]

        found = []
        for index in range(self._systems[name].num_input_ports()):
            signals = signals_here or self._signals_at(_PortId(name, "in", index))
            feed = self._feeds.get(_InputId(name, index))
            origins = (
                [_Origin(self._draw_open_input(name), ())] if feed is None else self._origins(feed)
            )
            found += [_Origin(origin.block, signals or origin.signals) for origin in origins]
        return found

    def _signals_at(self, port: _PortId) -> Signals:
        """Symbols of the signals at a port, such as "q". They are empty if no symbol of the port is known."""
        # The station's own symbols come first: they are more specific than those of Drake's ports.
        if port in self._symbols:
            return self._symbols[port]
        system = self._systems[port.system]
        found = (
            system.get_input_port(port.port_index)
            if port.side == "in"
            else system.get_output_port(port.port_index)
        )
        symbol = _PORT_SYMBOLS.get(found.get_name())
        return () if symbol is None else (symbol,)

    def _draw_open_input(self, name: str) -> str:
        """Add a port for an input of the station that nothing feeds yet. Returns the key of the port.

        Args:
            name: name of the system that passes the input on, which is also that of the input.
        """
        key = f"input {name}"
        port = DrawnBlock(key, "reference", self._robot_of(name), name, "port", [name])
        self.graph.blocks.setdefault(key, port)
        return key

    def _draw_outputs(self) -> None:
        """Add the station's outputs, but for references, with their arrows.

        Outputs that are the same port of a system share a port.
        """
        names_of_port: dict[_PortId, list[str]] = {}
        for name, port in self._ports.outputs.items():
            # References are what the station is asked for, not what it shows: their sources are drawn already.
            if not name.endswith("reference"):
                names_of_port.setdefault(_port_id(port), []).append(name)
        for port_id, names in names_of_port.items():
            key = f"output {names[0]}"
            robot = self._robot_of(names[0])
            short_names = [name.removeprefix(f"{robot}.") for name in names]
            # All names of the port, the shortest first, joined by equals signs.
            label = " = ".join(sorted(short_names, key=len))
            self.graph.blocks[key] = DrawnBlock(key, "sensor", robot, label, "port")
            for origin in self._origins(_OutputId(port_id.system, port_id.port_index)):
                self.graph.connect(origin.block, key, origin.signals)

    def _robot_of(self, name: str) -> str:
        """Name of the robot with whose prefix a name begins. It is empty if there is none, or only one robot."""
        for robot in self._ports.plant.robots.values():
            if robot.prefix and name.startswith(robot.prefix):
                return robot.name
        return ""


def _rank_of_signal(signal: str) -> int:
    """Sort key of a signal in the text of an arrow: known symbols have a fixed order, and other names follow."""
    return _ORDER.index(signal) if signal in _ORDER else len(_ORDER)


def station_description(config: StationConfig) -> str:
    """Description of a station; a message, if the station comes with the package, so that other languages have it."""
    file = station_files().get(config.name)
    # A user may have copied a station of the package and described it anew.
    if file is None or read_yaml(file).get("description") != config.description:
        return config.description
    return description_message("station", config.name, config.description)


def _symbols_of_ports(ports: StationPorts) -> dict[_PortId, Signals]:
    """Symbols of the signals at the ports that the station offers. Of several names of a port, the first one counts."""
    symbols: dict[_PortId, Signals] = {_port_id(ports.state): _STATE}
    for name, port in ports.outputs.items():
        if name.startswith("applied_force."):
            symbols[_port_id(port)] = ("F",)
    for robot in ports.plant.robots.values():
        for name, symbol in _SYMBOLS.items():
            key = f"{robot.prefix}{name}"
            # A station has an input only if its configuration lists it, and an output only if its parts have it.
            for port in (ports.outputs.get(key), ports.inputs.get(key)):
                if port is not None:
                    symbols.setdefault(_port_id(port), (symbol,))
    return symbols


def _port_id(port: OutputPort | InputPort) -> _PortId:
    """Identity of a port."""
    side: Side = "out" if isinstance(port, OutputPort) else "in"
    return _PortId(port.get_system().get_name(), side, int(port.get_index()))


def drawing_of(name: str, system: System, ports: StationPorts) -> Drawn | None:
    """Find the block in which a system is drawn. Returns None for wiring, which is a part of the arrows.

    Args:
        name: name of the system.
        system: the system.
        ports: the station's ports, with the labels that its parts declared.
    """
    declaration = _declared_drawing(name, ports)
    declared = declaration.drawing
    is_silent = isinstance(system, _SILENT)
    # The outputs of a net are those of its Demultiplexer, which is silent otherwise.
    if declared is not None and (declared.net or not is_silent):
        return declared
    if is_silent or declaration.is_found:
        return None

    # A single robot has an empty prefix, with which all names begin.
    robot = next(
        (robot for robot in ports.plant.robots.values() if name.startswith(robot.prefix)), None
    )
    local_name = name if robot is None else name.removeprefix(robot.prefix)
    robot_name = robot.name if robot is not None and robot.prefix else ""
    if _is_wire(local_name, system):
        return None
    # Bars and sums come from the realisation of the servos by blocks. All else was added by the user.
    bar = _bar_or_sum(system)
    if bar is not None:
        return Drawn(name, "servo", bar.label, robot_name, shape=bar.shape)
    class_name = type(system).__name__
    if type(system) is LeafSystem:
        # A C++ class without Python bindings: Drake has its name, such as "drake::systems::controllers::Pid".
        class_name = system.GetSystemType().split("::")[-1]
    return Drawn(name, "own", f"{wrap_label(name)}\n{class_name}")


class _Outline(NamedTuple):
    """Shape and label of a block."""

    shape: Shape
    label: str


def _bar_or_sum(system: System) -> _Outline | None:
    """Outline of a system that joins, distributes or adds signals. Returns None for all other systems."""
    if isinstance(system, Multiplexer):
        return _Outline("mux", "")
    if isinstance(system, Selector):
        return _Outline("bus", "")
    if isinstance(system, Adder):
        return _Outline("sum", "+")
    return None


def _is_wire(local_name: str, system: System) -> bool:
    """Whether a system only passes values on: it joins values within a joint, or selects, reorders or turns axes.

    Args:
        local_name: name of the system without the robot's prefix. The systems of a joint have a dot in their names.
        system: the system.
    """
    if isinstance(system, Multiplexer):
        return "." in local_name
    if isinstance(system, MatrixGain):
        # A matrix of 0, 1 and -1 selects, reorders and turns axes.
        return bool(np.isin(np.asarray(system.D()), (-1.0, 0.0, 1.0)).all())
    return False


class _Declaration(NamedTuple):
    """Declaration of the station's parts about a system.

    Attributes:
        is_found: whether there is a declaration.
        drawing: block of the system; None for wiring, or if there is no declaration.
    """

    is_found: bool
    drawing: Drawn | None


def _declared_drawing(name: str, ports: StationPorts) -> _Declaration:
    """Find the declaration for a system: the one with its name, or else with the longest part before a dot.

    Args:
        name: name of the system, such as ``left.servo.joint_1``.
        ports: the station's ports, with the declarations of its parts by name.
    """
    drawings = ports.picture.drawn
    while name not in drawings:
        # A part declares its subsystem once, and all systems whose names begin with that name belong to it.
        name, dot, _ = name.rpartition(".")
        if not dot:
            return _Declaration(is_found=False, drawing=None)
    return _Declaration(is_found=True, drawing=drawings[name])


_FONT = "Helvetica,Arial,sans-serif"


class _Cluster(NamedTuple):
    """Blocks of a robot with the same role, and their common title."""

    title: str
    role: BlockRole
    blocks: list[DrawnBlock]


def _clusters(graph: BlockGraph) -> Iterator[_Cluster]:
    """Group the blocks of a graph by robot and role. Blocks that all robots share come first."""
    for robot in ["", *graph.robots]:
        for role in ROLES:
            blocks = [
                block
                for block in graph.blocks.values()
                if block.role == role and block.robot == robot
            ]
            if blocks:
                title = translate(TITLES[role])
                yield _Cluster(f"{robot}: {title}" if robot else title, role, blocks)


def dot_text(graph: BlockGraph) -> str:
    """Write a block graph in the language of Graphviz. The same graph gives the same text.

    Outputs of a robot that come from the same blocks share a port.
    """
    graph = graph.with_merged_outputs()
    title = f"{graph.title}\n{graph.description}".strip() + "\n "
    lines = [
        f"digraph {_dot_string(graph.title)} {{",
        "  rankdir=LR; ranksep=0.4; nodesep=0.15; newrank=true;",
        f'  fontname="{_FONT}"; fontsize=12; labelloc=t; label={_dot_string(title)};',
        f'  node [fontname="{_FONT}", fontsize=10, shape=box, style=filled, margin="0.16,0.05", height=0.3];',
        f'  edge [fontname="{_FONT}", fontsize=10, color="{WIRE}", arrowsize=0.6];',
    ]
    for cluster in _clusters(graph):
        colours = COLOURS[cluster.role]
        lines += [
            f"  subgraph {_dot_string(f'cluster {cluster.title}')} {{",
            f'    label={_dot_string(cluster.title)}; fontsize=11; fontcolor="{colours.line}"; labeljust=l;',
            f'    style="rounded,filled"; margin=10; color="{colours.fill}"; fillcolor="{colours.fill}";',
        ]
        lines += [f"    {_dot_node(block)}" for block in cluster.blocks]
        lines.append("  }")
    lines += [_dot_edge(graph, arrow) for arrow in graph.drawn_arrows()]
    return "\n".join([*lines, "}", ""])


def _dot_node(block: DrawnBlock) -> str:
    """Write a block as a node in the language of Graphviz; its shape and colours follow from its shape and role."""
    line = COLOURS[block.role].line
    attributes = {"label": block.text, "color": line, "fillcolor": "white"}
    if block.shape in BARS:
        attributes.update({"color": WIRE, "fillcolor": WIRE, "width": "0.07", "fixedsize": "true"})
    elif block.shape == "port":
        attributes.update(
            {"style": "rounded,filled", "fillcolor": line, "fontcolor": "white", "height": "0.22"}
        )
    elif block.shape == "sum":
        attributes.update({"shape": "circle", "width": "0.25", "height": "0.25", "margin": "0"})
    # A viewer shows the systems of the Diagram when the pointer rests on the block.
    attributes["tooltip"] = ", ".join(block.systems) or block.key
    return f"{_dot_string(block.key)} {_dot_attributes(attributes)};"


def _dot_edge(graph: BlockGraph, arrow: Arrow) -> str:
    """Write an arrow in the language of Graphviz.

    Graphviz places the second end right of the first. So an arrow that leads back is written with its target first,
    and with its head at the other end: the columns stay in the order of the signal flow.
    """
    attributes: dict[str, str] = {}
    if arrow.both:
        attributes["dir"] = "both"
    left = arrow.source
    right = arrow.target
    # Arrows in both directions are made forward, so that this does not replace "both".
    if not graph.is_forward(arrow.source, arrow.target):
        attributes["dir"] = "back"
        left = arrow.target
        right = arrow.source
    if arrow.text:
        attributes["label"] = f" {arrow.text} "
    suffix = f" {_dot_attributes(attributes)}" if attributes else ""
    return f"  {_dot_string(left)} -> {_dot_string(right)}{suffix};"


def _dot_attributes(attributes: dict[str, str]) -> str:
    """Write attributes of a node or an edge in the language of Graphviz."""
    pairs = [f"{name}={_dot_string(value)}" for name, value in attributes.items()]
    return f"[{', '.join(pairs)}]"


def _dot_string(text: str) -> str:
    """Write a text as a string in the language of Graphviz, in quotes."""
    # Backslashes first: the other replacements add some.
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def mermaid_text(graph: BlockGraph) -> str:
    """Write a block graph as a Mermaid flowchart. The same graph gives the same text.

    Outputs of a robot that come from the same blocks share a port.
    """
    graph = graph.with_merged_outputs()
    # Keys of blocks have characters that Mermaid does not accept in a name.
    names = {key: f"b{index}" for index, key in enumerate(graph.blocks)}
    lines = ["---", f"title: {_mermaid_string(graph.title)}", "---", "flowchart LR"]
    for index, cluster in enumerate(_clusters(graph)):
        lines.append(f"  subgraph s{index}[{_mermaid_string(cluster.title)}]")
        lines += [f"    {names[block.key]}{_mermaid_outline(block)}" for block in cluster.blocks]
        lines.append("  end")
    for arrow in graph.drawn_arrows():
        line = "<-->" if arrow.both else "-->"
        label = f"|{_mermaid_string(arrow.text)}|" if arrow.text else ""
        lines.append(f"  {names[arrow.source]} {line}{label} {names[arrow.target]}")
    lines.append(f"  classDef bar fill:{WIRE},stroke:{WIRE}")
    for role, colours in COLOURS.items():
        lines.append(f"  classDef {role} fill:#ffffff,stroke:{colours.line},color:#000000")
        lines.append(
            f"  classDef {role}_port fill:{colours.line},stroke:{colours.line},color:#ffffff"
        )
    return "\n".join([*lines, ""])


def _mermaid_outline(block: DrawnBlock) -> str:
    """Write the outline, the text and the style class of a block for Mermaid, as they follow the block's name."""
    # Mermaid has no thin bars: a small filled circle takes their place.
    if block.shape in BARS:
        return '((" ")):::bar'
    text = _mermaid_string(block.text)
    if block.shape == "port":
        return f"([{text}]):::{block.role}_port"
    if block.shape == "sum":
        return f"(({text})):::{block.role}"
    return f"[{text}]:::{block.role}"


def _mermaid_string(text: str) -> str:
    """Write a text as a string for Mermaid, in quotes."""
    # Mermaid takes texts as HTML, with its own escapes. Line breaks come last, since they contain "<".
    escaped = text.replace('"', "#quot;").replace("<", "#lt;").replace("\n", "<br/>")
    return f'"{escaped}"'
