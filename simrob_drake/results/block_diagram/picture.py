"""The block picture of a station: drawn as SVG, PNG or PDF, or as text in the language of Graphviz or Mermaid.

A drawing consists of *marks*: areas, lines and texts. The marks of a block belong together as a *part*, which is a
group in the SVG file, so that a page can react to a click on the block. A *net* is a signal from a block to others. A
*port* is an output of the station, or an input that nothing feeds; the ports of a robot form a list. A *bar* is a thin
block that joins or distributes signals. The *role* of a block, such as "servo", determines its colour. Positions are in
pixels, x to the right and y down.

``python -m simrob_drake.results.block_diagram.picture`` draws the stations of the package anew.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from math import fsum
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import one_of
from simrob_drake.base.files import diagrams_root
from simrob_drake.base.folders import check_ending, replaced_at_once
from simrob_drake.base.messages import message, translate
from simrob_drake.results.block_diagram.graph import ROLES, BlockGraph, DrawnBlock, Net
from simrob_drake.results.block_diagram.layout import CELL, LINE, ROW, Box, Layout, text_width
from simrob_drake.results.block_diagram.reading import (
    COLOURS,
    TITLES,
    WIRE,
    dot_text,
    mermaid_text,
    read_blocks,
)
from simrob_drake.results.block_diagram.routing import Lines, Point, Routing
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
_FONT_SIZE = 11.0
"""Usual size of the font [px]."""

_SIGNAL_SIZE = 10
"""Size of the font of signals and ports [px]."""

_TITLE_SIZE = 13
"""Size of the font of the title [px]."""

_BLACK = "#000000"
_WHITE = "#ffffff"

_EDGE = 12.0
"""Width of the margin around the picture [px]."""

_HEADER = 44.0
"""Height of the title and the description [px]."""

_LEGEND = 26.0
"""Height of the legend under the picture [px]."""

_VALUE_HEIGHT = 14.0
"""Height of a signal's value over the place of a name, if the signal has no name beside which the value fits [px]."""

_POINTS_PER_INCH = 72
_RESOLUTION = 144
"""Resolution of PNG files [dots per inch]: two dots for each pixel of the drawing."""


@dataclass(frozen=True)
class _Area:
    """A filled polygon with an outline. Colours are "#rrggbb", or "none"."""

    corners: Sequence[Point]
    fill: str
    line: str = "none"
    dashed: bool = False


@dataclass(frozen=True)
class _Line:
    """A line through points, in the colour of signals."""

    points: Sequence[Point]


@dataclass(frozen=True)
class _Text:
    """A line of text.

    Attributes:
        text: the text.
        at: point on the base line: the middle of the text if it is centred, else its left end.
        colour: colour of the letters.
        size: size of the font [px].
        centred: whether the text is centred.
        bold: whether the letters are bold.
    """

    text: str
    at: Point
    colour: str = _BLACK
    size: float = _FONT_SIZE
    centred: bool = True
    bold: bool = False


_Mark = _Area | _Line | _Text


class _Part(NamedTuple):
    """Marks that belong together, and the key of their block. The key is empty for marks that are no block."""

    key: str
    marks: list[_Mark]


class _DrawnNet(NamedTuple):
    """A net, a signal from one block to others, and its lines."""

    net: Net
    lines: Lines


class _Legend(NamedTuple):
    """Marks of the legend, and its width [px]."""

    marks: list[_Mark]
    width: float


class Drawing:
    """The drawing of a block graph. The same graph gives the same drawing."""

    def __init__(self, graph: BlockGraph) -> None:
        """Draw a graph."""
        layout = Layout(graph)
        routing = Routing(layout)
        self._nets = [
            _DrawnNet(net, lines) for net, lines in zip(layout.nets, routing.lines, strict=True)
        ]
        # The nets come first: the index of a net is that of its part.
        self._parts = [_Part("", list(_net_marks(net.text, lines))) for net, lines in self._nets]
        for column in layout.columns:
            for box in column:
                self._parts += _parts_of_box(box)

        legend = _legend(graph, routing.bottom + _LEGEND)
        self._top = routing.top - _HEADER
        title = _Text(
            graph.title, Point(0, self._top + 14), size=_TITLE_SIZE, centred=False, bold=True
        )
        description = _Text(graph.description, Point(0, self._top + 29), centred=False)
        self._parts.append(_Part("", [*legend.marks, title, description]))

        # The estimate of a text's width is for usual letters; those of the title are bold.
        widths = [
            routing.width,
            legend.width,
            text_width(graph.title, 14),
            text_width(graph.description),
        ]
        self._width = max(widths) + 2 * _EDGE
        self._height = routing.bottom - self._top + _LEGEND + 2 * _EDGE

    def svg(self, *, live: bool = False) -> str:
        """Write the drawing as SVG. Each block is a group of the class ``node``, whose title is the block's key.

        Args:
            live: whether a page shows values of signals in the picture. Then each signal is a group of the class
                ``wire``, and has an empty text for its value.
        """
        width = f"{self._width:.0f}"
        height = f"{self._height:.0f}"
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
            f' font-family="{_FONT}" font-size="{_FONT_SIZE:g}">',
            '<rect width="100%" height="100%" fill="#ffffff"/>',
            f'<g transform="translate({_EDGE:g} {_EDGE - self._top:.1f})">',
        ]
        values: list[str] = []
        for index, part in enumerate(self._parts):
            drawn = "".join(_svg_mark(mark) for mark in part.marks)
            if live and index < len(self._nets):
                # The parts of the nets are the first ones, so that their indices are those of the nets.
                drawn = _svg_wire(index, self._nets[index], drawn)
                values.append(_svg_value(index, self._nets[index]))
            lines.append(
                f'<g class="node"><title>{escape(part.key)}</title>{drawn}</g>'
                if part.key
                else drawn
            )
        # Values come last, so that nothing covers them.
        return "\n".join([*lines, *values, "</g>", "</svg>", ""])

    def file(self, kind: str) -> bytes:
        """Content of a file with the drawing.

        Args:
            kind: format of the file, such as "png" or "pdf", that Matplotlib writes.
        """
        from matplotlib.figure import Figure  # slow to load, and SVG does not need it

        # A pixel of the drawing is a point, so that fonts have the same size as in SVG.
        size = (self._width / _POINTS_PER_INCH, self._height / _POINTS_PER_INCH)
        figure = Figure(figsize=size, dpi=_RESOLUTION)
        # The axes fill the figure, with a pixel of the drawing as unit. Matplotlib's y is upwards, unless the limits
        # are given in the opposite order.
        top = self._top - _EDGE
        x_limits = (-_EDGE, self._width - _EDGE)
        y_limits = (top + self._height, top)
        axes = figure.add_axes((0, 0, 1, 1), xlim=x_limits, ylim=y_limits)
        axes.set_axis_off()
        for part in self._parts:
            for mark in part.marks:
                _draw_mark(axes, mark)
        # Without a date the same drawing gives the same file.
        metadata = {"CreationDate": None} if kind == "pdf" else None
        buffer = BytesIO()
        figure.savefig(buffer, format=kind, metadata=metadata)
        return buffer.getvalue()


def _legend(graph: BlockGraph, y: float) -> _Legend:
    """Make the legend of the roles that a graph has, on a base line at y [px]."""
    used_roles = {block.role for block in graph.blocks.values()}
    marks: list[_Mark] = []
    x = 0.0
    for role in ROLES:
        if role not in used_roles:
            continue
        colours = COLOURS[role]
        title = translate(TITLES[role])
        # A coloured rectangle of 12 x 10 px, then the title. The next role follows 15 px after the title.
        marks.append(_Area(_rectangle(x, y - 9, 12, 10), colours.fill, colours.line))
        marks.append(_Text(title, Point(x + 17, y), colours.line, centred=False))
        x += text_width(title) + 32
    return _Legend(marks, x)


def _net_marks(text: str, lines: Lines) -> Iterator[_Mark]:
    """Yield the marks of a net.

    Args:
        text: name of the signal; empty if nothing is written.
        lines: lines, arrowheads and branches of the net.
    """
    for polyline in lines.polylines:
        yield _Line(polyline)
    # An arrowhead is a triangle, 7 px long and 6.4 px wide; a dot is a square of 3.6 px.
    for head in lines.heads:
        tip = head.tip
        back = tip.x - 7 if head.points_right else tip.x + 7
        yield _Area([tip, Point(back, tip.y - 3.2), Point(back, tip.y + 3.2)], WIRE)
    for dot in lines.dots:
        yield _Area(_rectangle(dot.x - 1.8, dot.y - 1.8, 3.6, 3.6), WIRE)
    if text:
        yield _Text(text, lines.label, WIRE, size=_SIGNAL_SIZE, centred=False)


def _parts_of_box(box: Box) -> Iterator[_Part]:
    """Yield the parts of a box: a block is one part; in a list of ports, each port is a part of its own.

    Args:
        box: the box, at its place in the picture.
    """
    if box.is_port_list:
        yield from _parts_of_ports(box)
        return
    block = box.blocks[0]
    outline = _rectangle(box.x, box.y - box.height / 2, box.width, box.height)
    if box.is_bar:
        yield _Part(block.key, [_Area(outline, WIRE)])
        return
    colours = COLOURS[block.role]
    # A dashed frame shows that the system of another block does the work.
    frame = _Area(outline, colours.fill, colours.line, dashed=bool(block.within))
    yield _Part(block.key, [frame, *_content_of_block(box, block, colours.line)])


def _parts_of_ports(box: Box) -> Iterator[_Part]:
    """Yield the parts of a list of ports: the name of the robot, if it is written, and each port."""
    line_colour = COLOURS[box.blocks[0].role].line
    top = box.y - box.height / 2
    middle = box.x + box.width / 2
    for text in box.lines:
        base_line = Point(middle, top + LINE - 2)
        # The name of the robot is no block: a click on it selects nothing.
        yield _Part("", [_Text(text, base_line, line_colour, bold=True)])
    for port in box.blocks:
        y = box.y + box.port_offset(port.key)
        outline = _rectangle(box.x, y - ROW / 2, box.width, ROW)
        area = _Area(outline, line_colour, _WHITE)
        # 3.5 px below the middle, the base line puts small letters in the middle.
        label = _Text(port.label, Point(middle, y + 3.5), _WHITE, size=_SIGNAL_SIZE)
        yield _Part(port.key, [area, label])


def _content_of_block(box: Box, block: DrawnBlock, line_colour: str) -> Iterator[_Mark]:
    """Yield the text of a block, and the steps of its computation as boxes below each other.

    Args:
        box: box of the block.
        block: the block.
        line_colour: colour of the block's edge.
    """
    middle = box.x + box.width / 2
    steps = [step.split("\n") for step in block.inside]
    # A step needs its lines, CELL for the edges of its box, and 1.5 CELL for the arrow above it. The content is in the
    # middle of the box, and y is the height up to which it has been drawn. Base lines of texts are 3 px above the lower
    # edge of their line, and boxes of steps keep 7 px from the edges of the block.
    content_height = LINE * len(box.lines) + fsum(LINE * len(step) + 2.5 * CELL for step in steps)
    y = box.y - content_height / 2
    for index, text in enumerate(box.lines):
        # The first line is the name of the robot only in stations of several robots, and then it is bold.
        is_robot = index == 0 and text == block.robot and len(box.lines) > 1
        yield _Text(
            text, Point(middle, y + LINE - 3), line_colour if is_robot else _BLACK, bold=is_robot
        )
        y += LINE
    for index, step in enumerate(steps):
        y += 1.5 * CELL
        if index == 0:
            # No arrow leads to the first step, so it needs less room above.
            y -= CELL
        else:
            yield _Line([Point(middle, y - 1.5 * CELL), Point(middle, y)])
            yield _Area(
                [Point(middle, y), Point(middle - 3, y - 6), Point(middle + 3, y - 6)], WIRE
            )
        height = LINE * len(step) + CELL
        yield _Area(_rectangle(box.x + 7, y, box.width - 14, height), _WHITE, line_colour)
        for line_index, text in enumerate(step):
            yield _Text(text, Point(middle, y + CELL / 2 + LINE * (line_index + 1) - 3))
        y += height


def _rectangle(x: float, y: float, width: float, height: float) -> list[Point]:
    """Corners of a rectangle, clockwise from the left upper one, which is (x, y) [px]."""
    return [Point(x, y), Point(x + width, y), Point(x + width, y + height), Point(x, y + height)]


def _svg_mark(mark: _Mark) -> str:
    """Write an area, a line or a text as an element of SVG."""
    if isinstance(mark, _Text):
        return _svg_text(mark)
    if isinstance(mark, _Line):
        return f'<path d="M{_svg_points(mark.points)}" fill="none" stroke="{WIRE}"/>'
    edge = f' stroke="{mark.line}"' if mark.line != "none" else ""
    dashes = ' stroke-dasharray="5 3"' if mark.dashed else ""
    return f'<path d="M{_svg_points(mark.corners)}Z" fill="{mark.fill}"{edge}{dashes}/>'


def _svg_text(mark: _Text) -> str:
    """Write a line of text as an element of SVG. Attributes with the usual values are left out."""
    attributes = ""
    if mark.colour != _BLACK:
        attributes += f' fill="{mark.colour}"'
    if mark.size != _FONT_SIZE:
        attributes += f' font-size="{mark.size:g}"'
    if mark.centred:
        attributes += ' text-anchor="middle"'
    if mark.bold:
        attributes += ' font-weight="bold"'
    # The format "z" writes a small negative number as 0.0, not as -0.0.
    return f'<text x="{mark.at.x:.1f}" y="{mark.at.y:z.1f}"{attributes}>{escape(mark.text)}</text>'


def _svg_points(points: Sequence[Point]) -> str:
    """Write points as they follow the "M" of a path of SVG: "x y", joined by "L", the command to draw a line."""
    return "L".join(f"{point.x:.1f} {point.y:.1f}" for point in points)


def _svg_wire(index: int, drawn_net: _DrawnNet, drawn: str) -> str:
    """Write a signal as a group that a page can react to.

    Args:
        index: index of the net, by which the page finds it.
        drawn_net: the net and its lines.
        drawn: the elements of the net.
    """
    net = drawn_net.net
    ends = f'data-from="{escape(net.source)}" data-to="{escape("|".join(net.targets))}"'
    # The page draws these invisible paths wide, so that a pointer need not hit the thin line.
    reach = "".join(
        f'<path class="reach" d="M{_svg_points(polyline)}" fill="none"/>'
        for polyline in drawn_net.lines.polylines
    )
    return f'<g class="wire" data-wire="{index}" {ends}>{reach}{drawn}</g>'


def _svg_value(index: int, drawn_net: _DrawnNet) -> str:
    """Write the empty text for the value of a signal: right of its name, or above the line if it has no name.

    Args:
        index: index of the net, by which the page finds the text.
        drawn_net: the net and its lines.
    """
    net = drawn_net.net
    label = drawn_net.lines.label
    if net.text:
        x = label.x + text_width(f"{net.text} ", _SIGNAL_SIZE)
        y = label.y
    else:
        # The line is so short that the value would reach into the next block, so it is written above line and block,
        # and a little to the left.
        x = label.x - _VALUE_HEIGHT / 2
        y = label.y - _VALUE_HEIGHT
    return (
        f'<text class="value" data-value="{index}" x="{x:.1f}" y="{y:.1f}" font-size="10"></text>'
    )


def _draw_mark(axes: "Axes", mark: _Mark) -> None:
    """Draw a mark with Matplotlib. Lines are under areas, and texts above both (zorder).

    Args:
        axes: the frame, with pixels of the drawing as units.
        mark: an area, a line or a text.
    """
    from matplotlib.patches import Polygon

    if isinstance(mark, _Area):
        style = "--" if mark.dashed else "-"
        area = Polygon(mark.corners, fc=mark.fill, ec=mark.line, lw=1, ls=style, zorder=3)
        axes.add_patch(area)
    elif isinstance(mark, _Line):
        x = [point.x for point in mark.points]
        y = [point.y for point in mark.points]
        axes.plot(x, y, color=WIRE, lw=1, zorder=2)
    else:
        axes.text(
            mark.at.x,
            mark.at.y,
            mark.text,
            color=mark.colour,
            size=mark.size,
            ha="center" if mark.centred else "left",
            weight="bold" if mark.bold else "normal",
            zorder=4,
            parse_math=False,  # a $ in a name is a letter
        )


SUFFIXES = (".svg", ".png", ".pdf", ".dot", ".mmd")
"""Suffixes of the files to which block pictures are written."""


def station_dot(config: StationConfig) -> str:
    """Write a station's block picture in the language of Graphviz.

    Raises:
        SimrobError: the station cannot be built.
    """
    return dot_text(_graph(config))


def station_svg(config: StationConfig, *, live: bool = False, folded: Iterable[str] = ()) -> str:
    """Draw a station's block picture, as the text of an SVG file.

    Args:
        config: the station.
        live: whether a page shows values of signals in the picture: see :meth:`Drawing.svg`.
        folded: keys of blocks whose subsystems are drawn as one block: see :meth:`BlockGraph.with_folded`.

    Raises:
        SimrobError: the station cannot be built.
    """
    titles = {role: translate(title) for role, title in TITLES.items()}
    return Drawing(_graph(config).with_folded(folded, titles)).svg(live=live)


def loop_svg(config: StationConfig, name: str) -> str:
    """Draw a controller of a station, as the text of an SVG file, with the blocks that it reads and that it commands.

    Args:
        config: the station.
        name: name of the controller.

    Raises:
        UnknownName: the station has no controller of this name.
        SimrobError: the station cannot be built.
    """
    controller = one_of(message("results.loop", "loop"), name, config.controllers)
    return Drawing(_graph(config).neighbourhood(f"controller.{controller}")).svg()


def station_mermaid(config: StationConfig) -> str:
    """Write a station's block picture as a Mermaid flowchart, which many viewers of Markdown draw.

    Raises:
        SimrobError: the station cannot be built.
    """
    return mermaid_text(_graph(config))


def save_block_picture(config: StationConfig, file: Path | str) -> Path:
    """Write a station's block picture to a file, and return its path.

    Args:
        config: the station.
        file: the file. Its suffix is the format: .svg, .png or .pdf, or as text .dot (Graphviz) or .mmd (Mermaid).

    Raises:
        InvalidParameter: the file has another suffix.
        SimrobError: the station cannot be built.
        OutputError: the file cannot be written.
    """
    file = as_path(file, "file")
    suffix = check_ending(file, SUFFIXES, message("results.file_of_picture", "the picture's file"))
    if suffix in (".png", ".pdf"):
        content = Drawing(_graph(config)).file(suffix.removeprefix("."))
    else:
        writers = {".svg": station_svg, ".dot": station_dot, ".mmd": station_mermaid}
        content = writers[suffix](config).encode()
    with replaced_at_once(file) as work:
        work.write_bytes(content)
    return file


def main(folder: Path | None = None) -> None:
    """Draw the stations of this package as ``<station>.svg``.

    Args:
        folder: folder of the pictures. If it is None, they are written next to the files of the stations.
    """
    target_folder = folder or diagrams_root()
    for name in sorted(file.stem for file in diagrams_root().glob("*.yaml")):
        print(save_block_picture(load_station(name), target_folder / f"{name}.svg"))


def _graph(config: StationConfig) -> BlockGraph:
    """Build a station, and read the blocks of its picture."""
    # The station as it would run: the picture shows the very Diagram, not a description of it.
    closed = closed_station(resolve(config))
    return read_blocks(closed.diagram, closed.ports)


if __name__ == "__main__":
    main()
