"""Commands of a walk: limits, the order of their sources, users who steer, other blocks, and failing sensors."""

import json

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector, LeafSystem

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.stations.checks import check_station
from simrob_drake.walking.commands import (
    Commanded,
    Commander,
    Follower,
    Waypoints,
    clip_command,
    find_excess,
)
from simrob_drake.walking.parameters import MaxSpeed
from simrob_drake.walking.steps import Command

pytestmark = pytest.mark.usefixtures("no_plots")

MAX_SPEED = MaxSpeed(ahead=0.3, backward=0.2, sideways=0.1, turn_deg=40)
ROOT = np.array([0.0, 0, 0.5, 1, 0, 0, 0])  # x y z qw qx qy qz
NO_USER = np.zeros(4)
USER = np.array([1, 0.05, 0, 0])  # steers at 0.05 m/s
PORT = np.array([0.07, 0, 0])
SILENT_PORT = np.array([np.nan, 0, 0])
# ZJUDancer's legs follow 0.35 m/s; the second command is beyond.
TOO_FAST = [{"time": 0.3, "ahead": 0.2}, {"time": 0.6, "ahead": 0.9}]


def make_station(duration=1.2, **walk):
    """Station of ZJUDancer with changed keys of its controller `walk`."""
    settings = {f"controllers.walk.{key}": value for key, value in walk.items()}
    return load_station("zjudancer_walking", {"duration": duration, **settings})


class TestLimits:
    """Each part of a command has its own limits."""

    within = Command(0.3 - 0.1j, np.deg2rad(40))

    def test_a_command_within_the_limits_stays_the_same_object(self):
        assert clip_command(self.within, MAX_SPEED) is self.within
        assert find_excess(self.within, MAX_SPEED) == []

    @pytest.mark.parametrize(
        ("command", "expected"),
        [
            (Command(-0.5 + 0.2j, -3.0), Command(-0.2 + 0.1j, -np.deg2rad(40))),
            (Command(0.4 - 0.2j, 3.0), Command(0.3 - 0.1j, np.deg2rad(40))),
            (Command(0.1 + 0.5j, 0.1), Command(0.1 + 0.1j, 0.1)),
        ],
    )
    def test_a_command_is_clipped_at_the_limit_of_each_part(self, command, expected):
        assert clip_command(command, MAX_SPEED) == expected

    def test_the_parts_beyond_the_limits_are_listed(self):
        ahead, turn = find_excess(Command(0.4, -1), MAX_SPEED)

        assert ahead == ("ahead", 0.4, 0.3, "m/s")
        assert turn.key == "turn_deg"
        assert turn.value == pytest.approx(np.rad2deg(-1))
        assert turn.limit == pytest.approx(-40)
        assert turn.unit == "deg/s"


class TestOrderOfSources:
    """A user comes before a port, a port before the table, and the table before the path."""

    @pytest.fixture(scope="class")
    @classmethod
    def commander(cls):
        path = Follower(Waypoints(points=((0, 0), (1, 0)), speed=0.1), MAX_SPEED, 0.0)
        table = [Commanded(time=2, ahead=0.2), Commanded(time=3, turn_deg=10)]
        return Commander(table, path)

    @pytest.mark.parametrize(
        ("time", "user", "port", "speed"),
        [
            (2.5, USER, PORT, 0.05),
            (2.5, NO_USER, PORT, 0.07),
            (2.5, NO_USER, SILENT_PORT, 0.2),
            (2.5, NO_USER, None, 0.2),
            (2.0 - 1e-12, NO_USER, None, 0.2),
            (1.99, NO_USER, None, 0.1),  # before the table, the path
            (0.0, USER, None, 0.1),  # a run begins without a user
        ],
    )
    def test_the_first_source_with_a_command_decides(self, commander, time, user, port, speed):
        command, _ = commander.now(time, user, port, ROOT, 0.0)

        assert command.speed == pytest.approx(speed)

    def test_the_table_is_in_degrees(self, commander):
        command, _ = commander.now(3.0, NO_USER, None, ROOT, 0.0)

        assert command == Command(0j, np.deg2rad(10))

    def test_without_a_source_the_robot_stands(self):
        command, progress = Commander([], None).now(1.0, NO_USER, None, ROOT, 0.25)

        assert command == Command()
        assert progress == 0.25


class TestExcessiveCommands:
    """Commands that the legs cannot follow are clipped with a warning, or refused by a strict section."""

    def test_a_table_is_reported_before_the_run(self):
        findings = check_station(make_station(commands=TOO_FAST))

        warnings = [finding.text for finding in findings if finding.level == "warning"]
        assert "controllers.walk.commands[1].ahead, 0.9 m/s, is clipped to 0.35 m/s" in warnings

    def test_a_table_is_clipped_and_reported_after_the_run(self):
        result = simulate(make_station(commands=TOO_FAST), progress=False)

        (remark,) = result.summary()["remarks"]
        first_clipped = result.times[np.argmax(result["walk.clipped"])]
        assert set(result["walk.command.0"]) == {0.0, 0.2, 0.35}
        assert first_clipped == pytest.approx(0.6, abs=0.011)
        assert "walk clips commands that are beyond the speed limits of the legs" in remark
        assert remark.endswith("1.20 s")

    @pytest.mark.parametrize(
        ("walk", "message"),
        [
            (
                {"commands": TOO_FAST},
                r"controllers.walk.commands\[1\].ahead.*0.9 m/s.*at most 0.35 m/s",
            ),
            (
                {"path": {"points": [[0, 0], [0, 1]], "speed": 2}},
                r"walk.path.speed.*2 m/s.*at most 0.35 m/s",
            ),
        ],
    )
    def test_a_strict_section_refuses_them(self, walk, message):
        with pytest.raises(SimrobError, match=message):
            make_station(**walk, strict=True)

    def test_a_strict_section_ends_the_run_of_a_user_who_exceeds_them(self):
        config = make_station(strict=True)

        result = simulate(config, commands={"walk": lambda time: (0.0, -0.5, 0.0)}, progress=False)

        assert (result.ending, result.stopped_by) == ("monitor", "walk")
        assert (
            "the command sideways, -0.5 m/s, is beyond the limit of the legs, -0.1 m/s"
            in result.message
        )


@pytest.mark.long
class TestRunsOfUsers:
    """A run that a user has steered is recorded as a table of commands."""

    @pytest.fixture(scope="class")
    @classmethod
    def runs(cls):
        """The run of a user, and its repetition from the recorded table."""

        def steer(time):
            if time < 0.4:
                return None
            return (0.2, 0.01, 0.3) if time < 0.8 else (0.1, 0, -1 / 7)

        config = make_station(commands=[{"time": 0.1, "ahead": 0.1}, {"time": 0.5, "ahead": -0.1}])
        run = simulate(config, commands={"walk": steer}, progress=False)
        repetition = simulate(run.config, progress=False)
        without_user = simulate(config, progress=False)
        return run, repetition, without_user

    def test_the_table_has_the_commands_of_the_user(self, runs):
        run, _, _ = runs

        entries = run.config.controllers["walk"].commands
        assert [(entry.time, entry.ahead) for entry in entries] == [
            (0.1, 0.1),
            (0.4, 0.2),
            (0.8, 0.1),
        ]

    def test_the_repetition_is_equal_to_the_last_bit(self, runs):
        run, repetition, without_user = runs

        assert (repetition.values == run.values).all()
        assert not (without_user.values == run.values).all()
        assert (run.commanded, repetition.commanded) == (("walk",), ())

    def test_the_next_run_begins_without_the_user(self, runs):
        run, repetition, without_user = runs
        config = without_user.config

        after_run = simulate(config, start=run.final_state, duration=0.1, progress=False)
        after_repetition = simulate(
            config, start=repetition.final_state, duration=0.1, progress=False
        )

        # The table of the station has no command before 0.1 s.
        assert (after_run.values == after_repetition.values).all()
        assert set(after_run["walk.command.0"][2:]) == {0.0}

    def test_the_table_is_saved(self, runs, tmp_path):
        run, _, _ = runs

        run.save(tmp_path / "run", recording=False)

        text = (tmp_path / "run" / "commands.yaml").read_text()
        loaded = load_station(tmp_path / "run" / "station.yaml")
        summary = json.loads((tmp_path / "run" / "summary.json").read_text())
        assert text.startswith(
            "controllers:\n  walk:\n    commands:\n    - {time: 0.1, ahead: 0.1,"
        )
        assert loaded.controllers["walk"].commands == run.config.controllers["walk"].commands
        assert summary["remarks"] == []


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        ({"wlak": lambda time: None}, "no controller that takes commands 'wlak'.*walk"),
        ({"walk": 3}, "commands: walk"),
        ({"walk": lambda time: (1, 2)}, "3 numbers: ahead"),
        ({"walk": lambda time: (0.1, 0, float("nan"))}, "3 numbers: ahead"),
        (7, "commands"),
    ],
)
def test_invalid_commands_of_a_user_are_refused(commands, message):
    with pytest.raises(SimrobError, match=message):
        simulate(make_station(0.05), commands=commands, progress=False)


class LateCommand(LeafSystem):
    """Block that commands 0.15 m/s from 0.5 s on, and nothing before."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("base_pose", 7)
        self.DeclareVectorOutputPort("command", 3, self._calc_command, {self.time_ticket()})

    def _calc_command(self, context, output):
        is_late = context.get_time() >= 0.5 - 1e-9
        output.SetFromVector([0.15 if is_late else np.nan, 0.0, 0.1])


class FailingSensor(LeafSystem):
    """Block that measures the pose of the base, and fails for a tenth of a second."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("base_pose", 7)
        self.DeclareVectorOutputPort("pose", BasicVector(7), self._calc_pose)

    def _calc_pose(self, context, output):
        fails = 0.645 < context.get_time() < 0.745
        pose = self.get_input_port().Eval(context)
        output.SetFromVector(pose * (np.nan if fails else 1.0))


@pytest.fixture(scope="module")
def run_with_blocks():
    """Run with a block that commands and a sensor that fails."""
    config = make_station(
        commands=[{"time": 0.1, "ahead": 0.1}],
        reads={"command": "late.command", "base_pose": "sensor.pose"},
    )
    return simulate(
        config, blocks={"late": LateCommand(), "sensor": FailingSensor()}, progress=False
    )


def test_a_block_commands_a_walk(run_with_blocks):
    ahead = run_with_blocks["walk.command.0"]

    first_of_block = run_with_blocks.times[np.argmax(ahead == 0.15)]
    assert sorted(set(ahead)) == [0.0, 0.1, 0.15]
    assert first_of_block == pytest.approx(0.5, abs=0.011)


def test_a_walk_goes_on_without_feedback_while_a_sensor_fails(run_with_blocks):
    result = run_with_blocks

    blind = result.times[result["walk.blind"] > 0]
    is_of_walk = [name.startswith("walk") for name in result.names]
    (remark,) = result.summary()["remarks"]
    assert result.ending == "completed"
    assert blind[0] == pytest.approx(0.65, abs=0.011)
    assert blind[-1] == pytest.approx(0.74, abs=0.011)
    assert np.isfinite(result.values[:, is_of_walk]).all()
    assert "walk receives values that are not numbers, and continues as planned: 0.6" in remark


@pytest.mark.parametrize(
    ("walk", "message"),
    [
        (
            {"path": {"points": [[2, 1], [3, 1]]}},
            r"path\.points\[0\] is \(2, 1\) m.*within 0\.5 m of robot.*\(0, 0\) m",
        ),
        ({"path": {"points": [[0, 0]]}}, "path.points"),
        ({"path": {"points": [[0, 0], [0, 0]]}}, "points 0 and 1 of the path are the same"),
        ({"path": {"points": [[0, 0], [1, 0], [1, 0]]}}, "points 1 and 2 of the path are the same"),
        # On a closed path the last point is followed by the first one.
        (
            {"path": {"points": [[0, 0], [1, 0], [1, 1], [0, 0]], "laps": 2}},
            "points 3 and 0 of the path are the same",
        ),
        (
            {"commands": [{"time": 1}, {"time": 0.5}]},
            "times of commands are .*; they must not decrease",
        ),
        (
            {"gait": {"groups": [["right_front_foot"], ["left_foot"]]}},
            "gait.groups.*right_front_foot",
        ),
        ({"reads": {"comand": "imu.x"}}, "comand"),
    ],
)
def test_an_invalid_section_is_refused_with_its_cause(walk, message):
    with pytest.raises(SimrobError, match=message):
        simulate(make_station(0.05, **walk), progress=False)
