"""The station in a process of its own: runs, pauses, goes back, takes changes, tells, and may be killed."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from simrob_drake import LeggedRobot
from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.pendant.live import Live
from simrob_drake.programs.program import Program

WAIT = 60.0  # s; for what takes one or two on a machine that has nothing else to do
ELBOW = {"target_deg": {"left_elbow": 30}, "duration": 0.5}


class Slow:
    """A pipe that sends only when something has come."""

    def __init__(self, pipe: Any, come: Callable[[], object]) -> None:
        self.pipe, self.come = pipe, come

    def send(self, message: Any) -> None:
        self.come()
        self.pipe.send(message)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.pipe, name)


class Pendant:
    """A station that runs, and what it has told."""

    def __init__(self, station: str) -> None:
        self.news: list[dict[str, Any]] = []
        self.live = Live(self.news.append)
        self.station = self.ask("open", station=station, settings={})
        self.ask("pace", factor=None)

    def ask(self, method: str, **arguments: Any) -> Any:
        return self.live.call(method, **arguments).result(WAIT)

    def told(self, kind: str) -> list[dict[str, Any]]:
        return [news for news in self.news if news["news"] == kind]

    def until(self, kind: str, **what: Any) -> dict[str, Any]:
        """Wait for news, and return it."""
        end = time.monotonic() + WAIT
        while time.monotonic() < end:
            for news in self.told(kind):
                if all(news[key] == value for key, value in what.items()):
                    return news
            time.sleep(0.005)
        raise AssertionError(
            f"no {kind} with {what}: {[news for news in self.news if news['news'] != 'view'][-5:]}"
        )

    def signals(self, folder: Path) -> np.ndarray:
        return np.loadtxt(
            self.ask("save", what="signals", file=str(folder / "signals.csv")),
            delimiter=",",
            skiprows=1,
        )


@pytest.fixture(scope="module")
def shared() -> Iterator[Pendant]:
    pendant = Pendant("humanoid_dynamic")
    yield pendant
    pendant.live.close()


@pytest.fixture
def humanoid(shared: Pendant) -> Pendant:
    shared.ask("pace", factor=None)
    shared.ask("restart")
    shared.news.clear()
    return shared


def test_it_tells_what_can_be_taught(shared: Pendant) -> None:
    robot = shared.station["robots"]["robot"]
    assert (robot["model"], robot["kind"], len(robot["axes"])) == ("humanoid", "legs", 18)
    elbow = next(axis for axis in robot["axes"] if axis["name"] == "left_elbow")
    assert elbow["unit"] == "deg"
    assert elbow["low"] < 0 < elbow["high"]
    assert "bow" in robot["acts"]
    assert {"position", "torque", "base_pose"} <= {
        signal["name"] for signal in shared.station["signals"]
    }


@pytest.mark.long
def test_a_run_with_changes_is_that_of_the_program_that_was_noted(
    humanoid: Pendant, tmp_path: Path
) -> None:
    """A gain, a push and a drag while it runs: a program with what was told gives the same signals."""
    humanoid.ask("watch", signals=["position"])
    humanoid.ask("pace", factor=2.0)
    done = humanoid.live.call("do", moves=[ELBOW, {"wait": 1.5}])
    humanoid.until("tick", time=0.1)
    humanoid.ask("change", settings={"servo.kp": 300})
    humanoid.ask("push", at="trunk", force=[3, 0, 0])
    humanoid.until("noted")
    humanoid.ask("drag", at="trunk", point=[0, 0, 0], target=[0.05, 0.0, 0.5])
    time.sleep(0.3)
    humanoid.ask("drag", at="trunk", point=[0, 0, 0], target=None)
    assert done.result(WAIT)["ending"] == "completed"
    assert len(humanoid.told("tick")) == 40
    changes = [news["change"] for news in humanoid.told("noted")]
    assert [next(key for key in change if key != "time") for change in changes] == [
        "set",
        "push",
        "drag",
    ]
    robot = LeggedRobot("humanoid_dynamic")
    robot.run(Program.model_validate({"moves": [ELBOW, {"wait": 1.5}], "changes": changes}))
    np.testing.assert_array_equal(humanoid.signals(tmp_path)[:, 1:], robot.result().values)


def test_going_back_and_on_again_changes_nothing(humanoid: Pendant, tmp_path: Path) -> None:
    humanoid.ask("do", moves=[ELBOW])
    humanoid.ask("do", moves=[{"wait": 0.5}])
    end, signals = humanoid.ask("posture"), humanoid.signals(tmp_path)
    humanoid.ask("rewind", time=0.75)
    humanoid.ask("go_on")
    assert humanoid.ask("posture") == end
    np.testing.assert_array_equal(humanoid.signals(tmp_path), signals)


def test_a_change_before_one_that_the_program_has_stands_before_it(
    humanoid: Pendant, tmp_path: Path
) -> None:
    """The later one counts from its time on; gone back to before both, the run goes on as it went."""
    later = {"time": 0.6, "set": {"servo.kp": 200}}
    humanoid.ask("pace", factor=0.5)
    done = humanoid.live.call(
        "play", program=yaml.safe_dump({"moves": [{"wait": 1.0}], "changes": [later]})
    )
    humanoid.until("tick", time=0.1)
    humanoid.ask("change", settings={"servo.kp": 300})
    humanoid.until("noted")
    humanoid.ask("pace", factor=None)
    assert done.result(WAIT)["ending"] == "completed"
    signals, (noted,) = humanoid.signals(tmp_path), humanoid.told("noted")
    humanoid.ask("rewind", time=0.05)
    humanoid.ask("go_on")
    np.testing.assert_array_equal(humanoid.signals(tmp_path), signals)
    robot = LeggedRobot("humanoid_dynamic")
    robot.run(
        Program.model_validate({"moves": [{"wait": 1.0}], "changes": [later, noted["change"]]})
    )
    np.testing.assert_array_equal(signals[:, 1:], robot.result().values)


def test_one_tick_goes_on_from_the_moment_that_is_shown(humanoid: Pendant) -> None:
    done = humanoid.live.call("do", moves=[{"wait": 5.0}])
    humanoid.ask("pause")
    humanoid.until("phase", phase="paused")
    for _ in range(4):
        humanoid.ask("one_tick")
        humanoid.until("phase", phase="paused")
    while humanoid.told("tick")[-1]["time"] < 0.15:
        humanoid.ask("one_tick")
    humanoid.ask("rewind", time=0.1)
    humanoid.news.clear()
    humanoid.ask("one_tick")
    assert humanoid.until("tick", time=pytest.approx(0.15))
    humanoid.until("phase", phase="paused")
    humanoid.ask("stop")
    assert done.result(WAIT)["time"] == pytest.approx(0.15)


def test_what_is_done_after_going_back_goes_on_from_there(humanoid: Pendant) -> None:
    humanoid.ask("do", moves=[ELBOW])
    humanoid.ask("do", moves=[{"wait": 0.1}])
    waited = humanoid.ask("posture")
    humanoid.ask("rewind", time=0.5)
    humanoid.ask("do", moves=[{"target_deg": {"left_elbow": -20}, "duration": 0.5}])
    humanoid.ask("rewind", time=0.5)
    assert humanoid.ask("do", moves=[{"wait": 0.1}])["time"] == pytest.approx(0.6)
    assert humanoid.ask("posture") == waited
    humanoid.ask("rewind", time=0.25)
    assert humanoid.ask("do", moves=[{"wait": 0.05}])["time"] == pytest.approx(0.3)


def test_a_fall_can_be_looked_at_and_the_next_run_begins_before_it(humanoid: Pendant) -> None:
    humanoid.ask("do", moves=[{"wait": 0.1}])
    before = humanoid.ask("posture")
    hips = {"target_deg": {"left_hip_pitch": 110, "right_hip_pitch": 110}, "duration": 0.3}
    ended = humanoid.ask("do", moves=[hips, {"wait": 5.0}])
    assert (ended["ending"], ended["goes_on"]) == ("monitor", False)
    assert ended["time"] == pytest.approx(0.1)
    assert 0.5 < ended["reached"] < 5.0
    assert humanoid.ask("posture") == before
    humanoid.ask("rewind", time=ended["reached"])
    humanoid.ask("rewind", time=0.2)
    assert humanoid.ask("go_on") == ended  # it falls again
    assert humanoid.ask("do", moves=[{"wait": 0.1}])["time"] == pytest.approx(0.2)
    waited = humanoid.ask("posture")
    with pytest.raises(SimrobError, match="a time that was run"):
        humanoid.ask("rewind", time=0.3)
    humanoid.ask("rewind", time=0.1)
    humanoid.ask("do", moves=[{"wait": 0.1}])
    assert humanoid.ask("posture") == waited


def test_a_moment_that_was_not_run_pauses_nothing(humanoid: Pendant) -> None:
    done = humanoid.live.call("do", moves=[{"wait": 0.5}])
    with pytest.raises(SimrobError, match="a time that was run"):
        humanoid.ask("rewind", time=7.65)
    assert done.result(WAIT)["ending"] == "completed"


def test_it_pauses_steps_and_stops(humanoid: Pendant) -> None:
    humanoid.ask("pace", factor=1.0)
    done = humanoid.live.call("do", moves=[{"wait": 5.0}])
    humanoid.until("tick", time=0.1)
    humanoid.ask("pause")
    humanoid.until("phase", phase="paused")
    paused = humanoid.told("tick")[-1]["time"]
    humanoid.ask("one_tick")
    assert humanoid.until("tick", time=pytest.approx(paused + 0.05))
    time.sleep(0.2)
    assert humanoid.told("tick")[-1]["time"] == pytest.approx(paused + 0.05)
    humanoid.ask("stop")
    ended = done.result(WAIT)
    assert (ended["ending"], ended["stopped_by"]) == ("stopped", "user")
    assert ended["time"] == pytest.approx(paused + 0.05)


def test_a_run_hears_what_came_together_with_it(humanoid: Pendant) -> None:
    humanoid.live.call("picture")  # while it is drawn, both come
    done = humanoid.live.call("do", moves=[{"wait": 1.0}])
    humanoid.live.call("one_tick")
    humanoid.until("phase", phase="paused")
    assert humanoid.told("tick")[-1]["time"] < 0.2
    humanoid.ask("stop")
    assert done.result(WAIT)["ending"] == "stopped"


def test_another_run_takes_the_place_of_one(humanoid: Pendant) -> None:
    humanoid.ask("pace", factor=1.0)
    first = humanoid.live.call("do", moves=[{"wait": 20.0}])
    humanoid.until("tick", time=0.05)
    humanoid.ask("do", moves=[{"wait": 0.05}])
    assert first.result(WAIT)["ending"] == "stopped"


def test_pace_is_that_of_the_clock(humanoid: Pendant) -> None:
    humanoid.ask("pace", factor=4.0)
    humanoid.ask("do", moves=[{"wait": 2.0}])
    ratios = [news["ratio"] for news in humanoid.told("tick")]
    assert 2.0 < ratios[-1] < 4.4


def test_what_is_wrong_is_told_in_words(humanoid: Pendant) -> None:
    for method, arguments, told in (
        ("do", {"moves": [{"target_deg": {"left_elbo": 3}}]}, "left_elbow"),
        ("do", {"moves": [{"target_deg": {"left_elbow": 300}}]}, "limit"),
        ("push", {"at": "trunk", "force": [1, 0, 0]}, "nothing runs"),
        ("watch", {"signals": ["positon"]}, "position"),
        ("rewind", {"time": 5.0}, "was run"),
        ("play", {"program": "moves: ["}, "YAML"),
    ):
        with pytest.raises(SimrobError, match=told):
            humanoid.ask(method, **arguments)


@pytest.mark.long
def test_who_asks_a_process_that_was_killed_gets_an_answer() -> None:
    pendant = Pendant("bouncing_ball")
    asked = pendant.live.call("do", moves=[{"wait": 100.0}])
    assert pendant.live.pid is not None
    os.kill(pendant.live.pid, signal.SIGKILL)
    with pytest.raises(SimrobError, match="has ended"):
        asked.result(WAIT)
    assert pendant.until("died")["why"] == "killed by signal 9"
    with pytest.raises(SimrobError, match="has ended"):
        pendant.ask("posture")
    pendant.live.close()


def test_answers_are_taken_while_something_long_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else both sides could wait for the other to read: this one with a long program, that one with a view."""
    live = Live(lambda news: None)
    try:
        first = live.call("stop")
        monkeypatch.setattr(live, "_pipe", Slow(live._pipe, lambda: first.result(WAIT)))
        assert live.call("stop").result(WAIT) is None
    finally:
        live.close()


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_who_asks_is_answered_though_the_news_cannot_be_taken() -> None:
    def refuse(news: dict[str, Any]) -> None:
        if news["news"] == "view":
            raise ValueError("not so")

    before = {*threading.enumerate()}
    live = Live(refuse)
    try:
        listening = {*threading.enumerate()} - before
        with pytest.raises(SimrobError, match="has ended"):
            live.call("open", station="irb120_kinematic", settings={}).result(WAIT)
        for thread in listening:
            thread.join(WAIT)
    finally:
        live.close()
