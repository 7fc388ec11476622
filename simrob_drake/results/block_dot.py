"""A block graph in Graphviz' language: from left to right, a cluster for each role, signals as arrows."""

from __future__ import annotations

from simrob_drake.results.block_graph import Block, BlockGraph
from simrob_drake.results.block_places import ROLES, Role

TITLES: dict[Role, str] = {
    "reference": "reference",
    "servo": "servos",
    "robot": "robot",
    "sensor": "outputs",
    "own": "own blocks",
}
COLOURS: dict[Role, tuple[str, str]] = {  # of the cluster, of the lines of its blocks
    "reference": ("#eaf3fb", "#3f78a8"),
    "servo": ("#fdf3e3", "#b9791f"),
    "robot": ("#e9f5e9", "#3d8745"),
    "sensor": ("#f1edf8", "#735aa3"),
    "own": ("#f3f3f3", "#666666"),
}
WIRE = "#444444"

_FONT = "Helvetica,Arial,sans-serif"
_ROW = 0.55  # inches from one slot of a bus bar to the next


def dot_text(graph: BlockGraph) -> str:
    """Return the text of a block graph; the same graph gives the same text."""
    title = f"{graph.title}\n{graph.description}".strip() + "\n "
    lines = [
        f"digraph {_quoted(graph.title)} {{",
        "  rankdir=LR; ranksep=0.4; nodesep=0.15; newrank=true;",
        f'  fontname="{_FONT}"; fontsize=12; labelloc=t; label={_quoted(title)};',
        f'  node [fontname="{_FONT}", fontsize=10, shape=box, style=filled, margin="0.10,0.05", height=0.3];',
        f'  edge [fontname="{_FONT}", fontsize=10, color="{WIRE}", arrowsize=0.6];',
    ]
    for robot in ["", *graph.robots]:
        for role in ROLES:
            lines += _cluster(graph, robot, role)
    lines += [arrow for ends in graph.arrows if (arrow := _arrow(graph, *ends))]
    return "\n".join([*lines, "}", ""])


def _cluster(graph: BlockGraph, robot: str, role: Role) -> list[str]:
    blocks = [block for block in graph.blocks.values() if (block.role, block.robot) == (role, robot)]
    if not blocks:
        return []
    label, (fill, line) = f"{robot}: {TITLES[role]}" if robot else TITLES[role], COLOURS[role]
    columns = [blocks] if role == "robot" else []
    if role == "sensor":
        columns = [[block for block in blocks if block.shape == shape] for shape in ("block", "port")]
    return [
        f"  subgraph {_quoted(f'cluster {label}')} {{",
        f'    label={_quoted(label)}; fontsize=11; fontcolor="{line}"; style="rounded,filled"; margin=10;',
        f'    color="{fill}"; fillcolor="{fill}";',
        *(f"    {_node(graph, block)}" for block in blocks),
        *(f"    {{rank=same; {'; '.join(_quoted(block.key) for block in column)}}}" for column in columns if column),
        "  }",
    ]


def _node(graph: BlockGraph, block: Block) -> str:
    line = COLOURS[block.role][1]
    look = {"label": block.label, "color": line, "fillcolor": "white"}
    if block.shape == "bar":
        slots = _slots(graph, block.key)
        look = {"label": "|".join(f"<p{index}>" for index in range(len(slots))), "shape": "record"}
        look |= {"color": WIRE, "fillcolor": WIRE, "fixedsize": "true", "width": "0.07"}
        look["height"] = f"{_ROW * len(slots):.2f}"
    elif block.shape == "port":
        look |= {"style": "rounded,filled", "fillcolor": line, "fontcolor": "white", "height": "0.22"}
    elif block.shape == "sum":
        look |= {"shape": "circle", "width": "0.25", "height": "0.25", "margin": "0"}
    look["tooltip"] = ", ".join(block.systems) or block.key
    return f"{_quoted(block.key)} {_attributes(look)};"


def _slots(graph: BlockGraph, bar: str) -> list[str]:
    """Return the blocks at the slots of a bus bar, on the side where it has more of them; feedback comes last."""
    sources, targets = graph.sources(bar), graph.targets(bar)
    if len(sources) > len(targets):
        return sources
    return targets + [source for source in sources if not graph.forward(source, bar)]


def _arrow(graph: BlockGraph, source: str, target: str) -> str:
    """Return an arrow; two blocks of one column that exchange signals share one with two heads."""
    signals = ", ".join(graph.arrows[source, target])
    back = graph.arrows.get((target, source))
    look = {}
    if back is not None and {graph.blocks[source].role, graph.blocks[target].role} == {"robot"}:
        if list(graph.blocks).index(source) > list(graph.blocks).index(target):
            return ""
        look["dir"], signals = "both", f"{signals} / {', '.join(back)}"
    if signals:
        look["label"] = f" {signals} "
    out, into = _slot(graph, source, target, "e"), _slot(graph, target, source, "w")
    if not graph.forward(source, target):
        out, into = _slot(graph, source, target, "w"), _slot(graph, target, source, "e")
    return f"  {out} -> {into}{f' {_attributes(look)}' if look else ''};"


def _slot(graph: BlockGraph, key: str, other: str, side: str) -> str:
    """Return where an arrow from or to ``other`` meets a block."""
    if graph.blocks[key].shape == "bar" and other in _slots(graph, key):
        return f"{_quoted(key)}:p{_slots(graph, key).index(other)}:{side}"
    return _quoted(key)


def _attributes(look: dict[str, str]) -> str:
    return f"[{', '.join(f'{name}={_quoted(value)}' for name, value in look.items())}]"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
