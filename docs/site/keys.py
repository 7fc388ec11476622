"""Every key of every YAML file, from the schemas by which editors complete them: a page a section."""

import json
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from docs.site.texts import Page, cell, markdown, table
from simrob_drake.base.sections import file_schema
from simrob_drake.extensions.learning.task import Task
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.programs.schemas import model_schemas
from simrob_drake.stations.schema import station_schema

Schema = Mapping[str, Any]
FOLDER = "reference/keys"
LIMITS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
PLAIN = {
    "number": "number",
    "integer": "whole number",
    "boolean": "true or false",
    "string": "text",
    "object": "a section",
}
PER_AXIS = "number or list of number or by name: number"


def schemas() -> dict[str, Schema]:
    """Return the schema of each kind of file, by the name that examples give it."""
    others = {name.split(".")[0]: schema for name, schema in model_schemas().items()}
    return {
        "station": station_schema(),
        **others,
        "study": file_schema(Study),
        "task": file_schema(Task),
    }


def referred(schema: Schema) -> str:
    """Return the name of the section that a schema refers to, or nothing."""
    return str(schema["$ref"]).rpartition("/")[2] if "/$defs/" in schema.get("$ref", "") else ""


@cache
def kinds() -> Mapping[str, str]:
    """Return what sections that come in kinds are called in files, by their classes."""
    found = {
        name: section.get("properties", {}).get("kind", {}).get("const")
        for schema in schemas().values()
        for name, section in schema.get("$defs", {}).items()
    }
    return {name: str(kind) for name, kind in found.items() if kind}


def called(section: str) -> str:
    """Return what a section is called: by its kind, if it comes in kinds."""
    return f"`{kinds()[section]}`" if section in kinds() else section


def anchor(section: str) -> str:
    """Return where a section stands on its page."""
    return section.lower()


def _bounds(value: Schema) -> str:
    found = [f"{sign} {value[key]:g}" for key, sign in LIMITS.items() if key in value and abs(value[key]) < 1e12]
    return f" {', '.join(found)}" if found else ""


def shown_type(value: Schema, here: str = "") -> str:
    """Return in words what a value may be, with links to the sections that it may be."""
    if name := referred(value):
        return f"[{called(name)}]({here}#{anchor(name)})"
    if values := [value["const"]] if "const" in value else value.get("enum"):
        return ", ".join(f"`{choice}`" for choice in values)
    if choices := value.get("anyOf") or value.get("oneOf"):
        shown = dict.fromkeys(shown_type(choice, here) for choice in choices if choice.get("type") != "null")
        return " or ".join(shown).replace(PER_AXIS, "number, a list, or by axis")
    return _shown_collection(value, here) or PLAIN.get(value.get("type", ""), "anything") + _bounds(value)


def _shown_collection(value: Schema, here: str) -> str:
    """Return what a list or a mapping holds, or nothing of anything else."""
    if value.get("type") == "array":
        size = f"{value['minItems']} × " if value.get("minItems") == value.get("maxItems", 0) else ""
        inner = value.get("items") or {"anyOf": value.get("prefixItems", [{}])}
        return f"list of {size}{shown_type(inner, here) if inner is not True else 'anything'}"
    named = value.get("additionalProperties")
    return f"by name: {shown_type(named, here)}" if isinstance(named, dict) else ""


def _default(value: Schema, required: bool) -> str:
    if required:
        return "required"
    default = value.get("default")
    text = json.dumps(default, ensure_ascii=False)
    return "" if default is None or len(text) > 40 else f"`{text.strip(chr(34)) or chr(34) * 2}`"


def key_table(section: Schema, here: str = "") -> str:
    """Return the keys of a section: what each may be, its default, what it means."""
    required = section.get("required", ())
    rows = [
        [f"`{key}`", shown_type(value, here).replace("|", "\\|"), _default(value, key in required),
         cell(value.get("description", ""))]
        for key, value in section.get("properties", {}).items()
    ]  # fmt: skip
    return table(["key", "value", "default", "what it is"], rows) if rows else ""


def _sections(schema: Schema, key: Schema, seen: dict[str, None]) -> dict[str, None]:
    """Return the names of all sections that a key leads to, the nearest first."""
    text = json.dumps(key)
    for name in schema.get("$defs", {}):
        if f'"#/$defs/{name}"' in text and name not in seen:
            seen[name] = None
            _sections(schema, schema["$defs"][name], seen)
    return seen


def _told(text: str) -> str:
    return markdown(text) + "\n" if text else ""


def section_text(schema: Schema, name: str, level: str = "##") -> str:
    """Return what there is to say of a section."""
    section = schema["$defs"][name]
    title = f"`kind: {kinds()[name]}`" if name in kinds() else name
    heading = f"{level} {title} {{ #{anchor(name)} }}"
    return "\n".join([heading, "", _told(section.get("description", "")), key_table(section)])


def key_page(file: str, schema: Schema, key: str) -> Page:
    """Return the page of a top key: what it may be, and each section below it."""
    value = schema["properties"][key]
    where = f"A key of `{file}.yaml`: {shown_type(value)}."
    default = _default(value, key in schema.get("required", ()))
    parts = [f"# `{key}` ({file})", _told(value.get("description", "")), where]
    parts += [f"Default: {default}."] if default.startswith("`") else []
    parts += [section_text(schema, name) for name in _sections(schema, value, {})]
    return Page(f"{FOLDER}/{file}/{key}.md", "\n\n".join(parts) + "\n")


def file_pages(file: str, schema: Schema) -> Iterator[Page]:
    """Yield the page of a kind of file, and those of its keys that are sections."""
    rows = []
    for key, value in schema["properties"].items():
        whole = bool(_sections(schema, value, {}))
        if whole:
            yield key_page(file, schema, key)
        shown = "a section" if whole else shown_type(value)
        required = key in schema.get("required", ())
        link = f"[`{key}`]({key}.md)" if whole else f"`{key}`"
        rows.append([link, shown, _default(value, required), cell(value.get("description", ""))])
    columns = ["key", "value", "default", "what it is"]
    text = f"# `{file}.yaml`\n\n{_told(schema.get('description', ''))}\n{table(columns, rows)}"
    yield Page(f"{FOLDER}/{file}/index.md", text)


def pages() -> Iterator[Page]:
    """Yield the pages of all files."""
    for file, schema in schemas().items():
        yield from file_pages(file, schema)
