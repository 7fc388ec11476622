"""What varies beside a station's keys: figures of gaits and of programs; and that what is built is used again."""

import numpy as np
import pytest
import yaml

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.tuning import scene
from simrob_drake.extensions.tuning.doubts import doubts
from simrob_drake.extensions.tuning.journal import made
from simrob_drake.extensions.tuning.rollout import Case, Margin, measures
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.programs.gaits.biped import walk
from tests.programs.test_station_program import station as turning  # noqa: F401  # a fixture

GAIT = {
    "gait": {"name": "walk", "steps": 1},
    "gait.step_time": 0.3,
    "gait.bearing.height": 0.5,
    "duration": 1.0,
}
WAITS = {"moves": [{"wait": 0.1}]}
PUSHED = {"duration": 0.2, "forces.shove": {"kind": "push", "start": 0.05, "force": [0, 0, 30]}}


def test_a_gait_is_planned_with_its_figures_changed_and_run():
    """As by hand: the other keys of a section stay."""
    scene = Scene.of("zjudancer_dynamic", GAIT)
    bearing = {"height": 0.5, "posture_deg": {"RodD": 40, "RodI": 40}}
    motion = walk("zjudancer", 1, step_time=0.3, bearing=bearing)
    assert np.array_equal(scene.motion.positions, motion.positions)
    by_hand = simulate(
        motion.station({"duration": 1.0}), reference=motion.trajectory(), progress=False
    )
    assert np.array_equal(scene.run().values, by_hand.values)
    assert made(Case(1, "zjudancer_dynamic", GAIT)).rows[0]["ahead"] == measures(by_hand)["ahead"]


def test_a_program_is_run_with_its_figures_changed(tmp_path):
    file = tmp_path / "program.yaml"
    file.write_text(yaml.safe_dump({"moves": [{"target_deg": {"joint_1": 10}, "duration": 1.0}]}))
    changes = {"program": str(file), "program.moves.0.duration": 0.4}
    scene = Scene.of("irb120_kinematic", changes)
    run = scene.run()
    assert run.stop_time == pytest.approx(0.4)
    assert run["q.joint_1"][-1] == pytest.approx(np.deg2rad(10))
    scene.write(tmp_path)
    assert yaml.safe_load(file.read_text())["moves"][0]["duration"] == 0.4


def test_the_same_is_run_in_the_other_engine():
    """A push moves the robot as far in both, to what their contacts differ by; the runs are none the less others."""
    pytest.importorskip("simrob_drake.extensions.mujoco")
    pytest.importorskip("mujoco")
    here, there = (
        Scene.of("zjudancer_dynamic", {**PUSHED, "engine": engine})
        for engine in ("drake", "mujoco")
    )
    assert here.digest != there.digest
    drake, mujoco = here.run(), there.run()
    assert mujoco["base.z"][-1] == pytest.approx(drake["base.z"][-1], abs=1e-3)
    assert not np.array_equal(mujoco["base.z"], drake["base.z"])
    assert "engine" in doubts(here, 1)
    assert "engine" in doubts(Scene.of("humanoid_balance", {}), 1)  # its loop, too


@pytest.mark.parametrize(
    ("station", "changes", "told"),
    [
        ("zjudancer_dynamic", {"engine": "mujuco"}, "did you mean 'mujoco'"),
        ("irb120_kinematic", {"engine": "mujoco", "program": WAITS}, "does no programs"),
        (
            "zjudancer_dynamic",
            {"gait.name": "wolk"},
            "no gait of zjudancer 'wolk'; did you mean 'walk'",
        ),
        (
            "zjudancer_dynamic",
            {"gait.name": "walk", "gait.bearing.hight": 1},
            "unknown key; did you mean 'height'",
        ),
        ("zjudancer_dynamic", {"gait.name": "walk", "gait.step_length": 0.9}, "mm too short"),
        (
            "zjudancer_dynamic",
            {"gait.name": "walk", "gait.steps": 10**9},
            "steps is 1000000000; it must be a whole number",
        ),
        (
            "zjudancer_dynamic",
            {"gait.name": "walk", "gait.steps": "1e3"},
            "steps is '1e3'; it must be a whole number",
        ),
        (
            "zjudancer_dynamic",
            {"gait.name": "walk", "gait.amplitude": "1e3"},
            "amplitude is '1e3'; it must be a finite number",
        ),
        (
            "zjudancer_dynamic",
            {"gait.name": "walk", "gait.rest": 1e9},
            r"1e\+09 s long; it must be at most 1000 s long",
        ),
        ("irb120_dynamic", {"gait.name": "walk"}, "without gaits"),
        ("two_arms", {"gait.name": "walk"}, "needs a station of one robot, and this has 2"),
        ("irb120_kinematic", {"program": "nowhere.yaml"}, "nowhere.yaml"),
        ("irb120_kinematic", {"gait": "walk", "program": WAITS}, "beside a program"),
        ("zjudancer_dynamic", {"gait": "walk", "servo.kpp": 1}, "did you mean 'kp'"),
    ],
)
def test_what_cannot_be_is_told(station, changes, told):
    with pytest.raises(SimrobError, match=told):
        Scene.of(station, changes)


@pytest.mark.parametrize(
    ("key", "told"), [("moves.1.duration", "are 0 to 0"), ("moves.0.0", "unknown")]
)
def test_so_is_a_place_that_a_program_has_not(key, told, tmp_path):
    file = tmp_path / "program.yaml"
    file.write_text(yaml.safe_dump({"moves": [{"target_deg": {"joint_1": 10}}]}))
    with pytest.raises(SimrobError, match=told):
        Scene.of("irb120_kinematic", {"program": str(file), f"program.{key}": 1})


@pytest.mark.long
def test_what_is_built_is_used_again_and_runs_are_those_of_simulate():
    """For other references, pushes and durations; not for other gains."""
    scene._KEPT.clear()
    ramp = {"reference.target_deg": 5, "reference.duration": 0.1}
    changes = [
        PUSHED,
        {**PUSHED, "forces.shove.force": [0, 9, 0]},
        {**PUSHED, **ramp},
        {**PUSHED, "duration": 0.1},
    ]
    for change in [*changes, {**PUSHED, "servo.kp": 500}]:
        config = load_station("irb120_dynamic", change)
        assert np.array_equal(scene.run(config).values, simulate(config, progress=False).values)
        assert scene.run(config).config == config
    assert len(scene._KEPT) == 2


def test_the_margin_is_the_largest_push_that_does_not_end_a_run():
    """A ball that floats, pushed for 0.1 s by F, comes F/m (0.1²/2 + 0.1 · 0.5) m far in 0.6 s: a limit bounds F."""
    mass, limit = 0.9048, 0.1
    box = {"kind": "workspace", "piece": "ball", "lower": [-1, -1, 0], "upper": [limit, 1, 2]}
    push = {"kind": "push", "at": "ball", "start": 0.0, "force": [1, 0, 0]}
    changes = {"gravity": 0, "pieces.ball.pose": [0, 0, 0.5, 0, 0, 0], "duration": 0.6}
    changes |= {"forces.shove": push, "monitors.box": box}
    largest = limit * mass / (0.1**2 / 2 + 0.1 * 0.5)
    for sizes in ([0.5, 0.99 * largest, 1.01 * largest, 4], [0.99 * largest], [1.01 * largest, 4]):
        (row,) = made(
            Case(1, "bouncing_ball", changes, margin=Margin(push="shove", sizes=sizes))
        ).rows
        assert row["ended"] == "completed"
        assert row["margin"] == max([size for size in sizes if size < largest], default=0)


def test_a_scene_does_the_program_of_its_station(turning):  # noqa: F811
    scene = Scene.of(str(turning), {"program.moves.0.duration": 0.2})
    assert scene.run().stop_time == pytest.approx(0.2)
    assert scene.digest != Scene.of(str(turning), {}).digest
    walked = Scene.of("yobotics_terrain", {"gait.name": "trot", "gait.steps": 2})
    assert walked.program is None  # a gait that is named takes its place
    assert walked.config.program is None
