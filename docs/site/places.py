"""Where the files of the repository are on the site, and the links of its pages that lead out of their folder.

Pages of ``docs/`` stay where they are, those of ``docs/es/`` are a site of their own below ``es/``. Those at the top of
the repository stand beside them, and whatever else is linked to, such as examples, is shown below ``files/``.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from docs.site.texts import Page

ROOT = Path(__file__).parents[2]
SPANISH = "docs/es/"
LINK = re.compile(r"(?<!\\)\]\((?!https?:|#|mailto:)([^)#\s]*)(#[^)\s]*)?\)")
FOLDERS = {"lessons": "lecciones", "course": "curso"}
"""Those whose pages all stand in the navigation, README.md first, then by name; and what they are called in Spanish."""
ALIKE = {"teachers.md": "profesores.md", "profesores.md": "teachers.md"}
AS_THEY_ARE = {".svg", ".png", ".webp", ".gif"}
SELDOM_SOUGHT = "---\nsearch: {boost: 0.2}\n---\n\n"
LANGUAGES = {".py": "python", ".yaml": "yaml", ".json": "json"}


def repository_path(source: str, *, spanish: bool = False) -> str:
    """Return the path in the repository of a page of a site, by its path in the folder that the site is built from.

    A made page stands where its links would lead if it were in the repository.
    """
    if spanish:
        return "README.es.md" if source == "readme.md" else f"{SPANISH}{source}"
    top = {
        "readme.md": "README.md",
        "changelog.md": "CHANGELOG.md",
        "contributing.md": "CONTRIBUTING.md",
    }
    return top.get(source, f"docs/{source}")


def place(path: str) -> str:
    """Return where on the site the file or folder of the repository with this path is, as a path from its top."""
    file = ROOT / path
    if path == "README.es.md":
        return "es/readme.html"
    if path.startswith("docs/"):
        inside = PurePosixPath(path).relative_to("docs")
        if inside.suffix == ".md":
            return str(inside.with_name("index.html" if inside.name == "README.md" else f"{inside.stem}.html"))
        return str(inside / "index.html" if file.is_dir() else inside)
    if "/" not in path and file.suffix == ".md":
        return f"{file.stem.lower()}.html"
    if file.is_dir():
        return f"files/{path}/index.html"
    return f"files/{path}" if file.suffix in AS_THEY_ARE else f"files/{path}.html"


def twin(path: str) -> str | None:
    """Return the path of the same page in the other language; None where there is none.

    Both are called alike, but for the folders of lessons and of the course, in which pages have numbers.
    """
    if path in ("README.md", "README.es.md"):
        return "README.es.md" if path == "README.md" else "README.md"
    if not path.startswith("docs/"):
        return None
    spanish = path.startswith(SPANISH)
    inside = PurePosixPath(path).relative_to(SPANISH if spanish else "docs")
    names = {there: here for here, there in FOLDERS.items()} if spanish else FOLDERS
    folder = ROOT / ("docs" if spanish else SPANISH) / Path(*(names.get(part, part) for part in inside.parent.parts))
    number = re.match(r"\d+-", inside.name)
    others = sorted(folder.glob(f"{number[0]}*.md" if number else ALIKE.get(inside.name, inside.name)))
    return others[0].relative_to(ROOT).as_posix() if others else None


def target(page: str, link: str) -> str:
    """Return the path in the repository that a link of the page with this path leads to."""
    return os.path.normpath(os.path.join(os.path.dirname(page), link))


def rewritten(text: str, page: str) -> str:
    """Return the text of a page with those links changed that lead out of the folder of its site."""
    own = SPANISH if page.startswith(SPANISH) or page == "README.es.md" else "docs/"
    here = os.path.dirname(place(page))

    def changed(match: re.Match[str]) -> str:
        link, anchor = match[1], match[2] or ""
        to = target(page, link) if link else page
        stays = to.startswith(own) and (own == SPANISH or not to.startswith(SPANISH))
        if not link or (stays and page.startswith(own)):
            return match[0]
        return f"]({os.path.relpath(place(to), here or '.')}{anchor})"

    return LINK.sub(changed, text)


def _listing(folder: Path) -> str:
    names = sorted(f"{entry.name}/" if entry.is_dir() else entry.name for entry in folder.iterdir()
                   if not entry.name.startswith((".", "_")))  # fmt: skip
    return f"# {folder.relative_to(ROOT)}/\n\n" + "\n".join(f"- `{name}`" for name in names) + "\n"


def _shown(file: Path) -> str:
    language = LANGUAGES.get(file.suffix, "text")
    return f"{SELDOM_SOUGHT}# {file.relative_to(ROOT)}\n\n````{language}\n{file.read_text(encoding='utf-8')}\n````\n"


def _linked() -> set[str]:
    """Return the paths of all files and folders outside of ``docs/`` to which pages link."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
    found = {
        target(page.relative_to(ROOT).as_posix(), match[1])
        for page in pages
        for match in LINK.finditer(page.read_text(encoding="utf-8"))
        if match[1]
    }
    return {path for path in found if place(path).startswith("files/") and (ROOT / path).exists()}


def shown_files() -> Iterator[Page]:
    """Yield pages that show the files and list the folders that are linked to."""
    for path in sorted(_linked()):
        file = ROOT / path
        if file.is_dir() or file.suffix not in AS_THEY_ARE:
            yield Page(
                place(path).removesuffix("html") + "md",
                _listing(file) if file.is_dir() else _shown(file),
            )


def copied_files() -> Iterator[tuple[str, Path]]:
    """Yield the places of pictures that are linked to, and the files themselves."""
    for path in sorted(_linked()):
        if (ROOT / path).is_file() and Path(path).suffix in AS_THEY_ARE:
            yield place(path), ROOT / path
