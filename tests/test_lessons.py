"""The lessons: each script runs, and prints what its pages say in both languages, to 5 %."""

import re
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted((ROOT / "examples" / "lessons").glob("*.py"))
PAGES = [
    *sorted((ROOT / "docs" / "lessons").glob("0*.md")),
    *sorted((ROOT / "docs" / "es" / "lecciones").glob("0*.md")),
]
LONG = {"tune_it", "humanoid_steps"}
NUMBER = r"(?<![\w_])-?\d+(?:\.\d+)?(?![\w_])"

pytestmark = pytest.mark.usefixtures("no_plots")


def page_of(script, language):
    """Return the page of a language that names a script."""
    (page,) = [
        page
        for page in PAGES
        if f"lessons/{script.name}" in page.read_text() and ("es" in page.parts) == language
    ]
    return page.read_text()


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(file, id=file.stem, marks=[pytest.mark.long] if file.stem in LONG else [])
        for file in SCRIPTS
    ],
)
def test_a_lesson_prints_what_its_pages_say(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_path(str(script))["main"]()

    printed = capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} <= {"runs"}
    for spanish in (False, True):
        (shown,) = re.findall(
            rf"{script.name}\).*?```text\n(.*?)```", page_of(script, spanish), re.DOTALL
        )
        assert re.sub(NUMBER, "", shown) == re.sub(NUMBER, "", printed)
        numbers = [
            [float(found) for found in re.findall(NUMBER, text)] for text in (printed, shown)
        ]
        np.testing.assert_allclose(*numbers, rtol=0.05, atol=0.02)


def test_there_are_five_lessons_in_both_languages():
    assert len(SCRIPTS) == 5
    assert len(PAGES) == 2 * len(SCRIPTS)
