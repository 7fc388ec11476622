"""A block graph in Graphviz' language: from left to right, a cluster for each role, signals as arrows."""

from __future__ import annotations

from collections.abc import Iterable

from simrob_drake.results.block_graph import Block, BlockGraph
from simrob_drake.results.block_places import Role

ROLE_TITLES: dict[Role, str] = {
    "reference": "reference",
    "servo": "servos",
    "robot": "robot",
    "sensor": "outputs",
    "own": "own blocks",
}
"""The clusters, from left to right."""

COLOURS: dict[Role, tuple[str, str]] = {  # of the cluster, of the lines of its blocks
    "reference": ("#eaf3fb", "#3f78a8"),
    "servo": ("#fdf3e3", "#b9791f"),
    "robot": ("#e9f5e9", "#3d8745"),
    "sensor": ("#f1edf8", "#735aa3"),
    "own": ("#f3f3f3", "#666666"),
}

_FONT = "Helvetica,Arial,sans-serif"
_WIRE = "#444444"
_ROW = 0.62  # inches from one joint's row to the next


def dot_text(graph: BlockGraph) -> str:
    """Return the text of a block graph; the same graph gives the same text."""
    lines = [
        f"digraph {_quoted(graph.title)} {{",
        "  rankdir=LR; ranksep=0.45; nodesep=0.16; splines=true; newrank=true;",
        f'  fontname="{_FONT}"; fontsize=13; labelloc=t; label={_quoted(_title(graph))};',
        f'  node [fontname="{_FONT}", fontsize=10, shape=box, style=filled, margin="0.10,0.05", height=0.3];',
        f'  edge [fontname="{_FONT}", fontsize=10, color="{_WIRE}", arrowsize=0.6];',
    ]
    for robot in ["", *graph.robots]:
        lines += _clusters(graph, robot)
    lines += [_arrow(graph, source, target, names) for (source, target), names in graph.arrows.items()]
    return "\n".join([*lines, "}", ""])


def _title(graph: BlockGraph) -> str:
    return f"{graph.title}\n{graph.description}".strip() + "\n "


def _clusters(graph: BlockGraph, robot: str) -> list[str]:
    """Return the clusters of a robot, or of what the robots share."""
    lines = []
    for role, title in ROLE_TITLES.items():
        blocks = [block for block in graph.blocks.values() if (block.role, block.robot) == (role, robot)]
        if not blocks:
            continue
        label = f"{robot}: {title}" if robot else title
        fill, line = COLOURS[role]
        lines.append(f"  subgraph {_quoted(f'cluster {label}')} {{")
        lines.append(f'    label={_quoted(label)}; fontsize=11; fontcolor="{line}"; style="rounded,filled";')
        lines.append(f'    color="{fill}"; fillcolor="{fill}"; margin=10;')
        lines += [f"    {_node(graph, block)}" for block in blocks]
        if role == "robot":
            lines.append(f"    {{rank=same; {'; '.join(_quoted(block.key) for block in blocks)}}}")
        lines.append("  }")
    return lines


def _node(graph: BlockGraph, block: Block) -> str:
    line = COLOURS[block.role][1]
    look = {"tooltip": ", ".join(block.systems) or block.key, "color": line, "fillcolor": "white", "label": block.label}
    if block.shape == "bar":
        slots = _slots(graph, block.key)
        ports = "|".join(f"<p{index}>" for index in range(len(slots)))
        look |= {"shape": "record", "label": ports, "fillcolor": _WIRE, "color": _WIRE, "fixedsize": "true"}
        look |= {"width": "0.07", "height": f"{_ROW * len(slots):.2f}"}
    elif block.shape == "port":
        look |= {"style": "rounded,filled", "fillcolor": line, "fontcolor": "white", "height": "0.22"}
    elif block.shape == "sum":
        look |= {"shape": "circle", "width": "0.25", "height": "0.25", "margin": "0"}
    return f"{_quoted(block.key)} [{', '.join(f'{name}={_quoted(value)}' for name, value in look.items())}];"


def _slots(graph: BlockGraph, bar: str) -> list[str]:
    """Return what the slots of a bus bar connect, on the side where it has more arrows."""
    sources = [source for source, target in graph.arrows if target == bar]
    targets = [target for source, target in graph.arrows if source == bar and _forward(graph, bar, target)]
    return max(targets, sources, key=len)


def _forward(graph: BlockGraph, source: str, target: str) -> bool:
    order: Iterable[Role] = list(ROLE_TITLES)
    places = [list(order).index(graph.blocks[key].role) for key in (source, target)]
    return places[0] <= places[1]


def _arrow(graph: BlockGraph, source: str, target: str, names: list[str]) -> str:
    look = {"label": f" {', '.join(names)} "} if names else {}
    if not _forward(graph, source, target):
        look["constraint"] = "false"
    return f"  {_end(graph, source, target, 'e')} -> {_end(graph, target, source, 'w')}" + (
        f" [{', '.join(f'{name}={_quoted(value)}' for name, value in look.items())}];" if look else ";"
    )


def _end(graph: BlockGraph, key: str, other: str, side: str) -> str:
    if graph.blocks[key].shape == "bar" and other in _slots(graph, key):
        return f"{_quoted(key)}:p{_slots(graph, key).index(other)}:{side}"
    return _quoted(key)


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
