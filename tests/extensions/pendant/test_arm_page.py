"""The page of an arm: sliders that move it, targets, lines, branches; its session goes where kinematics puts it."""

import asyncio
from concurrent.futures import Future
from contextlib import asynccontextmanager
from math import radians

import pytest
from stub_session import StubSession

pytest.importorskip("nicegui", reason="needs the extra gui")
from nicegui import ui
from nicegui.testing import user_simulation
from nicegui.testing.user_interaction import UserInteraction

from simrob_drake import Arm
from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.pendant import arm_questions
from simrob_drake.extensions.pendant.pages import arm as page
from simrob_drake.extensions.pendant.pages.words import MINUS, Notice, Phrases, pose_words, words
from simrob_drake.programs.moves.kinds import KINDS, check_move
from simrob_drake.programs.moves.move_l import MoveL
from simrob_drake.programs.program import Program
from simrob_drake.results.record.state import State

t = words("en")


def given(result):
    future = Future()
    future.set_result(result)
    return future


class ArmSession(StubSession):
    """An arm that is at once where it is jogged to."""

    def __init__(self, station="irb120_workcell"):
        super().__init__("irb120", station=station)
        self.real, self.robot, self.program, self.phase = Arm(station), "robot", Program(), "idle"
        own = self.real.cell.robot("robot").model
        lower, upper = own.axis_limits / own.user_units
        axes = [
            {"name": name, "aliases": [], "unit": "deg", "low": low, "high": high, "now": 0.0}
            for name, low, high in zip(self.real.axes, lower, upper, strict=True)
        ]
        moves = {key: list(kind.model_fields) for key, kind in KINDS.items()}
        self.description = {
            "robots": {"robot": {"model": "irb120", "kind": "arm", "axes": axes, "moves": moves}}
        }
        self.targets, self.ghosts, self.pending, self.shown_ghost = {}, [], (), None

    def watch(self, signals, viewer):
        assert signals == []  # of which it has none

    def ask(self, question):
        return given({"torque_limits": [150.0] * 6}[question])

    def where(self, frame="base"):
        return given(arm_questions.where(self.real, frame))

    def jog_axes(self, targets_deg, duration=None):
        self.calls.append(("jog_axes", dict(targets_deg)))
        try:
            move = arm_questions.jog_move(self.real, targets_deg, duration)
        except SimrobError as problem:
            self.told("message", message=Notice(fills={"text": str(problem)}, wrong=True))
            return given(None)
        at = {"robot": self.real.chain.postures(move["move_abs_j"]["targets"], "q")[0]}
        self.real.cell.state = State(at, {"robot": 0 * at["robot"]}, at)
        self.told("phase")
        return given(True)

    def jog_tool(self, delta, frame="base", *, start=None):
        self.calls.append(("jog_tool", list(delta), frame, list(start)))
        return self.jog_axes(
            arm_questions.inverse(self.real, arm_questions.jogged(self.real, delta, frame, start))
        )

    def jog_pose(self, pose, frame="base"):
        return self.jog_axes(arm_questions.inverse(self.real, pose, frame))

    def teach_target(self, name=None, frame="world"):
        told = arm_questions.where(self.real, frame)
        target = {"axes": told["axes"], "pose": told["pose"], "tool": told["tool"], "frame": frame}
        called = name or f"p{len(self.targets) + 1}"
        self.told("program", targets={**self.targets, called: target})
        return given(called)

    def remove_target(self, name):
        self.told(
            "program", targets={key: value for key, value in self.targets.items() if key != name}
        )

    def add_line(self, kind, target, *, via=None, **how):
        goal = self.targets[target]
        content = {
            "targets_deg": goal["pose"] if kind != "move_abs_j" else [*goal["axes"].values()],
            **how,
        }
        if goal["frame"] != "world" and kind != "move_abs_j":
            content["wobj"] = goal["frame"]
        if via:
            content["via"] = self.targets[via]["pose"][:3]
        self.told("program", program=self.program.with_added_moves(check_move({kind: content})))
        return True

    def edit(self, index, move):
        self.told("program", program=self.program.with_replaced_move(index, check_move(move)))
        return True

    def remove(self, index):
        self.told("program", program=self.program.without_move(index))

    def branches(self, target=None):
        pose = (
            [] if target is None else [self.targets[target]["pose"], self.targets[target]["frame"]]
        )
        self.told("program", ghosts=arm_questions.branches(self.real, *pose))
        return given(self.ghosts)

    def choose_branch(self, number):
        axes = self.ghosts[number]["axes"]
        self.hide_ghosts()
        return self.jog_axes(axes)

    def show_branch(self, number):
        self.calls.append(("show_branch", number))
        self.told("program", shown_ghost=number)
        return given(True)

    def hide_ghosts(self):
        self.told("program", ghosts=[])
        return given(True)

    def tool(self, name):
        self.real.tool(name)
        self.told("phase")
        return given(True)

    def try_move(self, move):
        self.told("program", pending=(move,))
        return given(True)

    def run_line(self, index):
        self.calls.append(("run_line", index))
        return given(True)


@asynccontextmanager
async def opened(session, language="en"):
    async with user_simulation(lambda: page.build(session, words(language))) as user:
        await user.open("/")
        await settled()
        yield user


def on_page(scenario):
    """Let a test wait for its page."""

    def run():
        asyncio.run(scenario())

    return run


async def settled(seconds=0.05):
    """Wait until the page has followed its session."""
    await asyncio.sleep(seconds)


def the(user, kind, label):
    """Return the field of a kind that has a label, or is called so for those who do not see it."""
    found = [
        element
        for element in user.find(kind).elements
        if label in (element.props.get("label"), element.props.get("aria-label"))
    ]
    assert len(found) == 1, label
    return found[0]


async def press(user, label):
    buttons = [
        b for b in user.find(ui.button).elements if label in (b.text, b.props.get("aria-label"))
    ]
    assert len(buttons) == 1, label
    assert buttons[0].enabled, f"{label} cannot be pressed"
    UserInteraction(user, {buttons[0]}, None).click()
    await settled()


@on_page
async def test_a_slider_of_a_joint_moves_it_and_all_others_show_where_it_is():
    session = ArmSession()
    async with opened(session) as user:
        assert the(user, ui.slider, "Joint 5").value == 90
        the(user, ui.slider, "Joint 1").value = 20
        await settled()
        assert session.calls == [("jog_axes", {"joint_1": 20})]
        assert session.real.reference[0] == pytest.approx(radians(20))
        assert the(user, ui.number, "Joint 1").value == 20


@on_page
async def test_a_number_beyond_the_limit_is_refused_in_its_field():
    session = ArmSession()
    async with opened(session) as user:
        field = the(user, ui.number, "Joint 1")
        field.value = 170
        await settled()
        assert session.calls == []
        assert field.error == f"from {MINUS}165° to 165°"


@on_page
async def test_the_tools_sliders_count_from_their_middle_along_a_frame():
    session = ArmSession()
    async with opened(session) as user:
        user.find("Tool", kind=ui.tab).click()
        await settled()
        middle = arm_questions.tool_pose(session.real)
        the(user, ui.slider, "z").value = -40
        await settled()
        the(user, ui.slider, "x").value = 10
        await settled()
        jogs = [call for call in session.calls if call[0] == "jog_tool"]
        assert jogs == [
            ("jog_tool", [0, 0, -0.04, 0, 0, 0], "base", middle),
            ("jog_tool", [0.01, 0, -0.04, 0, 0, 0], "base", middle),
        ]
        wanted = [middle[0] + 0.01, middle[1], middle[2] - 0.04]
        assert arm_questions.tool_pose(session.real)[:3] == pytest.approx(wanted, abs=1e-8)
        assert the(user, ui.slider, "z").value == -40, "they stay while the tool alone is jogged"
        await settled(0.6)
        session.arm.jog_axes({"joint_1": 5})
        await settled()
        assert the(user, ui.slider, "z").value == 0, "and count anew where it got otherwise"


@on_page
async def test_ranges_are_a_hundred_millimetres_and_thirty_degrees_unless_changed():
    session = ArmSession()
    async with opened(session) as user:
        user.find("Tool", kind=ui.tab).click()
        await settled()
        assert (the(user, ui.slider, "x").props["min"], the(user, ui.slider, "x").props["max"]) == (
            -100,
            100,
        )
        assert (
            the(user, ui.slider, "Rz").props["min"],
            the(user, ui.slider, "Rz").props["max"],
        ) == (-30, 30)
        the(user, ui.number, t("arm.range_mm")).value = 250
        the(user, ui.number, t("arm.range_deg")).value = 90
        assert the(user, ui.slider, "y").props["max"] == 250
        assert the(user, ui.slider, "Rx").props["min"] == -90


@on_page
async def test_jogs_go_along_the_frame_that_is_chosen():
    session = ArmSession()
    async with opened(session) as user:
        user.find("Tool", kind=ui.tab).click()
        await settled()
        the(user, ui.select, t("arm.frame")).value = "tool"
        await settled()
        the(user, ui.slider, "z").value = 20
        await settled()
        assert session.calls[0][2] == "tool"


@on_page
async def test_a_typed_pose_is_gone_to_in_the_frame_that_is_chosen():
    session = ArmSession()
    async with opened(session) as user:
        user.find("Tool", kind=ui.tab).click()
        await settled()
        the(user, ui.select, t("arm.frame")).value = "board"
        await settled()
        fields = [
            the(user, ui.number, f"{name}: {t('arm.pose')}")
            for name in ("x", "y", "z", "Rz", "Ry", "Rx")
        ]
        now = arm_questions.tool_pose(session.real, "board")
        scale = [1000.0] * 3 + [1.0] * 3
        assert [field.value for field in fields] == pytest.approx(
            [v * k for v, k in zip(now, scale, strict=True)], abs=1e-3
        )
        fields[1].value = None
        UserInteraction(user, {fields[2]}, None).trigger("keydown.enter")
        assert fields[1].error == t("legs.number_needed")
        assert session.calls == []
        wanted = [*now[:2], now[2] + 0.05, *now[3:]]
        for field, value, factor in zip(fields, wanted, scale, strict=True):
            field.value = value * factor
        UserInteraction(user, {fields[2]}, None).trigger("keydown.enter")
        await settled()
        assert arm_questions.tool_pose(session.real, "board") == pytest.approx(wanted, abs=1e-3)


@on_page
async def test_a_target_is_taught_gone_to_and_forgotten():
    session = ArmSession()
    async with opened(session) as user:
        await user.should_see(t("arm.no_targets"))
        await user.should_see(t("arm.no_lines"))
        the(user, ui.select, t("arm.goes_with")).value = "board"
        await press(user, t("arm.teach"))
        await user.should_see(t("arm.no_line_to", target="p1"))  # the next step
        # a notice, since the list may be out of sight
        await user.should_see(t("arm.taught", name="p1"))
        assert session.book.targets["p1"]["frame"] == "board"
        await user.should_see("in board")
        session.arm.jog_axes({"joint_1": 30})
        await press(user, t("arm.go_to", name="p1"))
        assert session.real.reference[0] == pytest.approx(0)
        await press(user, t("arm.forget", name="p1"))
        assert session.book.targets == {}


@on_page
async def test_a_line_is_added_shown_by_its_targets_name_stepped_and_changed():
    session = ArmSession()
    async with opened(session) as user:
        session.arm.teach_target()
        session.arm.jog_axes({"joint_1": 30})
        session.arm.teach_target("over")
        await settled()
        the(user, ui.select, t("arm.move")).value = "move_l"
        await press(user, t("arm.add_line"))
        move = session.book.program.moves[0].entry()["move_l"]
        assert move["targets_deg"] == pytest.approx(session.book.targets["over"]["pose"])
        assert move["speed"] == pytest.approx(0.2)
        await user.should_see("1. MoveL over, 200 mm/s")
        await press(user, t("arm.step"))
        assert session.calls[-1] == ("run_line", 0)
        await press(user, f"{t('legs.edit')}: 1. MoveL over, 200 mm/s")
        durations = [
            one
            for one in user.find(ui.number).elements
            if one.props.get("label") == t("fields.duration")
        ]
        max(durations, key=lambda element: element.id).value = 2.5
        await press(user, t("legs.save"))
        assert "2.5 s" in Phrases(t, []).move(session.book.program.moves[0].entry())
        await user.should_not_see("200 mm/s")


@on_page
async def test_an_arc_needs_a_target_on_its_way():
    session = ArmSession()
    async with opened(session) as user:
        for angle in (0, 20):
            session.arm.jog_axes({"joint_1": angle})
            session.arm.teach_target()
        await settled()
        with pytest.raises(AssertionError, match="Via"):
            the(user, ui.select, t("arm.via"))
        the(user, ui.select, t("arm.move")).value = "move_c"
        the(user, ui.select, t("arm.target")).value = "p2"
        add = next(b for b in user.find(ui.button).elements if b.text == t("arm.add_line"))
        assert not add.enabled
        the(user, ui.select, t("arm.via")).value = "p1"
        await press(user, t("arm.add_line"))
        assert session.book.program.moves[0].via == pytest.approx(
            session.book.targets["p1"]["pose"][:3]
        )
        await user.should_see("MoveC p1 → p2")


@on_page
async def test_a_branch_is_chosen_among_those_that_can_be_taken():
    session = ArmSession()
    async with opened(session) as user:
        session.arm.jog_axes({"joint_1": 10, "joint_2": 20, "joint_4": 20, "joint_5": 60})
        pose = arm_questions.tool_pose(session.real)
        await press(user, t("arm.branches"))
        usable = [number for number, branch in enumerate(session.arm.ghosts) if branch["usable"]]
        buttons = [b for b in user.find(ui.button).elements if b.text == t("arm.choose")]
        assert len(buttons) == len(session.arm.ghosts)
        assert sum(b.enabled for b in buttons) == len(usable) > 1
        wanted = session.arm.ghosts[usable[1]]["axes"]
        await user.should_see("impossible: ")
        reasons = [
            label.text
            for label in user.find(ui.label).elements
            if label.text.startswith("impossible: ")
        ]
        assert len(reasons) == len(session.arm.ghosts) - len(usable)
        assert all(len(text) > len("impossible: ") for text in reasons)
        await press(user, t("arm.choose_branch", number=usable[1] + 1))
        assert arm_questions.where(session.real)["axes"] == pytest.approx(wanted, abs=1e-6)
        assert arm_questions.tool_pose(session.real)[:3] == pytest.approx(pose[:3], abs=1e-8)
        assert session.arm.ghosts == []


@on_page
async def test_tools_and_pieces_change_hands():
    session = ArmSession()
    async with opened(session) as user:
        the(user, ui.select, t("arm.tool")).value = "gripper"
        assert session.real.cell.robot("robot").tcp == "gripper"
        the(user, ui.select, t("arm.held")).value = "pencil"
        await press(user, t("arm.leave_piece"))
        await user.should_see(t("arm.tried", what="leave pencil"))
        await press(user, t("moves.wait"))
        await user.should_see(t("arm.tried", what="stand still for 1 s"))
        await press(user, t("legs.add"))


@on_page
async def test_it_speaks_spanish():
    async with opened(ArmSession(), "es") as user:
        await user.should_see("Enseñar")
        assert the(user, ui.slider, "Eje 1").value == 0


def test_a_pose_reads_in_millimetres_and_degrees():
    pose = [0.35, -0.1, 0.3004, 0, 12.345, 180]
    assert pose_words(t, pose) == f"x 350 y {MINUS}100 z 300.4 mm · Rz 0° Ry 12.3° Rx 180°"
    assert pose_words(t, [0.35, -0.1, 0.3]) == f"x 350 y {MINUS}100 z 300 mm"


def test_lines_that_were_not_taught_here_show_their_figures():
    phrases = Phrases(t, [])
    assert phrases.move({"move_l": {"targets": [0.3, 0, 0.2], "wobj": "board", "speed": 0.1}}) == (
        "MoveL x 300 y 0 z 200 mm, 100 mm/s, in board"
    )
    assert phrases.move({"move_abs_j": [0, radians(30)]}) == "MoveAbsJ 0° 30°"
    assert phrases.move({"move_j": {"targets": [[0.3, 0, 0.2], [0.3, 0, 0.3]]}}).startswith(
        "MoveJ [[0.3"
    )


def test_sliding_axes_show_metres_and_forces_newtons():
    axes = [
        {"name": "lift", "aliases": [], "unit": "m", "is_finger": False},
        {"name": "wrist", "aliases": [], "unit": "deg", "is_finger": False},
        {"name": "finger", "aliases": [], "unit": "m", "is_finger": True},
    ]
    phrases = Phrases(t, axes)
    assert phrases.move({"move_abs_j": {"targets": [0.01, radians(30)]}}) == "MoveAbsJ 0.01 m 30°"
    assert (
        phrases.move({"move_abs_j": {"targets_deg": [0.01, 30, 0.004]}})
        == "MoveAbsJ 0.01 m 30° 0.004 m"
    )
    assert phrases.move({"grip": {"force": 20}}) == "Close the fingers (force 20 N)"
    assert (
        phrases.move({"open": {"width": 0.03, "duration": 1}})
        == "Open the fingers (width 0.03 m, duration 1 s)"
    )
    spanish = Phrases(words("es"), axes)
    assert spanish.move({"move_abs_j": {"targets_deg": [0.01, 30.5]}}) == "MoveAbsJ 0,01 m 30,5°"
    assert spanish.move({"grip": {"force": 20}}).endswith("(fuerza 20 N)")


@on_page
async def test_a_new_kind_of_motion_is_offered_and_shown_by_its_title():
    class MoveSpiral(MoveL):
        key = "move_spiral"
        title = "MoveSpiral"

    session = ArmSession()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(KINDS._all, MoveSpiral.key, MoveSpiral)
        async with opened(session) as user:
            session.arm.teach_target()
            await settled()
            the(user, ui.select, t("arm.move")).value = MoveSpiral.key
            await press(user, t("arm.add_line"))
            await user.should_see("1. MoveSpiral p1, 200 mm/s")
