"""A hand in the view: arrows and rings at tool, hand, piece and target, and links that are turned by the pointer."""

import re

import numpy as np
import pytest
import yaml
from playwright.sync_api import expect
from running import choose_option, running

_NAMED = "let found; viewer.scene.traverse((one) => { if (one.isMesh && one.name === name) found = one; });"
_ON_SCREEN = """
  viewer.camera.updateMatrixWorld(); // it may have been moved since the last frame
  const place = point.project(viewer.camera), box = viewer.renderer.domElement.getBoundingClientRect();
  return [box.left + (1 + place.x) / 2 * box.width, box.top + (1 - place.y) / 2 * box.height];
"""
_DOT = f"(name) => {{ {_NAMED} const point = found.getWorldPosition(new MeshCat.THREE.Vector3()); {_ON_SCREEN} }}"
_THERE = f"(name) => {{ {_NAMED} return !!found; }}"
_AT = f"([name, x]) => {{ {_NAMED} return !!found && Math.abs(found.position.x - x) < 1e-6; }}"
_POINT = f"(at) => {{ const point = viewer.scene.localToWorld(new MeshCat.THREE.Vector3(...at)); {_ON_SCREEN} }}"
_GIZMO = """() => {
  const gizmo = viewer.scene.children.find((one) => one.isGroup && one.visible && one.children.length === 15);
  return [gizmo.position.toArray(), gizmo.scale.x];
}"""


class Hand:
    """The pointer in the view of a page, in the mood to move things."""

    def __init__(self, page, pendant):
        self.page, self.pendant = page, pendant
        page.goto(pendant.url)
        expect(page.get_by_role("button", name="Play", exact=True)).to_be_enabled()
        self.view = page.locator("iframe").element_handle().content_frame()
        self.view.wait_for_url("**/view/")
        self.view.wait_for_function("typeof setHand !== 'undefined'")
        page.get_by_role("button", name="Move things with the pointer").click()

    def seen(self, place):
        """Return where a place of the view is on the page."""
        box = self.page.locator("iframe").bounding_box()
        return box["x"] + place[0], box["y"] + place[1]

    def by_steps(self, name):
        choose_option(self.page, "Steps", name, within=".pendant-grip")

    def choose(self, handle):
        """Click a dot; return where its gizmo is, and how long an arrow [m]."""
        self.view.wait_for_function(_THERE, arg=handle)
        self.page.mouse.click(*self.seen(self.view.evaluate(_DOT, handle)))
        return self.gizmo()

    def gizmo(self):
        place, size = self.view.evaluate(_GIZMO)
        return np.array(place), size

    def drag(self, begin, *ends):
        """Drag from a point of the world to others."""
        self.page.mouse.move(*self.seen(self.view.evaluate(_POINT, [*begin])))
        self.page.mouse.down()
        for end in ends:
            self.page.mouse.move(*self.seen(self.view.evaluate(_POINT, [*end])), steps=5)
        with self.page.expect_response(lambda answer: answer.url.endswith("/told")):
            self.page.mouse.up()

    def program(self, name):
        return yaml.safe_load((self.pendant.folder / name / "program.yaml").read_text())


@pytest.mark.long
def test_an_arm_is_jogged_by_arrows_rings_and_links(page, tmp_path):
    with running("irb120_gripper", tmp_path) as pendant:
        hand = Hand(page, pendant)
        hand.by_steps("10 mm, 15°")
        place, size = hand.choose("tool:")
        tip = np.add(place, [0, 0, size])
        hand.drag(tip, np.add(tip, [0, 0, 0.047]))
        height = page.get_by_role("spinbutton", name=re.compile("^z: Pose of the tool"))
        page.get_by_role("tab", name="Tool", exact=True).click()
        expect(height).to_have_value(re.compile(rf"^{1e3 * place[2] + 50:.0f}(\.0)?$"))  # by steps
        moved, size = hand.gizmo()
        np.testing.assert_allclose(moved, np.add(place, [0, 0, 0.05]), atol=1e-4)
        told = []
        page.on(
            "request", lambda asked: told.append(asked.url) if asked.url.endswith("/told") else None
        )
        # drags nothing
        page.mouse.dblclick(*hand.seen(hand.view.evaluate(_POINT, [*np.add(moved, [0, 0, size])])))
        page.mouse.dblclick(*hand.seen(hand.view.evaluate(_POINT, [0.0, -0.08, 0.45])))
        assert told == []
        moved, size = hand.gizmo()
        angles = np.array([-1.1, -0.8, -0.55])  # of its side that is near
        ring = 0.72 * size * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        hand.drag(*(moved + ring))
        turned = page.get_by_role("spinbutton", name=re.compile("^Rz: Pose of the tool"))
        expect(turned).to_have_value(re.compile(r"^-?(30|150)(\.0)?$"))
        page.get_by_role("tab", name="Joints").click()
        first = page.get_by_role("spinbutton", name="Joint 1", exact=True)
        expect(first).to_have_value(re.compile(r"^-?\d+(\.\d+)?$"))
        before = float(first.input_value())
        # the shoulder, which the first joint turns, or the upper arm
        hand.drag([0.0, -0.08, 0.45], [0.12, -0.09, 0.45])
        page.wait_for_timeout(500)
        expect(page.get_by_role("button", name="Stop", exact=True)).to_be_disabled()
        values = [
            float(page.get_by_role("spinbutton", name=f"Joint {number}", exact=True).input_value())
            for number in range(1, 7)
        ]
        assert abs(values[0] - before) > 5 or max(map(abs, values[1:3])) > 5


@pytest.mark.long
def test_pieces_and_targets_are_put_elsewhere(page, tmp_path):
    with running("irb120_gripper", tmp_path) as pendant:
        hand = Hand(page, pendant)
        hand.by_steps("50 mm, 45°")
        page.get_by_role("button", name="Teach", exact=True).click()
        place, size = hand.choose("target:p1")  # where the tool is, too
        tip = np.add(place, [0.9 * size, 0, 0])
        hand.drag(tip, np.subtract(tip, [0.09, 0, 0]))
        expect(
            page.get_by_role("listitem").filter(has_text=f"x {1e3 * place[0] - 100:.0f}")
        ).to_be_visible()
        place, size = hand.choose("piece:cube_3")
        tip = np.add(place, [0.9 * size, 0, 0])
        hand.drag(tip, np.add(tip, [0.11, 0, 0]))
        hand.view.wait_for_function(_AT, arg=["piece:cube_3", place[0] + 0.1])
        page.get_by_role("button", name="Undo").click()
        hand.view.wait_for_function(_AT, arg=["piece:cube_3", place[0]])


@pytest.mark.long
def test_a_limb_of_a_humanoid_sets_joints_to_be_tested(page, tmp_path):
    with running("humanoid", tmp_path) as pendant:
        hand = Hand(page, pendant)
        place, size = hand.choose("limb:left_hand")
        tip = np.add(place, [0, 0, size])
        hand.drag(tip, np.add(tip, [0, 0, 0.08]))
        expect(page.get_by_text(re.compile("To be tested: .*left elbow"))).to_be_visible()
        # The suggested duration, which the slow servos need, is longer than a test may take.
        page.get_by_role("spinbutton", name="Duration", exact=True).first.fill("1")
        page.get_by_role("button", name=re.compile("Test$")).click()
        expect(page.get_by_role("status")).to_contain_text("Ran to its end")
        expect(page.get_by_text("Tested and not added yet")).to_be_visible()
