"""A robot that is pushed over while it walks: curled up in time by its guard, it keeps its head off the floor."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import load_station, simulate
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.registry import load_gaits

GUARDS = read_yaml(Path(__file__).parents[1] / "examples" / "loops" / "fall_guards.yaml")
PUSHED = 1.5  # while it takes its second step [s]


@pytest.mark.parametrize("robot", GUARDS)
def test_the_guards_fit_their_robots_and_move_both_sides_alike(robot):
    config = load_station(f"{robot}_dynamic", {"controllers": GUARDS[robot]})
    for guard in config.controllers.values():
        posture = guard.posture_deg
        for axis, angle in posture.items():
            assert posture.get(axis.replace("left", "right")) == angle


@pytest.mark.long
@pytest.mark.parametrize(("robot", "force"), [("zjudancer", 27), ("roid1", 10)])
def test_a_robot_that_curls_up_as_it_falls_keeps_its_head_off_the_floor(robot, force):
    motion, turn = replace(walk(robot, 4), falls=True), np.deg2rad(load_gaits(robot).facing_deg)
    push = {
        "kind": "push",
        "start": PUSHED,
        "force": [force * np.cos(turn), force * np.sin(turn), 0.0],
    }

    lowest = {}

    for guarded in (False, True):
        config = motion.station(
            {
                "forces.push": push,
                "sensors.head": {"kind": "distance", "body": motion.model.tools["head"]},
                "controllers": GUARDS[robot] if guarded else {},
                "duration": PUSHED + 1.3,
                "solver.max_step": 0.01,
                "sample_rate": 500,
            }
        )
        result = simulate(config, reference=motion.trajectory(), progress=False)
        assert result.ending == "completed"
        lowest[guarded] = result["distance.head"].min()
        if guarded:
            lean = np.arccos(1 - 2 * (result["base.qx"] ** 2 + result["base.qy"] ** 2))
            acts = result["curl.active"] > 0
            first = np.argmax(acts)
            # 250 deg/s at most
            assert np.rad2deg(lean[first]) == pytest.approx(
                GUARDS[robot]["curl"]["tilt_deg"], abs=3
            )
            assert acts[first:].all()
            assert np.rad2deg(result["q.left_knee"][-1]) == pytest.approx(120, abs=15)
    assert lowest[False] < 0
    assert lowest[True] > 0.05
