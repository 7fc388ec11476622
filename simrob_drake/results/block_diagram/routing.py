"""Lines of the nets of a block picture: only level and upright lines, so that none runs through a box or a text.

A net is a signal on its way from one box to the boxes that read it. The gaps left and right of the columns of boxes
are called *channels*: channel 0 is left of column 0, and channel i + 1 is right of column i. In each channel that a
net reaches, it has a *trunk*, an upright line to which its level lines lead. Each trunk has a *track*, an index that
sets its x in the channel, so that trunks do not overlap. If a net leads beyond the next column, a *lane*, a level line
past one or more columns, connects its trunks of two channels. A net that leads back has a lane below all boxes.

A *port* is an output of the station; the ports of a robot are one box, a list. A net with ``both`` is an exchange of
signals between two boxes, with an arrowhead at each end. Positions are in pixels, x to the right and y down.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import permutations
from math import fsum
from statistics import fmean
from typing import NamedTuple

from simrob_drake.results.block_diagram.graph import Net
from simrob_drake.results.block_diagram.layout import PITCH, ROW, Box, Layout, text_width


class Point(NamedTuple):
    """A point of the picture [px]."""

    x: float
    y: float


class Head(NamedTuple):
    """An arrowhead: its tip, and whether it points to the right. Otherwise it points to the left."""

    tip: Point
    points_right: bool


_TRACK = 9.0
"""Distance of neighbouring tracks [px]."""

_HEAD = 9.0
"""Room for an arrowhead [px]."""

_LABEL = 5.0
"""Distance of the name of a net from its box [px]."""

_LABEL_HEIGHT = 3.5
"""Height of the base line of the name of a net over its line [px]."""

_LANE = 14.0
"""Distance of lanes from each other and from the boxes that they pass above or below [px]."""

_BRACKET = 4.0
"""Distance of the bracket that encloses several ports from the list of ports [px]."""

_CLEAR = 6.0
"""Least distance of a lane from the boxes between which it passes [px]."""

_SAME_HEIGHT = 4
"""Level lines that are closer than this would look like one line [px]."""

_SEARCH_STEP = 2.0
"""Distance of the heights that are tried for a lane between boxes [px]."""


@dataclass
class Lines:
    """Drawing of a net.

    Attributes:
        label: left end of the base line of the net's name.
        polylines: lines, each with two or more points.
        heads: arrowheads.
        dots: points where the net branches.
    """

    label: Point
    polylines: list[list[Point]] = field(default_factory=list)
    heads: list[Head] = field(default_factory=list)
    dots: list[Point] = field(default_factory=list)


# Compared by identity: trunks of different nets may have the same heights.
@dataclass(eq=False)
class _Trunk:
    """Upright line of a net in a channel.

    Attributes:
        from_left: heights of the level lines that meet the trunk from the left [px].
        from_right: heights of the level lines that meet the trunk from the right [px].
        track: index that sets the trunk's x: tracks are counted from the left of the channel.
    """

    from_left: list[float] = field(default_factory=list)
    from_right: list[float] = field(default_factory=list)
    track: int = 0

    @property
    def heights(self) -> list[float]:
        """Heights of all level lines that meet the trunk [px]."""
        return [*self.from_left, *self.from_right]

    @property
    def top(self) -> float:
        """Height of the upper end [px]."""
        return min(self.heights)

    @property
    def bottom(self) -> float:
        """Height of the lower end [px]."""
        return max(self.heights)

    @property
    def is_level(self) -> bool:
        """Whether all level lines have the same height. Then there is nothing upright to draw."""
        return self.bottom - self.top < 1

    def leads_down(self) -> bool:
        """Whether the lines at the right are lower than those at the left, on average."""
        # mean(right) > mean(left), multiplied by both counts, as one of them may be zero
        right = fsum(self.from_right) * len(self.from_left)
        left = fsum(self.from_left) * len(self.from_right)
        return right > left


class _Rank(NamedTuple):
    """Sort key of trunks in a channel, from left to right."""

    group: int
    height: float


class _Passage(NamedTuple):
    """Part of a net that passes columns.

    Attributes:
        net: index of the net.
        first: index of the channel at the left end.
        last: index of the channel at the right end.
        stops: indices of the channels where the net enters boxes, in ascending order.
        leads_back: whether the net leads from the right to the left.
    """

    net: int
    first: int
    last: int
    stops: list[int]
    leads_back: bool = False


class _Lane(NamedTuple):
    """Level line past columns: its height [px], and the channels at its left and right end."""

    height: float
    first: int
    last: int


class _Occupied(NamedTuple):
    """A height [px] that a level line of a net has in a channel."""

    net: int
    height: float


class _Arrival(NamedTuple):
    """The end of a net at a box that reads it: its height in the picture [px], and the box."""

    height: float
    box: Box


class Routing:
    """Lines of all nets of a layout.

    Attributes:
        lines: lines of each net, in the order of the layout's nets.
        width: width of all boxes and lines [px].
    """

    def __init__(self, layout: Layout) -> None:
        """Route the nets of a layout. The x of the layout's boxes are set, since they depend on the lines between."""
        self._layout = layout
        self._channel_count = len(layout.columns) + 1
        # Trunks of each channel, by the index of the net.
        self._trunks: list[dict[int, _Trunk]] = [
            defaultdict(_Trunk) for _ in range(self._channel_count)
        ]
        self._lanes: dict[int, list[_Lane]] = defaultdict(list)
        self._occupied: list[list[_Occupied]] = [[] for _ in range(self._channel_count)]
        # Upper and lower end of each column [px]. They grow with each lane, which later lanes pass farther out.
        self._tops = [min(box.y - box.height / 2 for box in column) for column in layout.columns]
        self._bottoms = [max(box.y + box.height / 2 for box in column) for column in layout.columns]
        # Heights first, then the tracks of trunks between them, and then x: each needs the one before.
        self._route_lanes()
        for channel in range(self._channel_count):
            self._set_tracks(channel)
        self._track_starts: list[float] = []  # x of the first track of each channel [px]
        self.width = self._set_positions()
        self.lines = [self._draw(index, net) for index, net in enumerate(layout.nets)]

    @property
    def top(self) -> float:
        """Upper end of all boxes and lines [px]."""
        return min(self._tops)

    @property
    def bottom(self) -> float:
        """Lower end of all boxes and lines [px]."""
        return max(self._bottoms)

    def _source(self, index: int) -> Box:
        """Box from which a net comes, by the index of the net."""
        return self._layout.boxes[self._layout.nets[index].source]

    def _start_height(self, index: int) -> float:
        """Height in the picture at which a net leaves its source, by the index of the net [px]."""
        source = self._source(index)
        return source.y + source.outlets[index]

    def _arrivals(self, index: int, net: Net) -> dict[int, list[_Arrival]]:
        """Ends of a net at the boxes that read it, by the box's column, which is also the channel at its left.

        Args:
            index: index of the net.
            net: the net.
        """
        arrivals: dict[int, list[_Arrival]] = defaultdict(list)
        for target in net.targets:
            box = self._layout.boxes[target]
            arrival = _Arrival(box.y + box.inlets[index], box)
            # A net leads to a list of ports once, also if it is the signal of several of them.
            if arrival not in arrivals[box.column]:
                arrivals[box.column].append(arrival)
        return arrivals

    def _route_lanes(self) -> None:
        """Make the trunks and lanes of all nets. Short lanes are made first, so that they are close to the boxes."""
        passages: list[_Passage] = []
        for index, net in enumerate(self._layout.nets):
            passages += self._join_neighbours(index, net)

        def priority(passage: _Passage) -> tuple[int, float, int]:
            """Sort key of a passage: its length, then the height of its source, from below."""
            length = passage.last - passage.first
            return length, -self._source(passage.net).y, passage.net

        for passage in sorted(passages, key=priority):
            if passage.leads_back:
                self._route_back(passage)
            else:
                self._route_ahead(passage)

    def _join_neighbours(self, index: int, net: Net) -> list[_Passage]:
        """Add the ends of a net to the trunks next to its boxes.

        Args:
            index: index of the net.
            net: the net.

        Returns:
            the passages of the net that are still to be routed: ahead and back, as far as it leads beyond the channel
            of its source.
        """
        start = self._source(index).column + 1
        start_height = self._start_height(index)
        self._trunks[start][index].from_left.append(start_height)
        self._occupied[start].append(_Occupied(index, start_height))

        arrivals = self._arrivals(index, net)
        for channel, ends in arrivals.items():
            for end in ends:
                self._trunks[channel][index].from_right.append(end.height)
                self._occupied[channel].append(_Occupied(index, end.height))

        # The channel of the source needs no passage: its trunk leads there directly.
        channels_ahead = sorted(channel for channel in arrivals if channel > start)
        channels_behind = [channel for channel in arrivals if channel < start]
        passages = []
        if channels_ahead:
            passages.append(_Passage(index, start, channels_ahead[-1], channels_ahead))
        if channels_behind:
            passages.append(
                _Passage(index, min(channels_behind), start, channels_behind, leads_back=True)
            )
        return passages

    def _route_back(self, passage: _Passage) -> None:
        """Add the lane of a net that leads back: a single one, below all columns that it passes."""
        # Below, so that the reader sees feedback at the bottom of the picture, as control engineers draw it.
        height = self._height_beyond(passage.first, passage.last, upper=False)
        self._reserve(height, passage.first, passage.last)
        self._add_lane(passage.net, _Lane(height, passage.first, passage.last), passage.stops)

    def _route_ahead(self, passage: _Passage) -> None:
        """Add the lanes of a net that leads ahead: one to each channel where it enters boxes."""
        height = self._start_height(passage.net)
        begin = passage.first
        # Each lane begins at the height of the one before, so that a straight continuation is preferred.
        for stop in passage.stops:
            height = self._height_of_lane(passage.net, height, begin, stop)
            self._reserve(height, begin, stop)
            self._add_lane(passage.net, _Lane(height, begin, stop))
            begin = stop

    def _height_of_lane(self, net: int, height: float, first: int, last: int) -> float:
        """Height at which a net passes columns with the least detour: between the boxes, or above all of them.

        Args:
            net: index of the net.
            height: height from which the net comes [px].
            first: index of the channel from which it comes.
            last: index of the channel to which it leads.
        """
        aims: list[float] = []
        if net in self._trunks[last]:
            aims = self._trunks[last][net].from_right
        aim = fmean(aims) if aims else height

        top = min(self._tops[first:last])
        bottom = max(self._bottoms[first:last])
        count = int((bottom - top) / _SEARCH_STEP)
        heights_inside = [top + _SEARCH_STEP * step for step in range(count)]
        # Exact heights first: the search in steps would miss the one that gives a straight line.
        candidates = [height, *aims, *heights_inside]
        free = [candidate for candidate in candidates if self._is_free(net, candidate, first, last)]
        free.append(self._height_beyond(first, last, upper=True))  # there is always room above

        def detour(candidate: float) -> tuple[float, float]:
            """Sort key of a height: length of the upright lines at both ends [px], then of that at the begin."""
            upright_at_begin = abs(candidate - height)
            upright_at_end = abs(candidate - aim)
            return upright_at_begin + upright_at_end, upright_at_begin

        return min(free, key=detour)

    def _add_lane(self, net: int, lane: _Lane, stops: Sequence[int] = ()) -> None:
        """Add a lane to a net, and join the lane to the net's trunks.

        Args:
            net: index of the net.
            lane: the lane.
            stops: channels between the lane's ends where the net enters boxes, too.
        """
        # The lane crosses all channels between its ends, also those where the net has no trunk.
        for channel in range(lane.first, lane.last + 1):
            self._occupied[channel].append(_Occupied(net, lane.height))
        for channel in {lane.first, lane.last, *stops}:
            trunk = self._trunks[channel][net]
            if channel > lane.first:
                trunk.from_left.append(lane.height)
            if channel < lane.last:
                trunk.from_right.append(lane.height)
        self._lanes[net].append(lane)

    def _height_beyond(self, first: int, last: int, *, upper: bool) -> float:
        """Free height of a lane above or below all columns between two channels.

        Args:
            first: index of the left channel.
            last: index of the right channel.
            upper: whether the lane is above the columns. Otherwise it is below them.
        """
        step = -_LANE if upper else _LANE
        edge = min(self._tops[first:last]) if upper else max(self._bottoms[first:last])
        height = edge + step
        # Level lines that nets have in the channels which the lane crosses.
        heights = [line.height for channel in self._occupied[first : last + 1] for line in channel]
        # Small steps use the room between lanes better than whole lanes would.
        while any(abs(height - other) < _LANE - 1 for other in heights):
            height += step / 7
        return height

    def _reserve(self, height: float, first: int, last: int) -> None:
        """Extend the columns between two channels to a height [px], so that later lanes pass beyond it.

        A height between the boxes changes nothing.

        Args:
            height: height of a lane [px].
            first: index of the left channel, which is also that of the first column.
            last: index of the right channel.
        """
        for column in range(first, last):
            self._tops[column] = min(self._tops[column], height)
            self._bottoms[column] = max(self._bottoms[column], height)

    def _is_free(self, net: int, height: float, first: int, last: int) -> bool:
        """Whether a net can pass straight at a height between two channels, clear of all boxes and other nets.

        Args:
            net: index of the net.
            height: the height [px].
            first: index of the left channel.
            last: index of the right channel.
        """
        lines = [line for channel in self._occupied[first : last + 1] for line in channel]
        # A net may meet its own lines: they carry the same signal.
        if any(line.net != net and abs(height - line.height) < _LANE - 1 for line in lines):
            return False
        boxes = [box for column in self._layout.columns[first:last] for box in column]
        return all(abs(height - box.y) >= box.height / 2 + _CLEAR for box in boxes)

    def _set_tracks(self, channel: int) -> None:
        """Set the track of each trunk of a channel, so that trunks do not overlap and few lines cross.

        Args:
            channel: index of the channel.
        """
        trunks = [trunk for trunk in self._trunks[channel].values() if not trunk.is_level]
        order = _order_of_trunks(trunks)
        for rank, trunk in enumerate(order):
            # A trunk needs a track of its own right of each earlier one that it would touch.
            occupied = [
                other.track
                for other in order[:rank]
                if _overlap(trunk, other) or _must_be_left(other, trunk)
            ]
            trunk.track = max((track + 1 for track in occupied), default=0)

    def _set_positions(self) -> float:
        """Set the x of all boxes and channels, from left to right. Returns the width of the picture [px]."""
        x = 0.0
        for channel, trunks in enumerate(self._trunks):
            # A channel has, from left to right, the names of the nets that begin there, the tracks, and the arrowheads.
            names_width = self._width_of_names(channel)
            self._track_starts.append(x + names_width + _TRACK)
            if trunks:
                last_track = max(
                    (trunk.track for trunk in trunks.values() if not trunk.is_level), default=-1
                )
                # Tracks count from 0. A free distance is left of the first track, and one right of the last.
                x += names_width + _TRACK * (last_track + 2) + _HEAD
            if channel < len(self._layout.columns):
                column = self._layout.columns[channel]
                column_width = max(box.width for box in column)
                for box in column:
                    box.x = x + (column_width - box.width) / 2
                x += column_width
        return x

    def _width_of_names(self, channel: int) -> float:
        """Width of the longest name of the nets that begin in a channel, with its margins [px]; 0 if none has a name.

        Args:
            channel: index of the channel.
        """
        widths = [0.0]
        for net in self._layout.nets:
            begins_here = self._layout.boxes[net.source].column == channel - 1
            if begins_here and net.text:
                width_of_head = _HEAD if net.both else 0.0
                widths.append(text_width(net.text, 10) + 2 * _LABEL + width_of_head)
        return max(widths)

    def _draw(self, index: int, net: Net) -> Lines:
        """Draw the lines of a net, once its trunks have tracks and its boxes have their x.

        Args:
            index: index of the net.
            net: the net.
        """
        source = self._source(index)
        begin = Point(source.x + source.width, self._start_height(index))
        # An exchange of signals has an arrowhead at its source, too: the name follows it.
        width_of_head = _HEAD if net.both else 0.0
        lines = Lines(label=Point(begin.x + _LABEL + width_of_head, begin.y - _LABEL_HEIGHT))

        # The trunk of this net in each channel that it reaches.
        trunks = {
            channel: trunk_by_net[index]
            for channel, trunk_by_net in enumerate(self._trunks)
            if index in trunk_by_net
        }
        trunk_x = {
            channel: self._track_starts[channel] + _TRACK * trunk.track
            for channel, trunk in trunks.items()
        }
        first_x = trunk_x[source.column + 1]
        lines.polylines.append([begin, Point(first_x, begin.y)])
        for channel, trunk in trunks.items():
            if not trunk.is_level:
                _draw_trunk(lines, trunk, trunk_x[channel])
        for lane in self._lanes[index]:
            left = Point(trunk_x[lane.first], lane.height)
            right = Point(trunk_x[lane.last], lane.height)
            lines.polylines.append([left, right])
        for channel, arrivals in self._arrivals(index, net).items():
            for arrival in arrivals:
                self._draw_arrival(lines, index, arrival, trunk_x[channel])
        if net.both:
            lines.heads.append(Head(begin, points_right=False))
        return lines

    def _draw_arrival(self, lines: Lines, net: int, arrival: _Arrival, trunk_x: float) -> None:
        """Add the level line from a trunk to a box, with its arrowhead, to the lines of a net.

        Several ports of a list are enclosed by a bracket.

        Args:
            lines: lines of the net.
            net: index of the net.
            arrival: the end of the net at the box.
            trunk_x: x of the trunk [px].
        """
        box = arrival.box
        bracket: list[Point] = []
        end_x = box.x
        if box.is_port_list:
            ports = self._layout.port_range(net, box)
            # A net to a single port ends at the port itself.
            if ports.first < ports.last:
                end_x = box.x - _BRACKET
                bracket = [
                    Point(end_x, box.y + ports.first - ROW / 3),
                    Point(end_x, box.y + ports.last + ROW / 3),
                ]
        end = Point(end_x, arrival.height)
        lines.polylines.append([Point(trunk_x, arrival.height), end])
        lines.heads.append(Head(end, points_right=True))
        if bracket:
            lines.polylines.append(bracket)


def _draw_trunk(lines: Lines, trunk: _Trunk, x: float) -> None:
    """Add a trunk at a given x [px], and the dots where it branches, to the lines of a net."""
    lines.polylines.append([Point(x, trunk.top), Point(x, trunk.bottom)])
    heights = trunk.heights
    for height in sorted(set(heights)):
        # A single line at an end of the trunk is only a corner.
        is_inside = trunk.top < height < trunk.bottom
        if is_inside or heights.count(height) > 1:
            lines.dots.append(Point(x, height))


def _order_of_trunks(trunks: Sequence[_Trunk]) -> list[_Trunk]:
    """Sort trunks from left to right, so that few of their lines cross, and none lies on another trunk's line."""
    order = sorted(trunks, key=_rank_of_trunk)
    pairs = [
        (left, right)
        for left, right in permutations(order, 2)
        if _must_be_left(left, right) and not _must_be_left(right, left)
    ]
    # Each pass moves trunks to the left of those that they must precede. With n trunks, n passes are enough; demands
    # that form a circle cannot all be met.
    for _ in trunks:
        for left, right in pairs:
            if order.index(left) > order.index(right):
                order.remove(left)
                order.insert(order.index(right), left)
    return order


def _rank_of_trunk(trunk: _Trunk) -> _Rank:
    """Sort key of a trunk in its channel, from left to right.

    First come trunks that do not lead down, the highest first; then those that lead down, the lowest first; then those
    of nets that come back from the right, the highest first. With this order, trunks that lead in the same direction do
    not cross.
    """
    if not trunk.from_left:  # the net comes back from the right
        return _Rank(2, min(trunk.from_right))
    if trunk.leads_down():
        return _Rank(1, -min(trunk.from_left))
    return _Rank(0, min(trunk.from_left))


def _overlap(trunk: _Trunk, other: _Trunk) -> bool:
    """Whether two trunks on the same track would touch, or be less than half a pitch (8 px) apart."""
    return trunk.top < other.bottom + PITCH / 2 and other.top < trunk.bottom + PITCH / 2


def _must_be_left(trunk: _Trunk, other: _Trunk) -> bool:
    """Whether a trunk must be left of another one, as its line to the left would lie on the other's to the right."""
    return any(abs(a - b) < _SAME_HEIGHT for a in trunk.from_left for b in other.from_right)
