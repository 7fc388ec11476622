"""What happens while a program runs: at its time, as said, and again to the last bit however it came about."""

from typing import Any

import numpy as np
import pytest

from simrob_drake import LeggedRobot, Workcell, load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.sections import validate_section
from simrob_drake.programs.program import Program
from simrob_drake.programs.timeline import GRID, Change, Timeline, following
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import Moment, Runner, Ticks

MOVES: list[dict[str, Any]] = [{"target_deg": {"left_elbow": 30}, "duration": 0.5}, {"wait": 0.52}]
PULLED = [[0.05, 0.0, 0.5], [0.06, 0.0, 0.5], [0.07, 0.01, 0.5]]
CHANGES: list[dict[str, Any]] = [
    {"time": 0.2, "set": {"servo.kp": 300}},
    {"time": 0.3, "push": {"at": "trunk", "force": [3, 0, 0], "duration": 0.12}},
    {"time": 0.35, "drag": {"at": "trunk", "targets": PULLED}},
    {"time": 0.7, "set": {"gravity": 8.0}},
]


def legged(changes: list[dict[str, Any]], **more: Any) -> SimulationResult:
    robot = LeggedRobot("humanoid_dynamic")
    robot.run(validate_section(Program, {"moves": MOVES, "changes": changes, **more}, "it"))
    return robot.result()


@pytest.mark.long
def test_a_program_with_changes_is_the_same_twice_and_ends_on_the_grid() -> None:
    once, again = legged(CHANGES), legged(CHANGES)
    np.testing.assert_array_equal(once.values, again.values)
    assert once.times[-1] == pytest.approx(1.05, abs=1e-12)


@pytest.mark.long
def test_changes_that_come_while_it_runs_give_what_the_program_says_afterwards() -> None:
    """A page adds them at ticks, a drag target by target; the program that it keeps gives the same to the last bit."""
    robot = LeggedRobot("humanoid_dynamic")
    line = robot.cell.timeline = Timeline(GRID)
    coming, pulling = [Change.model_validate(change) for change in CHANGES], list(PULLED)

    def tell(time: float, moment: Moment) -> bool:
        pulled = next((number for number, change in enumerate(line.changes) if change.drag), None)
        if pulled is not None and pulling:
            drag = line.changes[pulled].drag
            assert drag is not None
            longer = drag.model_copy(update={"targets": (*drag.targets, tuple(pulling.pop(0)))})
            line.changes[pulled] = line.changes[pulled].model_copy(update={"drag": longer})
        while coming and coming[0].time <= time + 1e-9:
            change = coming.pop(0)
            if change.drag is not None:
                first = change.drag.model_copy(update={"targets": (tuple(pulling.pop(0)),)})
                change = change.model_copy(update={"drag": first})
            line.changes.append(change)
        return False

    line.tell = tell
    robot.run(Program.model_validate({"moves": MOVES}))
    assert Program(moves=(), changes=tuple(line.changes)).changes == tuple(
        map(Change.model_validate, CHANGES)
    )
    np.testing.assert_array_equal(robot.result().values, legged(CHANGES).values)


@pytest.mark.long
def test_a_walk_that_is_driven_goes_so_and_again_to_the_last_bit_by_its_program() -> None:
    """A page adds a command at a tick, the next ones in their time; from the kept program the walk is the same."""
    moves, rows = [{"go": {"duration": 2.5}}], [(0.0, 0.1, 0.0, 0.0), (0.6, 0.1, 0.0, 20.0)]

    def driven(
        tell: Any = None, changes: tuple[Any, ...] = ()
    ) -> tuple[Timeline, SimulationResult]:
        # each sample of the walk is seen
        robot = LeggedRobot(load_station("roid1_dynamic", {"sample_rate": 100}))
        line = robot.cell.timeline = Timeline(GRID, changes)
        line.tell = (lambda time, _: tell(line, time)) if tell else line.tell
        robot.run(Program.model_validate({"moves": moves}))
        return line, robot.result()

    def tell(line: Timeline, time: float) -> bool:
        if time == pytest.approx(0.25):
            line.add(Change.model_validate({"time": time, "drive": {"commands": rows[:1]}}))
        if time == pytest.approx(0.85):
            line.changes[0] = Change.model_validate({"time": 0.25, "drive": {"commands": rows}})
        return False

    line, live = driven(tell)
    _, again = driven(changes=tuple(line.changes))
    _, stood = driven()
    np.testing.assert_array_equal(live.values, again.values)
    ahead = {
        name: float(np.hypot(run["base.x"][-1], run["base.y"][-1]))
        for name, run in (("d", live), ("s", stood))
    }
    assert ahead["d"] > 0.05 > 5 * ahead["s"]
    assert live["walk.command.2"][-1] == pytest.approx(np.deg2rad(20.0))


def test_a_command_by_hand_holds_from_after_its_moment_on_whenever_the_run_began() -> None:
    rows = [[0, 0.1, 0, 10], [0.5, 0.2, 0, 0]]
    line = Timeline(changes=[Change.model_validate({"time": 1.0, "drive": {"commands": rows}})])
    line.now = 0.9

    hand = line.walk_drivers(load_station("roid1_walking"))["walk"]

    assert hand(0.1) is None
    assert hand(0.11) == hand(0.6) == pytest.approx((0.1, 0.0, np.deg2rad(10)))
    assert hand(0.61) == (0.2, 0.0, 0.0)
    assert not Timeline().walk_drivers(load_station("roid1_walking"))


@pytest.mark.long
def test_each_change_does_what_it_says() -> None:
    """Softer servos sag more, a push moves the trunk on, and gravity shows in the torques."""
    plain = legged([], grid=GRID)
    for change, signal, begin in (
        (0, "q.left_elbow", 0.2),
        (1, "base.x", 0.3),
        (2, "base.z", 0.35),
        (3, "tau.left_knee", 0.7),
    ):
        changed = legged([CHANGES[change]])
        same = plain.times <= begin
        np.testing.assert_array_equal(changed[signal][same][:-1], plain[signal][same][:-1])
        assert np.abs(changed[signal] - plain[signal])[~same].max() > 1e-6


@pytest.mark.long
def test_settings_of_the_station_reach_the_servos_that_a_gait_sets() -> None:
    robot = LeggedRobot("humanoid_dynamic")
    moves, change = [{"walk": {"steps": 1}}], {"time": 0.5, "set": {"servo.kp": 7}}
    robot.run(Program.model_validate({"moves": moves, "changes": [change]}))

    gains = [run.config.servo_of("robot").kp for run in robot.result().runs[0].runs]

    assert gains[0] != 7
    assert gains[1:] == [7.0] * len(gains[1:])


def test_references_of_the_station_go_on_across_a_change() -> None:
    """A sine that is cut is the sine: its references are those of a run without changes."""
    station = load_station(
        "irb120_kinematic", {"reference": {"kind": "sine", "amplitude_deg": 10, "frequency": 0.5}}
    )
    cell, cut = (
        Workcell(station),
        {"moves": [{"play": 1.0}], "changes": [{"time": 0.4, "set": {"sample_rate": 100}}]},
    )
    result = cell.perform(Program.model_validate(cut))

    plain = Workcell(station).play(1.0)

    np.testing.assert_allclose(
        result["q.joint_1"], np.interp(result.times, plain.times, plain["q.joint_1"]), atol=1e-4
    )


@pytest.mark.parametrize(
    "station", ["humanoid_dynamic", "irb120_dynamic", "box_on_floor", "irb120_kinematic"]
)
def test_what_follows_a_tick_depends_on_its_state_alone(station: str) -> None:
    """A run that begins in the state of a tick is the rest of the run, with ticks at the same moments."""
    runner, kept = Runner(station), dict[float, Any]()

    def keep(moment: Moment) -> bool:
        kept[round(moment.time, 9)] = moment.state()
        return False

    whole = runner.run(duration=0.3, ticks=Ticks(0.05, keep))
    again = runner.run(duration=0.3, ticks=Ticks(0.05))
    np.testing.assert_array_equal(whole.values, again.values)
    shorter = runner.run(duration=0.3, ticks=Ticks(0.05, lambda moment: moment.time > 0.14))
    assert (shorter.config.duration, shorter.ending) == (0.15, "completed")
    np.testing.assert_array_equal(shorter.values[:-1], whole.values[: len(shorter.times) - 1])
    for robot in shorter.plant.robots:
        np.testing.assert_array_equal(
            shorter.final_state.positions[robot], kept[0.15].positions[robot]
        )


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ([{"time": 0.1}], "one of set, push, drag and drive"),
        ([{"time": 0.1, "set": {"servo.kq": 3}}], "kp"),
        ([{"time": -1.0, "set": {"servo.kp": 3}}], "time"),
        ([{"time": 0.1, "push": {"at": "trnk", "force": [1, 0, 0]}}], "trunk"),
        (
            [{"time": 0.1, "drive": {"at": "robbot", "commands": [[0, 0.1, 0, 0]]}}],
            "changes.0..drive .robbot.; .*robot",
        ),
        ([{"time": 0.1, "drive": {"commands": [[0, 0.1]]}}], "drive"),
    ],
)
def test_what_cannot_happen_is_told(changes: list[dict[str, Any]], told: str) -> None:
    with pytest.raises(SimrobError, match=told):
        legged(changes)


def test_a_program_whose_changes_are_wrong_leaves_the_station_as_it_was() -> None:
    cell = Workcell(load_station("irb120_dynamic"))
    before = (cell.timeline, cell.strict)

    wrong = Change.model_validate({"time": 0.2, "set": {"servo.nothing": 1}})

    with pytest.raises(SimrobError), following(cell, GRID, (wrong,), strict=True):
        pass
    assert (cell.timeline, cell.strict) == before


def test_the_last_command_before_a_time_drives_a_robot_and_other_changes_do_not() -> None:
    """Each line has the time since the change, the speeds ahead and to the left, and the turning speed in degrees."""
    changes = [
        {"time": 0.0, "set": {"gravity": 9.0}},
        {"time": 0.1, "drive": {"commands": [(0.0, 0.3, 0.0, 0.0), (0.5, 0.2, -0.1, 90.0)]}},
        {"time": 0.2, "drive": {"at": "other", "commands": [(0.0, 9.0, 9.0, 9.0)]}},
        {"time": 0.3, "push": {"at": "trunk", "force": [3, 0, 0], "duration": 0.1}},
    ]
    timeline = Timeline(GRID, tuple(map(Change.model_validate, changes)))
    (walk,) = timeline.walk_drivers(load_station("roid1_walking")).values()

    assert walk(0.05) is None
    assert walk(0.11) == pytest.approx((0.3, 0.0, 0.0))
    assert walk(0.59) == pytest.approx((0.3, 0.0, 0.0))
    assert walk(0.61) == pytest.approx((0.2, -0.1, np.pi / 2))
