"""The page at the size of a school's screen: what is used most is in sight, and what was built in can be reached."""

import json
import re
from importlib.resources import files

import pytest
import yaml
from playwright.sync_api import expect
from running import ROOT, running

MOVES = [{"target_deg": {"left_elbow": angle}, "duration": 2.0} for angle in (30.0, 60.0)]
SIZE = {"width": 1366, "height": 768}
DROP = """([name, text]) => {
    const data = new DataTransfer();
    data.items.add(new File([text], name));
    document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
}"""
DRAG = """([from, to]) => {
    const [dragged, place] = [from, to].map((number) => document.querySelector(`[data-move="${number}"]`));
    const data = new DataTransfer();
    const event = (name, at) => new DragEvent(name, { dataTransfer: data, bubbles: true, cancelable: true });
    dragged.dispatchEvent(event("dragstart", dragged));
    place.dispatchEvent(event("dragover", place));
    place.dispatchEvent(event("drop", place));
}"""
BAD = ("serious", "critical")


@pytest.fixture(scope="module")
def humanoid(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layout")
    (folder / "humanoid_dynamic").mkdir()
    (folder / "humanoid_dynamic" / "program.yaml").write_text(yaml.safe_dump({"grid": 0.05, "moves": MOVES}))
    with running("humanoid", folder) as pendant:
        yield pendant


def opened(page, pendant):
    page.set_viewport_size(SIZE)
    page.goto(pendant.url)
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_enabled()


def in_sight(page, *names):
    """Tell which buttons lie outside of what is seen without scrolling."""
    boxes = {name: page.get_by_role("button", name=name).first.bounding_box() for name in names}
    ends = {name: (box["x"] + box["width"], box["y"] + box["height"]) for name, box in boxes.items()}
    return [name for name, (right, bottom) in ends.items() if right > SIZE["width"] or bottom > SIZE["height"]]


@pytest.mark.long
def test_all_that_teaches_is_in_sight_and_files_are_dropped_on_the_page(page, humanoid):
    opened(page, humanoid)
    assert in_sight(page, "2. Test", "3. Add", "4. Simulate", "Discard move", "Robots and stations") == []
    blocks = page.locator(".pendant-block")
    expect(blocks).to_have_count(2)
    page.evaluate(DRAG, [1, 0])
    expect(blocks.first).to_contain_text("60°")
    stored = yaml.safe_load((humanoid.folder / "humanoid_dynamic" / "program.yaml").read_text())
    assert stored["moves"] == MOVES[::-1]
    page.keyboard.press("Alt+G")
    page.get_by_role("dialog").get_by_role("textbox").fill("chess")
    expect(page.get_by_role("dialog").get_by_role("button", name="irb120 chess")).to_be_visible()
    expect(page.get_by_role("dialog").get_by_role("button", name="yobotics terrain")).to_be_hidden()
    urdf = ROOT / "models" / "double_pendulum" / "double_pendulum.urdf"
    page.evaluate(DROP, ["photo.png", "none"])
    expect(page.locator(".q-notification")).to_contain_text("it must be one that ends in .yaml")
    page.evaluate(DROP, [urdf.name, urdf.read_text()])
    expect(page.get_by_role("status")).to_contain_text("mesh 'base.obj' there is no such file")
    expect(page.get_by_role("tab", name="Arm")).to_be_visible()
    assert in_sight(page, "Teach", "Add line", "Play from the start", "Step") == []


@pytest.mark.long
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_serious(page, humanoid, theme):
    pytest.importorskip("axe_playwright_python")
    page.emulate_media(color_scheme=theme, reduced_motion="reduce")
    opened(page, humanoid)
    page.evaluate(files("axe_playwright_python").joinpath("axe.min.js").read_text())
    expect(page.get_by_role("button", name="Move things with the pointer")).to_be_visible()
    page.keyboard.press("g")  # with all that there is over the view
    expect(page.get_by_role("button", name="Own", exact=True)).to_be_visible()
    for tab in page.get_by_role("tab", name=re.compile("Legged|Arm|Station")).all():
        tab.click()
        assert serious(page) == "[]"
    page.keyboard.press("Alt+G")
    expect(page.get_by_role("dialog").get_by_role("button", name="irb120 chess")).to_be_visible()
    # axe takes the dimmed page for the ground of some of its words, whose colours are those looked at above
    assert serious(page, "[role=dialog]", ["color-contrast"]) == "[]"


def serious(page, where="body", without=()):
    """Return what axe finds there that is serious or critical, as a text."""
    page.mouse.move(5, 5)
    expect(page.locator(".q-tooltip")).to_have_count(0)
    # the library's own bar is there for moments, while something is asked of the server
    found = page.evaluate(
        "([where, rules]) => axe.run({ include: [where], exclude: ['.q-loading-bar'] }, "
        "{ resultTypes: ['violations'], iframes: false, rules })",
        [where, {rule: {"enabled": False} for rule in without}],
    )["violations"]
    return json.dumps([one["nodes"] for one in found if one["impact"] in BAD])
