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
    (folder / "humanoid_dynamic" / "program.yaml").write_text(
        yaml.safe_dump({"grid": 0.05, "moves": MOVES})
    )
    with running("humanoid", folder) as pendant:
        yield pendant


def opened(page, pendant):
    page.set_viewport_size(SIZE)
    page.goto(pendant.url)
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_enabled()


def in_sight(page, *names):
    """Tell which buttons lie outside of what is seen without scrolling."""
    boxes = {name: page.get_by_role("button", name=name).first.bounding_box() for name in names}
    ends = {
        name: (box["x"] + box["width"], box["y"] + box["height"]) for name, box in boxes.items()
    }
    return [
        name
        for name, (right, bottom) in ends.items()
        if right > SIZE["width"] or bottom > SIZE["height"]
    ]


@pytest.mark.long
def test_all_that_teaches_is_in_sight_and_files_are_dropped_on_the_page(page, humanoid):
    opened(page, humanoid)
    assert (
        in_sight(page, "2. Test", "3. Add", "4. Simulate", "Discard move", "Robots and stations")
        == []
    )
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
    expect(page.get_by_role("region", name="Messages")).to_contain_text(
        "mesh 'base.obj' there is no such file"
    )
    expect(page.get_by_role("tab", name="Arm")).to_be_visible()
    assert in_sight(page, "Teach", "Add line", "Play from the start", "Step") == []


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(390, 844), (844, 390)])
def test_a_phone_has_room_to_teach_and_shows_reasons_by_a_tap(chromium, humanoid, width, height):
    """Half of the height is left below what stays on top, and a tap on a disabled button shows its title."""
    context = chromium.new_context(
        viewport={"width": width, "height": height}, has_touch=True, is_mobile=True
    )
    page = context.new_page()
    page.set_default_timeout(60_000)
    page.goto(humanoid.url)
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_enabled()
    stays = page.locator(".pendant-stays")
    assert page.locator(".pendant-view").bounding_box()["height"] <= 0.4 * height
    page.evaluate("scrollTo(0, 800)")
    assert stays.bounding_box()["y"] == 0  # it stays on top
    assert stays.bounding_box()["height"] < 0.5 * height
    assert page.locator(".pendant-message").bounding_box()["y"] < 0  # messages scroll away
    page.evaluate("scrollTo(0, 0)")
    box = page.get_by_role("button", name="Stop", exact=True).bounding_box()
    page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator(".pendant-notice")).to_have_text("Nothing runs")
    context.close()


@pytest.mark.long
@pytest.mark.parametrize(("has_floor", "lowest"), [(True, 0.02), (False, -1.0)])
def test_a_camera_stays_above_a_floor(page, humanoid, has_floor, lowest):
    """A camera that is put 1 m below the ground comes back above a floor. Without a floor it stays there."""
    opened(page, humanoid)
    expect(page.locator("iframe.shown")).to_be_visible()
    height = (
        page.frame_locator("iframe")
        .locator("body")
        .evaluate(
            """(_, has_floor) => {
                const { camera, controls, scene_tree } = viewer;
                if (!has_floor) delete scene_tree.children.drake.children.station.children.floor;
                controls.dispatchEvent({ type: "change" });
                camera.position.y = -1.0;
                controls.update();
                return camera.position.y;
            }""",
            has_floor,
        )
    )
    assert height == pytest.approx(lowest, abs=2e-3)


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
