"""The block picture of a station, as a drawing, or as a text in the language of Graphviz or Mermaid.

``python -m simrob_drake.results.block_diagram.picture`` draws the stations of the package anew.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from math import fsum
from pathlib import Path

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import one_of
from simrob_drake.base.files import diagrams_root
from simrob_drake.base.folders import check_ending, replaced_at_once
from simrob_drake.base.messages import message, translate
from simrob_drake.results.block_diagram.graph import ROLES, BlockGraph, DrawnBlock, Net
from simrob_drake.results.block_diagram.layout import CELL, LINE, ROW, Layout, Placed, text_width
from simrob_drake.results.block_diagram.reading import COLOURS, TITLES, WIRE, dot_text, mermaid_text, read_blocks
from simrob_drake.results.block_diagram.routing import Lines, Point, Routing
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve

_FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
_EDGE, _HEADER, _LEGEND, _FONT_SIZE = 12.0, 44.0, 26.0, 11.0
_ABOVE = 14.0  # px over a wire without a name, whose value would stand in the next block


@dataclass(frozen=True)
class _Area:
    """A filled outline."""

    corners: Sequence[Point]
    fill: str
    line: str = "none"
    dashed: bool = False


@dataclass(frozen=True)
class _Way:
    """A line."""

    points: Sequence[Point]


@dataclass(frozen=True)
class _Words:
    """A line of text; ``at`` is where it begins, or its middle, on its base line."""

    text: str
    at: Point
    fill: str = "#000000"
    size: float = _FONT_SIZE
    middle: bool = True
    bold: bool = False


_Mark = _Area | _Way | _Words
_Part = tuple[str, list[_Mark]]  # the key of a block, or nothing, and its marks


class Drawing:
    """A block graph, drawn."""

    def __init__(self, graph: BlockGraph) -> None:
        """Draw a graph; the same graph gives the same drawing."""
        layout = Layout(graph)
        routing = Routing(layout)
        self._parts: list[_Part] = []
        self._nets = list(zip(layout.nets, routing.lines, strict=True))
        for net, lines in self._nets:
            self._parts.append(("", list(_net_marks(net.text, lines))))
        for column in layout.columns:
            self._parts += [part for placed in column for part in _block_parts(placed)]
        legend, x, (self._top, bottom) = list[_Mark](), 0.0, routing.span
        for role in (role for role in ROLES if any(block.role == role for block in graph.blocks.values())):
            (fill, line), y = COLOURS[role], bottom + _LEGEND
            title = translate(TITLES[role])
            legend += [_Area(_box(x, y - 9, 12, 10), fill, line), _Words(title, (x + 17, y), line, middle=False)]
            x += text_width(title) + 32
        self._top -= _HEADER
        heading = _Words(graph.title, (0, self._top + 14), size=13, middle=False, bold=True)
        self._parts += [("", [*legend, heading, _Words(graph.description, (0, self._top + 29), middle=False)])]
        wide = max(routing.width, x, text_width(graph.title, 14), text_width(graph.description))
        self._size = wide + 2 * _EDGE, bottom - self._top + _LEGEND + 2 * _EDGE

    def svg(self, *, live: bool = False) -> str:
        """Return it as SVG, a titled group ``node`` a block; ``live``, a group ``wire`` a signal for its value, too."""
        width, height = (f"{value:.0f}" for value in self._size)
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
            f' font-family="{_FONT}" font-size="{_FONT_SIZE:g}">',
            '<rect width="100%" height="100%" fill="#ffffff"/>',
            f'<g transform="translate({_EDGE:g} {_EDGE - self._top:.1f})">',
        ]
        values = list[str]()  # over all else
        for number, (key, marks) in enumerate(self._parts):
            drawn = "".join(map(_svg_mark, marks))
            if live and number < len(self._nets):
                drawn, value = _live_wire(number, *self._nets[number], drawn)
                values.append(value)
            lines.append(f'<g class="node"><title>{escape(key)}</title>{drawn}</g>' if key else drawn)
        return "\n".join([*lines, *values, "</g>", "</svg>", ""])

    def file(self, kind: str) -> bytes:
        """Return it as a file of a kind that Matplotlib writes: png or pdf."""
        from matplotlib.figure import Figure
        from matplotlib.patches import Polygon

        width, height = self._size
        figure = Figure(figsize=(width / 72, height / 72), dpi=144)
        top = self._top - _EDGE
        axes = figure.add_axes((0, 0, 1, 1), xlim=(-_EDGE, width - _EDGE), ylim=(top + height, top))
        axes.set_axis_off()
        for mark in (mark for _, marks in self._parts for mark in marks):
            if isinstance(mark, _Area):
                style = "--" if mark.dashed else "-"
                axes.add_patch(Polygon(mark.corners, fc=mark.fill, ec=mark.line, lw=1, ls=style, zorder=3))
            elif isinstance(mark, _Way):
                axes.plot(*zip(*mark.points, strict=True), color=WIRE, lw=1, zorder=2)
            else:
                align, weight = "center" if mark.middle else "left", "bold" if mark.bold else "normal"
                axes.text(
                    *mark.at,
                    mark.text,
                    color=mark.fill,
                    size=mark.size,
                    ha=align,
                    weight=weight,
                    zorder=4,
                    parse_math=False,
                )
        buffer = BytesIO()
        figure.savefig(buffer, format=kind, metadata={"CreationDate": None} if kind == "pdf" else None)
        return buffer.getvalue()


def _live_wire(number: int, net: Net, lines: Lines, drawn: str) -> tuple[str, str]:
    """Return a signal that a page can point at; and where its value goes: beside its name, or above a short way."""
    (x, y), ends = lines.label, f'data-from="{escape(net.source)}" data-to="{escape("|".join(net.targets))}"'
    ways = "".join(f'<path class="reach" d="M{_path(way)}" fill="none"/>' for way in lines.ways)
    x, y = (x + text_width(f"{net.text} ", 10), y) if net.text else (x - _ABOVE / 2, y - _ABOVE)
    value = f'<text class="value" data-value="{number}" x="{x:.1f}" y="{y:.1f}" font-size="10"></text>'
    return f'<g class="wire" data-wire="{number}" {ends}>{ways}{drawn}</g>', value


def _net_marks(text: str, lines: Lines) -> Iterator[_Mark]:
    """Yield what a signal is drawn of."""
    yield from map(_Way, lines.ways)
    for (x, y), right in lines.heads:
        back = x - 7 if right else x + 7
        yield _Area([(x, y), (back, y - 3.2), (back, y + 3.2)], WIRE)
    yield from (_Area(_box(x - 1.8, y - 1.8, 3.6, 3.6), WIRE) for x, y in lines.dots)
    if text:
        yield _Words(text, lines.label, WIRE, size=10, middle=False)


def _block_parts(placed: Placed) -> Iterator[_Part]:
    """Yield a block, or a bar of ports, each of which is one of its own."""
    block, (fill, line) = placed.blocks[0], COLOURS[placed.blocks[0].role]
    top = placed.y - placed.height / 2
    if placed.bar:
        yield block.key, [_Area(_box(placed.x, top, placed.width, placed.height), WIRE)]
    elif not placed.ports:
        frame = _Area(_box(placed.x, top, placed.width, placed.height), fill, line, dashed=bool(block.within))
        yield block.key, [frame, *_inside(placed, block, line)]
    else:
        for text in placed.lines:
            yield "", [_Words(text, (placed.x + placed.width / 2, top + LINE - 2), line, bold=True)]
        for port in placed.blocks:
            y = placed.y + placed.row(port.key)
            middle = placed.x + placed.width / 2
            row = _Area(_box(placed.x, y - ROW / 2, placed.width, ROW), line, "#ffffff")
            yield port.key, [row, _Words(port.label, (middle, y + 3.5), "#ffffff", size=10)]


def _inside(placed: Placed, block: DrawnBlock, line: str) -> Iterator[_Mark]:
    """Yield a block's words, and what happens in it as boxes of their own, one under the other."""
    middle, cells = placed.x + placed.width / 2, [cell.split("\n") for cell in block.inside]
    content = LINE * len(placed.lines) + fsum(LINE * len(cell) + 2.5 * CELL for cell in cells)
    y = placed.y - content / 2
    for number, text in enumerate(placed.lines):
        bold = number == 0 and text == block.robot and len(placed.lines) > 1
        yield _Words(text, (middle, y + LINE - 3), line if bold else "#000000", bold=bold)
        y += LINE
    for number, cell in enumerate(cells):
        y += 1.5 * CELL
        if number:
            yield _Way([(middle, y - 1.5 * CELL), (middle, y)])
            yield _Area([(middle, y), (middle - 3, y - 6), (middle + 3, y - 6)], WIRE)
        else:
            y -= CELL
        height = LINE * len(cell) + CELL
        yield _Area(_box(placed.x + 7, y, placed.width - 14, height), "#ffffff", line)
        for row, text in enumerate(cell):
            yield _Words(text, (middle, y + CELL / 2 + LINE * (row + 1) - 3))
        y += height


def _box(x: float, y: float, width: float, height: float) -> list[Point]:
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]


def _svg_mark(mark: _Mark) -> str:
    if isinstance(mark, _Words):
        look = f' fill="{mark.fill}"' if mark.fill != "#000000" else ""
        look += f' font-size="{mark.size:g}"' if mark.size != _FONT_SIZE else ""
        look += (' text-anchor="middle"' if mark.middle else "") + (' font-weight="bold"' if mark.bold else "")
        return f'<text x="{mark.at[0]:.1f}" y="{mark.at[1]:z.1f}"{look}>{escape(mark.text)}</text>'
    if isinstance(mark, _Way):
        return f'<path d="M{_path(mark.points)}" fill="none" stroke="{WIRE}"/>'
    dashed = ' stroke-dasharray="5 3"' if mark.dashed else ""
    edge = f' stroke="{mark.line}"' if mark.line != "none" else ""
    return f'<path d="M{_path(mark.corners)}Z" fill="{mark.fill}"{edge}{dashed}/>'


def _path(points: Sequence[Point]) -> str:
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


SUFFIXES = (".svg", ".png", ".pdf", ".dot", ".mmd")  # of files that pictures are written to


def station_dot(config: StationConfig) -> str:
    """Return a station's block picture in Graphviz' language; raises SimrobError: a station that cannot be built."""
    return dot_text(_graph(config))


def station_svg(config: StationConfig, *, live: bool = False, folded: Iterable[str] = ()) -> str:
    """Return a station's block picture, see :meth:`Drawing.svg`; raises SimrobError: a station that cannot be built.

    Subsystems are one block each of which one of the ``folded`` blocks is a part.
    """
    return Drawing(_graph(config).with_folded(folded, TITLES)).svg(live=live)


def loop_svg(config: StationConfig, name: str) -> str:
    """Return the picture of a loop of a station with what it reads and moves; raises UnknownName: there is none."""
    return Drawing(
        _graph(config).around(f"controller.{one_of(message('results.loop', 'loop'), name, config.controllers)}")
    ).svg()


def station_mermaid(config: StationConfig) -> str:
    """Return a station's block picture for Mermaid, which Markdown shows; raises SimrobError: it cannot be built."""
    return mermaid_text(_graph(config))


def save_block_picture(config: StationConfig, file: Path | str) -> Path:
    """Write a station's block picture, as its suffix says .svg, .png, .pdf, or as text .dot or .mmd; return the file.

    Raises InvalidParameter: another suffix; SimrobError: the station cannot be built; OutputError: the file not
    written.
    """
    file = as_path(file, "file")
    suffix = check_ending(file, SUFFIXES, message("results.file_of_picture", "the picture's file"))
    if suffix in (".png", ".pdf"):
        content = Drawing(_graph(config)).file(suffix[1:])
    else:
        texts = {".svg": station_svg, ".dot": station_dot, ".mmd": station_mermaid}
        content = texts[suffix](config).encode()
    with replaced_at_once(file) as work:
        work.write_bytes(content)
    return file


def main(folder: Path | None = None) -> None:
    """Write ``<station>.svg`` for this package's own stations, next to their files if no folder is given."""
    for name in sorted(file.stem for file in diagrams_root().glob("*.yaml")):
        print(save_block_picture(load_station(name), (folder or diagrams_root()) / f"{name}.svg"))


def _graph(config: StationConfig) -> BlockGraph:
    closed = closed_station(resolve(config))
    return read_blocks(closed.diagram, closed.ports)


if __name__ == "__main__":
    main()
