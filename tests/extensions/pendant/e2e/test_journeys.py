"""Journeys through the page in both languages, each from what a user wants to what they see, at two sizes of screen."""

import re

import pytest
import yaml
from playwright.sync_api import expect
from running import running
from visiting import SCREENS, Visit

pytestmark = pytest.mark.long

URDF = """
<robot name="myarm">
  <link name="base"/>
  <link name="upper">
    <visual><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.04" length="0.4"/></geometry></visual>
    <inertial><origin xyz="0 0 0.2"/><mass value="2"/><inertia ixx="0.03" iyy="0.03" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="fore">
    <visual><origin xyz="0 0 0.15"/><geometry><cylinder radius="0.03" length="0.3"/></geometry></visual>
    <inertial><origin xyz="0 0 0.15"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="60" velocity="3"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="30" velocity="3"/>
  </joint>
</robot>
"""  # noqa: E501
DROP = """([name, text]) => {
    const data = new DataTransfer();
    data.items.add(new File([text], name));
    document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
}"""


each_language = pytest.mark.parametrize("language", list(SCREENS))


@each_language
def test_two_moves_are_taught_and_played(page, tmp_path, language):
    with running(
        "humanoid_fixed", tmp_path, "--language", language
    ) as pendant:  # kinematic: it takes no time
        visit = Visit(page, pendant, language)
        elbow = page.get_by_role("spinbutton", name=visit.texts["axes.left_elbow"])
        for count, angle in enumerate(("30", "0"), 1):
            elbow.fill(angle)
            visit.test_and_add("legs.test", count)
        page.keyboard.press("Alt+S")
        # The clock shows 2 s after both tests as well: only the message says that the whole program has been run.
        expect(page.locator(".pendant-message")).to_contain_text(re.compile(r"\b2 s\b"))
        expect(page.locator(".pendant-time")).to_have_text(re.compile(r"^2[.,]00 \w+ 2[.,]00 s$"))
        visit.idle()
        blocks = page.locator(".pendant-block")
        for number in (0, 1):
            expect(blocks.nth(number)).to_contain_text(re.compile(r"· 1 s$"))
        page.keyboard.press("Home")
        expect(page.locator(".pendant-time")).to_have_text(re.compile(r"^0[.,]00 "))
        expect(blocks.nth(0)).to_have_class(re.compile(r"\bnow\b"))
        blocks.nth(1).click()  # shows where the second move began
        expect(page.locator(".pendant-time")).to_have_text(re.compile(r"^1[.,]00 "))
        expect(blocks.nth(1)).to_have_class(re.compile(r"\bnow\b"))
        assert [move["target_deg"] for move in stored(pendant)["moves"]] == [
            {"left_elbow": 30},
            {"left_elbow": 0},
        ]


@each_language
def test_a_fall_is_produced_explained_and_scrubbed(page, tmp_path, language):
    with running("humanoid", tmp_path, "--language", language) as pendant:
        visit = Visit(page, pendant, language)
        page.get_by_text(visit.texts["push.title"], exact=True).click()
        page.get_by_role("spinbutton", name=visit.texts["push.force"], exact=True).fill("60")
        page.get_by_role("spinbutton", name=visit.texts["push.duration"], exact=True).fill("0.5")
        visit.press("run.tick")
        expect(page.locator(".pendant-state")).to_have_text(visit.texts["phase.paused"])
        page.get_by_role("button", name=visit.texts["push.along"].format(side="+x")).click()
        visit.press("run.play")
        expect(visit.lines("failure")).to_contain_text("robot")
        expect(visit.lines("failure")).to_have_count(1)
        expect(visit.lines("warning")).to_have_count(0)
        visit.idle()
        (push,) = (change["push"] for change in stored(pendant)["changes"] if "push" in change)
        assert push["force"] == [60.0, 0.0, 0.0]
        end = page.locator(".pendant-time").inner_text()
        visit.scrub("PageDown", 2)
        expect(page.locator(".pendant-time")).not_to_have_text(end)


@each_language
def test_a_robot_of_ones_own_is_dropped_and_its_import_explained(page, tmp_path, language):
    with running("irb120", tmp_path, "--language", language) as pendant:
        visit = Visit(page, pendant, language)
        page.evaluate(DROP, ["myarm.urdf", URDF])
        told = visit.texts["notice.imported_with_changes"].format(file="myarm.urdf")
        expect(page.get_by_role("status")).to_contain_text(told)
        expect(visit.lines("note")).to_have_count(4)  # and three things that the file leaves open
        expect(visit.lines("failure")).to_have_count(0)
        expect(page.get_by_role("tab", name=visit.texts["shell.arm_tab"])).to_be_visible()
        expect(page.get_by_role("button", name=visit.texts["moves.grip"])).to_have_count(0)


@each_language
def test_a_gain_is_changed_on_one_joint_and_compared_with_the_run_before(page, tmp_path, language):
    with running("irb120_dynamic", tmp_path, "--language", language) as pendant:
        visit = Visit(page, pendant, language)
        visit.open_station()
        page.locator('[data-block="joint_2.pd"]').click()
        slider = page.get_by_role("slider", name="servo.kp.joint_2")
        expect(
            page.get_by_text(visit.texts["station.tunes_one"].format(axis="joint_2"))
        ).to_be_visible()
        visit.press("run.play")
        expect(page.locator(".pendant-time")).to_have_text(re.compile(r"^3[.,]00 \w+ 3[.,]00 s$"))
        visit.idle()
        plot = page.locator(".simrob-plot").first
        expect(plot.locator("svg path[stroke-dasharray]").first).to_be_attached()  # the reference
        for _ in range(5):
            slider.locator("[tabindex='0']").press("ArrowRight")
        chip = page.locator(".q-chip").get_by_text(re.compile("^servo.kp.joint_2: 1[01]"))
        expect(chip).to_be_visible()
        visit.idle()
        expect(page.locator('[data-block="joint_2.pd"]')).to_contain_text(re.compile("kp 1[01]"))
        expect(page.locator('[data-block="joint_3.pd"]')).to_contain_text("kp 1000")
        expect(plot.locator("svg path").first).to_be_attached()  # the run before stays


@each_language
def test_a_remedy_is_applied_by_its_button_and_undone(page, tmp_path, language):
    with running("irb120_dynamic", tmp_path, "--language", language) as pendant:
        visit = Visit(page, pendant, language)
        visit.open_station()
        visit.set_key("verdict.final_error_deg", "1")
        visit.press("run.play")
        setting = "servo.feedforward = gravity"
        apply = page.get_by_role("button", name=visit.texts["run.apply"].format(setting=setting))
        expect(apply).to_be_enabled()
        expect(visit.lines("warning")).to_have_count(2)  # the sentence, and the joint that sags
        apply.click()
        expect(page.locator(".q-chip").get_by_text("servo.feedforward: gravity")).to_be_visible()
        visit.idle()
        visit.press("run.play")
        expect(visit.lines("success")).to_have_count(1)
        expect(visit.lines("warning")).to_have_count(0)
        visit.idle()
        visit.press("shell.undo")
        expect(page.locator(".q-chip").get_by_text("servo.feedforward: gravity")).to_be_hidden()


def stored(pendant):
    """Content of the program that is taught."""
    (file,) = pendant.folder.glob("*/program.yaml")
    return yaml.safe_load(file.read_text())
