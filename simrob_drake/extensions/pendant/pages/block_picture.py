"""The picture of a station's blocks: one is chosen in it, or a wire, which shows its value; zoomed and moved."""

import json
import re
from collections.abc import Awaitable, Callable, Collection, Mapping
from functools import partial
from html import escape, unescape
from typing import Any

from nicegui import ui

from simrob_drake.extensions.pendant.pages.elements import icon_button
from simrob_drake.extensions.pendant.pages.words import Words
from simrob_drake.results.block_diagram.graph import FOLDED

_NODE = re.compile(r'<g class="node"><title>(.*?)</title>(.*?)</g>', re.DOTALL)
_WIRE = re.compile(r'<g class="wire" data-wire="(\d+)" data-from="(.*?)" data-to="(.*?)">')
_TEXT = re.compile(r"<text[^>]*>(.*?)</text>")
_VALUE = re.compile(r'(<text class="value" data-value="(\d+)"[^>]*>)[^<]*')
_WIDTH = re.compile(r'<svg ([^>]*width="(\d+)")')
_SMALLEST = 0.6
"""Smallest scale at which the picture opens: its texts are 8 pixels high then, which can just be read."""
_UNTIL_DRAWN = 100
"""Time from a new drawing until a browser shows it [ms]."""
_FOLDS = {"unfold_less": True, "unfold_more": False}
_ZOOMS = {"zoom_in": 1.25, "zoom_out": 0.8, "fit_screen": 0}

Wires = Mapping[str, tuple[str, list[str]]]
"""Blocks at the ends of each wire, by its number: where it comes from, and where it goes."""


class BlockPicture:
    """The picture of a station's blocks; it can be as large as the screen, and its subsystems can be folded.

    Attributes:
        labels: what stands in each block, by its name.
        wires: where wires go.
        chosen: the name of the block that is marked; empty for none.
        folded: names of blocks whose subsystems are to be one block each.
    """

    def __init__(
        self,
        t: Words,
        on_block: Callable[[str], object],
        on_wire: Callable[[str], object],
        on_fold: Callable[[], Awaitable[object]],
        on_choice: Callable[[bool], object] = lambda by_key: None,
    ) -> None:
        """Make an empty picture.

        Args:
            t: texts in the language of the page.
            on_block: shows a block, by its name: the one that the user chooses, and again in a new drawing.
            on_wire: shows a wire that the user chooses, by its number.
            on_fold: shows another picture, with other blocks folded.
            on_choice: is called after the user has chosen a block or a wire, with whether it was done by a key.
        """
        self.labels: dict[str, str] = {}
        self.wires: Wires = {}
        self.chosen = ""
        self._svg, self._wire = "", ""
        self._values = dict[str, str]()  # what stands on the wires, by their numbers
        self.folded: list[str] = []
        self._on_block = on_block
        self._on_wire = on_wire
        self._on_fold = on_fold
        self._on_choice = on_choice
        self._changed: Collection[str] = ()
        with ui.element("div").classes("block-picture w-full") as place:
            with ui.element("div").classes("block-tools"):
                icon_button("fullscreen", t("station.enlarge")).on(
                    "click", js_handler="(event) => window.blocks.enlarge(event)"
                )
                for icon, folds in _FOLDS.items():
                    icon_button(icon, t(f"station.{icon}"), partial(self._fold, folds))
                for icon, factor in _ZOOMS.items():
                    button = icon_button(icon, t(f"station.{icon}"))
                    button.on(
                        "click", js_handler=f"(event) => window.blocks.zoom(event.target, {factor})"
                    )
            self._place = ui.html("")
        for event, what in (("wheel", "wheel"), ("pointermove", "drag"), ("keydown", "key")):
            place.on(event, js_handler=f"(event) => window.blocks.{what}(event)")
        for event in ("click", "keydown"):
            self._place.on(
                event,
                lambda event: self._choose(*event.args),
                js_handler="(event) => window.blocks.choose(event, emit)",
            )

    def show(self, svg: str) -> None:
        """Show a drawing, with the same block chosen as before if it is there. No values stand on its wires yet."""
        self._svg, self.labels, self._wire = svg, labels_of(svg), ""
        self._values = {}
        self.wires = {
            number: (unescape(source), unescape(targets).split("|"))
            for number, source, targets in _WIRE.findall(svg)
        }
        self.choose(self.chosen if self.chosen in self.labels else "")

    def mark(self, changed: Collection[str]) -> None:
        """Mark blocks as changed while they run."""
        if set(changed) != set(self._changed):
            self._changed = changed
            self._draw()

    def tell(self, values: Mapping[str, str]) -> None:
        """Write values on wires, by their numbers. They stay there when a block or a wire is chosen."""
        self._values |= values
        self._place.client.run_javascript(f"window.blocks.values({json.dumps(dict(values))})")

    def choose(self, block: str) -> None:
        """Mark a block, and tell of it."""
        self.chosen, self._wire = block, ""
        self._draw()
        self._on_block(block)

    async def _fold(self, folds: bool) -> None:
        """Fold or unfold the subsystem of the chosen block; all of them where none is chosen."""
        here = self.chosen.removeprefix(FOLDED)
        self.folded = [name.removeprefix(FOLDED) for name in self.labels if name.startswith(FOLDED)]
        if folds:
            self.folded += [here] if here else [*self.labels]
        else:
            self.folded = [name for name in self.folded if here not in ("", name)]
        self.chosen = f"{FOLDED}{here}" if folds and here else here
        await self._on_fold()

    def choose_wire(self, wire: str) -> None:
        """Mark a wire by its number, and show it."""
        self.chosen = ""
        self._wire = wire
        self._draw()
        self._on_wire(wire)

    def wires_of(self, block: str) -> list[str]:
        """Numbers of the wires that begin or end at a block."""
        return [
            number
            for number, (source, targets) in self.wires.items()
            if block == source or block in targets
        ]

    def _choose(self, block: str, wire: Any, by_key: bool = False) -> None:
        """Show what the user has chosen: a block, or a wire if it has a number."""
        if wire == "":
            self.choose(block)
        else:
            self.choose_wire(str(wire))
        self._on_choice(by_key)

    def _draw(self) -> None:
        """Draw the picture as it is now, with the chosen block or wire in sight."""
        drawn = with_buttons(self._svg, self.chosen, self._wire, self._changed)
        self._place.set_content(with_values(drawn, self._values))
        if self.chosen or self._wire:
            self._place.client.run_javascript(f"setTimeout(window.blocks.reveal, {_UNTIL_DRAWN})")


def labels_of(svg: str) -> dict[str, str]:
    """Return what stands in the blocks that have words, by their names."""
    texts = {unescape(name): _TEXT.findall(inner) for name, inner in _NODE.findall(svg)}
    lines = {name: [unescape(line).strip() for line in found] for name, found in texts.items()}
    return {name: "\n".join(filter(None, found)) for name, found in lines.items() if any(found)}


def with_buttons(svg: str, chosen: str = "", wire: str = "", changed: Collection[str] = ()) -> str:
    """Return a drawing whose blocks say that they are buttons; bars, which say nothing, are none.

    It is as wide as its place, but not so small that it cannot be read, nor larger than twice as it was drawn, until
    the user zooms. Blocks that are ``changed`` are marked, and so is the chosen block, or a wire.
    """
    labels = labels_of(svg)

    def button(found: re.Match[str]) -> str:
        name = unescape(found[1])
        if name not in labels:
            return found[0]
        marks = " chosen" * (name == chosen) + " changed" * (name in changed)
        attributes = f'data-block="{found[1]}" tabindex="0" role="button" aria-pressed="{str(name == chosen).lower()}"'
        return found[0].replace('<g class="node">', f'<g class="node{marks}" {attributes}>')

    size = rf'style="--own: \2px; min-width: calc({_SMALLEST} * \2px); max-width: calc(2 * \2px)"'
    drawn = _NODE.sub(button, _WIDTH.sub(rf"<svg {size} \1", svg, count=1))
    return drawn.replace(
        f'class="wire" data-wire="{wire}"', f'class="wire chosen" data-wire="{wire}"'
    )


def with_values(svg: str, values: Mapping[str, str]) -> str:
    """Write values on the wires of a drawing, by the numbers of the wires. Other wires have none."""
    return _VALUE.sub(lambda found: found[1] + escape(values.get(found[2], "")), svg)
