"""A block graph as text: for Graphviz, and as a Mermaid flowchart, which GitHub and many editors draw in Markdown."""

from collections.abc import Iterator

from simrob_drake.parts.captions import BlockRole
from simrob_drake.results.block_diagram.graph import BARS, ROLES, Arrow, BlockGraph, DrawnBlock

TITLES: dict[BlockRole, str] = {
    "reference": "reference",
    "loop": "outer loops",
    "own": "own blocks",
    "servo": "servos",
    "force": "forces",
    "robot": "robot",
    "scene": "scene",
    "sensor": "sensors and outputs",
}
COLOURS: dict[BlockRole, tuple[str, str]] = {  # of the blocks, and of their edges
    "reference": ("#eaf3fb", "#3f78a8"),
    "loop": ("#fbeaea", "#a84b4b"),
    "servo": ("#fdf3e3", "#b9791f"),
    "force": ("#f7f3d2", "#857715"),
    "robot": ("#e9f5e9", "#3d8745"),
    "sensor": ("#f1edf8", "#735aa3"),
    "scene": ("#e6f4f3", "#2f8580"),
    "own": ("#f3f3f3", "#666666"),
}
WIRE = "#444444"

_FONT = "Helvetica,Arial,sans-serif"


def dot_text(graph: BlockGraph) -> str:
    """Return a block graph in Graphviz' language; the same graph gives the same text."""
    graph = graph.folded()
    title = f"{graph.title}\n{graph.description}".strip() + "\n "
    lines = [
        f"digraph {_quoted(graph.title)} {{",
        "  rankdir=LR; ranksep=0.4; nodesep=0.15; newrank=true;",
        f'  fontname="{_FONT}"; fontsize=12; labelloc=t; label={_quoted(title)};',
        f'  node [fontname="{_FONT}", fontsize=10, shape=box, style=filled, margin="0.16,0.05", height=0.3];',
        f'  edge [fontname="{_FONT}", fontsize=10, color="{WIRE}", arrowsize=0.6];',
    ]
    for name, role, blocks in _clusters(graph):
        fill, line = COLOURS[role]
        lines += [
            f"  subgraph {_quoted(f'cluster {name}')} {{",
            f'    label={_quoted(name)}; fontsize=11; fontcolor="{line}"; labeljust=l;',
            f'    style="rounded,filled"; margin=10; color="{fill}"; fillcolor="{fill}";',
            *(f"    {_node(block)}" for block in blocks),
            "  }",
        ]
    lines += [_edge(graph, arrow) for arrow in graph.drawn_arrows()]
    return "\n".join([*lines, "}", ""])


def _clusters(graph: BlockGraph) -> Iterator[tuple[str, BlockRole, list[DrawnBlock]]]:
    """Yield the blocks of one robot and role, with what they are called together."""
    for robot in ["", *graph.robots]:
        for role in ROLES:
            blocks = [block for block in graph.blocks.values() if (block.role, block.robot) == (role, robot)]
            if blocks:
                yield f"{robot}: {TITLES[role]}" if robot else TITLES[role], role, blocks


def _node(block: DrawnBlock) -> str:
    line = COLOURS[block.role][1]
    look = {"label": block.text, "color": line, "fillcolor": "white"}
    if block.shape in BARS:
        look |= {"color": WIRE, "fillcolor": WIRE, "width": "0.07", "fixedsize": "true"}
    elif block.shape == "port":
        look |= {"style": "rounded,filled", "fillcolor": line, "fontcolor": "white", "height": "0.22"}
    elif block.shape == "sum":
        look |= {"shape": "circle", "width": "0.25", "height": "0.25", "margin": "0"}
    look["tooltip"] = ", ".join(block.systems) or block.key
    return f"{_quoted(block.key)} {_attributes(look)};"


def _edge(graph: BlockGraph, arrow: Arrow) -> str:
    """Return an arrow, written from left to right also where it leads back, so that the columns stay in order."""
    ends, look = [arrow.source, arrow.target], {"dir": "both"} if arrow.both else {}
    if not graph.forward(*ends):
        look["dir"], ends = "back", ends[::-1]
    if arrow.text:
        look["label"] = f" {arrow.text} "
    return f"  {' -> '.join(map(_quoted, ends))}{f' {_attributes(look)}' if look else ''};"


def _attributes(look: dict[str, str]) -> str:
    return f"[{', '.join(f'{name}={_quoted(value)}' for name, value in look.items())}]"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def mermaid_text(graph: BlockGraph) -> str:
    """Return a block graph as a flowchart; the same graph gives the same text."""
    graph = graph.folded()
    names = {key: f"b{index}" for index, key in enumerate(graph.blocks)}
    lines = ["---", f"title: {_marked(graph.title)}", "---", "flowchart LR"]
    for number, (name, _, blocks) in enumerate(_clusters(graph)):
        lines.append(f"  subgraph s{number}[{_marked(name)}]")
        lines += [f"    {names[block.key]}{_shape(block)}" for block in blocks]
        lines.append("  end")
    for arrow in graph.drawn_arrows():
        label = f"|{_marked(arrow.text)}|" if arrow.text else ""
        lines.append(f"  {names[arrow.source]} {'<-->' if arrow.both else '-->'}{label} {names[arrow.target]}")
    lines.append(f"  classDef bar fill:{WIRE},stroke:{WIRE}")
    for role, (_, line) in COLOURS.items():
        lines.append(f"  classDef {role} fill:#ffffff,stroke:{line},color:#000000")
        lines.append(f"  classDef {role}_port fill:{line},stroke:{line},color:#ffffff")
    return "\n".join([*lines, ""])


def _shape(block: DrawnBlock) -> str:
    """Return a block's outline, text and style."""
    if block.shape in BARS:
        return '((" ")):::bar'
    text = _marked(block.text)
    if block.shape == "port":
        return f"([{text}]):::{block.role}_port"
    return f"(({text})):::{block.role}" if block.shape == "sum" else f"[{text}]:::{block.role}"


def _marked(text: str) -> str:
    return '"' + text.replace('"', "#quot;").replace("<", "#lt;").replace("\n", "<br/>") + '"'
