"""What a robot on its feet withstands: found by bisection, the same as of whole runs, and as mechanics has it."""

import csv
import json

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.tuning import burdens
from simrob_drake.extensions.tuning.burdens import Burdens
from simrob_drake.extensions.tuning.doubts import drawn
from simrob_drake.extensions.tuning.journal import made
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.extensions.tuning.walking import UNCHANGED, bracket, subject_of
from simrob_drake.extensions.tuning.walking_folder import PushMap, PushTrial, WalkingFolder
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.simulation import Runner
from simrob_drake.simulation.stepping import Stepper
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

MASS, HALF, FORCE_TIME = 10.0, np.array([0.1, 0.06, 0.3]), 0.005  # kg, m, s
BLOCK = """<robot name="block">
  <link name="trunk"><inertial><mass value="9.999"/>
    <inertia ixx="{0}" ixy="0" ixz="0" iyy="{1}" iyz="0" izz="{2}"/></inertial></link>
  <link name="fin"><inertial><mass value="0.001"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="fin" type="revolute"><parent link="trunk"/><child link="fin"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="5"/></joint>
  <transmission name="fin"><type>transmission_interface/SimpleTransmission</type><joint name="fin"/>
    <actuator name="fin"/></transmission>
</robot>
"""
ROBOT = """
urdf: block.urdf
base: floating
root: trunk
axes: {fin: {joint: fin, sign: 1}}
home_deg: 0
servo: {kp: 1, ki: 0, kd: 0.1}
feet: {default: corners, contacts: {corners: {radius: 0.001, stiffness: 1.0e+6, points: {trunk: CORNERS}}}}
"""
DISCRETE = {"kind": "discrete", "time_step": 0.005}
STATION = """
robot: {model: robot.yaml, base: [0, 0, 0.3, 2.1, 0, 0]}
servo: {realization: implicit}
floor: {}
contact: {friction: {static: 100, dynamic: 100}}
monitors: {fall: {tilt_deg: 60}}
solver: {kind: continuous, scheme: cenic, max_step: 0.01, error_control: true}
"""


@pytest.fixture
def block(tmp_path):
    """A block that stands on four corners, turned by 2.1 rad."""
    moments = (
        MASS
        / 3
        * np.array(
            [HALF[1] ** 2 + HALF[2] ** 2, HALF[0] ** 2 + HALF[2] ** 2, HALF[0] ** 2 + HALF[1] ** 2]
        )
    )
    corners = [[x * HALF[0], y * HALF[1], 0.001 - HALF[2]] for x in (-1, 1) for y in (-1, 1)]
    (tmp_path / "block.urdf").write_text(BLOCK.format(*moments))
    (tmp_path / "robot.yaml").write_text(ROBOT.replace("CORNERS", json.dumps(corners)))
    file = tmp_path / "block.yaml"
    file.write_text(STATION)
    return str(file)


def tipping_force(half):
    """Return the force at the middle of a block that, for a short time, just tips it over an edge.

    From the edge the middle is ``half`` wide, b, and HALF[2] high, h. The impulse about the edge, gravity's taken off,
    turns it at w = (F h - m g b) t / I, I = 4/3 m r²; it tips if that lifts its middle to r: I w² / 2 = m g (r - h).
    """
    high, gravity = HALF[2], 9.80665
    reach = np.hypot(half, high)
    inertia, lift = MASS * reach**2 * 4 / 3, MASS * gravity * (reach - high)
    return (np.sqrt(2 * inertia * lift) / FORCE_TIME + MASS * gravity * half) / high


@pytest.mark.long
def test_a_block_tips_as_mechanics_has_it(block):
    """Ahead over the edge that is 0.1 m before its middle, to the sides over one at 0.06 m; however it is turned.

    The bisection ends within 2 %. The push is not quite an impact: longer ones need less, by 1 % in 5 ms (2 % in 10).
    """
    asked = PushMap(
        station=block, phases=1, start=0.2, duration=FORCE_TIME, after=1.5, close=0.02, first=1000
    )
    (trial,) = asked.trials()
    rows = made(trial).rows
    assert [row["direction_deg"] for row in rows] == [0, 90, 180, 270]
    for row, half in zip(rows, (HALF[0], HALF[1]) * 2, strict=True):
        assert row["force"] == pytest.approx(0.985 * tipping_force(half), rel=0.018)
        assert row["ended"] == "fall"
        assert row["impulse"] == pytest.approx(row["force"] * FORCE_TIME)
        assert row["impulse_per_mass"] == pytest.approx(row["impulse"] / MASS, rel=1e-6)
    one = asked.model_copy(update={"force": 1.03 * rows[1]["force"], "directions": 8})
    ends = {row["direction_deg"]: row["ended"] for row in made(one.trials()[0]).rows}
    assert [ends[turn] for turn in (0, 90, 180, 270)] == ["completed", "fall", "completed", "fall"]


@pytest.mark.parametrize("largest", [0.02, 0.9, 7.0, 300.0])
def test_a_bracket_holds_the_largest(largest):
    low, high = bracket(lambda size: size <= largest, 5.0, close=0.1)
    assert low <= largest < high
    assert 0 < high - low <= 0.1 * high
    assert bracket(lambda size: size <= 40, 5.0, close=0.1, most=20) == (20, float("inf"))
    low, high = bracket(lambda size: False, 5.0, close=0.1)
    assert low == 0
    assert high < 5e-3


@pytest.mark.parametrize(
    ("station", "force", "more"),
    [
        ("roid1_balance", 2.0, {}),
        (
            "zjudancer_dynamic",
            15.0,
            {
                "gait.name": "walk",
                "gait.steps": 1,
                "solver": {"kind": "discrete", "time_step": 0.005},
            },
        ),
    ],
)
def test_what_goes_on_from_a_moment_is_the_whole_run(station, force, more, monkeypatch):
    """To the last bit, with a loop and with discrete steps; also after another push was tried."""
    moment, histories = 0.203, []
    stepped = Stepper.run

    def kept(self, recorder, watch):
        outcome = stepped(self, recorder, watch)
        histories.append(recorder.history())
        return outcome

    monkeypatch.setattr(Stepper, "run", kept)
    push = {"kind": "push", "start": moment, "force": [force, 0, 0]}
    scene = Scene.of(station, {"duration": 0.4, "forces.push": push, **more})
    runner = Runner(scene.config)
    result = runner.run(reference=scene.reference)
    fork = runner.branch(moment, reference=scene.reference)
    fork.outcome({"push": {"start": moment, "force": [0, force, 0]}})
    assert (
        fork.outcome({"push": {"start": moment, "force": [force, 0, 0]}}).ending
        == result.ending
        == "completed"
    )
    whole, _, other, again = histories
    after = whole.times >= moment
    assert np.array_equal(whole.times[after], again.times)
    for one, two in zip(
        (whole.continuous, *whole.discrete), (again.continuous, *again.discrete), strict=True
    ):
        assert np.array_equal(one[after], two)
    ends = [
        np.concatenate([run.continuous[-1], *(group[-1] for group in run.discrete)])
        for run in (again, other)
    ]
    assert not np.array_equal(*ends)


@pytest.mark.parametrize("robot", ["zjudancer", "yobotics"])
def test_ahead_is_where_the_gaits_go(robot):
    """As their file says; a frame that is turned is pushed along the same way."""
    config = load_station(f"{robot}_dynamic", {"robot.base": [0, 0, 1, 0.4, 0, 0]})
    subject = subject_of(config)
    facing = np.deg2rad(load_gaits(robot).facing_deg)
    assert subject.ahead == pytest.approx([np.cos(facing), np.sin(facing), 0], abs=1e-9)
    assert subject.along(np.pi / 2) == pytest.approx([-np.sin(facing), np.cos(facing), 0], abs=1e-9)
    assert np.cos(subject.heading - facing - 0.4) == pytest.approx(1)
    foot = subject_of(config, "left_foot" if robot != "yobotics" else "lidar")
    assert np.dot(foot.ahead, foot.left) == pytest.approx(0, abs=1e-9)
    assert foot.mass == subject.mass == pytest.approx(mass_of(config))


def mass_of(config):
    plant = add_plant(DiagramBuilder(), resolve(config)).plant
    return plant.CalcTotalMass(plant.CreateDefaultContext())


def test_a_draw_is_a_robot_and_a_floor_of_many():
    """Masses within 5 % of the links', friction between 0.5 and 1.2, joints 0.5 degrees beside; of the seed."""
    config = load_station("zjudancer_dynamic")
    draws = [drawn(config, seed) for seed in range(40)]
    assert drawn(config, 7) == draws[7] != draws[8]
    factors = np.array([list(draw["robot.mass_factors"].values()) for draw in draws])
    assert (0.95 <= factors.min() < 0.955, 1.045 < factors.max() <= 1.05) == (True, True)
    frictions = [draw["contact.friction"]["static"] for draw in draws]
    assert (0.5 <= min(frictions) < 0.6, 1.1 < max(frictions) <= 1.2) == (True, True)
    assert np.std([draw["robot.initial_deg"] for draw in draws]) == pytest.approx(0.5, rel=0.1)
    doubled = {"robot.mass_factors": {"chest": 2.0}}
    heavier = mass_of(load_station("zjudancer_dynamic", doubled)) - mass_of(config)
    chest = next(
        link
        for link in resolve(config).robots["robot"].model.element.iterfind("link")
        if link.get("name") == "chest"
    )
    assert heavier == pytest.approx(float(chest.find("inertial/mass").get("value")))
    with pytest.raises(
        SimrobError, match=r"no link \(under mass_factors\) 'chst'; did you mean 'chest'"
    ):
        mass_of(load_station("zjudancer_dynamic", {"robot.mass_factors": {"chst": 2.0}}))


def test_a_gait_goes_as_many_steps_as_the_pushes_take():
    """Moments lie evenly over two of its steps; nothing is added where the steps are told."""
    walk = {"gait.name": "walk", "gait.step_time": 0.25}
    asked = PushMap(station="roid1_dynamic", overrides=walk, phases=4)
    trials = asked.trials()
    assert [trial.moment for trial in trials] == pytest.approx([3, 3.125, 3.25, 3.375])
    assert trials[-1].scene().motion.duration > 3.375 + 0.1 + 2 + 1.5
    told = asked.model_copy(update={"overrides": {**walk, "gait.steps": 2}})
    assert told.trials()[-1].scene().motion.duration < 5
    assert [
        trial.moment for trial in PushMap(station="roid1_dynamic", phases=2).trials()
    ] == pytest.approx([3, 3.4])


def test_moments_are_spread_over_two_steps_of_a_loop_that_walks():
    trials = PushMap(station="roid1_walking", phases=4).trials()
    # steps of 0.2302 s
    assert [trial.moment for trial in trials] == pytest.approx([3.0, 3.1151, 3.2302, 3.3453])


@pytest.mark.long
def test_a_block_bears_the_slope_that_mechanics_has(block):
    """It tips on a slope of atan(b / h), 0.1 m before and 0.06 m beside its middle."""
    asked = Burdens(station=block, vary=["slope"], seconds=2.5, close=0.15)
    trials = {trial.what: trial for trial in asked.trials()}
    assert list(trials) == ["slope up", "slope down", "slope across, up to the left"]
    for what, half in (("slope down", HALF[0]), ("slope across, up to the left", HALF[1])):
        (row,) = made(trials[what]).rows
        assert row["figure"] < np.rad2deg(np.arctan(half / HALF[2])) < row["fails_at"]


@pytest.mark.long
def test_a_burden_must_not_hold_the_robot_up(monkeypatch):
    """What goes less far than it is asked to, of its own way, is held up; the trunk bears the load."""
    walk = {"gait.name": "walk", "gait.settle": 0.1, "gait.ramp_steps": 0, "gait.steps": 2}
    monkeypatch.setattr(
        burdens,
        "bracket",
        lambda holds, first, **_: (first, np.inf) if holds(first) else (0.0, first),
    )
    for least, figure, ended in ((0.5, 0.25, "completed"), (1.0, None, "held up")):
        asked = Burdens(
            station="roid1_dynamic", overrides=walk, vary=["load"], seconds=0.8, least=least
        )
        rows = made(asked.trials()[0]).rows
        assert [(row["figure"], row["ended"]) for row in rows] == [(figure, ended)]
        assert asked.summary(rows)[0]["weakest"] == figure


@pytest.mark.parametrize(
    ("station", "more", "told"),
    [
        ("irb120_dynamic", {}, "it must be a dynamic station with a robot on feet of its own"),
        (
            "three_humanoids",
            {"at": "roid1.left_foot"},
            "it must be a dynamic station with a robot on feet",
        ),
        ("three_humanoids", {}, "--at"),
        (
            "roid1_dynamic",
            {"overrides": {"monitors.fall": None}},
            "it must be a station that tells when robot has fallen",
        ),
        ("roid1_dynamic", {"at": "nose"}, "no robot, tool or link 'nose'"),
        (
            "roid1_dynamic",
            {"overrides": {"duration": 3}},
            "--set duration: the trial says how long a run is",
        ),
        (
            "roid1_dynamic",
            {"variant": {"servo.kpp": 3}},
            "--variant servo.kpp: unknown key; did you mean 'kp'",
        ),
        ("roid1_dynamic", {"overrides": {"engine": "mujoco"}}, "engine: is to be left out"),
        (
            "roid1_dynamic",
            {"overrides": {"servo.kp": 1}, "start": 1},
            "falls by itself: robot fell",
        ),
    ],
)
def test_what_cannot_be_is_told_before_any_push(station, more, told, tmp_path):
    with pytest.raises(SimrobError, match=told):
        WalkingFolder(tmp_path / "map", PushMap(station=station, **more))
    assert not (tmp_path / "map").exists()


@pytest.mark.long
def test_the_command_writes_table_summary_and_picture(block, tmp_path, capsys):
    """With other settings beside, of a draw; what is there already is not made again."""
    folder = tmp_path / "map"
    options = [
        "--phases",
        "2",
        "--directions",
        "2",
        "--start",
        "0.1",
        "--after",
        "0.2",
        "--seeds",
        "1",
        "--newtons",
        "1",
    ]
    command = [
        "pushes",
        block,
        *options,
        "--variant",
        "monitors.fall.tilt_deg=1e-6",
        "--out",
        str(folder),
    ]
    assert run_command(command) == 0
    shown = capsys.readouterr().out
    assert "forward" in shown
    assert "100%" in shown
    rows = list(csv.DictReader((folder / "pushes.csv").open()))
    assert len(rows) == 2 * 2 * 2
    beside = {row["settings"] for row in rows} - {UNCHANGED}
    assert beside == {"monitors.fall.tilt_deg=1e-06"}
    assert all(
        row["ended"] == ("completed" if row["settings"] == UNCHANGED else "fall") for row in rows
    )
    summary = json.loads((folder / "pushes.json").read_text())["summary"]
    assert [row["withstood"] for row in summary] == [1.0] * 3 + [0.0] * 3
    assert (folder / "pushes.png").stat().st_size > 10_000
    before = (folder / "rows.jsonl").read_text()
    (folder / "rows.jsonl").write_text(
        "".join(before.splitlines(keepends=True)[:3]) + '{"number": 4, "ro'
    )
    assert run_command(command) == 0
    assert (folder / "rows.jsonl").read_text() == before
    assert (folder / "rows.jsonl").read_text().count("\n") == 4
    assert run_command([*command, "--seconds", "3"]) == 2
    assert "--seconds: it has an effect only with --vary; leave it out" in capsys.readouterr().err


def test_a_trial_that_cannot_be_made_withstands_nothing(block):
    asked = PushMap(station=block, phases=1, start=0.1)
    rows = made(PushTrial(1, UNCHANGED, {"servo.kpp": 1}, None, False, asked, 0.1)).rows
    assert [row["ended"] for row in rows] == ["refused"] * 4
    assert all(row["weakest_force"] == 0 for row in asked.summary(rows))


@pytest.mark.parametrize("moment", [0.0, 0.1, 3.0])
def test_a_run_is_left_at_a_moment_within_it(moment):
    with pytest.raises(
        InvalidParameter, match=r"at is .*a time within the run, greater than 0 and less than 0.1 s"
    ):
        Runner(load_station("double_pendulum", {"duration": 0.1})).branch(moment)
