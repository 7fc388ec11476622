"""The block picture of a station, as DOT, Mermaid or a drawing of Graphviz.

``python -m simrob_drake.results.block_diagram.picture`` draws the stations of the package anew.
"""

import subprocess
from pathlib import Path

from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.files import diagrams_root
from simrob_drake.folders import replaced_at_once
from simrob_drake.results.block_diagram.dot import dot_text
from simrob_drake.results.block_diagram.graph import BlockGraph
from simrob_drake.results.block_diagram.mermaid import mermaid_text
from simrob_drake.results.block_diagram.reading import read_blocks
from simrob_drake.stations.closed import closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_names
from simrob_drake.stations.resolve import resolve

DRAWN_SUFFIXES = (".svg", ".png", ".pdf")
"""What Graphviz draws; .dot and .mmd are written without it."""

_TIMEOUT = 60.0  # s; a station takes less than one


def station_dot(config: StationConfig) -> str:
    """Return the block picture of a station in Graphviz' language.

    Raises:
        SimrobError: a station that cannot be built.
    """
    return dot_text(_graph(config))


def station_svg(config: StationConfig) -> str:
    """Return the block picture of a station as SVG.

    Raises:
        SimrobError: a station that cannot be built, or Graphviz is missing, or fails.
    """
    return _drawn(station_dot(config), "svg").decode()


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
        file: its suffix says what is written: .dot, .mmd, or through Graphviz .svg, .png, .pdf.

    Returns:
        the file.

    Raises:
        InvalidParameter: another suffix.
        SimrobError: Graphviz is needed and missing, or fails.
        OutputError: the file cannot be written.
    """
    file = as_path(file, "file")
    suffix = file.suffix.lower()
    if suffix not in (".dot", ".mmd", *DRAWN_SUFFIXES):
        raise InvalidParameter("the picture's file", file.name, f"one of .dot, .mmd, {', '.join(DRAWN_SUFFIXES)}")
    text = station_mermaid(config) if suffix == ".mmd" else station_dot(config)
    content = _drawn(text, suffix[1:]) if suffix in DRAWN_SUFFIXES else text.encode()
    with replaced_at_once(file) as work:
        work.write_bytes(content)
    return file


def main(folder: Path | None = None) -> None:
    """Write ``<station>.dot`` and ``<station>.svg`` for the package's stations, beside their files unless told."""
    for name in station_names():
        for suffix in (".dot", ".svg"):
            print(save_block_picture(load_station(name), (folder or diagrams_root()) / f"{name}{suffix}"))


def _graph(config: StationConfig) -> BlockGraph:
    closed = closed_station(resolve(config))
    return read_blocks(closed.diagram, closed.ports)


def _drawn(text: str, kind: str) -> bytes:
    """Return what Graphviz draws from a text: ``kind`` is svg, png or pdf."""
    try:
        dot = ["dot", f"-T{kind}"]
        return subprocess.run(dot, input=text.encode(), capture_output=True, timeout=_TIMEOUT, check=True).stdout
    except FileNotFoundError as problem:
        raise SimrobError(
            f"a .{kind} picture needs Graphviz, whose program `dot` is not found; "
            "install Graphviz, or choose a .dot or .mmd file"
        ) from problem
    except subprocess.TimeoutExpired as problem:
        raise SimrobError(f"Graphviz took more than {_TIMEOUT:g} s; choose a .dot or .mmd file") from problem
    except subprocess.CalledProcessError as problem:
        message = " ".join(problem.stderr.decode(errors="replace").split())
        raise SimrobError(f"Graphviz failed: {message}; choose a .dot or .mmd file") from problem


if __name__ == "__main__":
    main()
