"""A block graph as a Mermaid flowchart, which GitHub and many editors draw inside of Markdown."""

from simrob_drake.results.block_diagram.dot import COLOURS, TITLES, WIRE
from simrob_drake.results.block_diagram.graph import BARS, ROLES, BlockGraph, DrawnBlock


def mermaid_text(graph: BlockGraph) -> str:
    """Return the text of a block graph; the same graph gives the same text."""
    names = {key: f"b{index}" for index, key in enumerate(graph.blocks)}
    lines = ["---", f"title: {_quoted(graph.title)}", "---", "flowchart LR"]
    for robot in ["", *graph.robots]:
        for role in ROLES:
            blocks = [block for block in graph.blocks.values() if (block.role, block.robot) == (role, robot)]
            if blocks:
                title = f"{robot}: {TITLES[role]}" if robot else TITLES[role]
                lines.append(f"  subgraph {f'{role}_of_{robot}' if robot else role}s[{_quoted(title)}]")
                lines += [f"    {names[block.key]}{_shape(block)}" for block in blocks]
                lines.append("  end")
    for arrow in graph.drawn_arrows():
        label = f"|{_quoted(arrow.text)}|" if arrow.text else ""
        lines.append(f"  {names[arrow.source]} {'<-->' if arrow.both else '-->'}{label} {names[arrow.target]}")
    return "\n".join([*lines, *_styles(), ""])


def _shape(block: DrawnBlock) -> str:
    """Return a block's outline, text and style."""
    if block.shape in BARS:
        return '((" ")):::bar'
    text = _quoted(block.label)
    if block.shape == "port":
        return f"([{text}]):::{block.role}_port"
    return f"(({text})):::{block.role}" if block.shape == "sum" else f"[{text}]:::{block.role}"


def _styles() -> list[str]:
    lines = [f"  classDef bar fill:{WIRE},stroke:{WIRE}"]
    for role, (_, line) in COLOURS.items():
        lines.append(f"  classDef {role} fill:#ffffff,stroke:{line},color:#000000")
        lines.append(f"  classDef {role}_port fill:{line},stroke:{line},color:#ffffff")
    return lines


def _quoted(text: str) -> str:
    return '"' + text.replace('"', "#quot;").replace("<", "#lt;").replace("\n", "<br/>") + '"'
