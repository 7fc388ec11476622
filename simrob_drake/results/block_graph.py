"""The blocks and arrows of a station's picture, measured from its Diagram.

Every system of the Diagram is either drawn (alone or together with those that it works with) or wiring. Wiring that
fans out or in is drawn as a bus bar, as Simulink draws its Mux; all other wiring is part of the arrows.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from pydrake.systems.framework import Diagram, OutputPort
from pydrake.systems.primitives import Demultiplexer, Multiplexer, Selector

from simrob_drake.results.block_places import Place, Role, Shape, place_of
from simrob_drake.stations.ports import StationPorts

_SYMBOLS = {  # of a station's ports; the first that a signal has is its name
    "position": "q",
    "velocity": "v",
    "torque": "τ",
    "reference": "q_ref",
    "reference_velocity": "v_ref",
    "reference_acceleration": "a",
    "feedforward": "τ_ff",
    "external_force": "F",
}
_PORT_SYMBOLS = {"geometry_pose": "poses", "query": "contacts", "applied_generalized_force": "τ"}
_STATE = "q, v"


@dataclass
class Block:
    """A block of the picture.

    Attributes:
        key: its identifier in the graph.
        role: what it is for, which makes its colour and cluster.
        robot: whose it is; empty for what the robots share.
        label: its lines.
        shape: block, bus bar, the station's port, or sum.
        systems: names of the systems of the Diagram that it stands for.
    """

    key: str
    role: Role
    robot: str
    label: str
    shape: Shape = "block"
    systems: list[str] = field(default_factory=list)


@dataclass
class BlockGraph:
    """A picture's blocks by key, and its arrows: (source, target) to the names of their signals."""

    title: str
    description: str
    robots: list[str]
    blocks: dict[str, Block] = field(default_factory=dict)
    arrows: dict[tuple[str, str], list[str]] = field(default_factory=dict)

    def connect(self, source: str, target: str, signal: str) -> None:
        """Add an arrow, or a signal to an arrow."""
        if source != target:
            signals = self.arrows.setdefault((source, target), [])
            if signal and signal not in signals:
                signals.append(signal)


def block_graph(diagram: Diagram, ports: StationPorts) -> BlockGraph:
    """Return the blocks and arrows of a Diagram that holds a station.

    Args:
        diagram: the station's systems, and any of the user's own, flat.
        ports: the station's. What references do is told as its configuration tells it.
    """
    return _Drawing(diagram, ports).graph


class _Drawing:
    """A graph in the making."""

    def __init__(self, diagram: Diagram, ports: StationPorts) -> None:
        config = ports.config
        self._ports = ports
        self._systems = {system.get_name(): system for system in diagram.GetSystems()}
        self._into = {
            (target.get_name(), int(index)): (source.get_name(), int(output))
            for (target, index), (source, output) in diagram.connection_map().items()
        }
        self._symbols = self._port_symbols()
        self._places = {name: place_of(name, system, ports) for name, system in self._systems.items()}
        self.graph = BlockGraph(config.name, config.description, list(config.robots))
        for name, place in self._places.items():
            if place is not None:
                self._draw(name, place)
        for name in self._systems:
            self._connect(name)
        self._add_outputs()
        self._settle_bars()

    def _port_symbols(self) -> dict[tuple[str, str, int], str]:
        """Return the names of signals by system, direction and index of a port."""
        symbols: dict[tuple[str, str, int], str] = {}
        for robot in self._ports.plant.robots.values():
            for name, symbol in _SYMBOLS.items():
                output, given = (own.get(f"{robot.prefix}{name}") for own in (self._ports.outputs, self._ports.inputs))
                if isinstance(output, OutputPort):
                    symbols.setdefault((output.get_system().get_name(), "out", int(output.get_index())), symbol)
                if given is not None:
                    symbols.setdefault((given.get_system().get_name(), "in", int(given.get_index())), symbol)
        state = self._ports.state
        symbols[(state.get_system().get_name(), "out", int(state.get_index()))] = _STATE
        return symbols

    def _symbol(self, system: str, direction: Literal["in", "out"], index: int) -> str:
        known = self._symbols.get((system, direction, index))
        if known is not None:
            return known
        block = self._systems[system]
        port = block.get_input_port(index) if direction == "in" else block.get_output_port(index)
        return _PORT_SYMBOLS.get(port.get_name(), "")

    def _draw(self, name: str, place: Place) -> None:
        block = self.graph.blocks.setdefault(place.key, Block(place.key, place.role, place.robot, "", place.shape))
        block.systems.append(name)
        if place.label and place.label not in block.label:
            block.label = f"{block.label}\n{place.label}".strip()

    def _connect(self, name: str) -> None:
        place = self._places[name]
        for index in range(self._systems[name].num_input_ports() if place else 0):
            feed = self._into.get((name, index))
            if place is not None and feed is not None:
                for source, signal in self._origins(*feed):
                    self.graph.connect(source, place.key, self._symbol(name, "in", index) or signal)

    def _origins(self, name: str, output: int) -> list[tuple[str, str]]:
        """Return the drawn blocks that an output comes from, through wiring, each with the name of the signal."""
        place, symbol = self._places[name], self._symbol(name, "out", output)
        if place is not None:
            return [(place.key, symbol)]
        found = []
        for index in range(self._systems[name].num_input_ports()):
            here = symbol or self._symbol(name, "in", index)
            feed = self._into.get((name, index))
            origins = self._origins(*feed) if feed is not None else [(self._open_input(name), "")]
            found += [(source, here or signal) for source, signal in origins]
        return found

    def _open_input(self, name: str) -> str:
        """Draw an input of a station that nothing feeds yet."""
        robot = next((r.name for r in self._ports.plant.robots.values() if r.prefix and name.startswith(r.prefix)), "")
        key = f"input {name}"
        self.graph.blocks.setdefault(key, Block(key, "reference", robot, name, "port", [name]))
        return key

    def _add_outputs(self) -> None:
        """Draw the station's outputs; names of one and the same port share an oval."""
        names: dict[tuple[str, int], list[str]] = {}
        for name, port in self._ports.outputs.items():
            names.setdefault((port.get_system().get_name(), int(port.get_index())), []).append(name)
        for (system, index), aliases in names.items():
            shown = [name for name in aliases if name.split(".")[-1] != "reference"]  # an input; not what is measured
            robot = next((r for r in self._ports.plant.robots.values() if aliases[0].startswith(r.prefix)), None)
            if not shown or robot is None:
                continue
            label = "\n".join(name.removeprefix(robot.prefix) for name in sorted(shown, key=len))
            key = f"output {shown[0]}"
            self.graph.blocks[key] = Block(key, "sensor", robot.name if robot.prefix else "", label, "port")
            for source, signal in self._origins(system, index):
                self.graph.connect(source, key, signal)

    def _settle_bars(self) -> None:
        """Give each bus bar the role of what it hands signals out to, or gathers them from."""
        for key, block in self.graph.blocks.items():
            if block.shape != "bar":
                continue
            system = self._systems[block.systems[0]]
            gathers = isinstance(system, Multiplexer) or not isinstance(system, Selector | Demultiplexer)
            ends = [s if gathers else t for s, t in self.graph.arrows if (t if gathers else s) == key]
            if ends:
                block.role = self.graph.blocks[ends[0]].role
