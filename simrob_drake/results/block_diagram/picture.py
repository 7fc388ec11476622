"""The block picture of a station, as a drawing, or as a text in the language of Graphviz or Mermaid.

``python -m simrob_drake.results.block_diagram.picture`` draws the stations of the package anew.
"""

from pathlib import Path

from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter
from simrob_drake.files import diagrams_root
from simrob_drake.folders import replaced_at_once
from simrob_drake.results.block_diagram.drawing import Drawing
from simrob_drake.results.block_diagram.graph import BlockGraph
from simrob_drake.results.block_diagram.reading import dot_text, mermaid_text, read_blocks
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_names
from simrob_drake.stations.resolve import resolve

SUFFIXES = (".svg", ".png", ".pdf", ".dot", ".mmd")
"""Of files that pictures are written to."""


def station_dot(config: StationConfig) -> str:
    """Return the block picture of a station in Graphviz' language.

    Raises:
        SimrobError: a station that cannot be built.
    """
    return dot_text(_graph(config))


def station_svg(config: StationConfig) -> str:
    """Return the block picture of a station as SVG.

    Raises:
        SimrobError: a station that cannot be built.
    """
    return Drawing(_graph(config)).svg()


def station_mermaid(config: StationConfig) -> str:
    """Return the block picture of a station as a Mermaid flowchart, which GitHub shows in Markdown.

    Raises:
        SimrobError: a station that cannot be built.
    """
    return mermaid_text(_graph(config))


def save_block_picture(config: StationConfig, file: Path | str) -> Path:
    """Write the block picture of a station.

    Args:
        config: the station.
        file: its suffix says what is written: .svg, .png, .pdf, or as a text .dot or .mmd.

    Returns:
        the file.

    Raises:
        InvalidParameter: another suffix.
        SimrobError: a station that cannot be built.
        OutputError: the file cannot be written.
    """
    file = as_path(file, "file")
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise InvalidParameter("the picture's file", file.name, f"one of {', '.join(SUFFIXES)}")
    if suffix in (".png", ".pdf"):
        content = Drawing(_graph(config)).file(suffix[1:])
    else:
        texts = {".svg": station_svg, ".dot": station_dot, ".mmd": station_mermaid}
        content = texts[suffix](config).encode()
    with replaced_at_once(file) as work:
        work.write_bytes(content)
    return file


def main(folder: Path | None = None) -> None:
    """Write ``<station>.svg`` for the package's stations, beside their files unless told."""
    for name in station_names():
        print(save_block_picture(load_station(name), (folder or diagrams_root()) / f"{name}.svg"))


def _graph(config: StationConfig) -> BlockGraph:
    closed = closed_station(resolve(config))
    return read_blocks(closed.diagram, closed.ports)


if __name__ == "__main__":
    main()
