"""The block picture as a page shows it: its blocks are buttons, for the mouse and for the keyboard."""

import re
from collections.abc import Callable
from html import unescape

from nicegui import ui

_NODE = re.compile(r'<g id="(node\d+)" class="node">\s*<title>(.*?)</title>(.*?)</g>\s*</g>', re.DOTALL)
_TEXT = re.compile(r"<text[^>]*>(.*?)</text>")
_START = re.compile(r"^.*?(?=<svg)", re.DOTALL)
_CHOOSE = """(event) => {
    const node = event.target.closest('[data-block]');
    if (!node || (event.type === 'keydown' && event.key !== 'Enter' && event.key !== ' ')) return;
    event.preventDefault();
    emit(node.dataset.block);
}"""
_LOOK = """
.block-picture svg {min-width: 48rem; max-width: 100%; height: auto; display: block; margin: auto}
.block-picture .node {cursor: pointer; outline: none}
.block-picture .node:hover polygon, .block-picture .node:hover path {stroke-width: 2}
.block-picture .node:focus-visible polygon, .block-picture .node:focus-visible path,
.block-picture .chosen polygon, .block-picture .chosen path {stroke: #d81b60; stroke-width: 3}
.body--dark .block-picture svg {filter: invert(0.9) hue-rotate(180deg)}
"""


class BlockPicture:
    """The picture of a station's blocks, of which one is chosen.

    Attributes:
        labels: what stands in each block, by its name.
        chosen: the name of the block that is marked; empty for none.
    """

    def __init__(self, on_choice: Callable[[str], object]) -> None:
        """Make an empty picture; ``on_choice`` is told the name of a block that the user chooses."""
        self.labels: dict[str, str] = {}
        self.chosen = ""
        self._svg = ""
        self._on_choice = on_choice
        ui.add_css(_LOOK)
        self._place = ui.html("").classes("block-picture w-full overflow-auto")
        self._place.on("click", lambda event: self.choose(event.args), js_handler=_CHOOSE)
        self._place.on("keydown", lambda event: self.choose(event.args), js_handler=_CHOOSE)

    def show(self, svg: str) -> None:
        """Show what Graphviz drew, with the same block chosen as before if it is there."""
        self._svg, self.labels = svg, labels_of(svg)
        self.choose(self.chosen if self.chosen in self.labels else "")

    def choose(self, block: str) -> None:
        """Mark a block, and tell of it."""
        self.chosen = block
        self._place.set_content(with_buttons(self._svg, block))
        self._on_choice(block)


def labels_of(svg: str) -> dict[str, str]:
    """Return what stands in the blocks that have words, by their names."""
    texts = {unescape(name): _TEXT.findall(inner) for _, name, inner in _NODE.findall(svg)}
    lines = {name: [unescape(line).strip() for line in found] for name, found in texts.items()}
    return {name: "\n".join(filter(None, found)) for name, found in lines.items() if any(found)}


def with_buttons(svg: str, chosen: str = "") -> str:
    """Return a drawing of Graphviz whose blocks say that they are buttons; bars, which say nothing, are none."""
    labels = labels_of(svg)

    def button(found: re.Match[str]) -> str:
        number, name = found[1], found[2]
        label = labels.get(unescape(name))
        if label is None:
            return found[0]
        mark, pressed = (" chosen", "true") if unescape(name) == chosen else ("", "false")
        attributes = f'data-block="{name}" tabindex="0" role="button" aria-pressed="{pressed}"'
        return found[0].replace(f'<g id="{number}" class="node">', f'<g id="{number}" class="node{mark}" {attributes}>')

    return _NODE.sub(button, _START.sub("", svg))
