"""The page of a robot with legs: joints are found and set, moves tested, stored and edited, in both languages."""

import asyncio
from concurrent.futures import Future
from math import radians
from typing import Annotated, ClassVar

import numpy as np
import pytest
from legs_session import LegsSession, described
from pydantic import Field

pytest.importorskip("nicegui", reason="needs the extra gui")
from nicegui import ui
from nicegui.testing import user_simulation
from nicegui.testing.user_interaction import UserInteraction

from simrob_drake.extensions.pendant.pages import joints, legs, plots
from simrob_drake.extensions.pendant.pages.words import Phrases, languages, matches, texts_of, words
from simrob_drake.extensions.pendant.run import EndedRun, Moments, TaughtRun
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.move import Move
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.feedback_loops import loops_known
from simrob_drake.stations.load import load_station

MOVE = {"target_deg": {"HomIF": 30.0, "CadDF": 20.0}, "duration": 1.5}


def shown(script, session=None, language="en"):
    """Open the page of a session, and go through a script with it."""
    session = session or LegsSession()

    async def run():
        async with user_simulation(lambda: legs.build(session, words(language))) as user:
            await user.open("/")
            await script(user, session)

    asyncio.run(run())
    return session


def called(user, kind, label):
    """Return the elements of a kind that are called so and can be seen, as they come in the page."""
    elements = sorted(user.find(kind).elements, key=lambda element: element.id)
    found = [element for element in elements if label in str(element.props.get("aria-label", ""))]
    return [element for element in found if seen(element)]


def seen(element):
    return all(parent.visible for parent in (element, *element.ancestors()))


def field(user, label):
    return called(user, ui.number, label)[0]


async def heard(seconds=0.05):
    """Let the page hear of what has changed."""
    await asyncio.sleep(seconds)


def given(result):
    future = Future()
    future.set_result(result)
    return future


def press(user, text):
    user.find(kind=ui.button, content=text).click()


def press_that(user, label):
    """Press the button that is called so to who does not see it."""
    UserInteraction(user, set(called(user, ui.button, label)[:1]), None).click()


def give(user, element, value):
    """Let the user enter a value."""
    with user:
        element.value = value


def test_the_order_of_use_is_numbered():
    async def script(user, session):
        for text in (
            "1. Joints and angles",
            "2. Test",
            "3. Add",
            "4. Simulate",
            "Discard move",
            "Reset",
        ):
            await user.should_see(text)

    shown(script)


def test_a_joint_is_found_by_its_words_its_name_and_its_name_in_the_thesis():
    axes = described()["robots"]["humanoid"]["axes"]
    cases = {
        "HomIF": ["left_shoulder_pitch"],
        "caddf": ["right_hip_pitch"],
        "left hip": ["left_hip_roll", "left_hip_pitch"],
        "wrist": ["right_wrist", "left_wrist"],
        "right_knee": ["right_knee"],
        "": [axis["name"] for axis in axes],
        "tail": [],
    }

    async def script(user, session):
        for search, found in cases.items():
            give(user, next(iter(user.find(ui.input).elements)), search)
            names = [axis["name"] for axis in axes]
            assert [
                name for name in names if called(user, ui.number, words("en")(f"axes.{name}"))
            ] == found
        await user.should_see("No joint is called so.")

    shown(script)


def test_accents_and_capitals_do_not_count_in_a_search():
    assert matches("MUNECA izq", [words("es")("axes.left_wrist")])
    assert not matches("muneca derecha", [words("es")("axes.left_wrist")])


def test_all_axes_of_the_package_are_named_in_every_language():
    for language in languages():
        known = texts_of(language)
        for robot in ("humanoid", "roid1", "zjudancer", "yobotics"):
            axes = load_robot(robot).axes
            told = [known[f"axes.{axis}"] for axis in axes]
            assert len(set(told)) == len(axes)


def test_set_joints_are_tested_together_in_their_time_and_then_stored():
    async def script(user, session):
        give(user, field(user, "left shoulder: arm forward"), 30.0)
        give(user, called(user, ui.slider, "right hip: leg forward")[0], 20.0)
        assert field(user, "right hip: leg forward").value == 20.0
        give(user, field(user, "Duration"), 1.5)
        press(user, "2. Test")
        await heard()
        await user.should_see(
            "Tested and not added yet: right hip: leg forward 20°, left shoulder: arm forward 30°"
        )
        press(user, "3. Add")
        await heard()
        await user.should_see(
            "1. right hip: leg forward 20°, left shoulder: arm forward 30° in 1.5 s"
        )

    session = shown(script)
    targets = {"left_shoulder_pitch": 30.0, "right_hip_pitch": 20.0}
    assert [call for call in session.calls if call[0] in ("test", "add")] == [
        ("test", targets, 1.5),
        ("add",),
    ]


def test_a_duration_is_suggested_until_the_user_sets_one():
    async def script(user, session):
        give(user, field(user, "left shoulder: arm forward"), 100.0)
        await heard()
        assert field(user, "Duration").value == 2.5
        give(user, field(user, "left shoulder: arm forward"), 30.0)
        await heard()
        assert field(user, "Duration").value == 1.0
        give(user, field(user, "Duration"), 4.0)
        give(user, field(user, "left shoulder: arm forward"), 100.0)
        await heard()
        assert field(user, "Duration").value == 4.0
        press(user, "2. Test")
        await heard()

    session = shown(script)
    assert [call for call in session.calls if call[0] == "test"] == [
        ("test", {"left_shoulder_pitch": 100.0}, 4.0)
    ]


def test_a_second_test_has_the_joints_that_were_set_since():
    async def script(user, session):
        give(user, field(user, "left elbow"), 30.0)
        press(user, "2. Test")
        give(user, field(user, "right elbow"), 20.0)
        press(user, "2. Test")

    calls = [call for call in shown(script).calls if call[0] == "test"]
    assert [targets for _, targets, _ in calls] == [{"left_elbow": 30.0}, {"right_elbow": 20.0}]


FELL = {"ending": "monitor", "goes_on": False, "time": 0.0}


@pytest.mark.parametrize(
    ("ended", "again"),
    [
        (FELL, [{"left_elbow": 35.0, "right_elbow": 20.0}]),
        (None, [{"left_elbow": 35.0}]),  # a newer one takes its place; the move is kept
        ({**FELL, "ending": "stopped"}, [{"left_elbow": 35.0}]),
        ({**FELL, "ending": "completed", "goes_on": True}, [{"left_elbow": 35.0}]),
    ],
)
def test_what_was_typed_stays_when_a_test_falls(ended, again):
    async def script(user, session):
        give(user, field(user, "left elbow"), 30.0)
        give(user, field(user, "right elbow"), 20.0)
        press(user, "2. Test")
        session.ending.set_result(ended)
        session.told("phase", "program", phase="idle", time=0.7)
        session.run.history["reference"].append((0.7, [0.0] * 18))  # where the fall began
        await heard()
        fell = "right_elbow" in again[0]
        assert field(user, "right elbow").value == (20.0 if fell else 0.0)
        give(user, field(user, "left elbow"), 35.0)
        press(user, "2. Test")

    tests = [
        targets for name, targets, _ in (call for call in shown(script).calls if call[0] == "test")
    ]
    assert tests[1:] == again


def test_a_test_that_is_refused_leaves_what_was_typed():
    async def script(user, session):
        give(user, field(user, "left elbow"), 30.0)
        press(user, "2. Test")
        session.book.pending = ()
        session.ending.set_result(None)
        session.told("phase", "program", time=0.0)
        await heard()
        assert field(user, "left elbow").value == 30.0
        await user.should_see("To be tested: left elbow")

    shown(script)


def test_only_what_was_tested_can_be_added():
    async def script(user, session):
        (add,) = user.find(kind=ui.button, content="3. Add").elements
        assert not add.enabled
        give(user, field(user, "left elbow"), 30.0)
        press(user, "2. Test")
        await heard()
        assert add.enabled
        press(user, "3. Add")
        await heard()
        assert not add.enabled

    shown(script)


def test_a_number_beyond_the_limits_is_refused_in_its_field_with_the_limit():
    async def script(user, session):
        shoulder = field(user, "right shoulder: arm forward")
        for value, refused in ((180.5, True), (180.0, False), (-90.1, True), (-90.0, False)):
            give(user, shoulder, value)
            assert shoulder.error == ("from \N{MINUS SIGN}90° to 180°" if refused else None)
            press(user, "2. Test")

    tests = [call for call in shown(script).calls if call[0] == "test"]
    assert [targets for _, targets, _ in tests] == [
        {"right_shoulder_pitch": 180.0},
        {"right_shoulder_pitch": -90.0},
    ]


def test_a_joint_that_was_set_can_be_taken_back():
    async def script(user, session):
        elbow = field(user, "left elbow")
        give(user, elbow, 30.0)
        press_that(user, "Take back: left elbow")
        assert elbow.value == 0.0
        press(user, "2. Test")  # of nothing

    assert "test" not in [call[0] for call in shown(script).calls]


def test_joints_that_a_hand_in_the_view_set_are_tested_and_shown_as_a_ghost():
    async def script(user, session):
        session.hand.asked = {"left_elbow": 40.0, "right_knee": 12.0}
        session.told("hand")
        await heard()
        assert field(user, "left elbow").value == 40.0
        assert session.hand.leant[-1] == session.hand.asked
        press_that(user, "Take back: left elbow")
        assert session.hand.leant[-1] == {"right_knee": 12.0}
        press(user, "2. Test")
        await heard()
        assert session.hand.leant[-1] == {}

    session = shown(script)
    assert ("test", {"right_knee": 12.0}, 1.0) in session.calls


def test_what_is_set_goes_with_the_move_and_with_all():
    async def script(user, session):
        for button, call in (("Discard move", "discard"), ("Reset", "reset")):
            give(user, field(user, "left elbow"), 30.0)
            press(user, button)
            assert field(user, "left elbow").value == 0.0
            await user.should_see("Set one joint or more")
            assert session.calls[-1] == (call,)

    shown(script)


def test_the_same_is_tested_once_more_in_another_time():
    async def script(user, session):
        give(user, field(user, "left elbow"), 30.0)
        press(user, "2. Test")
        give(user, field(user, "Duration"), 3.0)
        press(user, "2. Test")

    assert shown(script).calls[-1] == ("test", {"left_elbow": 30.0}, 3.0)


@pytest.mark.parametrize("robot", ["humanoid", "roid1", "zjudancer"])
def test_the_demo_of_the_thesis_is_told_the_same_on_all_humanoids(robot):
    async def script(user, session):
        search = next(iter(user.find(ui.input).elements))
        for alias in ("HomIF", "CadDF"):
            give(user, search, alias)
            (only,) = (
                row
                for row in user.find(ui.number).elements
                if row.props.get("suffix") == "°" and seen(row)
            )
            give(user, only, 30.0)
        press(user, "2. Test")

    calls = shown(script, LegsSession(robot)).calls
    assert calls[-1] == ("test", {"left_shoulder_pitch": 30.0, "right_hip_pitch": 30.0}, 1.0)


def test_the_key_enter_in_a_field_tests():
    async def script(user, session):
        elbow = field(user, "left elbow")
        give(user, elbow, 30.0)
        user.find(kind=ui.number).trigger("keydown.enter")

    assert ("test", {"left_elbow": 30.0}, 1.0) in shown(script).calls


def test_a_page_begins_no_task_once_its_server_has_ended(monkeypatch):
    """A task that lives longer than its loop would be awaited for ever by the next server of this process."""
    session, begun = LegsSession(), []

    async def run():
        async with user_simulation(lambda: legs.build(session, words("en"))) as user:
            await user.open("/")
            begun.clear()
        session.told("program", "phase", "tick")
        await heard()

    monkeypatch.setattr(joints.Marks, "_ask", lambda _: begun.append(True))
    asyncio.run(run())
    assert not begun


def test_joints_that_are_not_set_show_what_the_robot_is_asked_for():
    async def script(user, session):
        give(user, field(user, "left elbow"), 30.0)
        session.run.history["reference"].append((2.0, [radians(number) for number in range(18)]))
        session.told("phase", phase="idle", time=2.0)
        await heard()
        assert field(user, "right shoulder: arm outward").value == pytest.approx(1.0)
        assert field(user, "left elbow").value == 30.0
        session.told("tick", time=0.0)
        await heard()
        assert field(user, "right shoulder: arm outward").value == 0.0

    shown(script)


def test_a_step_a_walk_and_an_act_are_asked_for():
    async def script(user, session):
        give(user, field(user, "Steps"), 6)
        give(user, field(user, "Amplitude"), 0.5)
        press(user, "Step")
        press(user, "Walk")
        press(user, "Act")

    walk = {"walk": {"steps": 6, "amplitude": 0.5}}
    assert shown(script).calls[-3:] == [
        ("step",),
        ("try_move", walk),
        ("try_move", {"act": {"name": "crouch"}}),
    ]


def test_a_walk_of_half_a_step_is_refused():
    async def script(user, session):
        give(user, field(user, "Steps"), 2.5)
        press(user, "Walk")
        assert field(user, "Steps").error.startswith("a whole number")

    assert not [call for call in shown(script).calls if call[0] == "try_move"]


def test_pieces_are_taken_and_left_and_loops_switched():
    async def script(user, session):
        press(user, "Take")
        press(user, "Leave")
        for option in ("brought to the hand", "it stays where it is"):
            user.find(kind=ui.checkbox, content=option).click()
        give(user, next(iter(user.find(kind=ui.select, content="With").elements)), "left_hand")
        press(user, "Take")
        press(user, "Leave")
        user.find(kind=ui.switch, content="arms against a fall").click()

    calls = shown(script).calls
    assert calls[-5:] == [
        ("try_move", {"attach": {"piece": "box"}}),
        ("try_move", {"release": {"piece": "box", "fixed": False}}),
        ("try_move", {"attach": {"piece": "box", "tool": "left_hand", "pose": [0.0] * 6}}),
        ("try_move", {"release": {"piece": "box", "fixed": True}}),
        ("switch_loop", "guard", True),
    ]


def test_a_loop_is_explained_by_a_picture():
    async def script(user, session):
        answer = Future()
        answer.set_result("<svg><text>ankles</text></svg>")
        session.loop_picture = lambda name, language: (
            session.calls.append(("loop_picture", name)) or answer
        )
        press_that(user, "How it works: keep the balance")
        await heard()
        await user.should_see("arms, hips and at last a step bring it back")
        (dialog,) = user.find(ui.dialog).elements
        assert dialog.value
        press(user, "Close")
        await heard()

    assert ("loop_picture", "balance") in shown(script).calls


STORED = [
    MOVE,
    {"walk": {"steps": 4, "amplitude": 0.5}},
    {"act": "bow"},
    {"attach": "box"},
    {"wait": 2.0},
]


def lines(user):
    """Return the texts of stored moves and changes, as they stand below each other."""
    labels = sorted(user.find(ui.label).elements, key=lambda element: element.id)
    labels = [label for label in labels if label.props.get("role") != "heading"]
    return [label.text for label in labels if label.text[:1].isdigit() and ". " in label.text]


def test_stored_moves_are_told_put_in_order_and_deleted():
    async def script(user, session):
        told = [
            "left shoulder: arm forward 30°, right hip: leg forward 20° in 1.5 s",
            "walk 4 steps (amplitude 0.5)",
        ]
        told += ["bow", "take box", "stand still for 2 s"]
        assert lines(user) == [f"{number}. {text}" for number, text in enumerate(told, 1)]
        press_that(user, "Earlier: 3.")
        press_that(user, "Later: 4.")
        press_that(user, "Delete: 1.")
        await heard()
        assert lines(user) == [
            "1. bow",
            "2. walk 4 steps (amplitude 0.5)",
            "3. stand still for 2 s",
            "4. take box",
        ]
        press_that(user, "Earlier: 1.")  # it is the first
        press_that(user, "Later: 4.")
        await heard()
        assert lines(user)[0] == "1. bow"

    shown(script, LegsSession(moves=STORED))


def test_a_stored_move_is_edited_and_its_limits_hold():
    async def script(user, session):
        press_that(user, "Edit: 1.")
        await heard()
        shoulder = called(user, ui.number, "left shoulder: arm forward")[-1]
        give(user, shoulder, 200.0)
        press(user, "Save")
        assert shoulder.error == "from \N{MINUS SIGN}90° to 180°"
        give(user, shoulder, 45.0)
        press_that(user, "Delete: right hip: leg forward")
        give(
            user,
            next(iter(user.find(kind=ui.select, content="One more joint").elements)),
            "left_knee",
        )
        give(user, called(user, ui.number, "left knee: shank backward")[-1], 15.0)
        give(user, called(user, ui.number, "Duration")[-1], 2.0)
        press(user, "Save")

    session = shown(script, LegsSession(moves=STORED))
    assert session.calls[-1] == (
        "edit",
        0,
        {"target_deg": {"HomIF": 45.0, "left_knee": 15.0}, "duration": 2.0},
    )


def test_a_stored_walk_keeps_what_the_form_does_not_show():
    async def script(user, session):
        press_that(user, "Edit: 1.")
        await heard()
        give(user, called(user, ui.number, "Steps")[-1], 8)
        press(user, "Save")

    session = shown(script, LegsSession(moves=[{"walk": {"steps": 4, "step_time": 0.4}}]))
    assert session.book.program.moves[0].entry() == {"walk": {"steps": 8, "step_time": 0.4}}


def test_what_no_form_asks_for_is_edited_as_the_file_has_it():
    async def script(user, session):
        press_that(user, "Edit: 1.")
        await heard()
        text = next(iter(user.find(kind=ui.input, content="Further keys, as in the file").elements))
        assert text.value == ""
        give(user, text, "repeat: [")
        press(user, "Save")
        assert text.error
        assert "edit" not in [call[0] for call in session.calls]
        give(user, text, "repeat: 2")
        give(
            user,
            max(user.find(kind=ui.select, content="Act").elements, key=lambda element: element.id),
            "wave",
        )
        press(user, "Save")
        await heard()
        press_that(user, "Edit: 1.")
        texts = user.find(kind=ui.input, content="Further keys, as in the file").elements
        assert max(texts, key=lambda element: element.id).value == "repeat: 2"

    session = shown(script, LegsSession(moves=[{"act": "bow"}]))
    assert session.book.program.moves[0].entry() == {"act": {"name": "wave", "repeat": 2}}


def test_changes_of_a_run_stand_below_the_moves():
    changes = [
        {"time": 1.35, "set": {"servo.kp": 500}},
        {"time": 1.5, "push": {"at": "trunk", "force": [5, 0, -2.5]}},
        {"time": 2.0, "drag": {"targets": [[0, 0, 0]] * 10}},
    ]

    async def script(user, session):
        told = [
            "1. at 1.35 s: servo.kp = 500",
            "2. at 1.5 s: push trunk with 5 0 \N{MINUS SIGN}2.5 N for 0.1 s",
            "3. at 2 s: drag the robot for 0.5 s",
        ]
        assert lines(user) == told
        press_that(user, "Delete: 2.")
        await heard()
        assert lines(user) == [told[0], "2. at 2 s: drag the robot for 0.5 s"]

    shown(script, LegsSession(changes=changes))


def test_a_loop_that_cannot_be_switched_now_stays_as_it_is():
    async def script(user, session):
        session.phase = "running"
        (guard,) = user.find(kind=ui.switch, content="arms against a fall").elements
        give(user, guard, True)
        assert not guard.value
        session.told(
            "description", description=described() | {"loops": [{"name": "guard", "on": True}]}
        )
        await heard()
        (guard,) = user.find(kind=ui.switch, content="arms against a fall").elements
        assert guard.value

    calls = [call for call in shown(script).calls if call[0] == "switch_loop"]
    assert calls == [("switch_loop", "guard", True)]


def test_the_page_is_spanish_where_that_is_asked_for():
    async def script(user, session):
        for text in (
            "1. Articulaciones y ángulos",
            "2. Probar",
            "3. Añadir",
            "4. Simular",
            "Resetear",
        ):
            await user.should_see(text)
        assert (
            lines(user)[0]
            == "1. hombro izquierdo: brazo adelante 30°, cadera derecha: pierna adelante 20° en 1,5 s"
        )

    shown(script, LegsSession(moves=STORED), "es")


def test_another_robot_has_its_own_joints_and_one_without_legs_none():
    async def script(user, session):
        give(user, field(user, "left elbow"), 30.0)
        session.told("description")  # of the same: what was set stays
        await heard()
        assert field(user, "left elbow").value == 30.0
        session.told("description", description=described("yobotics"), robot="yobotics")
        await heard()
        assert field(user, "rear left knee")
        assert called(user, ui.number, "left elbow") == []
        session.told(
            "description", description={**described("irb120"), "loops": []}, robot="irb120"
        )
        await heard()
        await user.should_see("Nothing with legs is loaded.")

    shown(script)


def test_plots_are_drawn_of_what_is_watched_and_no_longer_than_they_are_open():
    async def script(user, session):
        session.run.history["position"].extend(
            (number / 20, [radians(number)] * 18) for number in range(3)
        )
        give(user, next(iter(user.find(ui.expansion).elements)), True)
        await heard(0.5)
        charts = user.find(ui.echart).elements
        (position,) = (chart for chart in charts if chart.props["aria-label"] == "position")
        rows = position.options["dataset"][0]["source"]
        assert [row[0] for row in rows] == [0.0, 0.05, 0.1]
        assert rows[2][1:] == pytest.approx([2.0] * 6)  # degrees
        assert position.options["series"][0]["name"] == "right shoulder: arm forward"
        before = np.array([0.0, 0.1]), np.full((2, 18), radians(30.0))
        session.run.ended.append(
            EndedRun(4, "program", 0.0, 0.1, "completed", {"position": before}, Moments())
        )
        session.told("phase")
        await heard(0.5)
        choices = {one.props.get("label", ""): one for one in user.find(ui.select).elements}
        compared, looked = choices["Compare with a run before"], choices["Look at a run before"]
        assert looked.options == compared.options == {4: "4: the program, 0.00 to 0.10 s"}
        session.run.compared = session.run.ended[0]  # as the session does when it is chosen
        give(user, compared, 4)
        assert ("compare", 4) in session.calls
        await heard(0.5)
        series, sources = position.options["series"], position.options["dataset"]
        assert len(series) == 18, "six curves of the run, of its reference, and of the run before"
        assert [one["datasetIndex"] for one in series] == [0] * 6 + [1] * 6 + [2] * 6
        assert {one["lineStyle"]["type"] for one in series[6:12]} == {"dashed"}
        assert sources[2]["source"][1][:2] == pytest.approx([0.1, 30.0])
        session.run.compared = None
        session.run.shown = session.run.ended[0]
        give(user, looked, 4)
        assert ("show", 4) in session.calls
        await heard(0.5)
        assert position.options["dataset"][0]["source"][1][:2] == pytest.approx([0.1, 30.0])
        give(user, next(iter(user.find(ui.expansion).elements)), False)
        session.told("tick")
        watched = {}
        for _, signals, viewer in (call for call in session.calls if call[0] == "watch"):
            watched[viewer] = list(signals)
        assert sorted(watched.values()) == [[], ["reference", "position"]]

    shown(script)


def test_a_joint_that_does_not_come_to_where_it_should_says_why():
    """An elbow at its limit, a knee where its gains hold it, and a neck that is where it should be."""
    session = LegsSession()
    axes = [axis["name"] for axis in session.description["robots"]["humanoid"]["axes"]]
    elbow, knee = axes.index("left_elbow"), axes.index("right_knee")
    session.description["signals"].append(
        {"name": "torque", "unit": "N·m", "title": "torque", "columns": axes}
    )
    session.run.watch(("reference", "position", "torque"))
    asked, done, torque = [0.0] * 18, [0.0] * 18, [0.0] * 18
    asked[elbow], done[elbow], torque[elbow] = radians(90), radians(33), -3.0
    asked[knee], done[knee], torque[knee] = radians(60), radians(57), 1.25

    async def script(user, session):
        session.ask = lambda _: given([3.0] * 18)
        session.run.take(1.0, None, {"reference": asked, "position": done, "torque": torque})
        session.told("phase", "tick")
        await heard(0.1)
        shown = {
            label.text: label.classes
            for label in user.find(ui.label).elements
            if "pendant-off" in label.classes
        }
        assert {text: {"red", "amber"} & {*classes} for text, classes in shown.items() if text} == {
            "at 33°: at its limit of 3 N·m": {"red"},
            "at 57°: its gains hold it 3° off, with 1.25 of 3 N·m": {"amber"},
        }
        ticks = [
            one
            for one in user.find(ui.element).elements
            if "pendant-tick" in one.classes and seen(one)
        ]
        assert len(ticks) == 18
        session.told("phase", "tick", phase="running")
        await heard(0.1)
        await user.should_see("at 33°: at its limit of 3 N·m")
        await user.should_not_see("its gains hold it")

    shown(script, session)


def test_moves_are_told_in_words():
    cases = {
        "take box (right hand, brought to the hand)": {
            "attach": {"piece": "box", "tool": "right_hand", "pose": [0] * 6}
        },
        "leave box (it stays where it is)": {"release": {"piece": "box", "fixed": True}},
        "walk 2 steps (sideways, step time 0.4)": {
            "walk": {"steps": 2, "gait": "sideways", "step_time": 0.4}
        },
        "the station's own motion for 5 s": {"play": 5.0},
        "MoveL [[0, 0, 0.5]]": {"move_l": {"targets": [[0, 0, 0.5]]}},
        "Go (ahead 0.2 m/s, duration 3 s)": {"go": {"ahead": 0.2, "duration": 3.0}},
        "{hop: 1}": {"hop": 1},
        "left tail 3 in 1 s": {"target_deg": {"left_tail": 3.0}, "duration": 1.0},
    }
    phrases = Phrases(words("en"), described()["robots"]["humanoid"]["axes"])
    assert [phrases.move(move) for move in cases.values()] == list(cases)


def test_plots_show_the_newest_run_only():
    run = TaughtRun()
    run.watch(["x"])
    for number, time in enumerate((0.1, 0.2, 0.3, 0.1, 0.2), 1):
        run.take(time, None, {"x": number})
    assert list(run.history["x"]) == [(0.1, 4), (0.2, 5)]
    assert plots.at(run.history["x"], 0.15) == 4
    assert plots.at(run.history["x"], 0.05) is None


def test_columns_are_called_without_what_all_begin_with():
    assert plots.short(["a.q.hip", "a.q.knee"]) == ["hip", "knee"]
    assert plots.short(["left.x", "left.y", "right.x"]) == ["left.x", "left.y", "right.x"]
    assert plots.short(["angle"]) == ["angle"]


def test_a_plot_has_no_more_points_than_show():
    rows = [(float(number), 0) for number in range(1000)]
    thin = plots.thinned(rows, 200)
    assert len(thin) == 200
    assert (thin[0], thin[-1]) == (rows[0], rows[-1])


class HopMove(Move):
    """A kind of move that the package does not have."""

    key = "hop"
    title = "Hop"
    form: ClassVar = {"height": 0.05, "tool": "tools", "both": None}

    height: Annotated[float, Field(gt=0, le=0.5)]
    """How high [m]."""
    tool: str | None = None
    both: bool = False

    def caption(self, *, robots=False):
        return f"hop {self.height:g} m"


def test_a_new_kind_of_move_is_offered_by_its_title_its_form_and_its_caption(monkeypatch):
    monkeypatch.setitem(KINDS._all, HopMove.key, HopMove)
    hop = {"hop": {"height": 0.1, "tool": "left_hand", "both": True}}

    async def script(user, session):
        assert field(user, "height").value == 0.05
        give(user, field(user, "height"), 0.6)
        press(user, "Hop")
        assert field(user, "height").error == "from 0 m to 0.5 m"
        give(user, field(user, "height"), 0.1)
        selects = user.find(kind=ui.select, content="With").elements
        give(user, max(selects, key=lambda element: element.id), "left_hand")
        user.find(kind=ui.checkbox, content="both").click()
        press(user, "Hop")
        session.told("program", pending=(hop,))
        await heard()
        await user.should_see("Tested and not added yet: hop 0.1 m")
        press(user, "3. Add")
        await heard()
        assert lines(user) == ["1. hop 0.1 m"]
        press_that(user, "Edit: 1.")
        await heard()
        give(user, called(user, ui.number, "height")[-1], 0.2)
        press(user, "Save")

    session = shown(script)
    assert [call for call in session.calls if call[0] == "try_move"] == [("try_move", hop)]
    assert session.book.program.moves[0].entry() == {"hop": {**hop["hop"], "height": 0.2}}


@pytest.mark.parametrize("language", ["en", "es"])
def test_each_loop_says_what_it_does(language):
    stations = ("humanoid_dynamic", "roid1_dynamic", "irb120_dynamic", "yobotics_dynamic")
    loops = {name for station in stations for name in loops_known(load_station(station))}
    assert len(loops) > 8
    for name in loops:
        assert Phrases(words(language), ()).loop(name).endswith("."), name


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("en", "sets all joints, so moves set here have no effect"),
        ("es", "fija todas las articulaciones"),
    ],
)
def test_a_walk_that_overrules_moves_is_named_before_one_is_tested(language, text):
    async def script(user, session):
        await heard()
        assert not any(text in label.text for label in user.find(ui.label).elements if seen(label))
        session.overruled_by = "walk"
        session.told("description")
        await heard()
        assert any(text in label.text for label in user.find(ui.label).elements if seen(label))

    shown(script, language=language)
