"""The blocks and arrows of a block picture."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import get_args

from simrob_drake.parts.captions import BlockRole, Shape

ROLES: tuple[BlockRole, ...] = get_args(BlockRole)
"""In the order of the signal flow."""

BARS: tuple[Shape, ...] = ("mux", "bus")


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
