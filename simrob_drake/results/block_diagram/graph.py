"""The blocks and arrows of a block picture, and how signals go through it: as nets that branch, column to column."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import get_args

from simrob_drake.parts.captions import BlockRole, Shape

ROLES: tuple[BlockRole, ...] = get_args(BlockRole)  # in the order of the signal flow

BARS: tuple[Shape, ...] = ("mux", "bus")

FOLDED = "folded "  # what the key of a block begins with that stands for several: that of one of them follows


@dataclass
class DrawnBlock:
    """A block of the picture."""

    key: str  # its identifier in the graph
    role: BlockRole  # what it is for, which makes its colour and column
    robot: str  # whose it is; empty for what the robots share
    label: str = ""  # its lines
    shape: Shape = "block"  # block, one of the thin bars, port of the station, or sum
    systems: list[str] = field(default_factory=list)  # names of the systems of the Diagram that it stands for
    inside: tuple[str, ...] = ()  # what happens in it, one after the other
    within: str = ""  # the block whose system does its work

    @property
    def text(self) -> str:
        """All its lines."""
        return "\n".join([self.label, *(f"↓ {part}" for part in self.inside)])


@dataclass(frozen=True)
class Arrow:
    """An arrow as it is drawn: with the names of its signals, and with two heads where blocks exchange signals."""

    source: str
    target: str
    text: str
    both: bool = False


@dataclass
class BlockGraph:
    """A picture's blocks by key, and its arrows: (source, target) to the signals that they carry."""

    title: str
    description: str = ""
    robots: list[str] = field(default_factory=list)
    blocks: dict[str, DrawnBlock] = field(default_factory=dict)
    arrows: dict[tuple[str, str], list[str]] = field(default_factory=dict)

    def connect(self, source: str, target: str, signals: Iterable[str]) -> None:
        """Add an arrow, or signals to an arrow; what a block tells itself is not drawn."""
        if source != target:
            carried = self.arrows.setdefault((source, target), [])
            carried += [signal for signal in dict.fromkeys(signals) if signal not in carried]

    def sources(self, key: str) -> list[str]:
        """Return the blocks that a block has arrows from."""
        return [source for source, target in self.arrows if target == key]

    def targets(self, key: str) -> list[str]:
        """Return the blocks that a block has arrows to."""
        return [target for source, target in self.arrows if source == key]

    def forward(self, source: str, target: str) -> bool:
        """Tell whether an arrow goes with the signal flow, not back as a measurement does."""
        before, after = (ROLES.index(self.blocks[key].role) for key in (source, target))
        if before == after and (target, source) in self.arrows and (source, target) in self.arrows:
            return list(self.blocks).index(source) < list(self.blocks).index(target)
        return before <= after

    def drawn_arrows(self) -> list[Arrow]:
        """Return the arrows to draw: one for two blocks that exchange signals; ports bear their names themselves."""
        drawn = []
        for (source, target), signals in self.arrows.items():
            back = self.arrows.get((target, source))
            if back is None:
                drawn.append(Arrow(source, target, "" if self.blocks[target].shape == "port" else ", ".join(signals)))
            elif self.forward(source, target):
                text = " / ".join(filter(None, (", ".join(signals), ", ".join(back))))
                drawn.append(Arrow(source, target, text, both=True))
        return drawn

    def dissolve_bars(self) -> None:
        """Take out bars that do not gather, or hand out, what is alike; the others get the role of their ends."""
        for key in [key for key, block in self.blocks.items() if block.shape in BARS]:
            bar, sources, targets = self.blocks[key], self.sources(key), self.targets(key)
            many = sources if bar.shape == "mux" else targets
            roles = {self.blocks[end].role for end in many}
            if len(many) > 1 and len(roles) == 1:
                bar.role = roles.pop()
                continue
            for source in sources:
                for target in targets:
                    self.connect(source, target, self.arrows[key, target] or self.arrows[source, key])
            self.arrows = {ends: signals for ends, signals in self.arrows.items() if key not in ends}
            del self.blocks[key]

    def folded(self) -> "BlockGraph":
        """Return it with those outputs of a robot that come from the same blocks as one block."""
        groups: dict[tuple[str, tuple[str, ...]], list[str]] = {}
        for key, block in self.blocks.items():
            if block.role == "sensor" and block.shape == "port":
                groups.setdefault((block.robot, tuple(self.sources(key))), []).append(key)
        first = {key: keys[0] for keys in groups.values() for key in keys}
        graph = BlockGraph(self.title, self.description, self.robots)
        graph.blocks = {key: replace(block) for key, block in self.blocks.items() if first.get(key, key) == key}
        for keys in groups.values():
            graph.blocks[keys[0]].label = "\n".join(self.blocks[key].label for key in keys)
        for (source, target), signals in self.arrows.items():
            graph.connect(source, first.get(target, target), signals)
        return graph

    def around(self, key: str) -> "BlockGraph":
        """Return a block alone with those that it has arrows from and to, without the ports of the station."""
        graph, ends = BlockGraph(self.title), {key, *self.sources(key), *self.targets(key)}
        near = {name: block for name, block in self.blocks.items() if name in ends and block.shape != "port"}
        graph.blocks = {name: replace(block, within="") for name, block in near.items()}
        graph.arrows = {pair: signals for pair, signals in self.arrows.items() if key in pair and {*pair} <= {*near}}
        return graph

    def with_folded(self, names: Iterable[str], titles: Mapping[BlockRole, str]) -> "BlockGraph":
        """Return it with each subsystem as one block of which one of these blocks is a part.

        The blocks of a robot that have the same role are a subsystem, without the ports of the station; ``titles`` are
        what these are called.
        """
        parts: dict[tuple[str, BlockRole], list[str]] = defaultdict(list)
        for key, block in self.blocks.items():
            if block.shape != "port":
                parts[block.robot, block.role].append(key)
        new, chosen = {key: key for key in self.blocks}, list(names)
        for keys in parts.values():
            if len(keys) > 1 and (named := [key for key in chosen if key in keys]):
                new |= dict.fromkeys(keys, f"{FOLDED}{named[0]}")
        graph = BlockGraph(self.title, self.description, self.robots)
        for key, block in self.blocks.items():
            if new[key] == key:
                graph.blocks[key] = replace(block, within=new.get(block.within, ""))
                continue
            label = f"{titles[block.role]} ({list(new.values()).count(new[key])})"
            graph.blocks.setdefault(new[key], DrawnBlock(new[key], block.role, block.robot, label))
            graph.blocks[new[key]].systems += block.systems
        for (source, target), signals in self.arrows.items():
            graph.connect(new[source], new[target], signals)
        return graph


_COLUMNS: tuple[tuple[BlockRole, ...], ...] = (
    ("reference",),
    ("loop", "own"),
    ("servo",),
    ("force",),
    ("robot",),
    ("sensor", "scene"),
)


@dataclass
class Net:
    """A signal on its way from a block to all that read it: drawn as one line that branches."""

    source: str
    text: str
    both: bool
    targets: list[str] = field(default_factory=list)


def nets_of(graph: BlockGraph) -> list[Net]:
    """Return the signals: arrows of one name from one block are one net, also those to the station's outputs."""
    nets: dict[tuple[str, str, str], Net] = {}
    outputs: dict[tuple[str, str], list[str]] = defaultdict(list)
    for arrow in graph.drawn_arrows():
        source, target = graph.blocks[arrow.source], graph.blocks[arrow.target]
        if target.shape == "port":
            outputs[source.key, target.robot].append(target.key)
            continue
        joint = target.key.rpartition(".")[0] if source.shape == "bus" else ""
        key = source.key, arrow.text, target.key if arrow.both else joint
        nets.setdefault(key, Net(source.key, arrow.text, arrow.both)).targets.append(target.key)
    for (source_key, robot), targets in outputs.items():
        known = [net for (key, text, only), net in nets.items() if key == source_key and not only]
        text = ", ".join(dict.fromkeys(signal for key in targets for signal in graph.arrows[source_key, key]))
        whole = next((net for net in known if net.text == text), None)
        if whole is None:
            whole = nets.setdefault((source_key, text, f" {robot}"), Net(source_key, text, both=False))
        whole.targets += targets
    return list(nets.values())


def columns_of(graph: BlockGraph) -> dict[str, int]:
    """Return the column of each block: the roles in the order of the signal flow, what only shows at the end."""
    found: dict[str, int] = {}
    after, bars_end = 0, True
    for roles in _COLUMNS:
        blocks = [block for block in graph.blocks.values() if block.role in roles and not _is_output(graph, block)]
        depths = _depths(graph, [block.key for block in blocks])
        if roles == ("force",) and blocks and not bars_end:
            after -= 1  # below the servos
        found |= {key: after + depth for key, depth in depths.items()}
        if blocks:
            last = max(depths.values())
            bars_end = roles == ("reference",) or all(
                graph.blocks[k].shape in BARS for k in depths if depths[k] == last
            )
            after += last + 1
    found |= {block.key: after for block in graph.blocks.values() if _is_output(graph, block)}
    order = sorted(set(found.values()))
    return {key: order.index(column) for key, column in found.items()}


def _is_output(graph: BlockGraph, block: DrawnBlock) -> bool:
    """Tell whether a block is a port of an output, or feeds nothing, as a monitor."""
    return block.role == "sensor" and not graph.targets(block.key)


def _depths(graph: BlockGraph, keys: list[str]) -> dict[str, int]:
    """Return how many blocks of these come before each, at most; what leads back in a circle does not count."""
    done: list[str] = []  # each after what it leads to
    forward: dict[str, list[str]] = {}

    def visit(key: str, path: tuple[str, ...]) -> None:
        ahead = [
            target for target in graph.targets(key) if (target, key) not in graph.arrows or graph.forward(key, target)
        ]
        forward[key] = [target for target in ahead if target in keys and target not in path]
        for target in forward[key]:
            if target not in forward:
                visit(target, (*path, target))
        done.append(key)

    for key in keys:
        if key not in forward:
            visit(key, (key,))
    depths = dict.fromkeys(keys, 0)
    for key in reversed(done):
        for target in forward[key]:
            depths[target] = max(depths[target], depths[key] + 1)
    return depths
