"""What is connected with what: physical nodes over all levels, and where each signal comes from."""

from collections.abc import Callable, Iterable, Iterator
from functools import cached_property, partial
from itertools import chain, count, takewhile

from scipy.cluster.hierarchy import DisjointSet

from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Expanded, Node, chosen_variant
from simrob_drake.extensions.simulink.reading.graph import ELEMENT, Port

Place = tuple[int, str, int]  # a port of a node: the node's identity, side and number

_CONDITIONS = ("enable", "ifaction")
_LONGEST_WAY = 1000  # through subsystems and tags
_ASIDE = (
    "PMIOPort",
    "Solver Configuration",
    "Connection Port",
    "ConnectionLabel",
    "SimscapeBus",
    "Two-Way Connection",
)
_NESTED = 3  # physical buses in buses


class Connections:
    """The connections of an expanded model."""

    def __init__(self, expanded: Expanded) -> None:
        self.expanded = expanded
        self._nets: DisjointSet[Place] = DisjointSet()
        self._feeds: dict[Place, tuple[Node, int]] = {}
        self._gotos: dict[str, list[Node]] = {}
        self._read: set[Place] = set()
        self._wired: dict[Node, set[Place]] = {}
        for node in (expanded.root, *expanded.nodes):
            if node.block.system is not None:
                self._join_level(node)
            if node.kind == "Goto":
                self._gotos.setdefault(node.text("GotoTag", "A"), []).append(node)
        self._join_buses([node for node in expanded.nodes if node.kind == "SimscapeBus"])

    def net(self, node: Node, side: str, number: int = 1) -> Place:
        """Return the physical node that a port is part of; the same value for all ports on it.

        The port counts as read.
        """
        self._read.add((id(node), side, number))
        return self._find((id(node), side, number))

    def on(self, place: Place) -> list[Node]:
        """Return the blocks with a port on a physical node."""
        return self._on.get(self._find(place), [])

    @cached_property
    def _on(self) -> dict[Place, list[Node]]:
        found: dict[Place, list[Node]] = {}
        for node, places in self._wired.items():
            for place in dict.fromkeys(map(self._find, places)):
                found.setdefault(place, []).append(node)
        return found

    def joined(
        self, start: Node, ends: Callable[[Node], Iterable[Place]] | None = None
    ) -> set[Node]:
        """Return the blocks that physical lines join with one, over any number of others, at their ``ends``, or all."""
        found, waiting = {start}, [start]
        while waiting:
            places = (self._wired.get if ends is None else ends)(waiting.pop()) or ()
            new = {
                one
                for place in places
                for one in self.on(place)
                if not one.children and one.kind not in _ASIDE
            }
            waiting += new - found
            found |= new
        return found

    def unread(self, node: Node) -> list[Place]:
        """Return the physical ports of a block that lines lead to and that nothing has asked for."""
        return sorted(self._wired.get(node, set()) - self._read)

    def leads_outside(self, node: Node, side: str, number: int) -> bool:
        """Tell whether a physical port is joined with a port of the model itself, as in a file that others use."""
        here, ports = self.net(node, side, number), _ports(self.expanded.root, "PMIOPort")
        return any(self._find((id(port), "conn", 1)) == here for port in ports)

    def alone(self, node: Node, side: str, number: int) -> bool:
        """Tell whether no other block has a part in a physical port's line."""
        others = (one for one in self.on(self.net(node, side, number)) if one is not node)
        return all(one.children or one.kind in _ASIDE for one in others)

    def source(self, node: Node, number: int = 1, side: str = "in") -> tuple[Node, int] | None:
        """Return the block and output that feed an input, through subsystems and tags; None where nothing does.

        Subsystems that run under a condition, whose ``side`` is ``enable`` or ``ifaction``, are not gone through.
        """
        return self._origin(node, self._feeds.get((id(node), side, number)))

    def sources(self, node: Node) -> list[tuple[Node, int]]:
        """Return the blocks and outputs that feed the inputs of a block, up to one that nothing feeds."""
        return [
            source
            for source in takewhile(bool, map(partial(self.source, node), count(1)))
            if source
        ]

    def inside(self, node: Node, output: int) -> tuple[Node, int] | None:
        """Return the block and output that feed an output of a subsystem from within."""
        port = self.outport(node, output)
        return None if port is None else self.source(port)

    def outport(self, node: Node, output: int) -> Node | None:
        """Return the block in a subsystem that is one of its outputs; of a variant's, the one of that name inside."""
        port = next((port for port in _ports(node, "Outport") if _number(port) == output), None)
        if not node.is_on("Variant"):
            return port
        inner = _ports(chosen_variant(node), "Outport")
        same = (own for own in inner if port is not None and own.block.name == port.block.name)
        return next(chain(same, (own for own in inner if _number(own) == output)), None)

    def elements(self, node: Node, output: int) -> dict[str, Node]:
        """Return the blocks in a subsystem that make one of its outputs a bus, by the names of their signals."""
        owner = chosen_variant(node) if node.is_on("Variant") else node
        ports = [port for port in _ports(owner, "Outport") if _number(port) == output]
        return {port.text(ELEMENT): port for port in ports if port.text(ELEMENT)}

    def bus_of(self, node: Node) -> tuple[Node, int] | None:
        """Return what feeds the bus of which a port block within a subsystem is an element; None of another block."""
        owner = node.parent
        if node.kind != "Inport" or not node.text(ELEMENT) or owner is None or owner.parent is None:
            return None
        return self._origin(node, self._feeds.get(self._from_outside(node, owner, owner.parent)))

    def is_conditional(self, node: Node) -> bool:
        """Tell whether a subsystem runs while a signal lets it."""
        return any((id(node), side, 1) in self._feeds for side in _CONDITIONS)

    def _origin(self, node: Node, here: tuple[Node, int] | None) -> tuple[Node, int] | None:
        for _ in range(_LONGEST_WAY):
            if here is None:
                return None
            following = self._before(*here)
            if following == here:
                return here
            here = following
        raise node.refusal(
            message(
                "simulink.signal_without_source",
                "its signal goes round through tags without a source",
            )
        )

    def signal_name(self, node: Node, number: int) -> str:
        """Return the name of the signal at an input, told where it comes from; else the block's that its line is from.

        Empty where there is none.
        """
        first, here = "", self._feeds.get((id(node), "in", number))
        for _ in range(_LONGEST_WAY):
            if here is None:
                break
            source, output = here
            level = source.parent.block.system if source.parent else None
            if level is not None and (
                name := level.signals.get(Port(source.block.sid, "out", output))
            ):
                return name
            first = first or source.block.name
            behind = self._behind(source, output)
            here = None if behind is None else self._feeds.get(behind)
        return first

    def _before(self, node: Node, output: int) -> tuple[Node, int] | None:
        """Go one step up a signal where a block only hands it on."""
        ends = (
            node.text(ELEMENT)
            or self.elements(node, output)
            or (node.children and self.is_conditional(node))
        )
        behind = None if ends else self._behind(node, output)
        return (node, output) if behind is None else self._feeds.get(behind)

    def _behind(self, node: Node, output: int) -> Place | None:
        """Return the input whose signal a block hands on at an output; None of one that makes its own."""
        if node.block.commented == "through":
            return id(node), "in", output
        if (
            node.kind in ("Inport", "InportShadow")
            and node.parent is not None
            and node.parent.parent is not None
        ):
            return self._from_outside(node, node.parent, node.parent.parent)
        if node.kind == "From":
            return id(self._goto(node) or node), "in", 1
        port = self.outport(node, output) if node.children else None
        return None if port is None else (id(port), "in", 1)

    @staticmethod
    def _from_outside(port: Node, owner: Node, outer: Node) -> Place:
        """Return the input of a subsystem that a port block in it is; of a variant's choice, that of the variant."""
        if not outer.is_on("Variant"):
            return id(owner), "in", _number(port)
        same = [own for own in _ports(outer, "Inport") if own.block.name == port.block.name]
        return id(outer), "in", _number(same[0] if same else port)

    def _goto(self, node: Node) -> Node | None:
        """Return the Goto block of a tag: on the same level, else outward, else anywhere."""
        found = self._gotos.get(node.text("GotoTag", "A"), [])
        by_level = {id(goto.parent): goto for goto in reversed(found)}
        level = node.parent
        while level is not None and id(level) not in by_level:
            level = level.parent
        return by_level[id(level)] if level is not None else found[0] if len(found) == 1 else None

    def _join_level(self, owner: Node) -> None:
        system = owner.block.system
        assert system is not None
        for net in system.nets:
            first: Place | None = None
            for node, port in _present(owner, net):
                place = (
                    id(node),
                    *(("conn", 1) if node.kind == "PMIOPort" else (port.side, port.number)),
                )
                self._wired.setdefault(node, set()).add(place)
                first = first or place
                self._join(first, place)
        for start, ends in system.wires:
            for node, end in _present(owner, ends):
                source = owner.children.get(start.block)
                if source is not None and end.side in ("in", *_CONDITIONS):
                    self._feeds[id(node), end.side, end.number] = (source, start.number)
        self._join_ports(owner)
        labels: dict[str, Place] = {}
        for node in owner.children.values():
            if node.kind == "ConnectionLabel":
                place = (
                    (id(node), "rconn", 1)
                    if (id(node), "rconn", 1) in self._nets
                    else (id(node), "lconn", 1)
                )
                self._join(labels.setdefault(node.text("Label", "A"), place), place)
            if node.block.commented == "through":
                self._join((id(node), "lconn", 1), (id(node), "rconn", 1))

    def _join_buses(self, buses: list[Node]) -> None:
        """Join the elements on the left of physical buses that are one node on the right, by their names."""
        for _ in range(_NESTED if buses else 0):
            known: dict[tuple[Place, str], Place] = {}
            for bus in buses:
                for number, name in enumerate(bus.text("HierarchyStrings").split(";"), start=1):
                    place = (id(bus), "lconn", number)
                    self._join(
                        known.setdefault((self._find((id(bus), "rconn", 1)), name.strip()), place),
                        place,
                    )

    def _join_ports(self, owner: Node) -> None:
        choice = chosen_variant(owner) if owner.is_on("Variant") else None
        inner: dict[str, Place] = {
            port.block.name: (id(port), "conn", 1) for port in _ports(owner, "PMIOPort")
        }
        if owner.is_on("Variant") and owner.children:
            inner = {
                name: (id(choice), *place)
                for name, place in (_sides(choice).items() if choice else ())
            }
        for name, place in _sides(owner).items():
            if name in inner:
                self._join((id(owner), *place), inner[name])

    def _find(self, place: Place) -> Place:
        self._nets.add(place)
        return self._nets[place]

    def _join(self, first: Place, second: Place) -> None:
        self._nets.add(first)
        self._nets.add(second)
        self._nets.merge(first, second)


def _present(owner: Node, ports: list[Port]) -> Iterator[tuple[Node, Port]]:
    """Return the ports of blocks that take part; those commented out do not."""
    return ((node, port) for port in ports if (node := owner.children.get(port.block)) is not None)


def _ports(owner: Node | None, kind: str) -> list[Node]:
    return (
        [] if owner is None else [child for child in owner.children.values() if child.kind == kind]
    )


def _number(node: Node) -> int:
    text = node.text("Port", "1")
    return int(text) if text.isdecimal() else 1


def _sides(owner: Node) -> dict[str, tuple[str, int]]:
    """Return the physical ports of a subsystem by the names of the port blocks: which side, and the how-manieth."""
    counts, places = {"lconn": 0, "rconn": 0}, {}
    for node in sorted(_ports(owner, "PMIOPort"), key=_number):
        side = "rconn" if node.text("Side", "Left") == "Right" else "lconn"
        counts[side] += 1
        places[node.block.name] = (side, counts[side])
    return places
