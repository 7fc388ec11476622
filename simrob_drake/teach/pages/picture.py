"""The block picture as a page shows it: its blocks are buttons, for the mouse and for the keyboard."""

import re
from collections.abc import Callable
from html import unescape

from nicegui import ui

_NODE = re.compile(r'<g class="node"><title>(.*?)</title>(.*?)</g>', re.DOTALL)
_TEXT = re.compile(r"<text[^>]*>(.*?)</text>")
_WIDTH = re.compile(r'<svg ([^>]*width="(\d+)")')
_CHOOSE = """(event) => {
    const node = event.target.closest('[data-block]');
    if (!node || (event.type === 'keydown' && event.key !== 'Enter' && event.key !== ' ')) return;
    event.preventDefault();
    emit(node.dataset.block);
}"""
_ENLARGE = """(event) => {
    const picture = event.target.closest('.block-picture');
    document.fullscreenElement ? document.exitFullscreen() : picture.requestFullscreen();
}"""
_LOOK = """
.block-picture {overflow: auto}
.block-picture svg {width: 100%; height: auto; display: block; margin: auto}
.block-picture:fullscreen {background: #fff}
.block-picture:fullscreen svg {min-width: 0 !important}
.body--dark .block-picture:fullscreen {background: #191919}
.block-picture .q-btn {position: sticky; left: calc(100% - 3rem)}
.block-picture .node {cursor: pointer; outline: none}
.block-picture .node:hover > path:first-of-type {stroke-width: 2}
.block-picture .node:focus-visible > path:first-of-type,
.block-picture .chosen > path:first-of-type {stroke: #d81b60; stroke-width: 3}
.body--dark .block-picture svg {filter: invert(0.9) hue-rotate(180deg)}
"""


class BlockPicture:
    """The picture of a station's blocks, of which one is chosen; it can be as large as the screen.

    Attributes:
        labels: what stands in each block, by its name.
        chosen: the name of the block that is marked; empty for none.
    """

    def __init__(self, on_choice: Callable[[str], object], enlarge: str) -> None:
        """Make an empty picture.

        Args:
            on_choice: is told the name of a block that the user chooses.
            enlarge: what the button is called that shows it as large as the screen.
        """
        self.labels: dict[str, str] = {}
        self.chosen = ""
        self._svg = ""
        self._on_choice = on_choice
        ui.add_css(_LOOK)
        with ui.element("div").classes("block-picture w-full"):
            whole = ui.button(icon="fullscreen").props(f'flat round dense aria-label="{enlarge}"').tooltip(enlarge)
            whole.on("click", js_handler=_ENLARGE)
            self._place = ui.html("")
        self._place.on("click", lambda event: self.choose(event.args), js_handler=_CHOOSE)
        self._place.on("keydown", lambda event: self.choose(event.args), js_handler=_CHOOSE)

    def show(self, svg: str) -> None:
        """Show a drawing, with the same block chosen as before if it is there."""
        self._svg, self.labels = svg, labels_of(svg)
        self.choose(self.chosen if self.chosen in self.labels else "")

    def choose(self, block: str) -> None:
        """Mark a block, and tell of it."""
        self.chosen = block
        self._place.set_content(with_buttons(self._svg, block))
        self._on_choice(block)


def labels_of(svg: str) -> dict[str, str]:
    """Return what stands in the blocks that have words, by their names."""
    texts = {unescape(name): _TEXT.findall(inner) for name, inner in _NODE.findall(svg)}
    lines = {name: [unescape(line).strip() for line in found] for name, found in texts.items()}
    return {name: "\n".join(filter(None, found)) for name, found in lines.items() if any(found)}


def with_buttons(svg: str, chosen: str = "") -> str:
    """Return a drawing whose blocks say that they are buttons; bars, which say nothing, are none.

    It is as wide as its place, but never so small that it cannot be read, nor larger than twice as it was drawn.
    """
    labels = labels_of(svg)

    def button(found: re.Match[str]) -> str:
        name = found[1]
        if unescape(name) not in labels:
            return found[0]
        mark, pressed = (" chosen", "true") if unescape(name) == chosen else ("", "false")
        attributes = f'data-block="{name}" tabindex="0" role="button" aria-pressed="{pressed}"'
        return found[0].replace('<g class="node">', f'<g class="node{mark}" {attributes}>')

    sized = _WIDTH.sub(r'<svg style="min-width: calc(0.9 * \2px); max-width: calc(2 * \2px)" \1', svg, count=1)
    return _NODE.sub(button, sized)
