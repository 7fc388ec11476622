"""The blocks and arrows of a block picture, and what makes them easy to read: bus bars only where signals branch."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, get_args

from simrob_drake.parts.captions import BlockRole

ROLES: tuple[BlockRole, ...] = get_args(BlockRole)
"""In the order of the signal flow."""

Shape = Literal["block", "mux", "bus", "port", "sum"]
"""Of them two are thin bars: a mux brings signals together, a bus hands them out."""

BARS: tuple[Shape, ...] = ("mux", "bus")

_FAN = 3
"""From how many arrows of one block into one cluster on they branch from a bus bar."""


@dataclass
class DrawnBlock:
    """A block of the picture."""

    key: str  # its identifier in the graph
    role: BlockRole  # what it is for, which makes its colour and cluster
    robot: str  # whose it is; empty for what the robots share
    label: str = ""  # its lines
    shape: Shape = "block"  # block, one of the thin bars, port of the station, or sum
    systems: list[str] = field(default_factory=list)  # names of the systems of the Diagram that it stands for


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
        """Return the arrows to draw: one for two blocks that exchange signals, and no name told twice."""
        drawn = []
        for (source, target), signals in self.arrows.items():
            back = self.arrows.get((target, source))
            if back is None:
                drawn.append(Arrow(source, target, "" if self._labelled(source, target) else ", ".join(signals)))
            elif self.forward(source, target):
                text = " / ".join(filter(None, (", ".join(signals), ", ".join(back))))
                drawn.append(Arrow(source, target, text, both=True))
        return drawn

    def _labelled(self, source: str, target: str) -> bool:
        """Tell whether an arrow to a port of the station carries what another arrow of its source names already."""
        others = [self.arrows[source, other] for other in self.targets(source) if other != target]
        return self.blocks[target].shape == "port" and self.arrows[source, target] in others

    def tidy(self) -> None:
        """Draw bus bars where signals branch or come together, and nowhere else."""
        for key in [key for key, block in self.blocks.items() if block.shape in BARS]:
            self._settle_bar(key)
        for key in [key for key, block in self.blocks.items() if block.shape not in BARS]:
            self._branch(key)

    def _settle_bar(self, key: str) -> None:
        """Give a bar the role of its many ends; dissolve it where it has one source, or one target, in its way."""
        bar, sources, targets = self.blocks[key], self.sources(key), self.targets(key)
        many = sources if bar.shape == "mux" else targets
        if len(many) > 1:
            bar.role = self.blocks[many[0]].role
            return
        for source in sources:
            for target in targets:
                self.connect(source, target, self.arrows[key, target] or self.arrows[source, key])
        self.arrows = {ends: signals for ends, signals in self.arrows.items() if key not in ends}
        del self.blocks[key]

    def _branch(self, key: str) -> None:
        """Let the arrows of a block into another cluster, if they are many, branch from a bar there."""
        clusters: dict[tuple[BlockRole, str], list[str]] = {}
        for target in self.targets(key):
            clusters.setdefault((self.blocks[target].role, self.blocks[target].robot), []).append(target)
        for (role, robot), targets in clusters.items():
            if len(targets) < _FAN or not self.forward(key, targets[0]) or role == self.blocks[key].role:
                continue
            bar = f"{key} to {robot} {role}"
            self.blocks[bar] = DrawnBlock(bar, role, robot, shape="bus")
            carried = {target: self.arrows.pop((key, target)) for target in targets}
            self.connect(key, bar, (signal for signals in carried.values() for signal in signals))
            for target in sorted(targets, key=lambda target: self.blocks[target].shape != "port"):
                whole = set(carried[target]) == set(self.arrows[key, bar])
                self.connect(bar, target, [] if whole else carried[target])
