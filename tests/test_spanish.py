"""Each Spanish page holds what its English one does: sections, commands, tables, code; and one decimal mark."""

import re
from pathlib import Path

import pytest

from docs.site.places import FOLDERS, twin

ROOT = Path(__file__).parent.parent
ENGLISH = [
    page.relative_to(ROOT).as_posix()
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
    if not page.is_relative_to(ROOT / "docs" / "es")
]
SPANISH = [
    page.relative_to(ROOT).as_posix()
    for page in [ROOT / "README.es.md", *sorted(ROOT.glob("docs/es/**/*.md"))]
]
ENGLISH_ALONE = {"docs/gallery.md", "docs/results/verdicts.md"}
"""Pages that are made of the package's own words, which are English."""
SPANISH_ALONE = {"docs/es/simrob.md"}
"""For those who come from SimRob, whose words are Spanish."""
USER_PAGES = [page for page in ENGLISH if not page.startswith("docs/decisions/")]
"""Pages for users. Decisions are for developers and in English, as CONTRIBUTING.md is."""
PAIRS = [page for page in ENGLISH if twin(page)]

each_pair = pytest.mark.parametrize("page", PAIRS)


def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


def code(page):
    """Return the blocks of code of a page, each with its language."""
    return re.findall(r"^```(\w*)\n(.*?)^```", text_of(page), re.DOTALL | re.MULTILINE)


def prose(page):
    """Return a page without its blocks of code."""
    return re.sub(r"^```.*?^```", "", text_of(page), flags=re.DOTALL | re.MULTILINE)


def tables(page):
    """Return how many rows each table of a page has."""
    return [
        len(table.splitlines()) for table in re.findall(r"(?:^\|.*\n)+", prose(page), re.MULTILINE)
    ]


def sections(page):
    """Return the levels of a page's headings, in their order."""
    return [len(marks) for marks in re.findall(r"^(#+) ", prose(page), re.MULTILINE)]


def commands(page):
    """Return the commands of a page with their options, whatever values they are given."""
    shown = [line.split("#")[0] for _, block in code(page) for line in block.splitlines()]
    lines = [line for line in shown if re.match(r"(simrob|make|python|pip) ", line)]
    lines += re.findall(r"`(simrob [^`]+)`", prose(page))
    words = [(line.split()[:2], re.findall(r" (--[\w-]+)", line)) for line in lines]
    return {
        (*called, option)
        for called, options in words
        for option in ("", *options)
        if option != "--language"
    }


def test_every_page_is_in_both_languages():
    assert {page for page in USER_PAGES if not twin(page)} == ENGLISH_ALONE
    assert {page for page in SPANISH if not twin(page)} == SPANISH_ALONE


@each_pair
def test_both_have_the_same_sections(page):
    assert sections(twin(page)) == sections(page)


@each_pair
def test_both_have_the_same_tables(page):
    assert tables(twin(page)) == tables(page)


@each_pair
def test_both_have_the_same_blocks_of_code(page):
    assert [language for language, _ in code(twin(page))] == [
        language for language, _ in code(page)
    ]


@each_pair
def test_both_name_the_same_commands(page):
    assert commands(twin(page)) == commands(page)


NAMES = "Drake|Python|MuJoCo|FMI|MATLAB|ssik|arXiv|OpenModelica|versión|version"
PLAIN = (
    rf"(?m)`[^`]*`|\b3\.1[1-4]\b|\]\([^)]*\)|https?://\S+|(?:{NAMES})\s[\d.]+|^#.*$|\d+\.\d+\.\d+"
)
"""What has points that are no decimal marks: code, links, versions."""


@pytest.mark.parametrize("page", SPANISH)
def test_spanish_pages_write_decimals_with_a_comma(page):
    numbers = re.findall(r"\b\d+\.\d+\b", re.sub(PLAIN, "", prose(page)))
    assert numbers == []


@pytest.mark.parametrize("page", ENGLISH)
def test_english_pages_write_decimals_with_a_point(page):
    assert re.findall(r"\b\d+,\d+\b", re.sub(PLAIN, "", prose(page))) == []


def test_the_folders_of_lessons_are_known():
    assert all(
        (ROOT / "docs" / "es" / there).is_dir()
        for here, there in FOLDERS.items()
        if (ROOT / "docs" / here).is_dir()
    )
