"""The site of docs/: what is made from the code lacks nothing, links lead to where things are, faults are found."""

import re
from pathlib import Path

import pytest
import yaml

import simrob_drake

pytest.importorskip("latex2mathml", reason="needs the extra docs")

from docs.site import api, commands, keys, links, parts, places
from docs.site.texts import markdown
from simrob_drake import station_names
from simrob_drake.cli.app import whole_command

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def texts():
    """Return the pages of reference by their paths."""
    return {
        page.path: page.text for maker in (keys, commands, parts, api) for page in maker.pages()
    }


def test_every_key_of_every_file_has_a_row(texts):
    for file, schema in keys.schemas().items():
        pages = "\n".join(
            text for path, text in texts.items() if path.startswith(f"reference/keys/{file}")
        )
        sections = [schema, *schema.get("$defs", {}).values()]
        for key in {key for section in sections for key in section.get("properties", {})}:
            assert re.search(rf"^\| \[?`{key}`", pages, re.MULTILINE), f"{file}: {key}"


def test_a_row_of_a_key_says_what_it_may_be(texts):
    rows = texts["reference/keys/station/servo.md"].splitlines()
    assert any(
        row.startswith(
            "| `law` | `pid`, `cascade`, `computed_torque` | `pid` | `pid`; `cascade`: a position loop"
        )
        for row in rows
    )
    assert any(
        row.startswith("| `kp` | number, a list, or by axis |  | Proportional gain") for row in rows
    )


def test_every_option_of_every_command_has_a_row(texts):
    assert "run" in commands.commands()
    for name in commands.commands():
        page = texts[f"reference/commands/{name}.md"]
        for parameter in whole_command(name).params:
            shown = (
                parameter.opts
                if parameter.param_type_name == "option" and parameter.name != "help"
                else []
            )
            assert all(f"`{option}`" in page for option in shown), f"{name}: {shown}"


@pytest.mark.parametrize("family", parts.FAMILIES)
def test_every_kind_of_part_has_a_section(family, texts):
    for kind in parts.FAMILIES[family]:
        assert f"\n## {kind}\n" in texts[f"reference/parts/{family}.md"]


def test_every_public_name_and_every_module_of_blocks_has_a_page(texts):
    blocks = {file.stem for file in (ROOT / "simrob_drake" / "blocks").glob("*.py")} - {"__init__"}
    assert {f"reference/blocks/{block}.md" for block in blocks} <= set(texts)
    for name, module in api.places().items():
        assert hasattr(simrob_drake, name), name
        assert f"::: {module}.{name}\n" in texts[f"reference/python/{name}.md"]


def test_formulas_and_roles_of_docstrings_become_markdown():
    text = markdown(
        "Speed :math:`v` of :class:`Arm`, by :func:`simrob_drake.simulate`:\n\n.. math:: a = b\n\nEnd."
    )

    assert "<math" in text
    assert 'display="block"' in text
    assert "<code>Arm</code>, by <autoref" in text
    assert ":math:" not in text
    assert text.endswith("\n\nEnd.")
    assert markdown("``<a>`` of <robot>.<axis>") == "`<a>` of &lt;robot>.&lt;axis>"


@pytest.mark.parametrize(
    ("page", "link", "there"),
    [
        ("docs/arms.md", "stations.md#servos", "stations.md#servos"),
        ("docs/arms.md", "../examples/belt_pick.py", "files/examples/belt_pick.py.html"),
        ("docs/arms.md", "../diagrams/two_arms.svg", "files/diagrams/two_arms.svg"),
        ("docs/arms.md", "../examples", "files/examples/index.html"),
        ("docs/README.md", "es/README.md", "es/index.html"),
        ("README.md", "docs/arms.md", "arms.html"),
        ("README.es.md", "docs/es/arms.md", "arms.html"),
        ("docs/es/arms.md", "../gallery.md", "../gallery.html"),
        ("docs/es/arms.md", "../../examples/belt_pick.py", "../files/examples/belt_pick.py.html"),
        ("docs/es/arms.md", "stations.md", "stations.md"),
    ],
)
def test_links_lead_to_where_things_are_on_the_site(page, link, there):
    assert places.rewritten(f"[a]({link})", page) == f"[a]({there})"


@pytest.mark.parametrize(
    ("page", "twin"),
    [
        ("README.md", "README.es.md"),
        ("docs/stations.md", "docs/es/stations.md"),
        ("docs/course/01-kinematics.md", "docs/es/curso/01-cinematica.md"),
        ("docs/course/teachers.md", "docs/es/curso/profesores.md"),
    ],
)
def test_pages_of_both_languages_know_each_other(page, twin):
    assert (places.twin(page), places.twin(twin)) == (twin, page)


def test_the_links_of_a_finished_site_are_looked_at(tmp_path):
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here">x</a><a href="b.html#gone">x</a><a href="c.html">x</a>'
    )
    (tmp_path / "d.html").write_text('<html lang="en"><a href="d.html" hreflang="es">x</a>')

    (tmp_path / "b.html").write_text(
        '<p id="here"></p><a href="https://drake.mit.edu">x</a><script src="//cdn/x.js">'
    )

    assert list(links.findings(tmp_path)) == [
        "a.html: b.html#gone: there is no such place on that page",
        "a.html: c.html leads nowhere",
        "b.html: fetches //cdn/x.js",
        "d.html: d.html is not in the language es",
    ]


def test_every_page_stands_in_the_navigation():
    lines = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = set(re.findall(r"^ +- ([\w/-]+\.md)$", lines, re.MULTILINE))

    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").glob("**/*.md")}

    assert {
        page for page in pages if page.split("/")[0] not in ("es", "lessons", "course")
    } <= named


def test_the_spanish_site_is_built_as_the_english_one():
    spanish = yaml.safe_load((ROOT / "mkdocs.es.yml").read_text(encoding="utf-8"))
    assert (spanish["INHERIT"], spanish["docs_dir"], spanish["theme"]["language"]) == (
        "mkdocs.yml",
        "docs/es",
        "es",
    )


@pytest.mark.parametrize(
    "page", sorted((ROOT / "docs" / "results").glob("*.md")), ids=lambda page: page.stem
)
def test_every_table_of_results_says_its_command(page):
    whole, *sections = re.split(r"^#{2,} ", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    command = re.compile(r"`(simrob|python|make) [^`]+`")

    assert all("|---" not in text or command.search(text) for text in sections), page
    assert "| ---" not in whole or command.search(whole)


@pytest.mark.parametrize(
    ("page", "start", "end"),
    [
        ("docs/walking.md", "## Walks that react", "**Rough ground.**"),
        ("docs/es/walking.md", "## Marchas que reaccionan", "**Suelo abrupto.**"),
    ],
)
def test_the_page_of_walking_names_keys_that_there_are(page, start, end):
    text = (ROOT / page).read_text(encoding="utf-8")
    part = text[text.index(start) : text.index(end)]

    sections = keys.schemas()["gaits"]["$defs"]

    known = {
        key for name in ("WalkingParameters", "Feedback") for key in sections[name]["properties"]
    }
    assert {*re.findall(r"`([a-z_]+)`", part)} - known - {"walk", "reacting"} <= set(
        station_names()
    )


def test_lists_within_lists_are_indented_as_the_site_needs_it():
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]:
        prose = re.sub(
            r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        assert not re.search(r"^ {1,3}(?:[-*]|\d+\.) ", prose, re.MULTILINE), page
