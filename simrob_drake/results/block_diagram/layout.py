"""Where the blocks of a picture stand: in columns along the signal flow, each level with what it is connected to."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import fsum
from statistics import fmean

import numpy as np

from simrob_drake.results.block_diagram.graph import BARS, BlockGraph, DrawnBlock, columns_of, nets_of

LINE, ROW, CELL = 13.0, 14.0, 8.0
"""Heights of a line of text, of a port in its bar, and what a cell of a block has beside its text [px]."""
PITCH = 16.0  # from one arrow at a block to the next [px]

_GAP, _MARGIN, _BAR, _ROUNDS = 14.0, 7.0, 5.0, 13
_NARROW, _WIDE = " ijl.,:;'|()[]/!frt⋮-", "mwMW@±√ΣΔ%"


def text_width(text: str, size: float = 11.0) -> float:
    """Return how wide a line is in the widest of the usual fonts [px]."""
    units = (0.38 if c in _NARROW else 0.96 if c in _WIDE else 0.74 if c.isupper() else 0.62 for c in text)
    return size * fsum(units)


@dataclass
class Placed:
    """A block, or the bar of a robot's ports, in its place; y is that of its middle [px]."""

    blocks: list[DrawnBlock]
    lines: list[str]
    column: int
    width: float
    height: float
    y: float = 0.0
    x: float = 0.0
    entry: float = 0.0  # where nets come in and go out on the whole, from the middle [px]
    leave: float = 0.0
    left: dict[int, float] = field(default_factory=dict)  # where nets come in, from the middle, by their numbers [px]
    right: dict[int, float] = field(default_factory=dict)  # where they go out

    @property
    def bar(self) -> bool:
        """Whether it is a thin bar."""
        return self.blocks[0].shape in BARS

    @property
    def force(self) -> bool:
        """Whether it acts on the plant beside the motors."""
        return self.blocks[0].role == "force"

    @property
    def ports(self) -> bool:
        """Whether it is a bar of the station's outputs."""
        return self.blocks[0].role == "sensor" and self.blocks[0].shape == "port"

    def row(self, key: str) -> float:
        """Return where a port stands, from the middle [px]."""
        place = next(number for number, block in enumerate(self.blocks) if block.key == key)
        return (place + 0.5) * ROW + self.height / 2 - len(self.blocks) * ROW


class Layout:
    """The places of a graph's blocks, and its nets."""

    def __init__(self, graph: BlockGraph) -> None:
        self._several = len(graph.robots) > 1
        self._robots = ["", *graph.robots]
        self.nets = nets_of(graph)  # all signals
        numbers = columns_of(graph)
        self.places: dict[str, Placed] = {}  # the thing that a block is drawn in, by its key
        self.columns: list[list[Placed]] = [[] for _ in range(max(numbers.values()) + 1)]  # from top to bottom
        for things in self._things(graph):
            placed = self._placed(things, numbers[things[0].key])
            self.columns[placed.column].append(placed)
            self.places |= {block.key: placed for block in things}
        for column in self.columns:
            self._settle(column, lambda placed: 0.0)
        for turn in range(_ROUNDS):
            self._set_ports()
            ahead = turn % 2 == 0
            for column in self.columns if ahead else reversed(self.columns):
                self._align(column, ahead, order=turn < _ROUNDS // 2)
        self._set_ports()
        self._straighten()

    def _things(self, graph: BlockGraph) -> list[list[DrawnBlock]]:
        """Return the blocks, the ports of a robot's outputs together in the order of their nets."""
        bars: dict[str, list[DrawnBlock]] = defaultdict(list)
        ports = (target for net in self.nets for target in net.targets if graph.blocks[target].shape == "port")
        for key in dict.fromkeys(ports):
            bars[graph.blocks[key].robot].append(graph.blocks[key])
        held = {block.key for bar in bars.values() for block in bar}
        alone = [[block] for block in graph.blocks.values() if block.key not in held]
        things = [*(bars[robot] for robot in self._robots if robot in bars), *alone]
        return sorted(things, key=lambda thing: (self._robots.index(thing[0].robot), thing[0].role == "force"))

    def _placed(self, things: list[DrawnBlock], column: int) -> Placed:
        block = things[0]
        if block.shape in BARS:
            return Placed(things, [], column, _BAR, PITCH)
        whose = [block.robot] if self._several and block.robot else []
        if block.role == "sensor" and block.shape == "port":
            width = max(text_width(text, 10) for text in [*whose, *(port.label for port in things)])
            return Placed(things, whose, column, width + 2 * _MARGIN, ROW * (len(things) + len(whose)))
        lines = [*whose, *block.label.split("\n")]
        if block.shape == "sum":
            return Placed(things, lines[-1:], column, 22.0, 22.0)
        cells = [cell.split("\n") for cell in block.inside]
        width = max(text_width(line) for line in [*lines, *(line for cell in cells for line in cell)])
        height = LINE * len(lines) + CELL + fsum(LINE * len(cell) + 2.5 * CELL for cell in cells)
        ends = max(sum(block.key in net.targets for net in self.nets), sum(n.source == block.key for n in self.nets))
        placed = Placed(things, lines, column, width + (4 if cells else 2) * _MARGIN, max(height, PITCH * ends))
        if cells and not block.within:  # into the first cell, and out of the last
            first, last = (LINE * len(cell) + CELL for cell in (cells[0], cells[-1]))
            placed.entry = -height / 2 + LINE * len(lines) + CELL + first / 2
            placed.leave = height / 2 - CELL - last / 2
        return placed

    def _ends(self, placed: Placed) -> Iterable[tuple[int, Placed, bool]]:
        """Yield each net of a place by its number, with what is at its other end, and whether it comes in."""
        keys = {block.key for block in placed.blocks}
        for number, net in enumerate(self.nets):
            if net.source in keys:
                yield from ((number, self.places[target], False) for target in net.targets)
            if keys.intersection(net.targets):
                yield number, self.places[net.source], True

    def _set_ports(self) -> None:
        """Say where nets meet what is placed: in the order of where they come from, those of far above first."""
        for placed in self.places.values():
            if placed.ports:
                self._sort_rows(placed)
            for incoming, side in ((True, placed.left), (False, placed.right)):
                heights: dict[int, list[float]] = defaultdict(list)
                for number, other, comes_in in self._ends(placed):
                    if comes_in == incoming:
                        step = other.column - placed.column
                        near = step == (-1 if incoming else 1)
                        far = 1e4 if (step >= 0 if incoming else step <= 0) else -1e4
                        heights[number].append(other.y if near else far)
                means = {number: fmean(values) for number, values in heights.items()}
                order = sorted(means, key=lambda number: (means[number], number))
                side.clear()
                middle = (len(order) - 1) / 2 - (placed.entry if incoming else placed.leave) / PITCH
                side.update({each: (place - middle) * PITCH for place, each in enumerate(order)})
                if placed.ports:
                    side.update({number: fmean(self.rows(number, placed)) for number in order})

    def _sort_rows(self, bar: Placed) -> None:
        """Put the ports of a bar in the order in which their nets come: those from far away over what is between."""

        def rank(block: DrawnBlock) -> tuple[int, float, int]:
            number = next(number for number, net in enumerate(self.nets) if block.key in net.targets)
            source = self.places[self.nets[number].source]
            return source.column, source.y, number

        bar.blocks.sort(key=rank)

    def rows(self, number: int, bar: Placed) -> tuple[float, float]:
        """Return the middles of the first and the last port of a bar that a net comes to, from the bar's middle."""
        rows = [bar.row(block.key) for block in bar.blocks if block.key in self.nets[number].targets]
        return rows[0], rows[-1]

    def _align(self, column: list[Placed], ahead: bool, *, order: bool) -> None:
        """Place a column level with what it is connected to: on its left where one goes ahead, else on its right."""

        def desired(placed: Placed) -> float:
            if placed.bar:
                return placed.y
            sides: dict[bool, list[float]] = {True: [], False: []}
            far = []
            for number, other, comes_in in self._ends(placed):
                there, here = (other.right, placed.left) if comes_in else (other.left, placed.right)
                if placed.ports or not self._next(placed, other):
                    far.append(other.y)
                elif not other.ports and not other.force:
                    below = placed.height / 2 + 2 * PITCH if placed.force else 0.0  # of the way of the torques
                    sides[comes_in == ahead].append(other.y + there[number] - here[number] + below)
            found = sides[True] or sides[False] or far
            return fmean(found) if found else placed.y

        if order:
            column.sort(key=lambda placed: (placed.force, round(desired(placed), 3)))
        for placed in column:
            if placed.bar:
                self._stretch(placed)
        self._settle(column, desired)

    def _next(self, one: Placed, other: Placed) -> bool:
        """Tell whether nothing but forces stands in the columns between two things."""
        first, last = sorted((one.column, other.column))
        return first < last and all(placed.force for column in self.columns[first + 1 : last] for placed in column)

    def _stretch(self, bar: Placed) -> None:
        """Let a bar be as high as what it is connected to."""
        many = [other for _, other, comes_in in self._ends(bar) if comes_in == (bar.blocks[0].shape == "mux")]
        ends = [other for other in many if abs(other.column - bar.column) == 1]
        if ends:
            top, bottom = min(end.y for end in ends), max(end.y for end in ends)
            bar.y, bar.height = (top + bottom) / 2, bottom - top + 2 * PITCH

    def _settle(self, column: Sequence[Placed], desired: Callable[[Placed], float]) -> None:
        """Place what stands in a column where it is desired to be, as far as it has room, in its order."""
        from scipy.optimize import isotonic_regression  # loaded where it is needed

        above = np.cumsum([0.0, *(placed.height + _GAP for placed in column[:-1])])  # what stands over each, packed
        tops = np.array([desired(placed) - placed.height / 2 for placed in column])
        for placed, top in zip(column, isotonic_regression(tops - above).x + above, strict=True):
            placed.y = float(top) + placed.height / 2

    def _straighten(self) -> None:
        """Move the ends of arrows so that these are straight where the sides that they lead to allow it."""
        for bar in filter(lambda placed: placed.bar, self.places.values()):
            for number, other, comes_in in self._ends(bar):
                side, there = (bar.left, other.right) if comes_in else (bar.right, other.left)
                if comes_in == (bar.blocks[0].shape == "mux") and abs(other.column - bar.column) == 1:
                    side[number] = other.y + there[number] - bar.y
        for net_number, net in enumerate(self.nets):
            source, ends = self.places[net.source], {id(self.places[t]): self.places[t] for t in net.targets}
            near = [end for end in ends.values() if end.column == source.column + 1]
            for end in near[:1] if len(near) == 1 or not source.bar else near:
                level = end.y + end.left[net_number]
                if end.ports or source.bar or len(end.left) > 1 or len(source.right) == 1:
                    _move(source, source.right, net_number, level - source.y)
                start = source.y + source.right[net_number]
                if not end.ports:
                    _move(end, end.left, net_number, start - end.y)


def _move(placed: Placed, side: dict[int, float], number: int, offset: float) -> None:
    """Move where a net meets a side to an offset from its middle, if nothing is there, and in the same order."""
    reach = placed.height / 2 - (2 if placed.bar else 6)
    others = [value for other, value in side.items() if other != number]
    order = all((value < side[number]) == (value < offset) for value in others)
    if abs(offset) <= reach and order and all(abs(value - offset) >= PITCH - 6 for value in others):
        side[number] = offset
