"""Parts of pages: keys that each press one element, icons that each have one meaning, forms with words and units."""

import asyncio
from collections import defaultdict

import pytest

pytest.importorskip("nicegui", reason="needs the extra gui")
from legs_session import LegsSession, described
from nicegui import ui
from nicegui.testing import user_simulation

from simrob_drake.extensions.pendant.describe import description
from simrob_drake.extensions.pendant.form import move_fields
from simrob_drake.extensions.pendant.move_labels import labels_of
from simrob_drake.extensions.pendant.pages import gallery, legs
from simrob_drake.extensions.pendant.pages.elements import (
    KEYS,
    NumberField,
    limit_text,
    page_keys,
    set_keys,
)
from simrob_drake.extensions.pendant.pages.move_forms import offers
from simrob_drake.extensions.pendant.pages.words import MINUS, Phrases, languages, texts_of, words
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.stations.load import load_station

WITHOUT_UNIT = {"steps", "amplitude", "attempts"}
"""Numbers of forms that are counts or factors."""


def on_page(build):
    """Build a page, and return what the build returned."""
    found = []

    async def run():
        async with user_simulation(lambda: found.append(build())) as user:
            await user.open("/")

    asyncio.run(run())
    return found[0]


# Keys


def test_keys_press_one_element_and_are_free_again_when_it_is_gone():
    def build():
        first = ui.button("First")
        set_keys(first, "Alt+G")
        with pytest.raises(ValueError, match=r"Alt\+G of 'Second' press 'First' already"):
            set_keys(ui.button("Second"), "Alt+G")
        letters = [page_keys().free_letter("Grip")]
        first.delete()
        return [*letters, page_keys().free_letter("Grip")]

    assert on_page(build) == ["R", "G"]


def test_letters_that_browsers_take_are_never_free():
    assert on_page(lambda: page_keys().free_letter("Feed")) == ""


def test_the_gallery_and_the_grip_have_keys_of_their_own():
    """Both had Alt+G, since the letters in use were listed by hand."""

    def build():
        session, t = LegsSession(), words("en")
        gallery.build(session, t, lambda _: None, lambda _: None)
        robot = {"moves": {"grip": ["force"], "open": ["width"]}}
        offers(session, Phrases(t, ()), robot, [KINDS["grip"], KINDS["open"]])
        elements = ui.context.client.elements.values()
        return [element.props[KEYS] for element in elements if KEYS in element.props]

    keys = on_page(build)
    assert len(keys) == 3
    assert len(set(keys)) == 3


# Forms


def moves_of(station, **settings):
    cell = Workcell(load_station(station, settings))
    (robot,) = description(cell)["robots"].values()
    return robot["moves"]


def test_a_description_contains_the_values_in_force():
    values = description(Workcell("irb120_dynamic"))["in_force"]
    assert values["pieces.gripper.mass"] == {"value": 1.0, "origin": "piece"}
    assert values["servo.torque_limit"]["value"]["joint_6"] == 15


def test_moves_of_fingers_are_offered_to_robots_with_fingers_alone():
    assert not {"grip", "open"} & moves_of("irb120_dynamic").keys()
    assert {"force", "width", "duration"} <= set(moves_of("irb120_gripper")["grip"])


def test_a_kinematic_station_asks_for_no_force_of_fingers():
    grip = moves_of("irb120_gripper", mode="kinematic", pieces={})["grip"]
    assert "width" in grip
    assert "force" not in grip


@pytest.mark.parametrize(
    ("station", "possible", "impossible"),
    [
        ("roid1_dynamic", {"walk", "go", "get_up", "kick"}, {"climb", "grip", "move_l"}),
        ("humanoid_fixed", {"walk", "act"}, {"go", "get_up"}),
        ("yobotics_dynamic", {"climb", "go"}, {"kick", "get_up"}),
    ],
)
def test_moves_of_legs_are_offered_to_robots_that_can_do_them(station, possible, impossible):
    found = moves_of(station).keys()
    assert possible <= found
    assert not impossible & found


def test_every_form_has_words_in_each_language_and_units_for_its_numbers():
    for key, kind in KINDS.items():
        fields = move_fields(kind, labels_of(kind).form, {})
        numbers = [field for field in fields if field.kind == "number"]
        assert [
            field.key for field in numbers if not field.unit and field.key not in WITHOUT_UNIT
        ] == []
        for language in languages():
            texts = texts_of(language)
            names = [field.key for field in fields if field.key not in ("name", "target_deg")]
            assert [name for name in names if f"fields.{name}" not in texts] == [], key
            assert not fields or f"moves.{key}" in texts, key


# Icons


def test_each_icon_of_the_page_has_one_meaning():
    """The tick of a run and Redo had the same icon."""
    same = {"delete": {"Delete", "Forget"}}  # what takes something away

    def build():
        session = LegsSession(moves=[{"target_deg": {"left_elbow": 30.0}, "duration": 2.0}])
        session.description = described()
        t = words("en")
        from simrob_drake.extensions.pendant.pages import shell, view

        shell._undo(session, t)
        view.build_bar(session, t)
        legs.build(session, t)
        meanings = defaultdict(set)
        for element in list(ui.context.client.elements.values()):
            if (
                isinstance(element, ui.button)
                and element.props.get("icon")
                and element.props.get("aria-label")
            ):
                meanings[element.props["icon"]].add(element.props["aria-label"].partition(":")[0])
        return meanings

    meanings = on_page(build)
    assert {"undo", "redo", "keyboard_tab"} <= meanings.keys()
    assert {
        icon: texts for icon, texts in meanings.items() if len(texts - same.get(icon, set())) > 1
    } == {}


# Limits


@pytest.mark.parametrize(
    ("value", "unit", "is_upper", "text"),
    [
        (171.88733853924697, "°", True, "171.8°"),
        (-171.88733853924697, "°", False, f"{MINUS}171.8°"),
        (29.999999999999996, "°", True, "30°"),
        (164.99981, "°", True, "165°"),
        (-90.00000000000001, "°", False, f"{MINUS}90°"),
        (0.7504, " m", True, "0.75 m"),
        (float("inf"), "°", True, ""),
    ],
)
def test_limits_are_rounded_inward_and_have_no_more_digits_than_are_read(
    value, unit, is_upper, text
):
    """An arm's limits had three digits behind the point."""
    assert limit_text(words("en"), value, unit, is_upper=is_upper) == text


def test_numbers_have_the_decimal_sign_of_the_language():
    assert limit_text(words("es"), 0.7504, " m", is_upper=True) == "0,75 m"
    assert words("es").figure(-23.5) == f"{MINUS}23,5"
    assert words("en").figure(-23.5) == f"{MINUS}23.5"
    assert words("es").decimals(2.0, 2) == "2,00"
    spanish = Phrases(words("es"), [{"name": "left_elbow", "aliases": [], "unit": "deg"}])
    assert spanish.target("left_elbow", 30.25).endswith("30,25°")


def test_a_limit_as_it_is_shown_can_be_entered():
    def build():
        field = NumberField(
            words("en"), "Joint 1", 0.0, low=-171.88733853924697, high=171.88733853924697, unit="°"
        )
        return [field.problem(value) for value in (171.8, -171.8, 172.0)]

    assert on_page(build) == [None, None, f"from {MINUS}171.8° to 171.8°"]


def test_a_round_number_that_stands_for_a_limit_is_the_limit():
    def build():
        field = NumberField(words("en"), "Joint 1", 165.0, low=-164.99981, high=164.99981, unit="°")
        return field.problem(165.0), field.value

    assert on_page(build) == (None, 164.99981)


def test_a_number_without_an_upper_limit_names_the_lower_one_alone():
    def build():
        field = NumberField(words("en"), "Force", 1.0, low=0.0, unit=" N")
        return field.problem(-1.0)

    assert on_page(build) == "at least 0 N"
