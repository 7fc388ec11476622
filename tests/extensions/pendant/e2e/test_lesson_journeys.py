"""The five lessons of the page, each done from begin to end as its texts say, in both languages."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from playwright.sync_api import expect
from running import choose_option, running
from visiting import SCREENS, Visit

pytestmark = pytest.mark.long

LESSONS = Path(__file__).parents[4] / "simrob_drake/extensions/pendant/lessons"


def play(visit: Visit) -> None:
    """Run the station to its end."""
    visit.press("run.play")
    visit.idle()


def set_keys_and_play(visit: Visit, **values: str) -> None:
    """Change keys of the station, their names with `__` for a point, and run it."""
    visit.open_station()
    for name, value in values.items():
        visit.set_key(name.replace("__", "."), value)
    play(visit)


def show_block(visit: Visit, block: str, caption: str) -> None:
    """Choose a block of the picture, and see what it is called below."""
    visit.open_station()
    visit.page.locator(f'[data-block="{block}"]').click()
    expect(visit.page.get_by_role("group", name=visit.texts["station.block"])).to_contain_text(
        caption
    )


# Lesson 1


def load_the_arm(visit: Visit) -> None:
    visit.open_station()
    visit.set_key("pieces.load.mass", "5")


def play_and_read_the_torque(visit: Visit) -> None:
    play(visit)
    show_block(visit, "joint_2.saturation", "joint_2")


# Lesson 2


def play_and_see_gains(visit: Visit) -> None:
    play(visit)
    show_block(visit, "joint_2.pd", "kp 1000")


# Lesson 3


def play_and_go_back(visit: Visit) -> None:
    play(visit)
    clock = visit.page.locator(".pendant-time")
    end = clock.inner_text()
    visit.scrub("PageDown", 2)
    expect(clock).not_to_have_text(end)


def stop_by_force(visit: Visit) -> None:
    page, texts = visit.page, visit.texts
    visit.open_station()
    keys = page.get_by_role("group", name=texts["station.keys"])
    keys.get_by_text("monitors", exact=True).click()
    keys.get_by_role("switch", name="stop", exact=True).click()
    expect(page.locator(".q-chip").get_by_text(re.compile(r"^monitors\.stop"))).to_be_visible()
    visit.idle()
    monitors = keys.locator(".q-expansion-item").filter(has_text="monitors")
    monitors.get_by_label(texts["station.entry_name"]).fill("hard")
    choose_option(page, texts["station.entry_kind"], "force_limit", within=".station-form:visible")
    monitors.get_by_label(texts["station.entry_keys"]).fill("{limit: 40}")
    monitors.get_by_role("button", name=texts["station.entry_add"]).click()
    expect(page.locator(".q-chip").get_by_text(re.compile(r"^monitors\.hard"))).to_be_visible()
    visit.idle()
    play(visit)


# Lesson 4


def try_and_add_a_shoulder(visit: Visit) -> None:
    shoulder = visit.page.get_by_role("spinbutton", name=visit.texts["axes.left_shoulder_pitch"])
    shoulder.fill("40")
    # The page proposes 20 s, in which these servos reach the angle.
    duration = visit.page.get_by_role("spinbutton", name=visit.texts["fields.duration"]).first
    expect(duration).to_have_value("20")
    duration.fill("2")
    visit.test_and_add("legs.test", 1)


def push_until_it_falls(visit: Visit) -> None:
    visit.push("+x", newtons=60, seconds=0.5)
    visit.idle()


def look_at_the_fall_and_stiffen(visit: Visit) -> None:
    visit.scrub("PageDown", 1)
    visit.open_station()
    visit.set_key("servo.kp", "300")
    visit.set_key("servo.kd", "30")
    play(visit)


def fall_without_the_loop(visit: Visit) -> None:
    visit.open_legs()  # as the lesson says: tab Station of the step before is still in front
    loop = visit.page.get_by_role("switch", name=visit.texts["names.balance"], exact=True)
    loop.click()
    expect(loop).not_to_be_checked()
    visit.idle()
    play(visit)


# Lesson 5


def play_slowly_and_see_a_servo(visit: Visit) -> None:
    visit.choose_pace(0.25)
    visit.press("run.play")
    expect(visit.page.locator(".pendant-state")).to_have_text(visit.texts["phase.running"])
    show_block(visit, "joint_2.pd", "kp 1000")
    visit.choose_pace()
    visit.idle()


def tune_while_it_runs(visit: Visit) -> None:
    visit.choose_pace(0.1)
    visit.press("run.play")
    expect(visit.page.locator(".pendant-state")).to_have_text(visit.texts["phase.running"])
    slider = visit.page.get_by_role("slider", name="servo.kp.joint_2")
    width = slider.bounding_box()["width"]
    # its ends are a tenth and ten times the gain
    slider.click(position={"x": 0.95 * width, "y": 5})
    expect(visit.page.locator('[data-block="joint_2.pd"].changed')).to_be_attached()
    visit.choose_pace()
    visit.idle()


LESSON_STEPS: dict[str, list[Callable[[Visit], None]]] = {
    "1-an-arm-moves": [
        play,
        load_the_arm,
        play_and_read_the_torque,
        lambda visit: set_keys_and_play(visit, servo__torque_limit="10"),
    ],
    "2-a-controller": [
        play_and_see_gains,
        lambda visit: set_keys_and_play(visit, servo__kp="4000"),
        lambda visit: set_keys_and_play(visit, servo__kp="1000", servo__kd="50", servo__ki="2000"),
        lambda visit: None,
    ],
    "3-contact-and-force": [
        play_and_go_back,
        lambda visit: set_keys_and_play(visit, contact__stiffness="20000"),
        play,
        stop_by_force,
    ],
    "4-a-humanoid-steps": [
        try_and_add_a_shoulder,
        lambda visit: visit.test_and_add("legs.step", 5),
        push_until_it_falls,
        look_at_the_fall_and_stiffen,
        play,
        fall_without_the_loop,
    ],
    "5-tune-it": [
        play_slowly_and_see_a_servo,
        tune_while_it_runs,
        play,
        lambda visit: set_keys_and_play(visit, pieces__load__mass="3"),
        lambda visit: None,
    ],
}


EVERY_PAIR = [(lesson, language) for lesson in LESSON_STEPS for language in SCREENS]
ALTERNATING_PAIRS = [
    (lesson, list(SCREENS)[number % len(SCREENS)]) for number, lesson in enumerate(LESSON_STEPS)
]


# Each takes a minute or more. All pairs of lesson and language are done with SIMROB_ALL_JOURNEYS=1, otherwise each
# lesson in one language.
@pytest.mark.parametrize(
    ("lesson", "language"),
    EVERY_PAIR if os.environ.get("SIMROB_ALL_JOURNEYS") else ALTERNATING_PAIRS,
)
def test_a_lesson_is_done_from_begin_to_end_with_its_buttons_in_sight(
    page, tmp_path, lesson, language
):
    content = yaml.safe_load((LESSONS / f"{lesson}.yaml").read_text())
    with running(content["subject"], tmp_path, "--language", language) as pendant:
        visit = Visit(page, pendant, language)
        texts = visit.texts
        page.keyboard.press("Alt+L")
        page.get_by_text(content["title"][language], exact=True).click()
        strip = page.locator(".pendant-tour")
        steps = content["steps"]
        assert len(LESSON_STEPS[lesson]) == len(steps)
        for number, (step, do) in enumerate(zip(steps, LESSON_STEPS[lesson], strict=True), 1):
            expect(strip).to_contain_text(
                texts["tour.step"].format(number=number, count=len(steps))
            )
            visit.idle()
            visit.expect_in_sight(visit.button("run.play").first)
            do(visit)
            if "checks" in step:
                expect(strip).to_contain_text(texts["tour.done"])
            if number < len(steps):
                strip.get_by_role("button", name=texts["tour.next"], exact=True).click()
        strip.get_by_role("button", name=texts["tour.end"]).last.click()
        expect(strip).to_be_hidden()
