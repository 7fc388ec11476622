"""Check a finished site: every link leads to a page and a place on it, and nothing is fetched from outside.

``python -m docs.site.links build/site`` prints what is wrong, and ends with 1 if anything is.
"""

import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

FETCHED = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "link": "href",
    "source": "src",
    "video": "src",
}
NOT_FETCHED = {"canonical", "prev", "next", "alternate"}


class _Page(HTMLParser):
    """Collects the places of a page, where it leads to, and what a browser fetches for it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.places, self.links, self.fetched = {"", "__skip", "top"}, set[str](), set[str]()
        self.language, self.translations = "", dict[str, str]()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and given.get("href"):
            self.links.add(given["href"])
            if "hreflang" in given:
                self.translations[given["hreflang"]] = given["href"]
        if tag == "html":
            self.language = given.get("lang", "")
        if tag in FETCHED and given.get("rel") not in NOT_FETCHED and given.get(FETCHED[tag]):
            self.fetched.add(given[FETCHED[tag]])


def is_outside(link: str) -> bool:
    """Tell whether a link leads to another host, or is none to a file."""
    return bool(urlsplit(link).scheme or urlsplit(link).netloc)


def findings(site: Path) -> Iterator[str]:
    """Yield what is wrong with the site in a folder, a line each."""
    pages = {file: _Page(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    for file, page in pages.items():
        if file.name == "404.html":  # whose links are from the top, wherever it is shown
            continue
        name = file.relative_to(site)
        yield from (f"{name}: fetches {link}" for link in sorted(page.fetched) if is_outside(link))
        for language, link in page.translations.items():
            there = pages.get((file.parent / unquote(link)).resolve())
            if there and there.language != language:
                yield f"{name}: {link} is not in the language {language}"
        for link in sorted(page.links | page.fetched):
            parts = urlsplit(link)
            to = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            to = to / "index.html" if to.is_dir() else to
            if is_outside(link):
                continue
            if not to.is_file():
                yield f"{name}: {link} leads nowhere"
            elif to in pages and unquote(parts.fragment) not in pages[to].places:
                yield f"{name}: {link}: there is no such place on that page"


if __name__ == "__main__":
    wrong = list(findings(Path(sys.argv[1]).resolve()))
    print("\n".join(wrong) or "all links of the site lead somewhere")
    sys.exit(bool(wrong))
