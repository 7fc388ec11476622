"""A block graph in Graphviz' language: from left to right, a cluster for each role, signals as arrows."""

from simrob_drake.parts.captions import BlockRole
from simrob_drake.results.block_diagram.graph import BARS, ROLES, Arrow, BlockGraph, DrawnBlock

TITLES: dict[BlockRole, str] = {
    "reference": "reference",
    "loop": "outer loops",
    "servo": "servos",
    "robot": "robot",
    "scene": "scene",
    "sensor": "outputs",
    "own": "own blocks",
}
COLOURS: dict[BlockRole, tuple[str, str]] = {  # of the cluster, of the lines of its blocks
    "reference": ("#eaf3fb", "#3f78a8"),
    "loop": ("#fbeaea", "#a84b4b"),
    "servo": ("#fdf3e3", "#b9791f"),
    "robot": ("#e9f5e9", "#3d8745"),
    "sensor": ("#f1edf8", "#735aa3"),
    "scene": ("#e6f4f3", "#2f8580"),
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
    for robot in ["", *reversed(graph.robots)]:  # dot begins at the bottom
        for role in ROLES:
            lines += _cluster(graph, robot, role)
    lines += [_arrow(graph, arrow) for arrow in graph.drawn_arrows()]
    return "\n".join([*lines, "}", ""])


def _cluster(graph: BlockGraph, robot: str, role: BlockRole) -> list[str]:
    blocks = [block for block in graph.blocks.values() if (block.role, block.robot) == (role, robot)]
    if not blocks:
        return []
    label, (fill, line) = f"{robot}: {TITLES[role]}" if robot else TITLES[role], COLOURS[role]
    columns = [[block for block in blocks if block.shape == shape] for shape in ("block", "port")]
    columns = {"sensor": columns, "robot": [blocks], "reference": [blocks]}.get(role, [])
    title_at = "b" if role == "sensor" and _upper(graph, robot) else "t"  # away from where torques come in
    return [
        f"  subgraph {_quoted(f'cluster {label}')} {{",
        f'    label={_quoted(label)}; fontsize=11; fontcolor="{line}"; labeljust=l; labelloc={title_at};',
        f'    style="rounded,filled"; margin=10; color="{fill}"; fillcolor="{fill}";',
        *(f"    {_node(graph, block)}" for block in blocks),
        *(f"    {{rank=same; {'; '.join(_quoted(block.key) for block in column)}}}" for column in columns if column),
        "  }",
    ]


def _node(graph: BlockGraph, block: DrawnBlock) -> str:
    line = COLOURS[block.role][1]
    look = {"label": block.label, "color": line, "fillcolor": "white"}
    if block.shape in BARS:
        slots = _slots(graph, block.key)
        look = {"label": "|".join(f"<p{index}>" for index in range(len(slots))), "shape": "record"}
        look |= {"color": WIRE, "fillcolor": WIRE, "fixedsize": "true", "width": "0.07"}
        look["height"] = f"{_ROW * max(_rows(graph, block), len(slots)):.2f}"
    elif block.shape == "port":
        look |= {"style": "rounded,filled", "fillcolor": line, "fontcolor": "white", "height": "0.22"}
    elif block.shape == "sum":
        look |= {"shape": "circle", "width": "0.25", "height": "0.25", "margin": "0"}
    look["tooltip"] = ", ".join(block.systems) or block.key
    return f"{_quoted(block.key)} {_attributes(look)};"


def _slots(graph: BlockGraph, bar: str) -> list[str]:
    """Return the blocks at the slots of a bar, on the side where it has many; feedback where the plant is nearer."""
    sources, block = graph.sources(bar), graph.blocks[bar]
    if block.shape == "mux":
        return sources
    feedback = [source for source in sources if not graph.forward(source, bar)]
    lower = block.robot and not _upper(graph, block.robot)
    return feedback + graph.targets(bar) if lower else graph.targets(bar) + feedback


def _rows(graph: BlockGraph, block: DrawnBlock) -> int:
    """Return how many rows the bars beside a mux have, so that its arrows lie level."""
    bars = [b for b in graph.blocks.values() if b.shape in BARS and (b.role, b.robot) == (block.role, block.robot)]
    return max(len(graph.targets(bar.key)) for bar in bars) if block.shape == "mux" else 0


def _upper(graph: BlockGraph, robot: str) -> bool:
    """Tell whether a robot stands in the upper half of the picture of several."""
    return robot in graph.robots[: len(graph.robots) // 2]


def _arrow(graph: BlockGraph, arrow: Arrow) -> str:
    """Return an arrow, written from left to right also where it leads back, so that the columns stay in order."""
    source, target = arrow.source, arrow.target
    look = {"dir": "both"} if arrow.both else {}
    if not graph.forward(source, target):
        look["dir"], source, target = "back", target, source
    if graph.blocks[target].shape == "bus":
        look["weight"] = "4"  # what feeds a bus stands beside it
    if graph.blocks[source].role == graph.blocks[target].role == "servo" and graph.blocks[source].shape == "block":
        look["weight"] = "8"  # a joint is a row
    if arrow.text:
        stacked = graph.blocks[source].role == graph.blocks[target].role == "robot"  # in one column
        look["xlabel" if stacked else "label"] = f" {arrow.text} "
    ends = f"{_slot(graph, source, target, 'e')} -> {_slot(graph, target, source, 'w')}"
    return f"  {ends} {_attributes(look)};" if look else f"  {ends};"


def _slot(graph: BlockGraph, key: str, other: str, side: str) -> str:
    """Return where an arrow from or to ``other`` meets a block."""
    if graph.blocks[key].shape in BARS and other in _slots(graph, key):
        return f"{_quoted(key)}:p{_slots(graph, key).index(other)}:{side}"
    return _quoted(key)


def _attributes(look: dict[str, str]) -> str:
    return f"[{', '.join(f'{name}={_quoted(value)}' for name, value in look.items())}]"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
