"""The lines of a picture: level and upright, each on a track of its own, so that none runs through a word."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import permutations
from math import fsum
from statistics import fmean
from typing import NamedTuple

from simrob_drake.results.block_diagram.graph import Net
from simrob_drake.results.block_diagram.layout import PITCH, ROW, Layout, Placed, text_width

Point = tuple[float, float]

_TRACK, _HEAD, _LABEL, _LANE, _BRACKET, _CLEAR = 9.0, 9.0, 5.0, 14.0, 4.0, 6.0


@dataclass
class Lines:
    """How a net is drawn."""

    ways: list[list[Point]] = field(default_factory=list)  # its lines, each of two points or more
    # where it has an arrowhead, each with whether that points to the right
    heads: list[tuple[Point, bool]] = field(default_factory=list)
    dots: list[Point] = field(default_factory=list)  # where it branches
    label: Point = (0.0, 0.0)  # where its name begins


@dataclass
class _Trunk:
    """The upright part of a net between two columns: where it is met from the left and from the right [px]."""

    from_left: list[float] = field(default_factory=list)
    from_right: list[float] = field(default_factory=list)
    track: int = 0

    @property
    def span(self) -> tuple[float, float]:
        """Its ends."""
        ends = [*self.from_left, *self.from_right]
        return min(ends), max(ends)

    @property
    def level(self) -> bool:
        """Whether there is nothing upright in it."""
        low, high = self.span
        return high - low < 1

    def leads_down(self) -> bool:
        """Tell whether it leads down from where it comes from."""
        return fsum(self.from_right) * len(self.from_left) > fsum(self.from_left) * len(self.from_right)


class _Far(NamedTuple):
    """A way of a net over or under columns, from one channel between columns to another, with those where it ends."""

    number: int
    first: int
    last: int
    ends: list[int]
    back: bool = False


class Routing:
    """The lines of all nets of a layout, whose places it sets from left to right."""

    def __init__(self, layout: Layout) -> None:
        self._layout, self._channels = layout, len(layout.columns) + 1
        self._trunks: list[dict[int, _Trunk]] = [defaultdict(_Trunk) for _ in range(self._channels)]
        self._lanes: dict[int, list[tuple[float, int, int]]] = defaultdict(list)
        self._taken: list[list[tuple[int, float]]] = [[] for _ in range(self._channels)]
        self._tops = [min(p.y - p.height / 2 for p in column) for column in layout.columns]
        self._bottoms = [max(p.y + p.height / 2 for p in column) for column in layout.columns]
        far = [task for number, net in enumerate(layout.nets) for task in self._join(number, net)]
        starts = {task.number: layout.places[layout.nets[task.number].source].y for task in far}
        for task in sorted(far, key=lambda task: (task.last - task.first, -starts[task.number], task.number)):
            self._lay(task)
        for channel in range(self._channels):
            self._set_tracks(channel)
        self._spread()
        self.lines = [self._drawn(number, net) for number, net in enumerate(layout.nets)]  # of each net

    @property
    def span(self) -> tuple[float, float]:
        """Top and bottom of all [px]."""
        return min(self._tops), max(self._bottoms)

    def _ends(self, number: int, net: Net) -> dict[int, dict[float, Placed]]:
        """Return where a net comes in, by columns."""
        ends: dict[int, dict[float, Placed]] = defaultdict(dict)
        for placed in (self._layout.places[target] for target in net.targets):
            ends[placed.column][placed.y + placed.left[number]] = placed
        return ends

    def _join(self, number: int, net: Net) -> list[_Far]:
        """Join a net to its neighbours, and return the ways that it has to go farther."""
        source = self._layout.places[net.source]
        start, ends = source.column + 1, self._ends(number, net)
        self._trunks[start][number].from_left.append(source.y + source.right[number])
        self._taken[start].append((number, source.y + source.right[number]))
        for column, levels in ends.items():
            self._trunks[column][number].from_right += levels
            self._taken[column] += [(number, level) for level in levels]
        ahead, back = ([c for c in ends if c > start], [c for c in ends if c < start])
        tasks = [_Far(number, start, max(ahead), sorted(ahead))] if ahead else []
        return tasks + ([_Far(number, min(back), start, back, back=True)] if back else [])

    def _lay(self, far: _Far) -> None:
        """Lay a way: ahead between what is in the way where that has room for it, else over or under it."""
        if far.back:
            level = self._beyond(far.first, far.last, upper=False)
            self._take(level, far.first, far.last)
            self._add_lane(far.number, level, far.first, far.last, far.ends)
            return
        source = self._layout.places[self._layout.nets[far.number].source]
        level, begin = source.y + source.right[far.number], far.first
        for end in far.ends:
            level = self._between(far.number, level, begin, end)
            self._add_lane(far.number, level, begin, end)
            begin = end

    def _between(self, number: int, level: float, first: int, last: int) -> float:
        """Return the level nearest to that of a net and its targets with room for it between two channels."""
        aims = self._trunks[last][number].from_right if number in self._trunks[last] else []
        aim = fmean(aims) if aims else level
        top, bottom = min(self._tops[first:last]), max(self._bottoms[first:last])
        inside = (top + 2.0 * step for step in range(int((bottom - top) / 2)))
        free = [found for found in (level, *aims, *inside) if self._passes(number, found, first, last)]
        free.append(self._beyond(first, last, upper=True))
        found = min(free, key=lambda found: (abs(found - level) + abs(found - aim), abs(found - level)))
        self._take(found, first, last)
        return found

    def _add_lane(self, number: int, level: float, first: int, last: int, ends: Sequence[int] = ()) -> None:
        for channel in range(first, last + 1):
            self._taken[channel].append((number, level))
        for channel in {first, last, *ends}:
            trunk = self._trunks[channel][number]
            trunk.from_left += [level] if channel > first else []
            trunk.from_right += [level] if channel < last else []
        self._lanes[number].append((level, first, last))

    def _beyond(self, first: int, last: int, *, upper: bool) -> float:
        """Return where there is room over or under the columns between two channels."""
        edges, step = (self._tops, -_LANE) if upper else (self._bottoms, _LANE)
        level = (min if upper else max)(edges[first:last]) + step
        while any(abs(level - other) < _LANE - 1 for taken in self._taken[first : last + 1] for _, other in taken):
            level += step / 7
        return level

    def _take(self, level: float, first: int, last: int) -> None:
        """Let what comes later lie beyond a level between two channels."""
        for column in range(first, last):
            self._tops[column] = min(self._tops[column], level)
            self._bottoms[column] = max(self._bottoms[column], level)

    def _passes(self, number: int, level: float, first: int, last: int) -> bool:
        """Tell whether a net can go on straight between what stands between two channels."""
        things = [placed for column in self._layout.columns[first:last] for placed in column]
        taken = [other for levels in self._taken[first : last + 1] for other in levels]
        clear = all(owner == number or abs(level - other) >= _LANE - 1 for owner, other in taken)
        return clear and all(abs(level - placed.y) >= placed.height / 2 + _CLEAR for placed in things)

    def _set_tracks(self, channel: int) -> None:
        """Give each upright part a track on which it meets no other, in an order in which few lines cross."""
        trunks = {number: trunk for number, trunk in self._trunks[channel].items() if not trunk.level}

        def rank(number: int) -> tuple[int, float]:
            trunk = trunks[number]
            if not trunk.from_left:  # it comes back from the right
                return 2, min(trunk.from_right)
            return (1, -min(trunk.from_left)) if trunk.leads_down() else (0, min(trunk.from_left))

        order = sorted(trunks, key=rank)
        pairs = [
            (one, other)
            for one, other in permutations(order, 2)
            if _before(trunks[one], trunks[other]) and not _before(trunks[other], trunks[one])
        ]
        for _ in order:
            for one, other in pairs:
                if order.index(one) > order.index(other):
                    order.remove(one)
                    order.insert(order.index(other), one)
        for place, number in enumerate(order):
            trunk = trunks[number]
            left = [trunks[other] for other in order[:place]]
            trunk.track = max((o.track + 1 for o in left if _meet(trunk, o) or _before(o, trunk)), default=0)

    def _spread(self) -> None:
        """Set the places from left to right, and the tracks between them."""
        x, self._tracks = 0.0, list[float]()
        for channel, trunks in enumerate(self._trunks):
            own = [net for net in self._layout.nets if self._layout.places[net.source].column == channel - 1]
            widths = (text_width(net.text, 10) + 2 * _LABEL + _HEAD * net.both for net in own if net.text)
            names = max(widths, default=0.0)
            upright = [trunk.track for trunk in trunks.values() if not trunk.level]
            self._tracks.append(x + names + _TRACK)
            x += (names + _TRACK * (max(upright, default=-1) + 2) + _HEAD) if trunks else 0.0
            if channel < len(self._layout.columns):
                column = self._layout.columns[channel]
                width = max(placed.width for placed in column)
                for placed in column:
                    placed.x = x + (width - placed.width) / 2
                x += width
        self.width = x  # of all [px]

    def _drawn(self, number: int, net: Net) -> Lines:
        """Return the lines of a net."""
        source, lines = self._layout.places[net.source], Lines()
        begin = (source.x + source.width, source.y + source.right[number])
        lines.label = begin[0] + _LABEL + _HEAD * net.both, begin[1] - 3.5
        lanes, trunks = self._lanes[number], {c: t[number] for c, t in enumerate(self._trunks) if number in t}
        upright = {c: self._tracks[c] + _TRACK * trunk.track for c, trunk in trunks.items()}
        lines.ways = [[begin, (upright[source.column + 1], begin[1])]]
        for channel, trunk in trunks.items():
            low, high = trunk.span
            if not trunk.level:
                lines.ways.append([(upright[channel], low), (upright[channel], high)])
            meets = [*trunk.from_left, *trunk.from_right]
            lines.dots += [
                (upright[channel], level)
                for level in sorted(set(meets))
                if not trunk.level and (low < level < high or meets.count(level) > 1)
            ]
        for level, first, last in lanes:
            lines.ways.append([(upright[first], level), (upright[last], level)])
        for column, levels in self._ends(number, net).items():
            for level, placed in levels.items():
                top, bottom = self._layout.rows(number, placed) if placed.ports else (0.0, 0.0)
                end = placed.x - (_BRACKET if top < bottom else 0)
                lines.ways.append([(upright[column], level), (end, level)])
                lines.heads.append(((end, level), True))
                if top < bottom:
                    lines.ways.append([(end, placed.y + top - ROW / 3), (end, placed.y + bottom + ROW / 3)])
        if net.both:
            lines.heads.append((begin, False))
        return lines


def _meet(one: _Trunk, other: _Trunk) -> bool:
    (low, high), (lowest, highest) = one.span, other.span
    return low < highest + PITCH / 2 and lowest < high + PITCH / 2


def _before(one: _Trunk, other: _Trunk) -> bool:
    """Tell whether a trunk must stand left of another: its line from the left would lie on that to the right."""
    return any(abs(a - b) < 4 for a in one.from_left for b in other.from_right)
