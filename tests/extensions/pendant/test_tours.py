"""Lessons in the page: what they ask for can be done, is known to be done then and not before, and is shown."""

import asyncio
from pathlib import Path

import pytest
import yaml
from fake_runs import BenchRun

pytest.importorskip("nicegui", reason="needs the extra gui")
from nicegui import ui
from nicegui.testing import user_simulation
from nicegui.testing.user_interaction import UserInteraction
from stub_session import StubSession

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.extensions.pendant.pages import shell
from simrob_drake.extensions.pendant.pages.tour import plain_links
from simrob_drake.extensions.pendant.pendant import Pendant
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.extensions.pendant.tours import Tour, TourProgress, page_of, tours
from simrob_drake.programs.timeline import Change, PushNow
from simrob_drake.robots.catalog import robot_names
from simrob_drake.stations.load import load_station, station_names

LESSONS = tours()
each_lesson = pytest.mark.parametrize("tour", LESSONS, ids=lambda tour: tour.title["en"])


@pytest.fixture
def session(tmp_path):
    opened = []

    def open_(subject):
        runs = []
        session = Session.open(
            subject, tmp_path, live=lambda tell: runs.append(BenchRun(tell)) or runs[0]
        )
        session.hear()
        session.set_pace(None)
        opened.append(session)
        return session

    yield open_
    for one in opened:
        one.close()


@each_lesson
def test_a_lesson_is_in_both_languages_and_of_what_there_is(tour):
    assert (load_station("irb120_dynamic").robots and set(tour.title)) == {"en", "es"}
    for number, step in enumerate(tour.steps):
        assert set(step.text) == {"en", "es"}
        progress = TourProgress(tour)
        progress.go(number)
        assert progress.subject in {*station_names(), *robot_names()}
        station = (
            progress.subject
            if progress.subject in station_names()
            else f"{progress.subject}_dynamic"
        )
        for key in (check.key for check in step.checks if check.key):
            load_station(station, {key: 5})  # a key that it has


def ran(session, future):
    while not future.done():
        session.hear(0.1)
    session.hear()


def follow(tour, session, *deeds):
    """Do what each step says, and see that it counts as done then, and not before."""
    progress, now = TourProgress(tour), session(tour.subject)
    for deed in deeds:
        if progress.step.subject:
            now.close()
            now = session(progress.subject)
        signals = [check.signal for check in progress.step.checks if check.signal]
        now.watch(signals, "lesson")
        assert not progress.look(now)
        for what in deed:
            if what == "play":
                ran(now, now.simulate())
            elif what == "look":
                assert not progress.look(now)  # the run alone is not all that was asked
                now.inspect(["position", "torque"])
            else:
                assert now.setup.set(*what)
                now.hear()
            now.hear()
        assert progress.look(now), (progress.step.text["en"], progress.done, str(now.message))
        progress.go(1)


@pytest.mark.long
def test_an_arm_moves(session):
    mass, limit = ("pieces.load.mass", 5), ("servo.torque_limit", 10)
    follow(LESSONS[0], session, ["play"], [mass], ["play", "look"], [limit, "play"])


@pytest.mark.long
def test_a_controller_does_away_with_an_error(session):
    stiff, integral = (
        [("servo.kp", 4000)],
        [("servo.kp", 1000), ("servo.kd", 50), ("servo.ki", 2000)],
    )
    follow(LESSONS[1], session, ["play"], [*stiff, "play"], [*integral, "play"])


@pytest.mark.long
def test_contact_and_force(session):
    hard = [("monitors.stop", None), ("monitors.hard", {"kind": "force_limit", "limit": 40})]
    follow(
        LESSONS[2],
        session,
        ["play"],
        [("contact.stiffness", 20000), "play"],
        ["play"],
        [*hard, "play"],
    )


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("title: {en: x}\nsubject: irb120", "steps"),
        (
            "title: {en: x}\nsubject: irb120\nsteps: [{text: {en: y}, checks: [{}]}]",
            "one of ended, key",
        ),
        (
            "title: {en: x}\nsubject: irb120\nsteps: [{text: {en: y}, checks: [{ended: a, moves: 1}]}]",
            "one of ended",
        ),
        (
            "title: {en: x}\nsubject: irb120\nsteps: [{text: {en: y}, checks: [{signal: q}]}]",
            "needs an axis",
        ),
        ("[", "is not YAML"),
    ],
)
def test_a_damaged_lesson_of_a_teacher_is_refused_by_its_name(tmp_path, content, why):
    (tmp_path / "mine.yaml").write_text(content)
    with pytest.raises(InvalidConfig, match=rf"mine\.yaml.*{why}"):
        tours(tmp_path)


def test_a_push_counts_although_another_one_was_deleted():
    """The changes were counted: with one deleted in the step, its new push was none."""
    old, new = (
        Change(time=time, push=PushNow(force=(60.0, 0.0, 0.0), duration=0.1))
        for time in (0.05, 0.5)
    )
    session = StubSession("humanoid")
    session.book.changes = (old,)
    step = {"text": {"en": "Push it."}, "checks": [{"pushed": True}]}
    progress = TourProgress(
        Tour.model_validate({"title": {"en": "Mine"}, "subject": "humanoid", "steps": [step]})
    )
    assert not progress.look(session), "it was pushed before the step"
    session.book.changes = ()
    assert not progress.look(session)
    session.book.changes = (new,)
    assert progress.look(session)


def test_a_look_at_a_signal_counts_from_the_begin_of_the_step():
    session = StubSession("irb120")
    session.inspected.append("torque")
    step = {"text": {"en": "Look."}, "checks": [{"inspected": "torque"}]}
    progress = TourProgress(
        Tour.model_validate({"title": {"en": "Mine"}, "subject": "irb120", "steps": [step]})
    )
    assert not progress.look(session), "it was looked at before the step"
    session.inspected.append("position")
    assert not progress.look(session)
    session.inspected.append("torque")
    assert progress.look(session)


@each_lesson
def test_the_page_of_a_lesson_is_there_in_both_languages(tour):
    root = Path(__file__).parents[3]
    english, spanish = (root / page_of(tour, language) for language in ("en", "es"))
    assert english.parent.name == "lessons"
    assert spanish.parent.name == "lecciones"
    for page in (english, spanish):
        shown = plain_links(page.read_text(encoding="utf-8"))
        assert shown.startswith("# ")
        assert "](../" not in shown


def test_links_to_other_files_become_text():
    text = (
        "![a plot](plot.png)\n\nSee [the page](../page.md#part) and [Drake](https://drake.mit.edu)."
    )
    assert plain_links(text) == "See the page and [Drake](https://drake.mit.edu)."


def test_a_lesson_is_shown_step_by_step(tmp_path):
    step = {
        "text": {"en": "Push it.", "es": "Empuja."},
        "checks": [{"pushed": True}, {"ended": "fall"}],
    }
    mine = {
        "title": {"en": "My lesson"},
        "subject": "humanoid",
        "steps": [step, {"text": {"en": "That was it."}}],
    }
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(mine))

    async def run():
        pendant = Pendant(lambda subject, _: StubSession(subject), "humanoid", lessons=tmp_path)
        session = pendant.session
        async with user_simulation(root=lambda: shell.build(pendant)) as user:
            await user.open("/")
            await asyncio.sleep(0.05)
            *_, mine = (
                one for one in user.client.elements.values() if isinstance(one, ui.menu_item)
            )
            UserInteraction(user, {mine}, None).click()
            await asyncio.sleep(0.1)
            await user.should_see("My lesson · step 1 of 2")
            await user.should_see("Push it.")
            await user.should_see("Not done yet.")
            session.told("program", changes=(type("Change", (), {"push": True, "set": None}),))
            session.told(
                "message",
                ending={"ending": "monitor", "stopped_by": "fall", "time": 1.0, "message": "fell"},
            )
            await asyncio.sleep(0.1)
            await user.should_see("Done.")
            user.find("Next", kind=ui.button).click()
            await asyncio.sleep(0.1)
            await user.should_see("That was it.")
            *_, end = (
                one
                for one in user.find("End the lesson", kind=ui.button).elements
                if isinstance(one, ui.button)
            )
            UserInteraction(user, {end}, None).click()
            await asyncio.sleep(0.1)
            await user.should_not_see("That was it.")

    asyncio.run(run())


def test_a_lesson_ends_when_its_user_opens_something_else():
    """Lesson 4, of a humanoid, stayed on after an arm was loaded."""

    def opened(subject, robot=None):
        return StubSession(subject)

    pendant = Pendant(opened, "humanoid")
    lesson = next(tour for tour in LESSONS if tour.subject == "humanoid")
    pendant.tour = TourProgress(lesson)
    assert pendant.load("irb120")
    assert pendant.tour is None
    pendant.tour = TourProgress(lesson)
    assert pendant.load("humanoid"), "which the lesson asks for"
    assert pendant.tour is not None
