"""What mkdocs calls while it builds the site: see ``mkdocs.yml`` and, for the Spanish one, ``mkdocs.es.yml``."""

import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page as SitePage

from docs.site import api, commands, keys, parts, places
from docs.site.texts import Page

TOP = {False: ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"), True: ("README.es.md",)}
"""Pages at the top of the repository that stand on each site; the second is the Spanish one."""


TITLES = {
    "Start": "Inicio",
    "Lessons": "Lecciones",
    "Course": "Curso",
    "How to": "Guías",
    "Results": "Resultados",
}
"""Those of the navigation in Spanish."""
ENGLISH_ALONE = ("Reference", "Decisions")
"""Sections of the navigation whose pages are in English alone: made from the code, or written for developers."""
FROM_TOP = "site:"
"""Before links that count from the top of the whole site."""
SPANISH_ALONE = ("simrob.md",)


def is_spanish(config: MkDocsConfig) -> bool:
    """Tell whether it is the Spanish site that is built."""
    return str(config.theme["language"]) == "es"


@cache
def reference() -> list[Page]:
    """Return the pages of reference, which are made from the code."""
    return [page for maker in (keys, commands, parts, api) for page in maker.pages()]


def made(config: MkDocsConfig) -> Iterator[Page]:
    """Yield the pages that are in no file below the site's folder."""
    for name in TOP[is_spanish(config)]:
        # else it is called as the start
        title = "---\ntitle: README\n---\n\n" if name.startswith("README") else ""
        yield Page(
            f"{name.split('.')[0].lower()}.md",
            title + (places.ROOT / name).read_text(encoding="utf-8"),
        )
    if not is_spanish(config):
        yield from reference()
        yield from places.shown_files()


def with_pages_below(entry: Any) -> Any:
    """Return an entry of the navigation with the pages of reference that lie in the folder of its page's name."""
    if isinstance(entry, dict):
        return {title: [with_pages_below(page) for page in pages] for title, pages in entry.items()}
    folder = entry.removesuffix("index.md")
    below = [page.path for page in reference() if page.path.startswith(folder) and page.path != entry]
    title = next((page.text.partition("\n")[0] for page in reference() if page.path == entry), "")
    return {title.strip("# `"): [entry, *below]} if entry.endswith("index.md") else entry


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the lessons into the navigation; the Spanish one is the English one, without what there is not in Spanish."""
    folder, entries = Path(config.docs_dir), list(config.nav or [])
    for name in reversed(places.FOLDERS):
        below = folder / (places.FOLDERS[name] if is_spanish(config) else name)
        if found := sorted(below.glob("*.md"), key=lambda page: (page.stem != "README", page.stem)):
            entries.insert(1, {name.capitalize(): [page.relative_to(folder).as_posix() for page in found]})
    if not is_spanish(config):
        entries = [with_pages_below(entry) for entry in entries]
    else:
        entries = [
            {TITLES[title]: [page for page in pages if (folder / page).is_file() or page == "readme.md"]}
            for entry in entries
            for title, pages in entry.items()
            if title not in ENGLISH_ALONE
        ]
        entries.append({"Referencia (en inglés)": "../reference/python/index.html"})
        next(entry["Guías"] for entry in entries if "Guías" in entry).extend(SPANISH_ALONE)
    config.nav = entries
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made, and the pictures from elsewhere."""
    for page in made(config):
        files.append(File.generated(config, page.path, content=page.text))
    if not is_spanish(config):
        for place, source in places.copied_files():
            files.append(File.generated(config, place, abs_src_path=str(source)))
    return files


def on_page_markdown(markdown: str, page: SitePage, config: MkDocsConfig, **_: Any) -> str:
    """Let links lead to where on the site things are."""
    return places.rewritten(markdown, places.repository_path(page.file.src_uri, spanish=is_spanish(config)))


def on_page_context(context: dict[str, Any], page: SitePage, config: MkDocsConfig, **_: Any) -> dict[str, Any]:
    """Let the choice of a language lead to the same page in it, where there is one."""
    spanish = is_spanish(config)
    source = places.repository_path(page.file.src_uri, spanish=spanish)
    other = places.place(places.twin(source) or ("docs/README.md" if spanish else "docs/es/README.md"))
    for entry in config.extra["alternate"]:
        own = (entry["lang"] == "es") == spanish
        entry["link"] = f"{FROM_TOP}{place_of(page, config) if own else other}"
    return context


def place_of(page: SitePage, config: MkDocsConfig) -> str:
    """Return where a page is on the whole site, as a path from its top."""
    return f"{'es/' if is_spanish(config) else ''}{page.file.dest_uri}"


def on_post_page(output: str, page: SitePage, config: MkDocsConfig) -> str:
    """Make links from the top of the site relative; mkdocs leads out of no folder of a site that is in another."""
    here = os.path.dirname(place_of(page, config)) or "."
    return re.sub(
        rf'href="{FROM_TOP}([^"]+)"',
        lambda link: f'href="{os.path.relpath(link[1], here)}"',
        output,
    )
