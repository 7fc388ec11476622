"""Every sensor, monitor, reference, force and controller, from its declaration: a page a family, a section a kind."""

import sys
from collections.abc import Iterator
from inspect import getdoc, getmembers, isclass
from typing import Any

from docs.site.keys import key_table
from docs.site.texts import Page, markdown, sentence, table
from simrob_drake.blocks.block import Block
from simrob_drake.parts import controllers, forces, monitors, references, sensors
from simrob_drake.parts.kinds import Kinds
from simrob_drake.stations.schema import station_schema

FOLDER = "reference/parts"
FAMILIES: dict[str, Kinds] = {
    "sensors": sensors.KINDS,
    "monitors": monitors.KINDS,
    "references": references.KINDS,
    "forces": forces.KINDS,
    "controllers": controllers.KINDS,
}
KEY = {"references": "reference"}
"""The key of a station that a family stands under, where it is another word."""


def blocks_of(model: type[Any]) -> list[type[Any]]:
    """Return the blocks that stand in the module of a kind."""
    module = sys.modules[model.__module__]
    return [
        block
        for _, block in getmembers(module, isclass)
        if issubclass(block, Block) and block.__module__ == module.__name__ and not block.__name__.startswith("_")
    ]


def kind_text(kind: str, model: type[Any], schema: dict[str, Any], keys: str) -> str:
    """Return what there is to say of a kind: what it does, its law, its keys, what it adds, the ports of its blocks."""
    module = sys.modules[model.__module__]
    parts = [f"## {kind}", markdown(getdoc(model) or ""), markdown(module.__doc__ or "")]
    parts.append(key_table(schema["$defs"][model.__name__], keys))
    if "wire" in vars(model) and (added := getdoc(model.wire)):
        parts.append(f"**In a station.** {markdown(added)}")
    parts += [
        f"### {block.__name__} {{ #{kind}-{block.__name__.lower()} }}\n\n{markdown(getdoc(block) or '')}"
        for block in blocks_of(model)
    ]
    return "\n\n".join(part for part in parts if part)


def family_page(family: str, kinds: Kinds, schema: dict[str, Any]) -> Page:
    """Return the page of a family."""
    key = KEY.get(family, family)
    keys = f"../keys/station/{key}.md"
    rows = [[f"[`{kind}`](#{kind})", sentence(getdoc(model) or "")] for kind, model in kinds.models.items()]
    summary = table(["kind", "what it does"], rows)
    head = f"# {family.capitalize()}\n\nKinds of the key [`{key}`]({keys}) of a station.\n\n{summary}"
    texts = [kind_text(kind, model, schema, keys) for kind, model in kinds.models.items()]
    return Page(f"{FOLDER}/{family}.md", "\n\n".join([head, *texts]) + "\n")


def pages() -> Iterator[Page]:
    """Yield the pages of all families."""
    schema = station_schema()
    for family, kinds in FAMILIES.items():
        yield family_page(family, kinds, schema)
