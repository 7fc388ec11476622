"""The page by keyboard alone, and what a screen reader reads of it."""

import re

import pytest
from playwright.sync_api import expect
from running import running
from visiting import Visit

from simrob_drake.extensions.pendant.pages.announcements import first_sentence
from simrob_drake.extensions.pendant.pages.words import Notice, words

pytestmark = pytest.mark.long

FOCUS = "document.activeElement"


@pytest.fixture(scope="module")
def pendant(tmp_path_factory):
    """A pendant with the arm that is moved by torque."""
    with running("irb120_dynamic", tmp_path_factory.mktemp("keyboard")) as started:
        yield started


@pytest.fixture
def visit(page, pendant):
    """A visit that has the tab of the station in front."""
    begun = Visit(page, pendant, "en")
    begun.open_station()
    return begun


def block(page, name):
    """A block in the picture of the station."""
    return page.locator(f'.block-picture [data-block="{name}"]')


def test_blocks_are_reached_chosen_and_left_by_keys(visit):
    page = visit.page
    block(page, "joint_2.pd").focus()

    page.keyboard.press("ArrowRight")
    beyond = page.evaluate(f"{FOCUS}.dataset.block")
    page.keyboard.press("ArrowLeft")
    expect(block(page, "joint_2.pd")).to_be_focused()
    page.keyboard.press("Enter")

    assert beyond not in (None, "joint_2.pd")
    expect(block(page, "joint_2.pd")).to_have_class(re.compile("chosen"))
    card = page.get_by_role("group", name=visit.texts["station.block"])
    expect(card.locator("[tabindex='-1']:focus")).to_have_count(1)
    page.keyboard.press("Escape")
    expect(block(page, "joint_2.pd")).to_be_focused()


def test_wires_of_a_block_are_chosen_by_buttons(visit):
    page = visit.page
    block(page, "joint_2.pd").click()
    card = page.get_by_role("group", name=visit.texts["station.block"])

    card.get_by_text(visit.texts["station.wires_of_block"]).click()
    wires = card.get_by_role("button", name=re.compile("→"))
    name = wires.first.inner_text()
    wires.first.press("Enter")

    expect(card.get_by_text(name, exact=True)).to_be_visible()
    expect(page.locator(".block-picture .wire.chosen")).to_have_count(1)


def test_a_slider_keeps_the_focus_while_its_gain_changes(visit):
    page = visit.page
    block(page, "joint_3.pd").click()
    slider = page.locator('.q-slider[aria-label="servo.kp.joint_3"]')
    slider.locator("[tabindex='0']").focus()

    # So slow that answers of the server to earlier presses arrive in between: they must not take back later ones. After
    # the long pauses the value counts, and the station is drawn anew while the next keys are pressed.
    for pause in (60, 60, 450, 60, 450, 60, 60, 450, 60, 60):
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(pause)
    chip = page.locator(".q-chip").get_by_text(re.compile(r"^servo\.kp\.joint_3: 1260"))
    expect(chip).to_be_visible()
    visit.idle()

    # Ten presses of a hundredth of a decade each: 1000 * 10^0.1 = 1258.9, with three digits.
    expect(slider.locator("[tabindex='0']")).to_be_focused()
    page.keyboard.press("ArrowRight")
    expect(page.locator(".q-chip").get_by_text(re.compile(r"joint_3: 1290"))).to_be_visible()


def test_a_screen_reader_reads_name_and_value_of_a_slider(visit):
    page = visit.page
    block(page, "joint_1.pd").click()
    page.locator('.q-slider[aria-label="servo.kp.joint_1"] [tabindex="0"]').focus()

    read = page.evaluate(
        f"['role', 'aria-label', 'aria-valuetext'].map((name) => {FOCUS}.getAttribute(name))"
    )

    assert read[:2] == ["slider", "servo.kp.joint_1"]
    assert read[2].startswith("1000")
    page.keyboard.press("ArrowRight")
    page.wait_for_function(f"{FOCUS}.getAttribute('aria-valuetext').startsWith('1020')")


def test_the_pad_of_pushes_is_opened_by_its_keys(visit):
    page = visit.page

    page.keyboard.press("Alt+U")

    field = page.get_by_role("combobox", name=visit.texts["push.body"], exact=True)
    expect(field).to_be_focused()


def test_enter_in_the_search_of_the_gallery_loads_the_first_entry(visit):
    page = visit.page
    page.keyboard.press("Alt+G")
    search = page.get_by_role("textbox", name=visit.texts["shell.search"], exact=True)

    search.fill("double pend")
    # The robot has the same name as its station.
    expect(page.get_by_role("button", name="double pendulum")).to_have_count(2)
    expect(page.get_by_role("button", name="roid1")).to_have_count(0)
    search.press("Enter")

    expect(page.locator(".pendant-loaded")).to_contain_text("double_pendulum")


def test_a_run_is_announced(visit):
    page = visit.page
    visit.press("run.play")

    expect(page.locator(".pendant-unseen")).to_contain_text("Ran to its end")


def test_only_the_first_sentence_of_a_message_is_announced():
    assert first_sentence(Notice(), words("en")) == ""
    assert first_sentence(Notice("conflict", {"file": "a.yaml"}), words("en")).count("a.yaml") == 1
