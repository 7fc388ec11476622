"""Every sensor, monitor, reference, force and controller, from its declaration: a page a family, a section a kind."""

import sys
from collections.abc import Iterator
from inspect import getdoc, isclass
from itertools import takewhile
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
    """Return the blocks of a kind: those that stand in its module, of several kinds each between it and the next."""
    classes = [one for one in vars(sys.modules[model.__module__]).values() if isclass(one)]
    own = [one for one in classes if one.__module__ == model.__module__]
    after = takewhile(lambda one: not _is_kind(one), own[own.index(model) + 1 :])
    blocks = own if sum(map(_is_kind, own)) == 1 else after
    return [block for block in blocks if issubclass(block, Block) and not block.__name__.startswith("_")]


def _is_kind(model: type[Any]) -> bool:
    """Tell whether a class is a kind of part, whose key `kind` has one value alone."""
    kind = getattr(model, "model_fields", {}).get("kind")
    return kind is not None and kind.annotation is not str


def kind_text(kind: str, model: type[Any], schema: dict[str, Any], keys: str) -> str:
    """Return what there is to say of a kind: what it does, its law, its keys, what it adds, the ports of its blocks."""
    module = sys.modules[model.__module__]
    alone = sum(isclass(one) and _is_kind(one) and one.__module__ == module.__name__ for one in vars(module).values())
    law = markdown(module.__doc__ or "") if alone == 1 else ""
    parts = [f"## {kind}", markdown(getdoc(model) or ""), law]
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
