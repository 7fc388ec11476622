"""The station's page: blocks to choose, a form that refuses in the checker's words, what a check finds, what ended."""

import asyncio
import math
import re
from concurrent.futures import Future
from contextlib import asynccontextmanager

import pytest
from stub_session import StubSession

pytest.importorskip("nicegui", reason="needs the extra gui")
from nicegui import ui
from nicegui.testing import user_simulation
from nicegui.testing.user_interaction import UserInteraction

from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.pendant.pages import station
from simrob_drake.extensions.pendant.pages.block_picture import (
    BlockPicture,
    labels_of,
    with_buttons,
    with_values,
)
from simrob_drake.extensions.pendant.pages.station import in_brief
from simrob_drake.extensions.pendant.pages.words import Notice, texts_of, value_text, words
from simrob_drake.programs.timeline import Change
from simrob_drake.results.block_diagram.picture import station_svg
from simrob_drake.stations.load import load_station
from simrob_drake.stations.schema import station_schema

SVG = station_svg(load_station("irb120_dynamic"), live=True)
SIGNALS = [
    {
        "name": name,
        "unit": unit,
        "title": name,
        "columns": [f"{name}.joint_{axis}" for axis in range(1, 7)],
    }
    for name, unit in (("reference", "rad"), ("position", "rad"), ("torque", "N·m"))
]


def given(result):
    future = Future()
    future.set_result(result)
    return future


class Station(StubSession):
    """An idle station that takes what the loader takes."""

    def __init__(self):
        super().__init__("irb120")
        self.drawn, self.watched, self.config = 0, {}, load_station(self.station)
        axes = [{"name": f"joint_{number}"} for number in range(1, 7)]
        robots = {"robot": {"kind": "arm", "axes": axes}}
        self.description = {"mode": "dynamic", "robots": robots, "bodies": [], "signals": SIGNALS}

    def schema(self):
        return station_schema()

    def set(self, key, value):
        try:
            self.config = load_station(self.station, {**self.settings, key: value})
        except SimrobError as problem:
            self.told("message", message=Notice(fills={"text": str(problem)}, wrong=True))
            return False
        self.told("description", settings={**self.settings, key: value})
        return True

    def unset(self, key):
        settings = {k: v for k, v in self.settings.items() if k != key}
        self.config = load_station(self.station, settings)
        self.told("description", settings=settings)
        return True

    def change(self, key, value):
        self.calls.append(("change", key, value))
        return given({})

    def watch(self, signals, viewer=None):
        self.watched[viewer] = list(signals)
        return given(None)

    def picture(self, folded, language):
        self.drawn += 1
        return given(
            station_svg(load_station("irb120_dynamic"), live=True, folded=folded) if folded else SVG
        )

    def check(self):
        findings = [("ok", "contact", "nothing penetrates"), ("warning", "base", "it tips over")]
        return given(
            [dict(zip(("level", "subject", "text"), finding, strict=True)) for finding in findings]
        )


@asynccontextmanager
async def opened(session, language="en"):
    async with user_simulation(lambda: station.build(session, words(language))) as user:
        await user.open("/")
        await settled()
        yield user


async def settled(seconds=0.25):
    """Wait until what follows the session, and what was asked, is there."""
    await asyncio.sleep(seconds)


def on_page(scenario, session=None, language="en"):
    session = session or Station()

    async def run():
        async with opened(session, language) as user:
            await scenario(user, session)

    asyncio.run(run())


IN_FORCE = {
    "en": {
        "pieces.gripper.mass": ("1.0", "in force: 1.0, from the piece's file"),
        "servo.torque_limit": ("3.1", "in force: 3.1, from the motor"),
        "servo.ki": ("0.5", "in force: 0.5, from the robot's file"),
    },
    "es": {
        "pieces.gripper.mass": ("1,0", "en vigor: 1,0, del fichero de la pieza"),
        "servo.torque_limit": ("3,1", "en vigor: 3,1, del motor"),
        "servo.ki": ("0,5", "en vigor: 0,5, del fichero del robot"),
    },
}


@pytest.mark.long
@pytest.mark.parametrize("language", IN_FORCE)
def test_a_field_that_is_not_set_shows_the_value_in_force_and_its_origin(language):
    session = Station()
    session.description["in_force"] = {
        "pieces.gripper.mass": {"value": 1.0, "origin": "piece"},
        "servo.torque_limit": {"value": 3.1, "origin": "motor"},
        "servo.ki": {"value": 0.5, "origin": "robot"},
    }

    async def scenario(user, _):
        (search,) = user.find(content=words(language)("station.search"), kind=ui.input).elements
        for key, (placeholder, hint) in IN_FORCE[language].items():
            search.value = key
            await settled(0.1)
            # The search field contains the key, too.
            (element,) = user.find(content=key, kind=ui.input).elements - {search}
            assert element.value in ("", None)
            assert element.props["placeholder"] == placeholder
            assert hint in element.props["hint"]

    on_page(scenario, session, language)


@pytest.mark.parametrize("value", [1.5, {"joint_1": 1.5}, [1.5, 2.5], True, "1.5", None])
def test_one_number_has_the_decimal_sign_of_the_language(value):
    """Lists and mappings are YAML, in which a comma separates."""
    expected = "1,5" if value == 1.5 else value_text(value, "en")
    assert value_text(value, "es") == expected


@pytest.mark.long
def test_a_gain_with_a_decimal_comma_is_a_number():
    async def scenario(user, session):
        (search,) = user.find(content=words("es")("station.search"), kind=ui.input).elements
        search.value = "servo.kp"
        await settled(0.1)
        field = user.find(content="servo.kp", kind=ui.input)
        field.elements -= {search}
        (element,) = field.elements
        assert element.value == "1000,0"
        element.value = "900,5"
        field.trigger("keydown.enter")
        await settled(0.1)
        assert session.book.settings == {"servo.kp": 900.5}

    on_page(scenario, language="es")


@pytest.mark.long
def test_a_wrong_value_is_refused_in_its_field_and_a_right_one_taken():
    async def scenario(user, session):
        user.find(content="Search for a key", kind=ui.input).type("proportional gain, per")
        await settled(0.1)
        field = user.find(content="servo.kp", kind=ui.input)
        (element,) = field.elements
        assert (element.value, element.props["suffix"]) == ("1000.0", "N·m/rad")
        element.value = "{joint_9: 5}"
        field.trigger("keydown.enter")
        await settled(0.1)
        assert "did you mean 'joint_6'" in element.error
        assert session.book.settings == {}
        element.value = "500"
        field.trigger("blur")
        await settled()
        assert element.error is None
        assert session.book.settings == {"servo.kp": 500}
        await user.should_see("servo.kp: 500")  # what is changed, to be taken back
        session.setup.unset("servo.kp")
        await settled()
        await user.should_not_see("servo.kp: 500")
        assert element.value == "1000.0"

    on_page(scenario)


def test_while_a_run_goes_on_a_change_is_that_of_the_run():
    async def scenario(user, session):
        session.told("phase", phase="running")
        user.find(content="Search for a key", kind=ui.input).type("along -z")
        await settled(0.1)
        field = user.find(content="gravity", kind=ui.input)
        next(iter(field.elements)).value = "3.7"
        field.trigger("keydown.enter")
        await settled(0.1)
        assert session.calls == [("change", "gravity", 3.7)]
        assert session.book.settings == {}

    on_page(scenario)


def test_a_block_of_a_joint_shows_its_signals_and_sliders_that_change_this_joint_alone():
    """The slider of joint_2 changed all joints, and its plots had no reference, no limit and no time."""

    async def scenario(user, session):
        (picture,) = user.find(kind=ui.html).elements
        user.find(kind=ui.html).trigger("click", ["joint_2.pd", ""])
        await settled(0.2)
        assert 'class="node chosen" data-block="joint_2.pd"' in picture.content
        await user.should_see("joint_2: PD\nkp 1000, kd 10")
        await user.should_see("joint 2")  # the one curve that is drawn
        watched = sorted(map(str, session.watched.values()))
        # those of the wires, and of the plots
        assert watched == [
            "['position', 'reference', 'torque']",
            "['position', 'reference']",
            "['torque']",
        ]
        sliders = {one.props["aria-label"]: one for one in user.find(kind=ui.slider).elements}
        assert set(sliders) == {"servo.kp.joint_2", "servo.kd.joint_2"}
        await user.should_see("The sliders change joint_2 alone.")
        slider = UserInteraction(user, {sliders["servo.kp.joint_2"]}, None)
        slider.trigger("change", 0.5)
        for _ in range(50):  # the value is taken some time after the last press of a key
            if session.drawn == 2:
                break
            await settled(0.1)
        gain = session.book.settings["servo.kp.joint_2"]
        assert gain == pytest.approx(1000 * 10**0.5, rel=2e-3)  # three digits
        gains = session.config.servo.kp
        assert [gains[f"joint_{number}"] for number in (1, 2, 3)] == [1000, gain, 1000]
        assert session.drawn == 2  # at first, and after the change

    on_page(scenario)


def test_the_servos_fold_into_one_block_and_unfold():
    async def scenario(user, session):
        (picture,) = user.find(kind=ui.html).elements

        async def press(icon):
            (found,) = (
                one for one in user.find(kind=ui.button).elements if one.props.get("icon") == icon
            )
            UserInteraction(user, {found}, None).click()
            await settled(0.5)
            return blocks()

        def blocks():
            return set(re.findall(r'data-block="(.*?)"', picture.content))

        before = blocks()
        everything = await press("unfold_less")
        assert sum(name.startswith("folded ") for name in everything) == 1, (
            "all: those of one block stay as they are"
        )
        assert await press("unfold_more") == before
        user.find(kind=ui.html).trigger("click", ["joint_2.pd", ""])
        folded = await press("unfold_less")
        servos = {name for name in before if re.match(r"joint_\d", name)}
        assert servos
        assert folded == before - servos | {"folded joint_2.pd"}
        assert "servos (" in picture.content
        assert (
            'data-block="folded joint_2.pd" tabindex="0" role="button" aria-pressed="true"'
            in picture.content
        )
        sliders = {one.props["aria-label"] for one in user.find(kind=ui.slider).elements}
        assert sliders == {"servo.kp", "servo.kd"}
        await user.should_see("The sliders change all joints.")
        assert await press("unfold_more") == before

    on_page(scenario)


def wire(source, target):
    """Return the number of a wire of the picture."""
    return re.search(rf'data-wire="(\d+)" data-from="{source}" data-to="{target}', SVG)[1]


def test_values_stand_on_the_wires_and_a_wire_shows_its_signal(monkeypatch):
    told = {}
    monkeypatch.setattr(BlockPicture, "tell", lambda _, values: told.update(values))

    async def scenario(user, session):
        session.run.watch(["position", "torque"])
        session.run.take(
            0.5, None, {"position": [0.1, -0.5, 0, 0, 0, 0], "torque": [1.0, 2.0, -37.23, 0, 0, 0]}
        )
        await settled(0.6)
        assert told[wire("torque", "plant")] == "max -37.2 N·m"
        assert told[wire("joint_2.pd", "joint_2.saturation")] == "2"
        assert told[wire("joint_signals", "joint_2.pd")] == "-28.6"
        user.find(kind=ui.html).trigger("click", ["", wire("torque", "plant")])
        await settled(0.1)
        await user.should_see("torque → Plant, torque")
        await user.should_see("joint 3")

    on_page(scenario)


def test_a_value_in_brief():
    pose = {
        "unit": "m",
        "columns": [f"base.{one}" for one in ("x", "y", "z", "qw", "qx", "qy", "qz")],
    }
    assert in_brief([0.123, 0, 1, 1, 0, 0, 0], pose) == "0.12 0.00 1.00 m"
    assert in_brief([-3e-5], {"unit": "m", "columns": ["gap"]}) == "0 m"
    assert in_brief([2.0], {"unit": "", "columns": ["foot"]}) == "2"
    assert in_brief([0.1, -0.2], {"unit": "rad", "columns": ["q.a", "q.b"]}) == "max -11.5 °"


def test_what_was_changed_while_it_ran_is_marked():
    async def scenario(user, session):
        (picture,) = user.find(kind=ui.html).elements
        assert 'class="node changed"' not in picture.content
        session.told("program", changes=(Change(time=1.35, set={"servo.kp": 500}),))
        await settled(0.1)
        assert picture.content.count('class="node changed"') == len(
            {f"joint_{n}.pd" for n in range(1, 7)}
        )
        user.find(kind=ui.html).trigger("click", ["joint_2.pd", ""])
        await settled(0.1)
        await user.should_see("at 1.35 s: servo.kp = 500")

    on_page(scenario)


@pytest.mark.long
def test_entries_are_added_and_taken_out():
    async def scenario(user, session):
        user.find(content="monitors", kind=ui.expansion).elements.pop().open()
        await settled(0.1)
        user.find(content="Name", kind=ui.input).type("fallen")
        (kind,) = user.find(content="Kind", kind=ui.select).elements
        kind.value = "fall"
        user.find(content="Its keys, as YAML", kind=ui.input).type("{height: -1}")
        user.find("Add").click()
        await settled(0.2)
        (keys,) = user.find(content="Its keys, as YAML", kind=ui.input).elements
        assert "monitors.fallen.height" in keys.error
        keys.value = "{height: 0.1}"
        user.find("Add").click()
        await settled()
        assert session.book.settings == {"monitors.fallen": {"kind": "fall", "height": 0.1}}
        await user.should_see("fallen (height 0.1 m): End the run when")
        (switch,) = user.find(content="fallen", kind=ui.switch).elements
        switch.value = False
        await settled()
        assert session.book.settings == {}

    on_page(scenario)


def test_what_a_check_finds_and_what_ended_a_run_are_told():
    async def scenario(user, session):
        await user.should_see("base: it tips over")
        await user.should_see("En orden (1)")
        ending = {
            "ending": "monitor",
            "time": 0.0,
            "reached": 1.35,
            "message": "fall: the base is at 0.1 m",
        }
        session.told(
            "message", message=Notice(fills={"text": ending["message"]}, wrong=True), ending=ending
        )
        await settled(0.2)
        await user.should_see("1,35 s: fall: the base is at 0.1 m")

    on_page(scenario, language="es")


def test_numbers_have_the_decimal_sign_of_the_language_and_are_taken_with_either():
    async def scenario(user, session):
        user.find(content="Buscar una clave", kind=ui.input).type("gravedad según")
        await settled(0.1)
        field = user.find(content="gravity", kind=ui.input)
        (element,) = field.elements
        assert element.value == "9,80665"
        assert element.props["hint"].startswith("Gravedad según el eje vertical [m/s²]")
        for typed, value in (("3,7", 3.7), ("1.62", 1.62)):
            element.value = typed
            field.trigger("keydown.enter")
            await settled(0.1)
            assert session.book.settings["gravity"] == value
            assert element.error is None

    on_page(scenario, language="es")


def test_an_empty_field_shows_what_holds_below_its_name():
    async def scenario(user, session):
        user.find(content="Search for a key", kind=ui.input).type("torque_limit")
        await settled(0.1)
        (element,) = user.find(content="servo.torque_limit", kind=ui.input).elements
        assert element.value == ""
        assert element.props["placeholder"] == "not given"
        # else the name of the key stands where the value should be
        assert "stack-label" in element.props

    on_page(scenario)


def test_what_the_user_chooses_is_noted_and_scrolled_to_and_a_new_picture_is_not():
    async def scenario(user, session):
        assert session.inspected == []
        user.find(kind=ui.html).trigger("click", ["joint_2.saturation", ""])
        await settled(0.1)
        assert "torque" in session.inspected
        count = len(session.inspected)
        session.told("description")
        await settled(0.5)
        assert len(session.inspected) == count

    on_page(scenario)


def test_the_blocks_of_a_picture_are_buttons():
    labels = labels_of(SVG)
    assert labels["joint_1.saturation"] == "Saturation\n±150 N·m"
    assert "joint_signals" not in labels  # a bar
    drawn = with_buttons(SVG, "plant")
    assert drawn.startswith("<svg")
    assert drawn.count('role="button"') == drawn.count('tabindex="0"') == len(labels)
    assert drawn.count('aria-pressed="true"') == 1


def test_a_picture_opens_as_wide_as_its_place_and_never_too_small_to_be_read():
    drawn = with_buttons(SVG)
    assert (
        '<svg style="--own: 1316px; min-width: calc(0.6 * 1316px); max-width: calc(2 * 1316px)" '
        in drawn
    )
    largest = max(float(size) for size in re.findall(r'font-size="(\d+)"', SVG))
    assert 0.6 * largest >= 7.0


def test_values_stay_on_the_wires_when_a_block_or_a_wire_is_chosen():
    number = wire("torque", "plant")

    async def scenario(user, session):
        session.run.watch(["position", "torque"])
        session.run.take(
            0.5, None, {"position": [0.1, -0.5, 0, 0, 0, 0], "torque": [1.0, 2.0, -37.23, 0, 0, 0]}
        )
        await settled(0.6)
        for chosen in (["", number], ["plant", ""], ["", wire("joint_2.pd", "joint_2.saturation")]):
            user.find(kind=ui.html).trigger("click", chosen)
            await settled(0.1)
            (drawn,) = (
                one.content for one in user.find(kind=ui.html).elements if "<svg" in one.content
            )
            assert re.search(rf'data-value="{number}"[^>]*>max -37.2 N·m</text>', drawn)

    on_page(scenario)


def test_values_are_written_as_texts():
    assert '">&lt;1</text>' in with_values(SVG, {wire("torque", "plant"): "<1"})
    assert with_values(SVG, {}) == SVG


def test_both_languages_have_the_words():
    english, spanish = (
        {k for k in texts_of(name) if k.startswith("station.")} for name in ("en", "es")
    )
    assert english == spanish


def test_plots_of_a_joint_have_its_reference_its_limit_and_the_moment_that_is_shown():
    async def scenario(user, session):
        times = (0.0, 0.5, 1.0)
        for name, end in (("reference", 0.5), ("position", 0.4), ("torque", 90.0)):
            session.run.history[name] = [
                (time, [0.0, end * time, 0.0, 0.0, 0.0, 0.0]) for time in times
            ]
        session.run.time = 0.5
        user.find(kind=ui.html).trigger("click", ["joint_2.pd", ""])
        await settled(0.8)
        charts = {
            chart.props["aria-label"]: chart.options for chart in user.find(kind=ui.echart).elements
        }
        position, torque = charts["position"], charts["torque"]
        assert [one["lineStyle"]["type"] for one in position["series"]] == ["solid", "dashed"]
        ends = [source["source"][-1] for source in position["dataset"]]
        assert ends == [
            pytest.approx([1.0, math.degrees(0.4)]),
            pytest.approx([1.0, math.degrees(0.5)]),
        ]
        assert torque["dataset"][1]["source"] == [[0.0, 200.0], [1.0, 200.0]]
        assert torque["series"][1]["lineStyle"]["type"] == "dotted"
        assert {
            plot["series"][0]["markLine"]["data"][0]["xAxis"] for plot in (position, torque)
        } == {0.5}
        await user.should_see("joint 2 (± 200)")

    session = Station()
    session.phase = "idle"
    session.client.ask = lambda method, **_: given(
        [200.0] * 6 if method == "torque_limits" else None
    )
    on_page(scenario, session)
