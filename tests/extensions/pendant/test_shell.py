"""What all tabs of the pendant share: words, keys, what is loaded, the bar that runs it, the view, what is taken."""

import asyncio
import re
from base64 import b64encode
from concurrent.futures import Future
from pathlib import Path

import pytest
from stub_session import Exports, Notice, StubSession

pytest.importorskip("nicegui", reason="needs the extra gui")
from nicegui import ElementFilter, ui
from nicegui.testing import user_simulation
from nicegui.testing.user_interaction import UserInteraction

from simrob_drake.base.errors import SimrobError, UnknownName
from simrob_drake.base.messages import message
from simrob_drake.base.remarks import Remark, Remedy
from simrob_drake.extensions import pendant
from simrob_drake.extensions.pendant.pages import shell
from simrob_drake.extensions.pendant.pages.elements import KEYS
from simrob_drake.extensions.pendant.pages.words import JudgedRun, languages, texts_of, words
from simrob_drake.extensions.pendant.pendant import Pendant
from simrob_drake.extensions.pendant.run import EndedRun, Moments
from simrob_drake.results.verdict.judge import CRITERIA
from simrob_drake.results.verdict.verdict import CriterionRow, Measure, MeasuredValue
from simrob_drake.robots.catalog import robot_names
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.load import load_station

EN, ES = texts_of("en"), texts_of("es")
BRACES = re.compile(r"{(\w+)}")


def opened(subject, robot=None, **more):
    if subject == "wrong":
        raise SimrobError("there is no station or robot 'wrong'")
    session = StubSession(subject, **more)
    session.book.robot = robot or session.book.robot
    session.opened()
    return session


@pytest.fixture(autouse=True)
def bare_tabs(monkeypatch):
    """The tabs have tests of their own."""
    monkeypatch.setattr(
        shell, "TABS", {name: lambda *_: None for name in ("legs", "arm", "station")}
    )


def visit(scenario, pendant=None, *, webgl=True):
    """Let a user do something in the page of a pendant."""

    async def run():
        shown = pendant or Pendant(opened, "humanoid")
        async with user_simulation(root=lambda: shell.build(shown)) as user:
            user.javascript_rules[re.compile(r"window\.hasWebGL\(\)")] = lambda _: webgl
            await user.open("/")
            await asyncio.sleep(0.05)
            await scenario(user, shown)

    asyncio.run(run())


def shown_name(picture):
    return picture.default_slot.children[1].text.replace(" ", "_")


def button(user, keys):
    (found,) = elements(user, **{KEYS: keys})
    return found


def press(user, element):
    UserInteraction(user, {element}, None).click()


def elements(user, **properties):
    """Return the elements of the page whose properties are so."""
    with user:
        found = ElementFilter(local_scope=False)
        return [
            one
            for one in found
            if all(one.props.get(name) == value for name, value in properties.items())
        ]


async def until(condition):
    for _ in range(250):
        if condition():
            return
        await asyncio.sleep(0.02)
    pytest.fail("it did not come")


async def heard(session, *topics, **news):
    session.told(*topics, **news)
    await asyncio.sleep(0.05)


# Words


def test_the_languages_say_the_same_things():
    assert languages() == ["en", "es"]
    assert EN.keys() == ES.keys()
    assert {key: sorted(BRACES.findall(text)) for key, text in EN.items()} == {
        key: sorted(BRACES.findall(text)) for key, text in ES.items()
    }
    assert all(isinstance(text, str) and text.strip() for text in [*EN.values(), *ES.values()])
    with pytest.raises(UnknownName, match="language 'fr'"):
        words("fr")


def test_a_fall_is_told_in_spanish():
    render = words("es").render
    fall = message(
        "parts.fell_leaning", "{who} fell: it leans by more than {tilt:g} deg", who="robot", tilt=45
    )
    at_time = message("mujoco.reason_at_time", "{why}, at {time:.4g} s", why=fall, time=2.561)
    stop = message(
        "results.stopped_by", "stopped by {monitor}: {reason}", monitor="fall", reason=at_time
    )
    assert render(stop) == "la detuvo fall: robot se cayó: se inclina más de 45°, a los 2,561 s"
    assert words("en").render(stop) == str(stop)


@pytest.mark.parametrize(
    "name", ["irb120_dynamic", "humanoid_fixed", "box_on_floor", "zjudancer_walking"]
)
def test_checks_of_a_station_are_told_in_spanish(name):
    render = words("es").render
    found = [one for one in check_station(load_station(name)) if "[" not in one.text]
    assert len(found) > 2
    assert [one.text for one in found if render(one.text) == one.text] == []
    assert [
        one.subject for one in found if render(one.subject) == one.subject and " of " in one.subject
    ] == []
    english = re.compile(r"\b(the|of|at|is|are|and|not|its|by)\b")
    # the source of a motor's values is a name
    told = [re.sub(r"\(.*\)", "", render(one.text)) for one in found]
    assert [text for text in told if english.search(text)] == []


def test_verdicts_are_shown_in_spanish():
    """Of all criteria, in their own words."""
    render = words("es").render
    for criterion in CRITERIA:
        value = MeasuredValue("joint_2", 2.0, criterion.unit, 1.0, 0.5, 194.0, "steps")
        measure = Measure(
            criterion, (value._replace(value=0.0, bound=1.0) if criterion.least else value,)
        )
        for text in (measure.row.criterion, measure.warning):
            assert render(text) != text
            assert not re.search(r"\b(was|were|of|the|its|bound|limit)\b", render(text)), render(
                text
            )


def test_every_notice_of_a_session_has_its_words():
    said = re.compile(r'(?:Notice|refuse)\(\s*"(\w+)"|key, \w+(?:, taken)? = \(?\s*"(\w+)"')
    sources = (file.read_text() for file in Path(pendant.__file__).parent.glob("*.py"))
    used = {key for source in sources for found in said.findall(source) for key in found if key}
    used |= {"damaged", "died", "lost"}  # one of two, where it is said
    assert used == {key.removeprefix("notice.") for key in EN if key.startswith("notice.")}


# A file that another editor has changed


def test_what_becomes_of_a_file_that_was_changed_elsewhere_is_asked():
    pendant = Pendant(opened, "humanoid", language="es")

    async def scenario(user, pendant):
        (alert,) = elements(user, role="alert")
        assert not alert.visible
        await heard(pendant.session, "program", conflict=True, file=Path("x/program.yaml"))
        assert alert.visible
        await user.should_see("Otro programa cambió program.yaml")
        user.find(ES["shell.take_theirs"]).click()
        user.find(ES["shell.keep_both"]).click()
        assert pendant.session.calls == [("take_theirs",), ("keep_both",)]
        await heard(pendant.session, "program", conflict=False)
        assert not alert.visible

    visit(scenario, pendant)


# What is loaded


def test_the_robots_are_shown_and_the_loaded_one_is_marked():
    async def scenario(user, pendant):
        buttons = [one for one in elements(user) if "pendant-robot" in one.classes]
        pictures = {shown_name(one): one.props["aria-pressed"] for one in buttons}
        assert pictures.keys() == set(robot_names())
        assert [name for name, pressed in pictures.items() if pressed == "true"] == ["humanoid"]
        # those with legs first
        assert list(pictures)[:4] == [
            "humanoid",
            "roid1",
            "yobotics",
            "zjudancer",
        ]

    visit(scenario)


def test_another_robot_takes_the_place_of_the_loaded_one():
    pendant = Pendant(opened, "humanoid")
    first = pendant.session

    async def scenario(user, pendant):
        (picture,) = (
            one
            for one in elements(user)
            if "pendant-robot" in one.classes and shown_name(one) == "irb120"
        )
        UserInteraction(user, {picture}, None).trigger("click")
        assert first.closed
        assert pendant.session.subject == "irb120"
        second = pendant.session
        assert not pendant.load("irb120")  # again
        assert pendant.session is second
        assert not second.closed

    visit(scenario, pendant)


def test_what_cannot_be_loaded_is_told_and_what_is_loaded_stays():
    pendant = Pendant(opened, "humanoid")
    first = pendant.session
    with pytest.raises(SimrobError, match="wrong"):
        pendant.load("wrong")
    assert pendant.session is first
    assert not first.closed


def test_of_several_robots_one_is_taught():
    def two(subject, robot=None):
        session = opened(subject, robot or "left", station="two_arms")
        kinds = {"left": "arm", "right": "legs"}
        session.told(
            description={
                "robots": {name: {"model": "irb120", "kind": kinds[name]} for name in kinds}
            }
        )
        return session

    async def scenario(user, pendant):
        first = pendant.session
        with user:
            choice = next(
                one
                for one in ElementFilter(kind=ui.select, local_scope=False)
                if one.value == "left"
            )
        assert choice.options == ["left", "right"]
        choice.set_value("right")
        assert first.closed  # before: two do not teach in one folder
        assert (pendant.session.subject, pendant.session.book.robot) == (first.subject, "right")

    visit(scenario, Pendant(two, "two_arms"))


def test_the_tab_of_its_kind_comes_to_the_front():
    async def scenario(user, pendant):
        with user:
            (tabs,) = ElementFilter(kind=ui.tabs, local_scope=False)
            heads = {
                one.props["name"]: one for one in ElementFilter(kind=ui.tab, local_scope=False)
            }
        assert tabs.value == "legs"
        assert {name: head.visible for name, head in heads.items()} == {
            "legs": True,
            "arm": False,
            "station": True,
        }
        tabs.set_value("station")
        await heard(pendant.session, "description")
        assert tabs.value == "station"  # as its user wants

    visit(scenario)


# The run


def test_the_bar_follows_a_run_and_play_does_what_comes_next():
    async def scenario(user, pendant):
        session = pendant.session
        play, tick, stop, start = (button(user, keys) for keys in ("Space", ".", "Shift+S", "Home"))
        assert [one.enabled for one in (play, tick, stop, start)] == [True, True, False, False]
        press(user, play)
        await heard(session, "phase", phase="running")
        assert (play.props["icon"], play.props["aria-label"], tick.enabled) == (
            "pause",
            EN["run.pause"],
            False,
        )
        await heard(session, "tick", time=1.25, reach=1.25, ratio=0.8)
        await user.should_see("1.25 of 1.25 s")
        await user.should_see("0.8 × the clock")  # below the time: the bar does not become wider
        press(user, play)
        await heard(session, "phase", phase="paused")
        assert [play.props["icon"], *(one.enabled for one in (tick, stop, start))] == [
            "play_arrow",
            True,
            True,
            True,
        ]
        press(user, tick)
        press(user, start)
        await heard(session, "phase", "tick", phase="idle", time=0.0, rewound=True)
        await user.should_see("0.00 of 1.25 s")
        press(user, play)
        await heard(session, "phase", "tick", phase="running", time=0.3, reach=0.3, rewound=False)
        await user.should_see("0.30 of 0.30 s")  # what came after is forgotten
        press(user, stop)
        await heard(session, "phase", phase="idle")
        press(user, tick)
        # what came next was discarded
        await heard(session, "phase", "tick", phase="idle", time=0.1)
        press(user, play)
        asked = [
            "simulate",
            "pause",
            "one_tick",
            "rewind",
            "go_on",
            "stop",
            "simulate",
            "pause",
            "simulate",
        ]
        assert [name for name, *_ in session.calls] == asked
        await heard(session, "program", pending=({"target_deg": {}},))
        assert not play.enabled
        assert not tick.enabled  # they would forget what was tested

    visit(scenario)


def test_the_view_says_which_run_its_ghost_is():
    async def scenario(user, pendant):
        run = pendant.session.run
        run.ended.append(EndedRun(4, "program", 0.0, 0.1, "completed", {}, Moments()))
        run.compared = run.ended[0]
        run.reach = 0.1
        await heard(pendant.session, "tick")
        await user.should_see(ES["shell.ghost"].format(run="ejecución 4"))
        run.compared = None
        await heard(pendant.session, "history")
        await user.should_not_see("En azul")

    visit(scenario, Pendant(opened, "humanoid", language="es"))


def test_the_way_back_is_the_user_s_and_no_echo_of_the_run():
    async def scenario(user, pendant):
        session = pendant.session
        await heard(session, "phase", "tick", phase="running", time=2.0, reach=2.0)
        (slider,) = (one for one in elements(user) if isinstance(one, ui.slider))
        assert (slider.value, slider.props["max"], slider.props["step"]) == (2.0, 2.0, 0.05)
        assert session.calls == []
        UserInteraction(user, {slider}, None).trigger("update:modelValue", 0.75)
        assert session.calls == [("rewind", 0.75)]

    visit(scenario)


def test_a_pace_that_is_shown_is_not_asked_for_again():
    """Else two tabs would answer each other for ever."""

    async def scenario(user, pendant):
        session = pendant.session
        (pace,) = (
            one for one in elements(user) if isinstance(one, ui.select) and "max" in one.options
        )
        await heard(session, "phase", pace=0.25)
        assert (pace.value, session.calls) == ("0.25", [])
        pace.set_value("max")
        assert session.calls == [("set_pace", None)]

    visit(scenario)


def test_a_message_is_told_in_the_page_s_language_and_what_is_wrong_stands_out():
    pendant = Pendant(opened, "humanoid", language="es")

    async def scenario(user, pendant):
        await heard(pendant.session, "message", message=Notice("exported", {"file": "a.csv"}))
        await user.should_see("Se ha escrito a.csv")
        await heard(
            pendant.session, "message", message=Notice(fills={"text": "kp is -1"}, wrong=True)
        )
        (place,) = elements(user, role="region")
        (line,) = place.default_slot.children
        assert "pendant-failure" in line.classes
        assert [one.text for one in line.default_slot.children if isinstance(one, ui.label)] == [
            "kp is -1"
        ]

    visit(scenario, pendant)


def severities(user):
    """Severity and text of each line of the message, in order."""
    (place,) = elements(user, role="region")
    found = []
    for line in place.default_slot.children:
        severity = [
            name
            for name in ("success", "note", "warning", "failure")
            if f"pendant-{name}" in line.classes
        ]
        texts = [one.text for one in line.default_slot.children if isinstance(one, ui.label)]
        if severity and texts:
            found.append((*severity, *texts))
    return found


SAGS = Remedy(
    "the servos sag under gravity: turn on gravity feedforward", "servo.feedforward", "gravity"
)
ROWS = (
    CriterionRow("warning", "final error", "1.2 deg", "1 deg", "joint_2"),
    CriterionRow("success", "peak torque", "30 N·m", "200 N·m", "joint_2"),
)


def test_each_line_of_a_verdict_has_the_colour_of_its_severity():
    """All lines were red and bold after a run that went to its end."""
    beyond = Remark("warning", "joint_2 ended 1.2 deg off", SAGS)
    verdict = [Remark("warning", "ran to its end at 3 s. One bound exceeded"), beyond]

    async def scenario(user, pendant):
        good = [Remark("success", "ran to its end at 3 s. All within bounds")]
        await heard(pendant.session, "message", message=Notice.of_remarks(good, ROWS[1:]))
        assert severities(user) == [("success", "Ran to its end at 3 s. All within bounds")]
        (fold,) = (one for one in elements(user) if "pendant-criteria" in one.classes)
        assert not fold.value
        await heard(pendant.session, "message", message=Notice.of_remarks(verdict, ROWS))
        assert severities(user) == [
            ("warning", "Ran to its end at 3 s. One bound exceeded"),
            ("warning", "joint_2 ended 1.2 deg off"),
        ]
        (fold,) = (one for one in elements(user) if "pendant-criteria" in one.classes)
        assert fold.value, "unfolded, since a bound is exceeded"
        rows = [one for one in elements(user) if one.tag == "tr"]
        assert [len(row.default_slot.children) for row in rows] == [5, 5, 5]
        assert [
            next(iter({"pendant-warning", "pendant-success"} & {*row.classes}), "") for row in rows
        ] == [
            *("", "pendant-warning", "pendant-success"),
        ]
        fell = Notice.of_remarks([Remark("failure", "stopped by fall")])
        await heard(pendant.session, "message", message=fell)
        assert severities(user) == [("failure", "stopped by fall")]

    visit(scenario)


def test_a_remedy_that_is_a_key_of_the_station_has_a_button_that_sets_it():
    remarks = [
        Remark("warning", "ran to its end"),
        Remark("warning", "joint_2 ended 1.2 deg off", SAGS),
        Remark("warning", "joint_3 is too weak", Remedy("carry less", "servo.torque_limit")),
    ]

    async def scenario(user, pendant):
        await heard(pendant.session, "message", message=Notice.of_remarks(remarks, ROWS))
        await user.should_see("The servos sag under gravity: turn on gravity feedforward")
        await user.should_see("Carry less")
        (apply,) = (
            one
            for one in elements(user)
            if isinstance(one, ui.button) and one.text.startswith("Apply")
        )
        assert apply.text == "Apply: servo.feedforward = gravity"
        await heard(pendant.session, "phase", phase="running")
        assert not apply.enabled, "the station is loaded anew by it"
        await heard(pendant.session, "phase", phase="idle")
        press(user, apply)
        assert ("set_all", {"servo.feedforward": "gravity"}) in pendant.session.calls

        contact = Remedy("turn contact on", "contact", {}, further=(("solver.kind", "discrete"),))
        await heard(
            pendant.session,
            "message",
            message=Notice.of_remarks([remarks[0], Remark("warning", "", contact)]),
        )
        (apply,) = (
            one
            for one in elements(user)
            if isinstance(one, ui.button) and one.text.startswith("Apply")
        )
        assert apply.text.endswith(", solver.kind = discrete")
        press(user, apply)
        assert ("set_all", {"contact": {}, "solver.kind": "discrete"}) in pendant.session.calls

    visit(scenario)


def test_a_verdict_is_marked_as_old_once_a_run_begins_or_the_station_changes():
    """It stayed as it was below the next run, and below a station with other keys."""

    def is_old(user):
        (place,) = elements(user, role="region")
        return "pendant-old" in place.classes

    def marks(user):
        return [one.text for one in elements(user) if "pendant-age" in one.classes and one.visible]

    async def scenario(user, pendant):
        session = pendant.session
        before = JudgedRun(7, {})
        remarks = [Remark("success", "all within bounds")]
        await heard(session, "message", message=Notice.of_remarks(remarks, ROWS[1:], before))
        assert (is_old(user), marks(user)) == (False, [])
        await heard(session, "phase", phase="running")
        assert (is_old(user), marks(user)) == (
            True,
            ["Verdict on run 7, from before what is shown now"],
        )
        await heard(session, "phase", phase="idle")
        assert not is_old(user)
        await heard(session, "description", settings={"servo.kp": 500})
        assert (is_old(user), len(marks(user))) == (True, 1)
        now = JudgedRun(8, {"servo.kp": 500})
        remarks = [Remark("success", "again")]
        await heard(session, "message", message=Notice.of_remarks(remarks, ROWS[1:], now))
        assert not is_old(user)

        # A page that is loaded again shows the message of before: its verdict is about the station of before.
        await heard(session, "message", message=Notice.of_remarks(remarks, ROWS[1:], before))
        assert marks(user) == ["Verdict on run 7, from before what is shown now"]

    visit(scenario)


def test_the_button_of_a_remedy_is_below_its_sentence():
    """Beside the sentence it left a narrow column for it."""

    async def scenario(user, pendant):
        remarks = [
            Remark("warning", "ran to its end"),
            Remark("warning", "joint_2 ended 1.2 deg off", SAGS),
        ]
        await heard(pendant.session, "message", message=Notice.of_remarks(remarks, ROWS))
        (row,) = (one for one in elements(user) if "pendant-remedy-button" in one.classes)
        (apply,) = row.default_slot.children
        assert apply.text.startswith("Apply")
        (sentence,) = (one for one in elements(user) if "pendant-remedy" in one.classes)
        assert not [one for one in sentence.default_slot.children if isinstance(one, ui.button)]

    visit(scenario)


def test_keys_have_the_names_of_the_keyboard_of_the_language():
    async def scenario(user, pendant):
        tips = [one.text for one in elements(user) if isinstance(one, ui.tooltip)]
        assert "Ejecutar (Espacio)" in tips
        assert "Volver al principio (Inicio)" in tips
        assert "Parar (Mayús+S)" in tips
        assert "Deshacer (Ctrl+Z)" in tips
        assert not [tip for tip in tips if re.search(r"Space|Home|Shift|Control", tip)]
        press(user, button(user, "?"))
        await user.should_see("Ctrl+Mayús+Z")
        # Scripts of the page, and screen readers, know the keys by their English names.
        assert button(user, "Space").props[KEYS] == "Space"

    visit(scenario, Pendant(opened, "humanoid", language="es"))


def test_a_tab_stays_in_front_when_the_page_or_the_station_is_loaded_again():
    pendant = Pendant(opened, "irb120")
    fronts = []

    def tabs(user):
        return next(one for one in elements(user) if isinstance(one, ui.tabs))

    async def choose(user, pendant):
        fronts.append(tabs(user).value)
        tabs(user).value = "station"
        await heard(pendant.session, "description")
        fronts.append(tabs(user).value)

    async def look_again(user, pendant):
        fronts.append(tabs(user).value)

    visit(choose, pendant)
    visit(look_again, pendant)
    assert fronts == ["arm", "station", "station"]


# The view


def test_the_view_is_a_frame():
    async def scenario(user, pendant):
        await until(lambda: elements(user, src="view/"))
        (frame,) = elements(user, src="view/")
        assert (frame.tag, frame.props["title"]) == ("iframe", EN["shell.view"])
        drag = button(user, "D")
        press(user, drag)
        assert drag.props["aria-pressed"] == "true"
        press(user, hand := button(user, "G"))  # of two moods one is there
        assert (drag.props["aria-pressed"], hand.props["aria-pressed"]) == ("false", "true")
        await user.should_see(EN["hand.hint"])
        press(user, hand)
        assert hand.props["aria-pressed"] == "false"
        await user.should_not_see(EN["hand.hint"])

    visit(scenario)


def test_without_webgl_a_run_is_a_strip_of_pictures_and_why(tmp_path):
    file = tmp_path / "program.png"
    file.write_bytes(b"\x89PNG strip")
    drawn = []

    def strip(exports):
        drawn.append(exports.session.run.time)
        done = Future()
        done.set_result(file)
        return done

    async def scenario(user, pendant):
        await user.should_see(EN["shell.no_webgl"])
        assert drawn == []  # nothing was run
        await heard(pendant.session, "phase", phase="running", time=2.0)
        assert drawn == []
        await heard(pendant.session, "phase", phase="idle", ending={"ending": "completed"})
        await until(lambda: drawn == [2.0])
        for phase in ("saving", "idle"):  # as it is drawn
            await heard(pendant.session, "phase", phase=phase)
        assert drawn == [2.0]
        (image,) = elements(user, alt=EN["shell.view"])
        assert (
            image.props["src"] == f"data:image/png;base64,{b64encode(file.read_bytes()).decode()}"
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Exports, "film_strip", strip, raising=False)
        visit(scenario, webgl=False)


# The rest of the head


def test_undo_and_redo_are_there_when_something_can_be():
    async def scenario(user, pendant):
        undo, redo = button(user, "Control+Z"), button(user, "Control+Shift+Z")
        assert (undo.enabled, redo.enabled) == (False, False)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(StubSession, "can_undo", True)
            await heard(pendant.session, "program")
            assert (undo.enabled, redo.enabled) == (True, False)

    visit(scenario)


def test_what_is_written_is_taken_away(tmp_path):
    file = tmp_path / "program.yaml"
    done = Future()
    done.set_result(file)

    async def scenario(user, pendant):
        first, *_ = (one for one in elements(user) if isinstance(one, ui.menu_item))
        press(user, first)
        await until(lambda: user.download.http_responses)
        (taken,) = user.download.http_responses
        assert taken.request.url.path == str(file)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Exports, "program", lambda _: done, raising=False)
        visit(scenario)


def test_the_help_lists_the_keys_of_what_is_there():
    async def scenario(user, pendant):
        press(user, button(user, "?"))
        await user.should_see("Ctrl+Shift+Z")
        await user.should_see("Alt+1")
        await user.should_not_see("Alt+2")  # no arm is loaded
        keys = [one.props[KEYS] for one in elements(user) if KEYS in one.props]
        assert len(keys) == len(set(keys))  # each presses one button

    visit(scenario)


def test_all_that_is_pressed_has_a_name():
    async def scenario(user, pendant):
        for one in elements(user):
            if isinstance(one, ui.button | ui.slider | ui.select):
                assert one.props.get("aria-label") or one.props.get("label"), one

    visit(scenario)


def test_a_tab_has_the_language_of_its_address():
    async def scenario(user, pendant):
        await user.should_see(EN["shell.title"])
        await user.open("/?language=es")
        await user.should_see(ES["shell.title"])
        await user.open("/?language=xx")
        await user.should_see(EN["shell.title"])

    visit(scenario)
