"""Read the blocks and arrows of a station's picture from its Diagram, and where each system stands in it.

Whoever added a system to the station said in which block it stands (:meth:`simrob_drake.parts.site.Site.draw`). Of the
others some are wiring, bars or sums; what is left is a user's own. As text the picture is for Graphviz, or a Mermaid
flowchart, which GitHub and many editors draw in Markdown.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from pydrake.systems.framework import Diagram, InputPort, LeafSystem, OutputPort, System
from pydrake.systems.primitives import Adder, Demultiplexer, MatrixGain, Multiplexer, PassThrough, Selector

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
_PORT_SYMBOLS: dict[str, str] = _LOOKS["port_symbols"]
_STATE = ("q", "v")
_ORDER = list(_SYMBOLS.values())
_SILENT = (PassThrough, Demultiplexer, EventTimes, SteadySteps)

Signals = tuple[str, ...]
Side = Literal["in", "out"]


def read_blocks(diagram: Diagram, ports: StationPorts) -> BlockGraph:
    """Return the blocks and arrows of a Diagram that holds a station, flat, and any systems of the user's own.

    Every system is either drawn, alone or together with those that it works with, or it is wiring: then it is part of
    the arrows, or a bus bar where it gathers or hands out the signals of several blocks. What references do is told as
    the station's configuration tells it.
    """
    return _Reader(diagram, ports).graph


class _Reader:
    """Goes through a Diagram and draws what it finds."""

    def __init__(self, diagram: Diagram, ports: StationPorts) -> None:
        config = ports.config
        self._ports, self._symbols = ports, _port_symbols(ports)
        self._systems: dict[str, System] = {system.get_name(): system for system in diagram.GetSystems()}
        self._feeds = {
            (target.get_name(), int(index)): (source.get_name(), int(output))
            for (target, index), (source, output) in diagram.connection_map().items()
        }
        self._places = {name: place_of(name, system, ports) for name, system in self._systems.items()}
        self.graph = BlockGraph(config.name, translate(station_description(config)), list(config.robots))
        for name in self._systems:
            self._draw(name)
        for name in self._systems:
            self._connect(name)
        self._draw_outputs()
        self.graph.dissolve_bars()
        for signals in self.graph.arrows.values():
            signals.sort(key=lambda signal: _ORDER.index(signal) if signal in _ORDER else len(_ORDER))

    def _draw(self, name: str) -> None:
        place = self._places[name]
        if place is None:
            return
        if place.net:
            for part, inner in place.net.items():
                key = f"{place.key}.{part}"
                self.graph.blocks.setdefault(key, DrawnBlock(key, place.role, place.robot, inner.label))
                for source in inner.sources:
                    self.graph.connect(f"{place.key}.{source}", key, [])
            self.graph.blocks[f"{place.key}.{next(iter(place.net))}"].systems.append(name)
            return
        new = DrawnBlock(
            place.key, place.role, place.robot, place.label, place.shape, inside=place.inside, within=place.within
        )
        block = self.graph.blocks.setdefault(place.key, new)
        if place.within:  # another system does its work
            self.graph.connect(place.key, place.within, ["τ"])
            self.graph.connect(place.within, place.key, _STATE)
        else:
            block.systems.append(name)

    def _connect(self, name: str) -> None:
        place = self._places[name]
        if place is not None and place.net:
            for key, inner in place.net.items():
                for output in inner.reads:
                    for source, signals in self._origins(*_identity(self._ports.outputs[output])[::2]):
                        self.graph.connect(source, f"{place.key}.{key}", signals or [output])
            return
        for index in range(self._systems[name].num_input_ports()):
            if place is not None and (name, index) in self._feeds:
                for source, signals in self._origins(*self._feeds[name, index]):
                    carried = self._signals(name, "in", index) or signals
                    if carried or place.role != "force" or self.graph.blocks[source].role != "robot":
                        self.graph.connect(source, place.key, carried)  # but not that a force knows where bodies are

    def _origins(self, name: str, output: int) -> list[tuple[str, Signals]]:
        """Return the drawn blocks that an output comes from, through wiring, each with what the signals are called."""
        place, here = self._places[name], self._signals(name, "out", output)
        if place is not None:
            key = f"{place.key}.{list(place.net)[output]}" if place.net else place.key
            return [(key, here)]
        found = []
        for index in range(self._systems[name].num_input_ports()):
            called = here or self._signals(name, "in", index)
            feed = self._feeds.get((name, index))
            origins = self._origins(*feed) if feed else [(self._open_input(name), called)]
            found += [(source, called or signals) for source, signals in origins]
        return found

    def _signals(self, name: str, side: Side, index: int) -> Signals:
        if (name, side, index) in self._symbols:
            return self._symbols[name, side, index]
        system = self._systems[name]
        port = system.get_input_port(index) if side == "in" else system.get_output_port(index)
        return (_PORT_SYMBOLS[port.get_name()],) if port.get_name() in _PORT_SYMBOLS else ()

    def _open_input(self, name: str) -> str:
        """Draw an input of the station that nothing feeds yet."""
        key = f"input {name}"
        self.graph.blocks.setdefault(key, DrawnBlock(key, "reference", self._robot(name), name, "port", [name]))
        return key

    def _draw_outputs(self) -> None:
        """Draw the station's outputs; names of one and the same signal share an oval."""
        names: dict[tuple[str, Side, int], list[str]] = {}
        for name, port in self._ports.outputs.items():
            if not name.endswith("reference"):  # what the station is given, not what it shows
                names.setdefault(_identity(port), []).append(name)
        for (system, _, index), aliases in names.items():
            key, robot = f"output {aliases[0]}", self._robot(aliases[0])
            short = sorted((name.removeprefix(f"{robot}.") for name in aliases), key=len)
            self.graph.blocks[key] = DrawnBlock(key, "sensor", robot, " = ".join(short), "port")
            for source, signals in self._origins(system, index):
                self.graph.connect(source, key, signals)

    def _robot(self, name: str) -> str:
        """Return the robot that a name belongs to, or nothing where the station has one only."""
        robots = self._ports.plant.robots.values()
        return next((robot.name for robot in robots if robot.prefix and name.startswith(robot.prefix)), "")


def station_description(config: StationConfig) -> str:
    """Description of a station; a message, if the station comes with the package, so that other languages have it."""
    file = station_files().get(config.name)
    if file is None or read_yaml(file).get("description") != config.description:
        return config.description
    return description_message("station", config.name, config.description)


def _port_symbols(ports: StationPorts) -> dict[tuple[str, Side, int], Signals]:
    """Return what the signals at ports are called."""
    symbols: dict[tuple[str, Side, int], Signals] = {_identity(ports.state): _STATE}
    symbols |= {_identity(port): ("F",) for name, port in ports.outputs.items() if name.startswith("applied_force.")}
    for robot in ports.plant.robots.values():
        for name, symbol in _SYMBOLS.items():
            key = f"{robot.prefix}{name}"
            for port in (ports.outputs.get(key), ports.inputs.get(key)):
                if port is not None:
                    symbols.setdefault(_identity(port), (symbol,))
    return symbols


def _identity(port: OutputPort | InputPort) -> tuple[str, Side, int]:
    return port.get_system().get_name(), "out" if isinstance(port, OutputPort) else "in", int(port.get_index())


def place_of(name: str, system: System, ports: StationPorts) -> Drawn | None:
    """Return where a system is drawn, or None for wiring that is part of the arrows."""
    robot = next((r for r in ports.plant.robots.values() if name.startswith(r.prefix)), None)
    local = name if robot is None else name.removeprefix(robot.prefix)
    owner = robot.name if robot is not None and robot.prefix else ""
    drawn = _drawing_of(name, ports)
    if isinstance(drawn, Drawn) and (drawn.net or not isinstance(system, _SILENT)):
        return drawn
    if isinstance(system, _SILENT) or drawn is None or _is_wire(local, system):
        return None
    bars: list[tuple[type, Shape, str]] = [(Multiplexer, "mux", ""), (Selector, "bus", ""), (Adder, "sum", "+")]
    for kind, shape, label in bars:
        if isinstance(system, kind):
            return Drawn(name, "servo", label, owner, shape=shape)
    shown = type(system).__name__ if type(system) is not LeafSystem else system.GetSystemType().split("::")[-1]
    return Drawn(name, "own", f"{wrap_label(name)}\n{shown}")


def _is_wire(local: str, system: System) -> bool:
    """Tell whether a system only hands values on: in a joint's row, or from one order of axes to another."""
    if isinstance(system, Multiplexer):
        return "." in local
    return isinstance(system, MatrixGain) and bool(np.isin(np.asarray(system.D()), (-1.0, 0.0, 1.0)).all())


def _drawing_of(name: str, ports: StationPorts) -> Drawn | str | None:
    """Return the block that was said to hold a system, None for wiring, and its name where nothing was said."""
    known = name
    while known not in ports.picture.drawn:
        known, dot, _ = known.rpartition(".")
        if not dot:
            return name
    return ports.picture.drawn[known]


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
"""Titles of the groups of blocks."""
COLOURS: dict[BlockRole, tuple[str, str]] = _LOOKS["colours"]  # of the blocks, and of their edges
WIRE = "#444444"

_FONT = "Helvetica,Arial,sans-serif"


def dot_text(graph: BlockGraph) -> str:
    """Return a block graph in Graphviz' language; the same graph gives the same text."""
    graph = graph.folded()
    title = f"{graph.title}\n{graph.description}".strip() + "\n "
    lines = [
        f"digraph {_quoted(graph.title)} {{",
        "  rankdir=LR; ranksep=0.4; nodesep=0.15; newrank=true;",
        f'  fontname="{_FONT}"; fontsize=12; labelloc=t; label={_quoted(title)};',
        f'  node [fontname="{_FONT}", fontsize=10, shape=box, style=filled, margin="0.16,0.05", height=0.3];',
        f'  edge [fontname="{_FONT}", fontsize=10, color="{WIRE}", arrowsize=0.6];',
    ]
    for name, role, blocks in _clusters(graph):
        fill, line = COLOURS[role]
        lines += [
            f"  subgraph {_quoted(f'cluster {name}')} {{",
            f'    label={_quoted(name)}; fontsize=11; fontcolor="{line}"; labeljust=l;',
            f'    style="rounded,filled"; margin=10; color="{fill}"; fillcolor="{fill}";',
            *(f"    {_node(block)}" for block in blocks),
            "  }",
        ]
    lines += [_edge(graph, arrow) for arrow in graph.drawn_arrows()]
    return "\n".join([*lines, "}", ""])


def _clusters(graph: BlockGraph) -> Iterator[tuple[str, BlockRole, list[DrawnBlock]]]:
    """Yield the blocks of one robot and role, with what they are called together."""
    for robot in ["", *graph.robots]:
        for role in ROLES:
            blocks = [block for block in graph.blocks.values() if (block.role, block.robot) == (role, robot)]
            if blocks:
                title = translate(TITLES[role])
                yield f"{robot}: {title}" if robot else title, role, blocks


def _node(block: DrawnBlock) -> str:
    line = COLOURS[block.role][1]
    look = {"label": block.text, "color": line, "fillcolor": "white"}
    if block.shape in BARS:
        look |= {"color": WIRE, "fillcolor": WIRE, "width": "0.07", "fixedsize": "true"}
    elif block.shape == "port":
        look |= {"style": "rounded,filled", "fillcolor": line, "fontcolor": "white", "height": "0.22"}
    elif block.shape == "sum":
        look |= {"shape": "circle", "width": "0.25", "height": "0.25", "margin": "0"}
    look["tooltip"] = ", ".join(block.systems) or block.key
    return f"{_quoted(block.key)} {_attributes(look)};"


def _edge(graph: BlockGraph, arrow: Arrow) -> str:
    """Return an arrow, written from left to right also where it leads back, so that the columns stay in order."""
    ends, look = [arrow.source, arrow.target], {"dir": "both"} if arrow.both else {}
    if not graph.forward(*ends):
        look["dir"], ends = "back", ends[::-1]
    if arrow.text:
        look["label"] = f" {arrow.text} "
    return f"  {' -> '.join(map(_quoted, ends))}{f' {_attributes(look)}' if look else ''};"


def _attributes(look: dict[str, str]) -> str:
    return f"[{', '.join(f'{name}={_quoted(value)}' for name, value in look.items())}]"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def mermaid_text(graph: BlockGraph) -> str:
    """Return a block graph as a flowchart; the same graph gives the same text."""
    graph = graph.folded()
    names = {key: f"b{index}" for index, key in enumerate(graph.blocks)}
    lines = ["---", f"title: {_marked(graph.title)}", "---", "flowchart LR"]
    for number, (name, _, blocks) in enumerate(_clusters(graph)):
        lines.append(f"  subgraph s{number}[{_marked(name)}]")
        lines += [f"    {names[block.key]}{_shape(block)}" for block in blocks]
        lines.append("  end")
    for arrow in graph.drawn_arrows():
        label = f"|{_marked(arrow.text)}|" if arrow.text else ""
        lines.append(f"  {names[arrow.source]} {'<-->' if arrow.both else '-->'}{label} {names[arrow.target]}")
    lines.append(f"  classDef bar fill:{WIRE},stroke:{WIRE}")
    for role, (_, line) in COLOURS.items():
        lines.append(f"  classDef {role} fill:#ffffff,stroke:{line},color:#000000")
        lines.append(f"  classDef {role}_port fill:{line},stroke:{line},color:#ffffff")
    return "\n".join([*lines, ""])


def _shape(block: DrawnBlock) -> str:
    """Return a block's outline, text and style."""
    if block.shape in BARS:
        return '((" ")):::bar'
    text = _marked(block.text)
    if block.shape == "port":
        return f"([{text}]):::{block.role}_port"
    return f"(({text})):::{block.role}" if block.shape == "sum" else f"[{text}]:::{block.role}"


def _marked(text: str) -> str:
    return '"' + text.replace('"', "#quot;").replace("<", "#lt;").replace("\n", "<br/>") + '"'
