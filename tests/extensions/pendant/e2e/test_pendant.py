"""The pendant as its users meet it: a browser in front of ``simrob teach``."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
import yaml
from playwright.sync_api import expect
from running import ROOT, choose_from_end, choose_option, running

from simrob_drake.extensions.pendant.server import leading_to


def opened(page, pendant, pace="fastest"):
    """Open the page, wait until the robot is there, take away what a test before has left, and choose a pace."""
    page.goto(pendant.url)
    stop, play, pending = (
        button(page, "Stop"),
        button(page, "Play"),
        page.get_by_text("Tested and not added yet"),
    )
    expect(
        play.or_(button(page, "Pause")).and_(page.locator(":enabled")).or_(pending).first
    ).to_be_visible()
    if stop.is_enabled():
        stop.click()
    if pending.count():
        button(page, "Discard move").click()
        expect(pending).to_have_count(0)
    expect(play).to_be_enabled()
    choose_option(page, "Speed", pace, within=".pendant-run")


def button(page, name):
    return page.get_by_role("button", name=name, exact=True)


def ran(page):
    """Wait until a run has ended that was begun."""
    expect(page.get_by_role("status")).to_contain_text("Ran to its end")
    expect(button(page, "Stop")).to_be_disabled()


def program(pendant, name="humanoid_dynamic"):
    return yaml.safe_load((pendant.folder / name / "program.yaml").read_text())


def typed(page, name, text):
    """Type into the field of a joint, and give it to be tested."""
    field = page.get_by_role("spinbutton", name=re.compile(name))
    field.fill(str(text))
    field.press("Enter")


def lasting(page, seconds):
    """Set the duration of a tested move, which the page would else suggest as the slow servos need it."""
    duration = page.get_by_role("group", name="Joints and angles").get_by_role(
        "spinbutton", name="Duration"
    )
    duration.fill(str(seconds))
    expect(duration).to_have_value(str(seconds))


def keyed(slider, key, times):
    """Move a slider by a key."""
    for _ in range(times):
        slider.locator("[tabindex='0']").press(key)


def taken(page, what):
    """Take something away, and return its file."""
    button(page, "Download").click()
    with page.expect_download() as download:
        page.get_by_role("menu").get_by_text(what).click()
    return download.value.path()


@pytest.fixture(scope="module")
def humanoid(tmp_path_factory):
    with running("humanoid", tmp_path_factory.mktemp("humanoid")) as pendant:
        yield pendant


@pytest.fixture
def alone(tmp_path):
    """A pendant in which no other test has left runs."""
    with running("humanoid", tmp_path / "humanoid") as pendant:
        yield pendant


def taught_by_the_keyboard(page, humanoid):
    """Teach the first move of a program."""
    for left in reversed(range(page.get_by_role("listitem").count())):  # of a first try
        button(page, "Undo").click()
        expect(page.get_by_role("listitem")).to_have_count(left)
    search = page.get_by_role("searchbox", name="Search for a joint")
    search.fill("CodI")
    elbow = "left elbow: fore-arm up"
    typed(page, elbow, 400)
    expect(
        page.get_by_text(re.compile("from .130° to 130°"))
    ).to_be_visible()  # refused in the field, with the limit
    # the page takes its user to that field: what is typed before then lands there
    expect(search).to_have_value("")
    lasting(page, 4)
    typed(page, elbow, 30)
    expect(page.get_by_text("Tested and not added yet")).to_be_visible()
    ran(page)
    page.keyboard.press("Alt+A")
    expect(page.get_by_role("listitem")).to_have_count(1)
    assert program(humanoid)["moves"] == [{"target_deg": {"left_elbow": 30.0}, "duration": 4.0}]


def with_a_move(page, humanoid):
    """Teach a move unless the tests before, which may not have been chosen, have left one."""
    if not program(humanoid).get("moves"):
        taught_by_the_keyboard(page, humanoid)


def test_a_humanoid_is_taught_by_the_keyboard(page, humanoid):
    opened(page, humanoid)
    taught_by_the_keyboard(page, humanoid)


@pytest.mark.long
def test_a_stored_move_is_edited_and_walks_follow(page, humanoid):
    opened(page, humanoid)
    with_a_move(page, humanoid)
    page.get_by_role("button", name=re.compile("^Edit: 1")).click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("spinbutton", name=re.compile("left elbow")).fill("45")
    dialog.get_by_role("button", name="Save").click()
    expect(dialog).to_be_hidden()
    assert program(humanoid)["moves"][0]["target_deg"] == {"left_elbow": 45.0}
    page.get_by_role("spinbutton", name="Steps").fill("2")
    button(page, "Walk").click()
    expect(page.get_by_text("Tested and not added yet: walk 2 steps")).to_be_visible()
    ran(page)
    page.keyboard.press("Alt+A")
    expect(page.get_by_role("listitem")).to_have_count(2)
    button(page, "Undo").click()
    expect(page.get_by_role("listitem")).to_have_count(1)
    button(page, "Redo").click()
    expect(page.get_by_role("listitem")).to_have_count(2)
    assert program(humanoid)["moves"][1]["walk"]["steps"] == 2


FLAT = "HTMLCanvasElement.prototype.getContext = () => null"
"""A browser that draws nothing in three dimensions, which leaves it time to hear a hand."""
GAMEPAD = "(axes) => { navigator.getGamepads = () => [{ connected: true, axes }]; }"


@pytest.mark.long
def test_a_walk_is_driven_by_keys_a_gamepad_and_a_finger_and_stands_when_let_go(page, humanoid):
    page.add_init_script(FLAT)
    opened(page, humanoid)
    with_a_move(page, humanoid)
    button(
        page, "4. Simulate"
    ).click()  # what is driven elsewhere than where the program leads is not in it
    expect(button(page, "Stop")).to_be_enabled()
    ran(page)
    opened(page, humanoid, pace="1 ×")
    button(page, "Drive by hand").click()
    pad = page.get_by_role("group", name=re.compile("^Drive: arrows"))
    stands, goes = "asked: ahead 0.00, left 0.00 m/s, turn 0°/s", "asked: ahead 0.25"
    expect(pad).to_be_focused()
    page.keyboard.down("ArrowUp")
    expect(pad).to_contain_text(goes)
    expect(pad).to_contain_text(re.compile(r"done: ahead 0\.(0[5-9]|[12])"))
    page.keyboard.up("ArrowUp")
    expect(pad).to_contain_text(stands)
    page.keyboard.down("ArrowUp")
    expect(pad).to_contain_text(goes)
    page.get_by_role("searchbox").focus()  # the key is still down
    expect(pad).to_contain_text(stands)
    page.keyboard.up("ArrowUp")
    pad.focus()
    page.evaluate(GAMEPAD, [-0.05, -1.0, 0.0])
    expect(pad).to_contain_text(goes)
    page.evaluate(GAMEPAD, [0.1, 0.8, 0.0])
    expect(pad).to_contain_text(re.compile("asked: ahead -0.[01][1-9],"))  # backward
    page.evaluate(GAMEPAD, [0.0, 0.0, 0.0])
    stick = pad.locator(".pendant-stick").bounding_box()
    page.mouse.move(stick["x"] + stick["width"] / 2, stick["y"] + 2)
    page.mouse.down()
    expect(pad).to_contain_text(re.compile(r"asked: ahead 0.2\d,"))
    page.mouse.up()
    expect(pad).to_contain_text(stands)
    button(page, "End the drive").click()
    expect(page.get_by_text(re.compile("Tested and not added yet: Go"))).to_be_visible()
    expect(pad).to_be_hidden()
    button(page, "3. Add").click()
    expect(page.get_by_text(re.compile("drive the robot by"))).to_be_visible()
    assert next(move for move in program(humanoid)["moves"] if "go" in move)["go"]["duration"] < 600
    button(page, "Undo").click()
    button(page, "Discard move").click()


@pytest.mark.long
def test_a_file_that_another_editor_changed_is_asked_about(page, humanoid):
    opened(page, humanoid)
    file = humanoid.folder / "humanoid_dynamic" / "program.yaml"
    text = file.read_text().replace("45", "50")
    file.write_text(text)
    page.get_by_role("button", name=re.compile("^Delete: 2")).click()
    asked = page.locator(".pendant-conflict")
    expect(asked).to_contain_text("program.yaml was changed by another program")
    assert file.read_text() == text
    button(page, "Load it (Undo brings this back)").click()
    expect(asked).to_be_hidden()
    expect(page.get_by_role("status")).to_be_empty()
    expect(page.get_by_text(re.compile("left elbow.* 50°")).last).to_be_visible()
    expect(page.get_by_role("listitem")).to_have_count(2)


@pytest.mark.long
def test_a_run_is_pushed_tuned_gone_back_in_and_taken_away(page, humanoid, tmp_path):
    opened(page, humanoid, pace="0.1 ×")
    page.get_by_role("tab", name="Station").click()
    page.locator('[data-block="servo"]').click()
    gain = page.get_by_role("slider", name="servo.kp")
    expect(gain).to_be_visible()
    page.get_by_text("Push", exact=True).click()
    button(page, "Play").click()
    button(page, "Pause").click()
    expect(button(page, "One tick")).to_be_enabled()
    page.get_by_role("button", name="push along +x").click()
    keyed(gain, "ArrowRight", 3)
    expect(page.locator(".simrob-plot").first).to_be_visible()
    choose_option(page, "Speed", "fastest", within=".pendant-run")
    button(page, "Play").click()
    # its end
    expect(page.locator(".pendant-time")).to_have_text(re.compile(r"^([1-9]\d*\.\d+) of \1 s$"))
    ran(page)
    changes = program(humanoid)["changes"]
    assert next(one for one in changes if "push" in one)["push"]["force"] == [10.0, 0.0, 0.0]
    gains = [one["set"]["servo.kp"] for one in changes if "set" in one]
    assert gains
    assert all(100 < gain < 120 for gain in gains)  # up to three steps of a hundredth of a decade
    end = page.locator(".pendant-time").inner_text()
    keyed(page.get_by_role("slider", name="Moment of the run"), "PageDown", 3)
    expect(page.locator(".pendant-time")).not_to_have_text(end)
    button(page, "Play").click()  # from there, with the same changes
    expect(page.locator(".pendant-time")).to_have_text(end)
    ran(page)
    script, signals = taken(page, "script"), taken(page, "signals")
    run = [sys.executable, str(script)]
    subprocess.run(
        run,
        cwd=tmp_path,
        check=True,
        capture_output=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    made = next(tmp_path.rglob("signals.csv"))
    assert made.read_text() == signals.read_text()
    assert "push" in taken(page, "The program (YAML)").read_text()


@pytest.mark.long
def test_a_body_is_dragged_by_the_pointer(page, humanoid):
    opened(page, humanoid)
    view = page.locator("iframe").element_handle().content_frame()
    view.wait_for_url("**/view/")
    drawn = "typeof viewer !== 'undefined' && viewer.scene_tree.find(['drake']).object.children.length > 0"
    view.wait_for_function(drawn)
    button(page, "One tick").click()
    expect(button(page, "Stop")).to_be_enabled()
    expect(button(page, "One tick")).to_be_enabled()
    box = page.locator("iframe").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.35 * box["height"]
    page.keyboard.down("Shift")
    page.mouse.move(x, y)
    page.mouse.down()
    page.keyboard.up("Shift")
    clock = page.locator(".pendant-time")
    for step in range(1, 4):
        before = clock.inner_text()
        with page.expect_response(lambda answer: answer.url.endswith("/told")):
            page.mouse.move(x + 15 * step, y)
        page.keyboard.press(".")  # in the view, too, where the focus is
        expect(clock).not_to_have_text(before)
    with page.expect_response(lambda answer: answer.url.endswith("/told")):
        page.mouse.up()
    button(page, "Play").click()
    ran(page)
    drag = next(one["drag"] for one in program(humanoid)["changes"] if "drag" in one)
    assert drag["at"] in ("trunk", "shoulder_line", "neck", "waistline")
    targets = np.array(drag["targets"])
    # one for each tick; the first may have come before the pointer was heard of
    assert 2 <= len(targets) <= 3
    ways = np.diff(targets, axis=0)
    lengths = np.linalg.norm(ways, axis=1)
    np.testing.assert_allclose(
        ways / lengths[:, np.newaxis], np.tile(ways[0] / lengths[0], (len(ways), 1)), atol=1e-6
    )
    assert np.ptp(targets[:, 2]) < 1e-6  # across the picture, which is upright
    assert lengths.min() > 0.005
    assert lengths.max() < 0.2


@pytest.mark.long
def test_two_tabs_show_one_run(page, humanoid):
    opened(page, humanoid)
    other = page.context.new_page()
    opened(other, humanoid, pace="0.5 ×")
    expect(page.locator(".pendant-run")).to_contain_text("0.5 ×")
    button(other, "One tick").click()
    for one in (page, other):
        expect(button(one, "Stop")).to_be_enabled()
        expect(one.locator(".pendant-time")).to_have_text(
            re.compile(r"^0\.(05|10) of 0\.(05|10) s$")
        )
    button(page, "Stop").click()
    expect(button(other, "Stop")).to_be_disabled()
    other.close()


@pytest.mark.long
def test_the_address_is_clean_opens_more_tabs_and_no_other_browser(
    page, chromium, humanoid, tmp_path
):
    printed = humanoid.url
    opened(page, humanoid)
    clean = printed.partition("?")[0]
    assert page.url == clean
    # after about:blank
    assert page.evaluate("[history.length, document.referrer, document.cookie]") == [
        2,
        "",
        "",
    ]
    page.reload()
    expect(button(page, "Play")).to_be_enabled()
    other = page.context.new_page()
    other.goto(printed)
    expect(button(other, "Play")).to_be_enabled()
    assert other.url == clean
    other.close()
    stranger = chromium.new_context().new_page()
    for address in (printed, clean):
        stranger.goto(address)
        assert "open the newest address" in stranger.inner_text("body")
    with leading_to(humanoid.url, tmp_path) as file:  # as another program leads here
        stranger.goto(file)
        expect(button(stranger, "Play")).to_be_enabled()
    assert stranger.url == clean
    stranger.context.close()


@pytest.mark.long
def test_nothing_is_lost_by_a_kill(page, humanoid):
    opened(page, humanoid)
    with_a_move(page, humanoid)
    before = program(humanoid)
    humanoid.kill_worker()
    expect(page.get_by_role("status")).to_contain_text("was started again")
    expect(button(page, "Play")).to_be_enabled()
    humanoid.kill()
    humanoid.start()
    expect(page.locator("body")).to_contain_text("open the newest address")  # it loads itself anew
    assert program(humanoid) == before
    opened(page, humanoid)
    expect(page.get_by_role("listitem")).to_have_count(
        len(before["moves"]) + len(before.get("changes", ()))
    )
    button(page, "4. Simulate").click()
    ran(page)


@pytest.mark.long
def test_the_station_is_changed_and_refused_in_the_checkers_words(page, humanoid):
    opened(page, humanoid)
    page.get_by_role("tab", name="Station").click()
    page.get_by_role("textbox", name="Search for a key").fill("proportional gain")
    field = page.get_by_role("textbox", name="servo.kp")
    field.fill("{left_elbo: 5}")
    field.press("Enter")
    expect(page.get_by_text("did you mean 'left_elbow'").first).to_be_visible()
    field.fill("150")
    field.press("Enter")
    expect(page.get_by_text("servo.kp: 150")).to_be_visible()
    expect(page.locator('[data-block="servo"]')).to_contain_text("kp 150")
    whole = button(page, "As large as the screen")
    for shown in (True, False):
        whole.click()
        page.wait_for_function(f"!!document.fullscreenElement === {str(shown).lower()}")


@pytest.mark.long
def test_an_arm_is_jogged_and_taught(page, tmp_path):
    with running("irb120_workcell", tmp_path) as pendant:
        opened(page, pendant)
        clock = page.locator(".pendant-time")
        for angle in (20, -20):
            before = clock.inner_text()
            typed(page, "Joint 1", angle)
            expect(clock).not_to_have_text(before)
            expect(button(page, "Stop")).to_be_disabled()
            button(page, "Teach").click()
            button(page, "Add line").click()
        button(page, "Play from the start").click()
        ran(page)
        lines = [
            move["move_j"]["targets_deg"] for move in program(pendant, "irb120_workcell")["moves"]
        ]
        (x1, y1), (x2, y2) = (line[:2] for line in lines)
        assert (x1, y1) == pytest.approx((x2, -y2))  # mirrored, as its postures are
        assert y1 > 0.05
        button(page, "Every posture for this pose").click()
        # with board and limits one of eight is left
        expect(page.get_by_text(re.compile("^impossible: "))).to_have_count(7)


@pytest.mark.long
def test_two_runs_before_are_compared_with_a_ghost_in_the_view(page, alone):
    opened(page, alone)
    page.get_by_role("searchbox", name="Search for a joint").fill("CodI")
    lasting(page, 2)
    for angle in (-60, 90):
        typed(page, "left elbow: fore-arm up", angle)
        expect(
            page.get_by_text(re.compile(f"Tested and not added yet.*{angle}".replace("-", ".")))
        ).to_be_visible()
        expect(button(page, "Stop")).to_be_disabled()
        page.keyboard.press("Alt+X") if angle < 0 else None
    page.get_by_text("Live plots", exact=True).click()
    choose_from_end(page, "Look at a run before", 1)
    choose_from_end(page, "Compare with a run before", 2)
    expect(page.get_by_text("run 1", exact=True)).to_be_visible()
    frame = page.frame_locator("#view-frame").locator("body")
    ghost = "viewer.scene_tree.find(['drake', 'compared']).object.children.length"
    assert frame.evaluate(f"() => {ghost}") > 0
    keyed(page.get_by_role("slider", name="Moment of the run"), "Home", 1)
    expect(page.locator(".pendant-time")).to_have_text("0.00 of 2.00 s")


@pytest.mark.long
def test_a_move_takes_as_long_as_its_edge_is_dragged_and_goes_where_it_is_dropped(page, alone):
    opened(page, alone)
    with_a_move(page, alone)
    before, edge = (
        program(alone)["moves"][0]["duration"],
        page.locator(".pendant-edge").first.bounding_box(),
    )
    block = page.locator(".pendant-block").first.bounding_box()
    page.mouse.move(edge["x"] + 4, edge["y"] + 4)
    page.mouse.down()
    page.mouse.move(edge["x"] + 4 - block["width"] / 2, edge["y"] + 4, steps=4)
    page.mouse.up()
    expect(page.locator(".pendant-block").first).to_contain_text(f"{before / 2:g}")
    assert program(alone)["moves"][0]["duration"] == pytest.approx(before / 2, abs=0.11)
    typed(page, "left elbow: fore-arm up", 20)
    expect(page.get_by_text(re.compile("Tested and not added yet.*20"))).to_be_visible()
    page.keyboard.press("Alt+A")
    expect(page.locator(".pendant-block")).to_have_count(2)
    moves = program(alone)["moves"]
    page.locator(".pendant-block").last.drag_to(page.locator(".pendant-block").first)
    expect(page.locator(".pendant-block").first).to_contain_text("20")
    assert program(alone)["moves"] == [moves[-1], *moves[:-1]]


@pytest.mark.long
def test_robots_are_loaded_by_their_pictures(page, humanoid):
    """A robot of another kind brings its tab to the front; otherwise the user's tab stays."""
    opened(page, humanoid)
    page.get_by_role("tab", name="Legged").click()
    for robot, tab in (("yobotics", "Legged"), ("ur5", "Arm"), ("zjudancer", "Legged")):
        button(page, "Robots and stations").click()
        button(page, robot).click()
        expect(page.get_by_role("dialog")).to_have_count(0)
        expect(page.get_by_role("tab", name=tab, selected=True)).to_be_visible()
        expect(button(page, "Play")).to_be_enabled()
        expect(page.get_by_role("status")).to_be_empty()
