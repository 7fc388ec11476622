"""What walks are asked for: clipped, refused, by hand, by another block, and without feedback."""

import json

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector, LeafSystem

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.stations.checks import check_station
from simrob_drake.walking.commands import Commanded, Commander, Follower, Waypoints, clip_command, find_excess
from simrob_drake.walking.parameters import MaxSpeed
from simrob_drake.walking.steps import Command

pytestmark = pytest.mark.usefixtures("no_plots")

MAX_SPEED = MaxSpeed(ahead=0.3, backward=0.2, sideways=0.1, turn_deg=40)
NOTHING = np.zeros(4)
HERE = np.array([0.0, 0, 0.5, 1, 0, 0, 0])


def station(duration=1.2, **walk):
    """Return ZJUDancer with other figures of its walk."""
    settings = {f"controllers.walk.{key}": value for key, value in walk.items()}
    return load_station("zjudancer_walking", {"duration": duration, **settings})


def test_each_part_of_a_command_is_clipped_at_its_own_limit():
    can = Command(0.3 - 0.1j, np.deg2rad(40))
    assert clip_command(can, MAX_SPEED) is can
    assert clip_command(Command(-0.5 + 0.2j, -3.0), MAX_SPEED) == Command(-0.2 + 0.1j, -np.deg2rad(40))
    ahead, turn = find_excess(Command(0.4, -1), MAX_SPEED)
    assert ahead == ("ahead", 0.4, 0.3, "m/s")
    assert turn == ("turn_deg", pytest.approx(np.rad2deg(-1)), pytest.approx(-40), "deg/s")
    assert find_excess(can, MAX_SPEED) == []


def test_a_hand_comes_before_an_input_that_before_the_table_and_that_before_the_path():
    path = Follower(Waypoints(points=((0, 0), (1, 0)), speed=0.1), MAX_SPEED, 0.0)
    commander = Commander([Commanded(time=2, ahead=0.2), Commanded(time=3, turn_deg=10)], path)
    hand, given, silent = np.array([1, 0.05, 0, 0]), np.array([0.07, 0, 0]), np.array([np.nan, 0, 0])

    def asked(time, hand=NOTHING, given=None, commander=commander):
        return commander.now(time, hand, given, HERE, 0.0)[0]

    assert asked(2.5, hand, given).speed == 0.05
    assert asked(0.0, hand).speed == pytest.approx(0.1)  # a run begins without hands
    assert asked(2.5, given=given).speed == 0.07
    assert asked(2.5, given=silent).speed == 0.2
    assert asked(2.0 - 1e-12).speed == 0.2
    assert asked(3.0) == Command(0j, np.deg2rad(10))
    assert asked(1.99).speed == pytest.approx(0.1)
    assert asked(1.0, commander=Commander([], None)) == Command()


def test_a_table_beyond_the_legs_is_told_before_and_after_the_run_or_refused():
    fast = [{"time": 0.3, "ahead": 0.2}, {"time": 0.6, "ahead": 0.9}]
    config = station(commands=fast)
    warnings = [finding.text for finding in check_station(config) if finding.level == "warning"]
    assert "controllers.walk.commands[1].ahead, 0.9 m/s, is clipped to 0.35 m/s" in warnings
    result = simulate(config, progress=False)
    assert set(result["walk.command.0"]) == {0.0, 0.2, 0.35}
    assert result.times[np.argmax(result["walk.clipped"])] == pytest.approx(0.6, abs=0.011)
    (remark,) = result.summary()["remarks"]
    assert "walk is asked for more than its legs can follow" in remark
    assert remark.endswith("1.20 s")
    with pytest.raises(SimrobError, match=r"controllers.walk.commands\[1\].ahead.*0.9 m/s.*at most 0.35 m/s"):
        station(commands=fast, strict=True)
    with pytest.raises(SimrobError, match=r"walk.path.speed.*2 m/s.*at most 0.35 m/s"):
        station(path={"points": [[0, 0], [0, 1]], "speed": 2}, strict=True)
    strict = simulate(station(strict=True), commands={"walk": lambda time: (0.0, -0.5, 0.0)}, progress=False)
    assert (strict.ending, strict.stopped_by) == ("monitor", "walk")
    assert "the command sideways of -0.5 m/s is beyond the -0.1 m/s that the legs can follow" in strict.message


@pytest.mark.long
def test_a_run_that_was_commanded_by_hand_is_repeated_to_the_last_bit(tmp_path, monkeypatch):
    def hand(time):
        return None if time < 0.4 else (0.2, 0.01, 0.3) if time < 0.8 else (0.1, 0, -1 / 7)

    config = station(commands=[{"time": 0.1, "ahead": 0.1}, {"time": 0.5, "ahead": -0.1}])
    result = simulate(config, commands={"walk": hand}, progress=False)
    rows = result.config.controllers["walk"].commands
    assert [(row.time, row.ahead) for row in rows] == [(0.1, 0.1), (0.4, 0.2), (0.8, 0.1)]
    again = simulate(result.config, progress=False)
    assert (again.values == result.values).all()
    assert (result.commanded, again.commanded) == (("walk",), ())
    assert not (simulate(config, progress=False).values == result.values).all()
    further = [simulate(config, start=run.final_state, duration=0.1, progress=False) for run in (result, again)]
    assert (further[0].values == further[1].values).all()  # the next run has no hands
    assert set(further[0]["walk.command.0"][2:]) == {0.0}
    result.save(tmp_path / "run", recording=False)
    text = (tmp_path / "run" / "commands.yaml").read_text()
    assert load_station(tmp_path / "run" / "station.yaml").controllers["walk"].commands == rows
    assert text.startswith("controllers:\n  walk:\n    commands:\n    - {time: 0.1, ahead: 0.1,")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["remarks"] == []


@pytest.mark.parametrize(
    ("hands", "told"),
    [
        ({"wlak": lambda time: None}, "no controller that takes commands 'wlak'.*walk"),
        ({"walk": 3}, "commands: walk"),
        ({"walk": lambda time: (1, 2)}, "3 numbers: ahead"),
        ({"walk": lambda time: (0.1, 0, float("nan"))}, "3 numbers: ahead"),
        (7, "commands"),
    ],
)
def test_hands_that_are_none_are_refused(hands, told):
    with pytest.raises(SimrobError, match=told):
        simulate(station(0.05), commands=hands, progress=False)


class Wish(LeafSystem):
    """Asks for 0.15 m/s from 0.5 s on, and for nothing before."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("base_pose", 7)
        self.DeclareVectorOutputPort("wish", 3, self._wish, {self.time_ticket()})

    def _wish(self, context, output):
        output.SetFromVector([0.15 if context.get_time() >= 0.5 - 1e-9 else np.nan, 0.0, 0.1])


class Blinks(LeafSystem):
    """Tells where the base is, but for a tenth of a second."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("base_pose", 7)
        self.DeclareVectorOutputPort("seen", BasicVector(7), self._seen)

    def _seen(self, context, output):
        blind = 0.645 < context.get_time() < 0.745
        output.SetFromVector(self.get_input_port().Eval(context) * (np.nan if blind else 1.0))


def test_another_block_commands_and_a_sensor_fails_for_a_while():
    config = station(commands=[{"time": 0.1, "ahead": 0.1}], reads={"command": "wish.wish", "base_pose": "blinks.seen"})
    result = simulate(config, blocks={"wish": Wish(), "blinks": Blinks()}, progress=False)
    assert result.ending == "completed"
    ahead = result["walk.command.0"]
    assert sorted(set(ahead)) == [0.0, 0.1, 0.15]
    assert result.times[np.argmax(ahead == 0.15)] == pytest.approx(0.5, abs=0.011)
    blind = result.times[result["walk.blind"] > 0]
    assert (blind[0], blind[-1]) == (pytest.approx(0.65, abs=0.011), pytest.approx(0.74, abs=0.011))
    assert np.isfinite(result.values[:, [name.startswith("walk") for name in result.names]]).all()
    (remark,) = result.summary()["remarks"]
    assert "walk reads what is not a number, and goes on as planned: 0.6" in remark


def test_what_cannot_be_followed_is_refused():
    for walk, told in (
        ({"path": {"points": [[2, 1], [3, 1]]}}, r"path.points.*starts at \(2, 1\) m.*within 0.5 m.*\(0, 0\) m"),
        ({"path": {"points": [[0, 0]]}}, "path.points"),
        ({"path": {"points": [[0, 0], [0, 0]]}}, "points 0 and 1 of the path are the same"),
        ({"commands": [{"time": 1}, {"time": 0.5}]}, "times of commands must rise"),
        ({"gait": {"groups": [["right_front_foot"], ["left_foot"]]}}, "gait.groups.*right_front_foot"),
        ({"reads": {"comand": "imu.x"}}, "comand"),
    ):
        with pytest.raises(SimrobError, match=told):
            simulate(station(0.05, **walk), progress=False)
