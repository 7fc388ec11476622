"""Blocks and arrows of a station's block picture, and the nets and columns in which they are drawn.

A *block* represents one or several systems of the station's Diagram. An *arrow* leads from a block to another one and
carries one or several signals. A *port* is a block for an output of the station, or for an input that nothing feeds.
A *bar* is a thin block that joins signals (mux) or distributes them (bus). A *net* is a signal from a block to all
blocks that read it: the picture shows it as one line that branches. The *role* of a block, such as "servo",
determines its colour and its column; roles are in the order of the signal flow, from the references to the sensors.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, get_args

from simrob_drake.parts.captions import BlockRole, Shape

ROLES: tuple[BlockRole, ...] = get_args(BlockRole)
"""All roles, in the order of the signal flow."""

BARS: tuple[Shape, ...] = ("mux", "bus")
"""Shapes of thin bars: a mux joins signals, a bus distributes them."""

FOLDED = "folded "
"""Beginning of the key of a block that represents a whole subsystem. The key of one of its blocks follows."""


@dataclass
class DrawnBlock:
    """A block of the picture.

    Attributes:
        key: unique name of the block in its graph.
        role: role in the signal flow, which determines colour and column.
        robot: name of the robot that the block belongs to; empty if the robots share it.
        label: lines of the block's text.
        shape: how the block is drawn: as a box, a thin bar, an oval port, or a circle for a sum.
        systems: names of the systems of the Diagram that the block represents.
        inside: steps of the block's computation in their order, drawn as boxes inside the block.
        within: key of the block whose system does the work, such as the plant for a servo in its actuators. It is
            empty if the block has systems of its own.
    """

    key: str
    role: BlockRole
    robot: str
    label: str = ""
    shape: Shape = "block"
    systems: list[str] = field(default_factory=list)
    inside: tuple[str, ...] = ()
    within: str = ""

    @property
    def text(self) -> str:
        """Label and steps of the block in lines, for formats that draw no boxes inside a block."""
        steps = [f"↓ {step}" for step in self.inside]
        return "\n".join([self.label, *steps])


class Ends(NamedTuple):
    """Keys of the two blocks that an arrow connects."""

    source: str
    target: str


@dataclass(frozen=True)
class Arrow:
    """An arrow with its text, ready to be drawn.

    Attributes:
        source: key of the block where the arrow begins.
        target: key of the block to which the arrow leads.
        text: names of the signals of the arrow. It is empty at a port, whose label has the name already.
        both: whether the blocks exchange signals. Then the arrow has two heads, and the text has both directions.
    """

    source: str
    target: str
    text: str
    both: bool = False


@dataclass
class BlockGraph:
    """Blocks and arrows of a picture.

    Attributes:
        title: title of the picture, the name of the station.
        description: a sentence about the station, under the title.
        robots: names of the station's robots.
        blocks: blocks by key.
        arrows: names of the signals that each arrow carries.
    """

    title: str
    description: str = ""
    robots: list[str] = field(default_factory=list)
    blocks: dict[str, DrawnBlock] = field(default_factory=dict)
    arrows: dict[Ends, list[str]] = field(default_factory=dict)

    def connect(self, source: str, target: str, signals: Iterable[str]) -> None:
        """Add signals to the arrow between two blocks. The arrow itself is added if it is new.

        An arrow from a block to itself is left out: it would only show how the block works inside.

        Args:
            source: key of the block where the arrow begins.
            target: key of the block to which it leads.
            signals: names of the signals; perhaps none.
        """
        if source == target:
            return
        # A list, not a set: the same Diagram gives the same picture.
        carried = self.arrows.setdefault(Ends(source, target), [])
        for signal in signals:
            if signal not in carried:
                carried.append(signal)

    def sources(self, key: str) -> list[str]:
        """Keys of the blocks from which arrows lead to a block."""
        return [ends.source for ends in self.arrows if ends.target == key]

    def targets(self, key: str) -> list[str]:
        """Keys of the blocks to which arrows lead from a block."""
        return [ends.target for ends in self.arrows if ends.source == key]

    def is_forward(self, source: str, target: str) -> bool:
        """Whether an arrow leads in the direction of the signal flow: to a block of the same role or of a later one.

        A measurement, for instance, leads back to its controller. If two blocks of the same role exchange signals, the
        arrow from the block that was added first is forward, and the other one is not.

        Args:
            source: key of the block where the arrow begins.
            target: key of the block to which it leads.
        """
        source_rank = ROLES.index(self.blocks[source].role)
        target_rank = ROLES.index(self.blocks[target].role)
        exchange = Ends(source, target) in self.arrows and Ends(target, source) in self.arrows
        if source_rank == target_rank and exchange:
            # Equal roles do not show which of the two commands the other.
            keys = list(self.blocks)
            return keys.index(source) < keys.index(target)
        return source_rank <= target_rank

    def drawn_arrows(self) -> list[Arrow]:
        """Arrows to draw. Two blocks that exchange signals have a single arrow with two heads.

        An arrow to a port of the station has no text, since the label of the port has the name of the signal.
        """
        drawn = []
        for ends, signals in self.arrows.items():
            text = ", ".join(signals)
            opposite = self.arrows.get(Ends(ends.target, ends.source))
            if opposite is None:
                is_port = self.blocks[ends.target].shape == "port"
                drawn.append(Arrow(ends.source, ends.target, "" if is_port else text))
            elif self.is_forward(ends.source, ends.target):
                # The opposite arrow is not forward, so that each pair is drawn once.
                texts = [text, ", ".join(opposite)]
                both_ways = " / ".join(part for part in texts if part)
                drawn.append(Arrow(ends.source, ends.target, both_ways, both=True))
        return drawn

    def dissolve_bars(self) -> None:
        """Remove the bars that do not help the reader, and give the remaining bars the role of their neighbours.

        A bar remains if it joins, or distributes, the signals of at least two blocks that all have the same role. In
        place of another bar, each of its sources is connected to each of its targets.
        """
        bars = [block for block in self.blocks.values() if block.shape in BARS]
        for bar in bars:
            # A mux has many sources and one target. A bus has one source and many targets.
            many_ends = self.sources(bar.key) if bar.shape == "mux" else self.targets(bar.key)
            roles = {self.blocks[end].role for end in many_ends}
            if len(many_ends) > 1 and len(roles) == 1:
                # The role determines the column, so that the bar is next to the blocks that it serves.
                bar.role = roles.pop()
            else:
                self._bypass(bar.key)

    def _bypass(self, key: str) -> None:
        """Remove a block, and connect each of its sources to each of its targets.

        Args:
            key: key of the block.
        """
        for source in self.sources(key):
            for target in self.targets(key):
                # The names behind the block are more specific, such as the part of the state that a target reads.
                signals = self.arrows[Ends(key, target)] or self.arrows[Ends(source, key)]
                self.connect(source, target, signals)
        self.arrows = {ends: signals for ends, signals in self.arrows.items() if key not in ends}
        del self.blocks[key]

    def with_merged_outputs(self) -> "BlockGraph":
        """Copy of the graph in which outputs of a robot that come from the same blocks share one port.

        The port has one line for each output. Graphviz and Mermaid would draw dozens of single ports.
        """
        ports: dict[_OutputGroup, str] = {}
        port_of_output: dict[str, str] = {}
        graph = BlockGraph(self.title, self.description, self.robots)
        for key, block in self.blocks.items():
            if block.role == "sensor" and block.shape == "port":
                group = _OutputGroup(block.robot, tuple(self.sources(key)))
                port_of_output[key] = ports.setdefault(group, key)
            port = port_of_output.get(key, key)
            if port == key:
                graph.blocks[key] = replace(block)
            else:
                # The first output of a group has made the port. Its copy is extended, so that this graph itself
                # does not change.
                graph.blocks[port].label += f"\n{block.label}"
        for ends, signals in self.arrows.items():
            graph.connect(ends.source, port_of_output.get(ends.target, ends.target), signals)
        return graph

    def neighbourhood(self, key: str) -> "BlockGraph":
        """Graph of a block with its sources and its targets only, without the ports of the station.

        Of the arrows, those from and to the block remain.

        Args:
            key: key of the block.
        """
        graph = BlockGraph(self.title)
        neighbours = {key, *self.sources(key), *self.targets(key)}
        for name, block in self.blocks.items():
            if name in neighbours and block.shape != "port":
                # The block that does the work may be missing here, so nothing may refer to it.
                graph.blocks[name] = replace(block, within="")
        for ends, signals in self.arrows.items():
            if key in ends and ends.source in graph.blocks and ends.target in graph.blocks:
                graph.arrows[ends] = signals
        return graph

    def with_folded(self, names: Iterable[str], titles: Mapping[BlockRole, str]) -> "BlockGraph":
        """Copy of the graph in which chosen subsystems are one block each.

        A subsystem is all blocks of a robot that have the same role, without the ports of the station.

        Args:
            names: keys of blocks. The subsystems to which they belong are folded; a block that is alone stays.
            titles: title of a subsystem by its role. The count of its blocks follows in the label.
        """
        shown_keys = self._keys_with_folded(names)
        counts = Counter(shown_keys.values())
        graph = BlockGraph(self.title, self.description, self.robots)
        for key, block in self.blocks.items():
            shown_key = shown_keys[key]
            if shown_key == key:
                graph.blocks[key] = replace(block, within=shown_keys.get(block.within, ""))
                continue
            label = f"{titles[block.role]} ({counts[shown_key]})"
            folded = DrawnBlock(shown_key, block.role, block.robot, label)
            # The first block of a subsystem adds the common block, and all of them add their systems.
            graph.blocks.setdefault(shown_key, folded).systems += block.systems
        for ends, signals in self.arrows.items():
            # Arrows within a folded subsystem would lead from a block to itself, and are dropped.
            graph.connect(shown_keys[ends.source], shown_keys[ends.target], signals)
        return graph

    def _keys_with_folded(self, names: Iterable[str]) -> dict[str, str]:
        """Key of the block in which each block is drawn once the subsystems of some blocks are folded.

        Args:
            names: keys of blocks whose subsystems are folded.
        """
        subsystems: dict[_Subsystem, list[str]] = defaultdict(list)
        for key, block in self.blocks.items():
            if block.shape != "port":
                subsystems[_Subsystem(block.robot, block.role)].append(key)

        chosen = list(names)
        shown_keys = {key: key for key in self.blocks}
        for members in subsystems.values():
            chosen_members = [key for key in chosen if key in members]
            # One block in place of one block would only hide its text.
            if chosen_members and len(members) > 1:
                shown_keys.update(dict.fromkeys(members, f"{FOLDED}{chosen_members[0]}"))
        return shown_keys


class _OutputGroup(NamedTuple):
    """Outputs of a robot that come from the same blocks: the robot's name, and the keys of the blocks."""

    robot: str
    sources: tuple[str, ...]


class _Subsystem(NamedTuple):
    """Blocks of a robot that have the same role. The name of the robot is empty for blocks that robots share."""

    robot: str
    role: BlockRole


@dataclass
class Net:
    """A signal from a block to all blocks that read it, drawn as one line that branches.

    Attributes:
        source: key of the block where the net begins.
        text: name of the signal, or names of several signals with the same source and the same targets.
        both: whether the net is an exchange of signals with a single target. Then both its ends have arrowheads.
        targets: keys of the blocks to which the net leads.
    """

    source: str
    text: str
    both: bool
    targets: list[str] = field(default_factory=list)


class _NetKey(NamedTuple):
    """Arrows with the same key belong to the same net.

    Attributes:
        source: key of the block where the net begins.
        text: name of the signal.
        group: empty for a net that leads to any blocks; else the name of the one target, joint or robot it leads to.
    """

    source: str
    text: str
    group: str


class _PortGroup(NamedTuple):
    """Ports of a robot that read the same block: the block's key, and the robot's name."""

    source: str
    robot: str


def nets_of(graph: BlockGraph) -> list[Net]:
    """Collect the arrows of a graph into nets, including those to the outputs of the station.

    Arrows with the same source and the same text are one net. A bus has a net for each joint, and each exchange of
    signals is a net of its own.
    """
    nets: dict[_NetKey, Net] = {}
    port_groups: dict[_PortGroup, list[str]] = defaultdict(list)
    for arrow in graph.drawn_arrows():
        target = graph.blocks[arrow.target]
        if target.shape == "port":
            # Ports wait until all other nets are known: they may join one of them.
            port_groups[_PortGroup(arrow.source, target.robot)].append(arrow.target)
            continue
        key = _NetKey(arrow.source, arrow.text, _net_group(graph, arrow))
        net = nets.setdefault(key, Net(arrow.source, arrow.text, arrow.both))
        net.targets.append(arrow.target)

    # Ports join the net of their signals if other blocks read the same signals. Else each robot's ports have a net.
    for group, ports in port_groups.items():
        signals = [signal for port in ports for signal in graph.arrows[Ends(group.source, port)]]
        text = ", ".join(dict.fromkeys(signals))
        common_key = _NetKey(group.source, text, "")
        # No block's key begins with a space, so that this group is different from all others.
        own_key = _NetKey(group.source, text, f" {group.robot}")
        key = common_key if common_key in nets else own_key
        net = nets.setdefault(key, Net(group.source, text, both=False))
        net.targets += ports
    return list(nets.values())


def _net_group(graph: BlockGraph, arrow: Arrow) -> str:
    """Group of the net of an arrow. Arrows of the same source and text with different groups are in different nets.

    Returns:
        the target, for an exchange of signals; the joint, for an arrow from a bus; otherwise an empty text.
    """
    if arrow.both:
        return arrow.target
    if graph.blocks[arrow.source].shape == "bus":
        # A bus has a net for each joint: the keys of a joint's blocks are "joint_1.error", "joint_1.pd" and so on.
        joint, _, _ = arrow.target.rpartition(".")
        return joint
    return ""


_COLUMN_GROUPS: tuple[tuple[BlockRole, ...], ...] = (
    ("reference",),
    ("loop", "own"),
    ("servo",),
    ("force",),
    ("robot",),
    ("sensor", "scene"),
)
"""Roles that share a group of columns, from left to right."""


def columns_of(graph: BlockGraph) -> dict[str, int]:
    """Index of the column of each block, from 0 at the left.

    Groups of roles follow each other in the order of the signal flow. Within a group, a block is right of the blocks
    that feed it, but for signals that lead back. Outputs, monitors, and sensors that feed no block are in the last
    column.
    """
    columns: dict[str, int] = {}
    next_column = 0
    # Forces act on the plant as the servos do. They are drawn below the blocks of the column before them, unless that
    # column has only bars, which are as high as the column, or only references.
    forces_need_own_column = True
    for roles in _COLUMN_GROUPS:
        blocks = [block for block in graph.blocks.values() if block.role in roles]
        keys = [block.key for block in blocks if not _is_output(graph, block)]
        if not keys:
            continue
        # For each block, the column within its group.
        depths = _depths(graph, keys)
        if roles == ("force",) and not forces_need_own_column:
            next_column -= 1
        for key, depth in depths.items():
            columns[key] = next_column + depth
        last_depth = max(depths.values())
        last_blocks = [graph.blocks[key] for key, depth in depths.items() if depth == last_depth]
        only_bars = all(block.shape in BARS for block in last_blocks)
        forces_need_own_column = only_bars or roles == ("reference",)
        next_column += last_depth + 1
    for block in graph.blocks.values():
        if _is_output(graph, block):
            columns[block.key] = next_column
    # Number the columns without gaps.
    used_columns = sorted(set(columns.values()))
    return {key: used_columns.index(column) for key, column in columns.items()}


def _is_output(graph: BlockGraph, block: DrawnBlock) -> bool:
    """Whether a block only shows something: an output of the station, a monitor, or a sensor that feeds no block."""
    return block.role == "sensor" and not graph.targets(block.key)


def _depths(graph: BlockGraph, keys: list[str]) -> dict[str, int]:
    """Count, for each of some blocks, the largest number of blocks on a chain of arrows that leads to it.

    Arrows that lead back, or that close a loop, are ignored.

    Args:
        graph: the graph.
        keys: keys of the blocks. Arrows from and to other blocks are ignored.

    Returns:
        the counts by key. A block that no other block of these feeds has 0.
    """
    successors: dict[str, list[str]] = {}
    # In the order of depth-first search: each block comes after all of its successors.
    finished: list[str] = []

    def visit(key: str, path: tuple[str, ...]) -> None:
        """Search from a block in depth, and append the blocks that are found to ``finished``.

        Args:
            key: key of the block.
            path: keys of the blocks from the first one of the search to this one.
        """
        forward = _forward_targets(graph, key)
        successors[key] = [target for target in forward if target in keys and target not in path]
        for target in successors[key]:
            if target not in successors:
                # The path finds loops: an arrow to a block that is already on it is ignored.
                visit(target, (*path, target))
        finished.append(key)

    for key in keys:
        if key not in successors:
            visit(key, (key,))

    # In the opposite order each block comes after all that feed it, so that its own depth is final.
    depths = dict.fromkeys(keys, 0)
    for key in reversed(finished):
        for target in successors[key]:
            depths[target] = max(depths[target], depths[key] + 1)
    return depths


def _forward_targets(graph: BlockGraph, key: str) -> list[str]:
    """Targets of a block. Where two blocks exchange signals, only the arrow in the direction of the signal flow counts.

    Args:
        graph: the graph.
        key: key of the block.
    """
    targets = []
    for target in graph.targets(key):
        is_exchange = Ends(target, key) in graph.arrows
        if not is_exchange or graph.is_forward(key, target):
            targets.append(target)
    return targets
