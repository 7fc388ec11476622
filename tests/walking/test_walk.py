"""The controller `walk`: the legs' kinematics, the same way as planned walks, and robots that keep their feet."""

from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.controllers.walk import WalkingLoop
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.station import add_station
from simrob_drake.walking.body import Rows
from simrob_drake.walking.estimator import Estimate
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import Stride

HUMANOIDS = ("zjudancer", "roid1", "humanoid")


def loop_of(station: str, gait: dict[str, Any]) -> tuple[DiagramBuilder, WalkingLoop]:
    """Return the loop of a station, and what keeps its plant alive."""
    builder = DiagramBuilder()
    add_station(builder, load_station(station, {"controllers.walk.gait": gait}))
    return builder, next(block for block in builder.GetSystems() if isinstance(block, WalkingLoop))


def pose(rows: Rows) -> RigidTransform:
    """Return a pose from the rows of its matrix."""
    return RigidTransform(np.array([*rows, [0, 0, 0, 1]]))


@pytest.mark.parametrize("robot", HUMANOIDS)
def test_legs_put_the_soles_where_they_shall_be(robot: str) -> None:
    builder, loop = loop_of(f"{robot}_walking", {})
    engine, body = loop.engine, loop.engine.body
    posture = engine.standing(loop.start)[1]
    base = np.array([0, 0, 1.0, 1, 0, 0, 0])
    seen = body.seen(np.concatenate([posture, 0 * posture, base, np.zeros(6)]))
    feet = [pose(foot) for foot in seen.feet]
    apart = feet[0].inverse() @ feet[1]
    assert apart.translation() == pytest.approx([0, engine.planner.steps.apart[1].imag, 0], abs=2e-6)
    assert apart.rotation().IsNearlyIdentity(2e-6)
    assert seen.lowest[0] == pytest.approx(seen.lowest[1], abs=2e-6)
    ahead = engine.planner.steps.rest_points[0].real
    middle = np.mean([body.facing @ foot.translation() for foot in feet], axis=0)
    assert (body.facing @ np.array(seen.com))[:2] == pytest.approx([middle[0] + ahead, middle[1]], abs=1e-5)
    # one foot ahead and up, as far as such legs can
    wanted = [RigidTransform(body.facing @ (foot.translation() * [1, 1, 0])) for foot in feet]
    wanted[0] = RigidTransform([0.03, 0, 0.02]) @ wanted[0]
    body.take(posture)
    root = RigidTransform([0.0, 0.0, 1.0 - feet[0].translation()[2]])
    found = body.reached(np.eye(3), np.array([(root.inverse() @ foot).GetAsMatrix34() for foot in wanted]), 30)
    there = [pose(foot) for foot in body.seen(np.concatenate([found, 0 * found, base, np.zeros(6)])).feet]
    step = body.facing @ (there[0].translation() - there[1].translation())
    assert step[[0, 2]] == pytest.approx([0.03, 0.02], abs=1e-5)
    assert builder is not None


def test_it_carries_itself_as_its_keys_say() -> None:
    """Height and pitch of the trunk, how wide it stands, and the axes that are in no leg."""
    bearing = {"height": 0.49, "pitch_deg": 6, "posture_deg": {"RodD": 40, "RodI": 40, "left_elbow": 30}}
    builder, loop = loop_of("zjudancer_walking", {"bearing": bearing, "widen": 0.03})
    posture, half = loop.engine.standing(loop.start)[1], loop.engine.stance.half
    turn = RotationMatrix.MakeZRotation(np.pi / 2) @ RotationMatrix.MakeYRotation(np.deg2rad(6))  # it looks along y
    turn = turn @ RotationMatrix.MakeZRotation(-np.pi / 2)
    base = [0, 0, 0.49, *turn.ToQuaternion().wxyz()]
    seen = loop.engine.body.seen(np.concatenate([posture, 0 * posture, base, np.zeros(6)]))
    assert seen.lowest == pytest.approx([0.0, 0.0], abs=1e-4)
    assert [foot[2][2] for foot in seen.feet] == pytest.approx([1.0, 1.0], abs=1e-5)  # flat
    assert abs(seen.feet[0][0][3] - seen.feet[1][0][3]) == pytest.approx(2 * half, abs=1e-5)
    assert half == pytest.approx(abs(loop.engine.body.homes[0][1]) + 0.03, abs=1e-6)
    elbow = list(load_robot("zjudancer").axes).index("left_elbow")
    assert np.rad2deg(posture[elbow]) == pytest.approx(30.0)
    assert builder is not None


@pytest.mark.parametrize("robot", HUMANOIDS)
def test_without_feedback_it_goes_as_planned(robot: str) -> None:
    """The planner mends the zero-moment point by the whole body, the engine is a pendulum: 1.6 deg rms between them.

    Most of it is in knees that swing, or are nearly straight.
    """
    gait, planned = load_gaits(robot).walks["walk"], walk(robot, 6)
    speed = gait.step_length / gait.step_time
    own = gait.model_dump(include={"step_time", "double_support", "lift", "zmp_inward", "zmp_ahead", "settle", "widen"})
    more = {
        "feedback": None,
        "lift_exponent": 3,
        "max_speed_change": [speed / 4, 0.1, 20],
        "bearing": {"height": gait.bearing.height},
    }
    builder, loop = loop_of(f"{robot}_walking", {**own, **more})
    stride, posture = loop.engine.standing(loop.start)
    found = [posture]
    for _ in range(round(100 * (gait.settle + 5 * gait.step_time))):
        stride, posture = loop.engine.sample(stride, posture, Command(complex(speed)), None)
        found.append(posture)
    asked = planned.positions[: len(found)]
    errors = np.rad2deg(np.array(found) - asked)
    assert np.abs(errors).max() < 14.0
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 1.7
    assert builder is not None


class TestWhatLasts:
    """What is measured again and again off the reference is learnt, and taken out."""

    def walked(self, samples: int = 60, **off: Any) -> Stride:
        """Return the stride after a walk on which all is measured as it shall be, but for what is ``off``."""
        builder, loop = loop_of("zjudancer_walking", {})
        stride, posture = loop.engine.standing(loop.start)
        measured = Estimate(stride.trunk.com, stride.trunk.zmp, 0.0, 0.0, 0.0, 0j, touches=False)
        for _ in range(samples):
            trunk = stride.trunk
            asked = measured._replace(com=trunk.com, xi=trunk.com if stride.step.active else trunk.zmp)
            stride, posture = loop.engine.sample(stride, posture, Command(), asked)
        stride, posture = loop.engine.sample(stride, posture, Command(0.1), asked._replace(com=stride.trunk.com))
        step, landing = stride.step._replace(transfer=0.0, nominal=0.28, time=0.0), stride.landing._replace(time=0.28)
        stride = stride._replace(step=step, landing=landing)
        for _ in range(8):
            free, sag = loop.engine.planner._planned(stride, Command(0.1), 5.2, None)[1], stride.learnt.sag
            now = {**{"com": stride.trunk.com + sag, "xi": free + sag}, **off}
            if "away" in now:
                now["com"] += now.pop("away")
            stride, posture = loop.engine.sample(stride, posture, Command(0.1), measured._replace(**now))
        assert builder is not None
        return stride

    def test_nothing_is_learnt_where_nothing_is_off(self) -> None:
        stride = self.walked()
        assert abs(stride.learnt.sag) < 1e-3
        assert (abs(stride.ground.slope), stride.learnt.counter, stride.learnt.turn_back) == (0.0, 0j, 0.0)

    def test_a_lean_is_countered_and_a_slope_followed(self) -> None:
        stride = self.walked(lean=0.02, pitch=-0.03, slope=0.1 - 0.05j)
        assert stride.learnt.counter.real < 0 < stride.learnt.counter.imag
        assert stride.ground.slope.real > 0 > stride.ground.slope.imag

    def test_who_stands_learns_the_slope_too(self) -> None:
        """At `slope_rate` = 1/s, so that a second of standing brings 63 % of it."""
        builder, loop = loop_of("zjudancer_walking", {})
        stride, posture = loop.engine.standing(loop.start)
        measured = Estimate(stride.trunk.com, stride.trunk.zmp, 0.0, 0.0, 0.0, 0.1 + 0j, touches=False)
        for _ in range(100):
            stride, posture = loop.engine.sample(stride, posture, Command(), measured)
        assert not stride.step.active
        assert stride.ground.slope == pytest.approx(0.1 * (1 - np.exp(-1)), rel=1e-6)
        assert builder is not None

    def test_who_answers_an_error_learns_a_tenth(self) -> None:
        calm, pushed = (self.walked(slope=0.1 + 0j, **off).ground.slope.real for off in ({}, {"xi": 0.2 + 0j}))
        assert 0.05 * calm < pushed < 0.2 * calm

    def test_a_sag_is_no_error_any_more(self) -> None:
        assert self.walked(away=-0.01).learnt.sag.real < -1e-4

    def test_the_heading_is_held(self) -> None:
        assert self.walked(heading=0.1).learnt.turn_back < 0 < self.walked(heading=-0.1).learnt.turn_back


def test_soles_tell_the_slope_under_them() -> None:
    builder, loop = loop_of("zjudancer_walking", {})
    posture = loop.engine.standing(loop.start)[1]
    turn = RotationMatrix.MakeYRotation(-np.arctan(0.1)) @ RotationMatrix.MakeXRotation(0.05)
    turn = RotationMatrix.MakeZRotation(0.7) @ turn @ RotationMatrix.MakeZRotation(-np.pi / 2)  # it looks along y
    base = [0, 0, 0.5, *turn.ToQuaternion().wxyz()]
    seen = loop.engine.body.seen(np.concatenate([posture, 0 * posture, base, np.zeros(6)]))
    assert loop.engine.estimator.estimate(Stride(), seen).slope == pytest.approx(0.1 + 0.05j, abs=1e-3)
    assert builder is not None


def ahead(result: Any, facing: tuple[float, float]) -> float:
    """Return how far a base has gone to where its robot looks [m]."""
    x, y = result["base.x"], result["base.y"]
    return float((x[-1] - x[0]) * facing[0] + (y[-1] - y[0]) * facing[1])


@pytest.mark.long
def test_it_starts_walks_and_stops_by_commands() -> None:
    commands = [{"time": 0.2, "ahead": 0.15}, {"time": 2.5}]
    result = simulate(load_station("zjudancer_walking", {"controllers.walk.commands": commands}), duration=5.0)
    assert result.stopped_by is None
    assert 0.15 < ahead(result, (0, 1)) < 0.4
    still = result.times > 4.5
    speeds = [result[name][still] for name in result.names if name.startswith("v.")]
    assert np.abs(speeds).max() < 0.2


@pytest.mark.long
def test_a_push_that_fells_a_planned_walk_is_answered() -> None:
    push = {"kind": "push", "start": 2.1, "force": [10.0, 17.3, 0]}  # N, ahead and to the right
    settings = {"forces.push": push, "duration": 4.5}
    assert simulate(load_station("zjudancer_walking", settings)).stopped_by is None
    blind = {**settings, "controllers.walk.gait": {"feedback": None}}
    assert simulate(load_station("zjudancer_walking", blind)).stopped_by == "fall"


@pytest.mark.long
def test_who_cannot_step_aside_stops_on_both_feet_and_walks_on() -> None:
    push = {"kind": "push", "start": 2.1 + 0.5 * 5 / 8, "force": [20.0, 0, 0]}  # N, to the left: it looks along -y
    settings = {"forces.push": push, "duration": 5.0}
    result = simulate(load_station("humanoid_walking", settings))
    assert result.stopped_by is None
    feet = result["walk.foot"]
    changes = result.times[1:][np.diff(feet) != 0]
    assert np.diff(changes[changes > 1.5]).max() > 0.4  # of steps of 0.25 s
    assert changes[-1] > 4.7
    y = result["base.y"]
    assert y[-1] < y[result.times < 4.0][-1] - 0.05
    going_on = {**settings, "controllers.walk.gait": {"feedback": {"brace_threshold": None}}}
    assert simulate(load_station("humanoid_walking", going_on)).stopped_by == "fall"


def test_it_shifts_its_weight_at_leisure_however_long_it_stood() -> None:
    builder, loop = loop_of("zjudancer_walking", {})
    stride, posture = loop.engine.standing(loop.start)
    for _ in range(120):
        stride, posture = loop.engine.sample(stride, posture, Command(), None)
    shares = []
    for _ in range(62):  # settle: 0.6 s
        stride, posture = loop.engine.sample(stride, posture, Command(0.1), None)
        shares.append(stride.swing.share)
    assert stride.step.standing == 1.0
    assert shares[58] == 0
    assert shares[61] > 1e-3
    assert builder is not None


@pytest.mark.long
def test_who_is_in_the_air_as_a_push_ends_falls_and_does_not_diverge() -> None:
    """In flight steps are short, and stay so in the diagram without the push."""
    push = {"kind": "push", "start": 2.2, "force": [-24.0, 0, 0]}
    result = simulate(load_station("zjudancer_walking", {"forces.push": push, "duration": 3.2}))
    assert result.stopped_by in (None, "fall")


@pytest.mark.long
def test_the_same_again_and_from_the_middle() -> None:
    """All that the walk remembers is state: resumed, it goes on as it went, to the last bit."""
    settings = {"solver": {"kind": "discrete", "time_step": 0.002}, "controllers.walk.commands": [{"ahead": 0.2}]}
    config = load_station("zjudancer_walking", settings)
    whole = simulate(config, duration=1.6)
    first = simulate(config, duration=0.8)
    second = simulate(config, duration=0.8, start=first.final_state)
    for name in ("q.left_knee", "q_ref.right_hip_roll", "base.x"):
        np.testing.assert_array_equal(whole[name][-1], second[name][-1])


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"controllers.walk.commands": [{"time": 2}, {"time": 1}]}, "must rise"),
        ({"controllers.walk.gait": {"step_tyme": 0.3}}, "step_time"),
        ({"controllers.walk.gait": {"foothold": {"inner": 0.3}}}, "beyond foothold.inner"),
        ({"controllers.walk.gait": {"groups": [["right_foot"], ["left_fot"]]}}, "left_foot"),
        (
            {"robot.model": "irb120", "robot.base": [0] * 6, "robot.initial_deg": 0, "servo.motor": None},
            "feet of its own",
        ),
    ],
)
def test_what_cannot_be_is_told(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(SimrobError, match=told):
        simulate(load_station("zjudancer_walking", settings), duration=0.1)
