"""The pictures of the teach pendant's chapters: ``python -m docs.teach_pictures`` renews them; it needs a browser."""

import sys
import tempfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from simrob_drake.extensions.pendant.pages.words import Words, languages, words
from tests.extensions.pendant.e2e.running import browser, missing, running

FOLDER = Path(__file__).parent / "images" / "teach"
_SIZE = {"width": 1400, "height": 1200}
_WIDTH = 1100  # of a picture in the docs
_QUALITY = 80
_SHORT = "(label, folder) => { label.innerText = label.innerText.replace(folder, 'taught'); }"
"""Has the page tell the usual folder, not that of this moment."""
Act = Callable[[Any, Words], None]
_PATIENCE = 120_000  # ms
_SETTLED = 1500  # ms until what moves has come to rest


def legs(page: Any, t: Words) -> None:
    """Teach two moves of the arms, and try a third."""
    for number, angles in enumerate(({8: 90, 10: 60}, {0: 60}, {1: 40})):
        for joint, angle in angles.items():
            field = page.locator(".q-tab-panel input[type=number]").nth(joint)
            field.fill(str(angle))
        field.press("Enter")
        page.wait_for_timeout(_SETTLED)
        if number < 2:
            page.keyboard.press("Alt+A")


def arm(page: Any, t: Words) -> None:
    """Jog, teach two targets and their lines, and show every posture of the second."""
    for angle in ("25", "-25"):
        field = page.locator(".q-tab-panel input[type=number]").first
        field.fill(angle)
        field.press("Enter")
        page.wait_for_timeout(_SETTLED)
        for name in ("arm.teach", "arm.add_line"):
            _button(page, t(name)).click()
    _button(page, t("arm.branches")).click()
    page.wait_for_timeout(2 * _SETTLED)


def station(page: Any, t: Words) -> None:
    """Run the station, and choose the block of a joint."""
    page.get_by_role("tab", name=t("shell.station_tab")).click()
    page.locator('[data-block="joint_2.pd"]').click()
    _button(page, t("run.play")).click()
    page.wait_for_timeout(3 * _SETTLED)


PAGES: dict[str, tuple[str, Act]] = {
    "legs": ("humanoid", legs),
    "arm": ("irb120_workcell", arm),
    "station": ("irb120_dynamic", station),
}
"""By name of the picture: what is opened, and what is done with it."""


def main() -> None:
    """Write a picture of each page in each language."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with browser() as chromium:
        for language in languages():
            for name, (subject, act) in PAGES.items():
                print(picture(chromium, language, name, subject, act))


def picture(chromium: Any, language: str, name: str, subject: str, act: Act) -> Path:
    """Write the picture of a page, and return its file."""
    t = words(language)
    with (
        tempfile.TemporaryDirectory() as folder,
        running(subject, Path(folder), "--language", language) as pendant,
    ):
        page = chromium.new_page(viewport=_SIZE)
        page.set_default_timeout(_PATIENCE)
        page.goto(pendant.url)
        _button(page, t("run.play")).and_(page.locator(":enabled")).wait_for()
        page.get_by_role("combobox", name=t("run.pace"), exact=True).first.click()
        page.get_by_role("option", name=t("run.fastest")).click()
        page.wait_for_timeout(_SETTLED)
        act(page, t)
        page.mouse.move(0, 0)
        page.wait_for_timeout(_SETTLED)
        page.locator(".pendant-loaded").evaluate(_SHORT, folder)
        page.evaluate("scrollTo(0, 0)")
        shot = Image.open(BytesIO(page.screenshot())).convert("RGB")
        page.close()
    file = FOLDER / f"{name}_{language}.webp"
    size = _WIDTH, round(_WIDTH * shot.height / shot.width)
    shot.resize(size, Image.Resampling.LANCZOS).save(file, quality=_QUALITY, method=6)
    return file


def _button(page: Any, name: str) -> Any:
    return page.get_by_role("button", name=name, exact=True)


if __name__ == "__main__":
    if why := missing():
        sys.exit(f"it {why}")
    main()
