"""Sizes and positions of the blocks of a picture: in columns along the signal flow.

The picture consists of *boxes*. A box is a block, or the list of all output ports of a robot (a *port* is an output of
the station, or an input that nothing feeds). A *bar* is a thin, high block: a mux joins signals, and a bus distributes
them. A *sum* is a small circle. The *steps* of a block's computation are drawn as boxes inside it.

Boxes are in columns; within its column, a box is as close as possible to the heights of the boxes that it is connected
to, so that most arrows are straight. Each net (a signal that one block sends to others) meets the left side of the
boxes that read it, its *inlets*, and the right side of its source, its *outlet*.

Positions are in pixels, x to the right and y down. Heights of inlets and outlets are measured from the middle of their
box. :mod:`simrob_drake.results.block_diagram.routing` sets x afterwards, from the count of lines that pass between
the columns.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import fsum
from statistics import fmean
from typing import NamedTuple

import numpy as np

from simrob_drake.results.block_diagram.graph import (
    BARS,
    BlockGraph,
    DrawnBlock,
    columns_of,
    nets_of,
)

LINE = 13.0
"""Height of a line of text [px]."""

ROW = 14.0
"""Height of a port in the list of a robot's ports [px]."""

CELL = 8.0
"""Height of a step's box inside a block, without its lines of text [px]."""

PITCH = 16.0
"""Distance of the ends of neighbouring nets at a box [px]."""

_GAP = 14.0
"""Least distance of two boxes of a column [px]."""

_MARGIN = 7.0
"""Width between a block's text and its edge [px]."""

_BAR_WIDTH = 5.0
"""Width of a bar that joins or distributes signals [px]."""

_SUM_SIZE = 22.0
"""Width and height of a sum [px]."""

_ROUNDS = 13
"""Rounds of alignment, alternately from left to right and back."""

_FAR_BELOW = 1e4
_FAR_ABOVE = -1e4
"""Heights beyond all boxes [px], for nets that pass below or above other columns."""

_NARROW = " ijl.,:;'|()[]/!frt⋮-"
_WIDE = "mwMW@±√ΣΔ%"
"""Characters that are much narrower or wider than others."""


def text_width(text: str, size: float = 11.0) -> float:
    """Estimated width of a line of text [px]. It is enough for the widest of the fonts that browsers use.

    Args:
        text: the line.
        size: size of the font [px].
    """
    return size * fsum(_relative_width(character) for character in text)


def _relative_width(character: str) -> float:
    """Estimated width of a character, as a part of the size of the font."""
    if character in _NARROW:
        return 0.38
    if character in _WIDE:
        return 0.96
    return 0.74 if character.isupper() else 0.62


@dataclass(eq=False)
class Box:
    """A rectangle of the picture: a block, or the list of a robot's output ports.

    Attributes:
        blocks: the block; in a list of ports all of them, from top to bottom.
        lines: lines of text. Ports have their own labels: the list only has the name of its robot.
        column: index of the column, from 0 at the left.
        width: width [px].
        height: height [px].
        y: height of the middle in the picture, positive downwards [px].
        x: left edge in the picture [px].
        entry_height: height of the centre of all inlets, from the middle [px].
        exit_height: height of the centre of all outlets, from the middle [px].
        inlets: height of the end of each net that enters at the left, from the middle, by the index of the net [px].
        outlets: height of the end of each net that leaves at the right, from the middle, by the index of the net [px].
    """

    blocks: list[DrawnBlock]
    lines: list[str]
    column: int
    width: float
    height: float
    y: float = 0.0
    x: float = 0.0
    entry_height: float = 0.0
    exit_height: float = 0.0
    inlets: dict[int, float] = field(default_factory=dict)
    outlets: dict[int, float] = field(default_factory=dict)

    @property
    def is_bar(self) -> bool:
        """Whether the box is a thin bar that joins or distributes signals."""
        return self.blocks[0].shape in BARS

    @property
    def is_force(self) -> bool:
        """Whether the box is a force that acts on the plant in addition to the motors."""
        return self.blocks[0].role == "force"

    @property
    def is_port_list(self) -> bool:
        """Whether the box is the list of a robot's output ports."""
        return _is_output_port(self.blocks[0])

    def port_offset(self, key: str) -> float:
        """Height of the middle of a port in the list of ports, from the middle of the list [px]."""
        keys = [block.key for block in self.blocks]
        # The rows of the ports end at the bottom of the box: the name of the robot may be above them.
        return (keys.index(key) + 0.5) * ROW + self.height / 2 - len(self.blocks) * ROW


class PortRange(NamedTuple):
    """Heights of the first and the last port of a list to which a net leads, from the middle of the list [px]."""

    first: float
    last: float


class _Connection(NamedTuple):
    """One end of a net, seen from a box.

    Attributes:
        net: index of the net.
        other: box at the other end.
        is_incoming: whether the net enters the box. Otherwise it leaves the box.
    """

    net: int
    other: Box
    is_incoming: bool

    @property
    def other_end(self) -> float:
        """Height of the net at the other box, in the picture [px]."""
        ends = self.other.outlets if self.is_incoming else self.other.inlets
        return self.other.y + ends[self.net]


class Layout:
    """Boxes of a graph's blocks with their heights, and its nets.

    Attributes:
        nets: all nets. Their indices in this list identify them.
        boxes: box in which each block is drawn, by the block's key.
        columns: boxes of each column, from left to right and from top to bottom.
    """

    def __init__(self, graph: BlockGraph) -> None:
        """Place the blocks of a graph."""
        self.nets = nets_of(graph)  # first, since the size of a box depends on its nets
        self._robots = ["", *graph.robots]  # the blocks that all robots share come first
        self._has_several_robots = len(graph.robots) > 1
        self.boxes: dict[str, Box] = {}
        column_of_block = columns_of(graph)
        self.columns: list[list[Box]] = [[] for _ in range(max(column_of_block.values()) + 1)]
        for blocks in self._blocks_of_boxes(graph):
            box = self._make_box(blocks, column_of_block[blocks[0].key])
            self.columns[box.column].append(box)
            for block in blocks:
                self.boxes[block.key] = box
        self._align_all()

    def _blocks_of_boxes(self, graph: BlockGraph) -> list[list[DrawnBlock]]:
        """Group the blocks that share a box: output ports by robot, in the order of their nets; others are alone.

        The groups are ordered by robots, with the blocks that all robots share first. Forces are the last of their
        robot, because they are drawn below the servos.
        """
        port_lists: dict[str, list[DrawnBlock]] = defaultdict(list)
        targets = [target for net in self.nets for target in net.targets]
        for key in dict.fromkeys(targets):
            block = graph.blocks[key]
            if block.shape == "port":
                port_lists[block.robot].append(block)
        listed_keys = {block.key for ports in port_lists.values() for block in ports}
        groups = [port_lists[robot] for robot in self._robots if robot in port_lists]
        groups += [[block] for block in graph.blocks.values() if block.key not in listed_keys]

        def rank(group: list[DrawnBlock]) -> tuple[int, bool]:
            """Sort key of a group: the robot, then whether it is a force. False comes before True."""
            first = group[0]
            return self._robots.index(first.robot), first.role == "force"

        return sorted(groups, key=rank)

    def _make_box(self, blocks: list[DrawnBlock], column: int) -> Box:
        """Make the box of a block, or of several ports, with the size that their text needs.

        Args:
            blocks: one block, or the output ports of a robot.
            column: index of the column of the box.
        """
        block = blocks[0]
        if block.shape in BARS:
            # The height is provisional: a bar is stretched along the boxes that it joins.
            return Box(blocks, [], column, _BAR_WIDTH, PITCH)
        robot_lines = [block.robot] if self._has_several_robots and block.robot else []
        if _is_output_port(block):
            texts = [*robot_lines, *(port.label for port in blocks)]
            width = max(text_width(text, 10) for text in texts)
            return Box(blocks, robot_lines, column, width + 2 * _MARGIN, ROW * len(texts))
        lines = [*robot_lines, *block.label.split("\n")]
        if block.shape == "sum":
            # A sum only shows its sign: the circle has no room for the name of the robot.
            return Box(blocks, lines[-1:], column, _SUM_SIZE, _SUM_SIZE)
        return self._make_block_box(block, lines, column)

    def _make_block_box(self, block: DrawnBlock, lines: list[str], column: int) -> Box:
        """Make the box of a block with text, and with the steps of its computation as boxes below the text.

        Args:
            block: the block.
            lines: lines of its text.
            column: index of the column of the box.
        """
        steps = [step.split("\n") for step in block.inside]
        lines_of_steps = [line for step in steps for line in step]
        width = max(text_width(line) for line in [*lines, *lines_of_steps])
        # A step's own box is higher than its lines by CELL, and the arrow to it has 1.5 CELL.
        height = LINE * len(lines) + CELL + fsum(LINE * len(step) + 2.5 * CELL for step in steps)
        incoming_count = sum(block.key in net.targets for net in self.nets)
        outgoing_count = sum(net.source == block.key for net in self.nets)
        # Each net needs its own end at the side of the box.
        height_of_ends = PITCH * max(incoming_count, outgoing_count)
        # Boxes inside the block need a margin of their own.
        margin_count = 4 if steps else 2
        box = Box(
            [block], lines, column, width + margin_count * _MARGIN, max(height, height_of_ends)
        )
        if steps and not block.within:
            # The signals enter the first step, and leave from the last one.
            first_height = LINE * len(steps[0]) + CELL
            last_height = LINE * len(steps[-1]) + CELL
            box.entry_height = -height / 2 + LINE * len(lines) + CELL + first_height / 2
            box.exit_height = height / 2 - CELL - last_height / 2
        return box

    def _align_all(self) -> None:
        """Set where all boxes are vertically (`y`), and the heights at which all nets begin and end.

        Each column is aligned to the column before it, alternately from left to right and back. During the first half
        of the rounds the boxes of a column may also change their order.
        """
        for column in self.columns:
            self._stack(column, lambda box: 0.0)  # all columns begin around the height 0
        for number in range(_ROUNDS):
            self._order_ends()
            to_the_right = number % 2 == 0
            # Later rounds keep the order, so that the heights settle.
            may_reorder = number < _ROUNDS // 2
            for column in self.columns if to_the_right else reversed(self.columns):
                self._align(column, to_the_right, may_reorder=may_reorder)
        # The last round has moved boxes, and so the heights from which nets come.
        self._order_ends()
        self._straighten_at_bars()
        self._straighten_nets()

    def _connections(self, box: Box) -> Iterator[_Connection]:
        """Yield the connections of a box: an outgoing one for each target of a net, an incoming one for each net."""
        keys = {block.key for block in box.blocks}
        for index, net in enumerate(self.nets):
            if net.source in keys:
                for target in net.targets:
                    yield _Connection(index, self.boxes[target], is_incoming=False)
            if keys.intersection(net.targets):
                yield _Connection(index, self.boxes[net.source], is_incoming=True)

    def _order_ends(self) -> None:
        """Set the inlets and outlets of all boxes, in the order of the heights from which their nets come."""
        for box in self.boxes.values():
            if box.is_port_list:
                self._sort_ports(box)
            box.inlets = self._ordered_ends(box, incoming=True)
            box.outlets = self._ordered_ends(box, incoming=False)

    def _ordered_ends(self, box: Box, *, incoming: bool) -> dict[int, float]:
        """Heights of the ends of nets on one side of a box, from its middle, by the index of the net [px].

        Args:
            box: the box.
            incoming: whether the side is the left one, where nets enter. Otherwise it is the right one.
        """
        heights: dict[int, list[float]] = defaultdict(list)
        for connection in self._connections(box):
            if connection.is_incoming == incoming:
                heights[connection.net].append(_height_at_neighbour(box, connection))
        means = {net: fmean(values) for net, values in heights.items()}
        # Lines that come from above end above: then nets of the same column do not cross.
        order = sorted(means, key=lambda net: (means[net], net))
        if box.is_port_list:
            # The net ends in the middle of the ports to which it leads.
            return {net: fmean(self.port_range(net, box)) for net in order}
        # The ends are PITCH apart, and their centre is at the entry or exit of the box. The rank of an end counts from
        # the top; the (fractional) rank of the middle of the box has the height 0.
        centre = box.entry_height if incoming else box.exit_height
        middle_rank = (len(order) - 1) / 2 - centre / PITCH
        return {net: (rank - middle_rank) * PITCH for rank, net in enumerate(order)}

    def _sort_ports(self, port_list: Box) -> None:
        """Sort the ports of a list like their nets: nets from farther left are higher, since they pass above boxes."""

        def rank(port: DrawnBlock) -> tuple[int, float, int]:
            """Sort key of a port: column and height of its source, then the index of its net."""
            index = next(index for index, net in enumerate(self.nets) if port.key in net.targets)
            source = self.boxes[self.nets[index].source]
            return source.column, source.y, index

        port_list.blocks.sort(key=rank)

    def port_range(self, net: int, port_list: Box) -> PortRange:
        """Range of the ports of a list to which a net leads.

        Args:
            net: index of the net.
            port_list: the list. The net leads to at least one of its ports.
        """
        targets = self.nets[net].targets
        offsets = [
            port_list.port_offset(block.key) for block in port_list.blocks if block.key in targets
        ]
        return PortRange(first=offsets[0], last=offsets[-1])

    def _align(self, column: list[Box], to_the_right: bool, *, may_reorder: bool) -> None:
        """Move the boxes of a column to the heights of the boxes that they are connected to.

        Args:
            column: boxes of the column. Its order changes if ``may_reorder`` is set.
            to_the_right: whether the nets that enter the boxes decide their heights, as mostly those from the left;
                otherwise the nets that leave. See `_desired_height`.
            may_reorder: whether the boxes are sorted by the heights at which they should be; forces come last.
        """

        def desired_height(box: Box) -> float:
            """Height at which a box should be [px]."""
            return self._desired_height(box, to_the_right)

        if may_reorder:
            # Rounded, so that the order does not depend on errors of the arithmetic.
            column.sort(key=lambda box: (box.is_force, round(desired_height(box), 3)))
        for box in column:
            if box.is_bar:
                self._stretch(box)
        self._stack(column, desired_height)

    def _desired_height(self, box: Box, to_the_right: bool) -> float:
        """Height at which a box's nets to its neighbours would be straight on average, in the picture [px].

        Without such nets, and for a list of ports, it is the mean height of the boxes that the box is connected to. A
        box without any nets keeps its height.

        Args:
            box: the box. A bar keeps its height, because the boxes that it joins determine that.
            to_the_right: whether the columns are aligned to the right. The nets that enter the box then decide, or
                those that leave if none enters. For an alignment to the left, the nets that leave come first.
        """
        if box.is_bar:
            return box.y
        deciding: list[float] = []
        others: list[float] = []
        distant: list[float] = []
        for connection in self._connections(box):
            other = connection.other
            if box.is_port_list or not self._are_neighbours(box, other):
                # A list of ports is high: it is only placed in the middle of its sources.
                distant.append(other.y)
            elif not other.is_port_list and not other.is_force:
                # Ports and forces are aligned to this box. It is not aligned to them.
                own_ends = box.inlets if connection.is_incoming else box.outlets
                # A force stays below the line of the torques, which leads from the servos to the plant.
                below_torques = box.height / 2 + 2 * PITCH if box.is_force else 0.0
                height = connection.other_end - own_ends[connection.net] + below_torques
                if connection.is_incoming == to_the_right:
                    deciding.append(height)
                else:
                    others.append(height)
        heights = deciding or others or distant
        return fmean(heights) if heights else box.y

    def _are_neighbours(self, box: Box, other: Box) -> bool:
        """Whether two boxes are in different columns, and all columns between them have nothing but forces."""
        first, last = sorted((box.column, other.column))
        between = [placed for column in self.columns[first + 1 : last] for placed in column]
        return first < last and all(placed.is_force for placed in between)

    def _stretch(self, bar: Box) -> None:
        """Set height and position of a bar, so that it reaches along all boxes that it joins or distributes to."""
        heights = [connection.other.y for connection in self._many_sided(bar)]
        if heights:
            top = min(heights)
            bottom = max(heights)
            bar.y = (top + bottom) / 2
            # A pitch beyond the outermost boxes at both ends.
            bar.height = bottom - top + 2 * PITCH

    def _many_sided(self, bar: Box) -> list[_Connection]:
        """Connections of a bar to the boxes of the next column on the side where it has several nets.

        A mux has several nets at its left, which it joins; a bus has them at its right.
        """
        is_mux = bar.blocks[0].shape == "mux"
        return [
            connection
            for connection in self._connections(bar)
            if connection.is_incoming == is_mux and abs(connection.other.column - bar.column) == 1
        ]

    def _stack(self, column: Sequence[Box], desired_height: Callable[[Box], float]) -> None:
        """Place the boxes of a column in their order, each as close to its desired height as the others allow.

        Args:
            column: boxes from top to bottom.
            desired_height: function that computes the desired height of a box's middle [px].
        """
        from scipy.optimize import isotonic_regression  # slow to load, and only pictures need it

        # With the desired tops d_i, the heights h_i and the gap g, the tops t_i minimise sum (t_i - d_i)^2 subject to
        # t_(i+1) >= t_i + h_i + g. With the tops p_i of boxes without room between them, p_(i+1) = p_i + h_i + g,
        # this is an isotonic regression: t_i - p_i must not decrease.
        packed_tops = np.cumsum([0.0, *(box.height + _GAP for box in column[:-1])])
        desired_tops = np.array([desired_height(box) - box.height / 2 for box in column])
        tops = isotonic_regression(desired_tops - packed_tops).x + packed_tops
        for box, top in zip(column, tops, strict=True):
            box.y = float(top) + box.height / 2

    def _straighten_at_bars(self) -> None:
        """Move the ends of nets along bars, so that the nets to the boxes that they join are straight."""
        for bar in self.boxes.values():
            if not bar.is_bar:
                continue
            for connection in self._many_sided(bar):
                ends = bar.inlets if connection.is_incoming else bar.outlets
                ends[connection.net] = connection.other_end - bar.y

    def _straighten_nets(self) -> None:
        """Move ends of nets along the sides of boxes, so that nets between neighbouring columns are straight."""
        for index, net in enumerate(self.nets):
            source = self.boxes[net.source]
            targets = dict.fromkeys(self.boxes[key] for key in net.targets)
            # Nets to farther columns pass other boxes, and are routed later.
            near = [box for box in targets if box.column == source.column + 1]
            # A net with several targets can only be straight to one of them, unless it leaves from a long bar.
            for target in near if source.is_bar else near[:1]:
                height = target.y + target.inlets[index]
                # The outlet moves to the height of the inlet if the inlet cannot move freely (ports, several inlets),
                # or if the outlet can (a bar, a single outlet).
                has_one_outlet = len(source.outlets) == 1
                is_shared_target = len(target.inlets) > 1
                if target.is_port_list or source.is_bar or is_shared_target or has_one_outlet:
                    _move_end(source, source.outlets, index, height - source.y)
                # If the outlet cannot move there, the inlet moves to the outlet. Ports stay where they are.
                height = source.y + source.outlets[index]
                if not target.is_port_list:
                    _move_end(target, target.inlets, index, height - target.y)


def _is_output_port(block: DrawnBlock) -> bool:
    """Whether a block is an output of the station, such as "tau" or "tcp_pose"."""
    return block.role == "sensor" and block.shape == "port"


def _height_at_neighbour(box: Box, connection: _Connection) -> float:
    """Height from which a net enters a box, or to which it leaves, in the picture [px].

    It is the height of the box at the other end. A net that leads farther than to the next column counts as far above
    all boxes, and one that leads back, or stays in its column, as far below.

    Args:
        box: the box.
        connection: one end of the net at this box.
    """
    # Count of columns that the net advances in the direction of the signal flow.
    advance = connection.other.column - box.column
    if connection.is_incoming:
        advance = -advance
    if advance == 1:
        return connection.other.y
    return _FAR_BELOW if advance <= 0 else _FAR_ABOVE


def _move_end(box: Box, ends: dict[int, float], net: int, offset: float) -> None:
    """Move the end of a net along the side of a box, if it stays on the side, in its order and clear of other ends.

    Args:
        box: the box.
        ends: the box's inlets or outlets. The net's height is changed in place.
        net: index of the net.
        offset: new height from the middle of the box [px].
    """
    # An end at the corner of a box would look as if the line passed the box. A bar has no visible corners [px].
    distance_to_corner = 2 if box.is_bar else 6
    reach = box.height / 2 - distance_to_corner
    others = [height for other, height in ends.items() if other != net]
    # Nets that change their order at a box would cross.
    keeps_order = all((height < ends[net]) == (height < offset) for height in others)
    # A little closer than usual is allowed, since a straight line is worth it.
    is_clear = all(abs(height - offset) >= PITCH - 6 for height in others)
    if abs(offset) <= reach and keeps_order and is_clear:
        ends[net] = offset
