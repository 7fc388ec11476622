"""Moves that cruise at a speed, and pass targets within zones: times, ways, limits, and what is refused."""

import numpy as np
import pytest

from simrob_drake import SimrobError, Workcell
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.blocks.references import hermite, hermite_samples
from simrob_drake.programs.errors import AccelerationLimitExceeded, SpeedLimitExceeded
from simrob_drake.programs.segments import zone_size
from simrob_drake.programs.smooth_path import RateLimits
from simrob_drake.programs.timing import remedy
from tests.programs.conftest import DOWN, HOME

CORNERS = np.array(
    [[0.05, 0.1, 0.05], [0.15, 0.1, 0.05], [0.15, 0.2, 0.05], [0.05, 0.2, 0.05]]
)  # m, on the table
ROWS = [
    [0.3, 0.2, -0.1, 0.2, 1.2, 0.5],
    [0.6, 0.1, 0.1, 0.4, 1.0, 0.0],
    [0.2, 0.0, 0.0, 0.0, 1.5, -0.4],
]


@pytest.fixture
def arm(kinematic):
    kinematic.move_j([*CORNERS[0], *DOWN], wobj="table")
    return kinematic


def tool_way(arm, plan, samples=4001):
    """Return times, places of the tool on the table, and their derivatives, each (k, 3)."""
    times = np.linspace(0, plan.duration, samples)
    places = (arm.frame("table").inverse() @ arm.chain.forward(plan.postures(times))[:, :3, 3].T).T
    speeds = np.gradient(places, times, axis=0)
    return times, places, speeds, np.gradient(speeds, times, axis=0)


def joint_pushes(plan):
    times = np.linspace(0, plan.duration, 4001)
    return np.abs(plan.trajectory.MakeDerivative(2).vector_values(times)).max(axis=1)


@pytest.mark.parametrize(("profile", "ramps"), [("trapezoid", 1.0), ("s_curve", 1.5), (None, 1.5)])
def test_a_line_cruises_at_its_speed(arm, profile, ramps):
    speed, push = 0.15, 1.0
    how = {"speed": speed, "acceleration": push, **({"profile": profile} if profile else {})}

    plan = arm.plan.move_l(CORNERS[1], wobj="table", **how)

    assert plan.duration == pytest.approx(0.1 / speed + ramps * speed / push)

    times, places, speeds, pushes = tool_way(arm, plan)
    along = np.linalg.norm(speeds, axis=1)
    even = np.abs(times - plan.duration / 2) < 0.1 / speed / 2 - ramps * speed / push / 2 - 2e-3
    np.testing.assert_allclose(along[even], speed, rtol=2e-4)
    assert along.max() < speed * (1 + 2e-4)
    assert np.linalg.norm(pushes[3:-3], axis=1).max() == pytest.approx(push, rel=5e-3)
    assert np.linalg.norm(places[:, 1:] - CORNERS[0, 1:], axis=1).max() < 3e-5  # on its line
    np.testing.assert_allclose(places[-1], CORNERS[1], atol=1e-6)


def test_unless_told_it_is_sped_up_as_much_as_the_joints_allow(arm):
    quick = arm.plan.move_l(CORNERS[1], wobj="table", speed=0.3)

    # the usual
    assert np.linalg.norm(tool_way(arm, quick)[3][3:-3], axis=1).max() == pytest.approx(
        2.0, rel=5e-3
    )

    limits = np.array(arm.plan.rate_limits)
    weak = np.full(6, 3.0)  # rad/s²
    object.__setattr__(planner := arm.plan, "rate_limits", RateLimits(limits[0], weak))

    slow = planner.move_l(CORNERS[1], wobj="table", speed=0.3)

    assert slow.duration > quick.duration
    assert 0.9 * 3.0 < joint_pushes(slow).max() < 3.0


def test_free_moves_take_as_long_as_accelerations_need(arm):
    limits = arm.plan.rate_limits
    object.__setattr__(planner := arm.plan, "rate_limits", RateLimits(limits[0], np.full(6, 1.0)))

    for how in ({}, {"profile": "trapezoid"}, {"zone": "z20"}):
        assert joint_pushes(
            planner.move_l(CORNERS[1:], wobj="table", **how)
        ).max() == pytest.approx(0.98, rel=0.02)
    with pytest.raises(
        AccelerationLimitExceeded, match=r"joint_\d would accelerate at .* deg/s²;.*duration of"
    ) as caught:
        planner.move_abs_j(HOME, duration=0.9)
    assert planner.move_abs_j(HOME, duration=caught.value.duration).duration > 0.9


def test_zones_round_the_corners_and_leave_the_lines_alone(arm):
    zone = 0.02
    plan = arm.plan.move_l(CORNERS[1:], wobj="table", zone="z20", speed=0.2)

    assert plan.duration == pytest.approx(0.3 / 0.2 + 1.5 * 0.2 / 2.0)  # one ramp up, one down

    times, places, speeds, pushes = tool_way(arm, plan)
    apart = np.linalg.norm(places[:, np.newaxis] - CORNERS[1:3], axis=2).min(axis=1)
    on_lines = apart > zone
    lines = [(places[:, 1] - 0.1, 0), (places[:, 0] - 0.15, 1), (places[:, 1] - 0.2, 2)]
    off = np.min([np.abs(offset) for offset, _ in lines], axis=0)
    assert off[on_lines].max() < 3e-5  # m
    # g(0) = 3/16 along both ways
    assert apart.min() == pytest.approx(np.sqrt(2) * zone * 3 / 16, rel=1e-3)
    assert np.linalg.norm(speeds, axis=1)[500:-500].min() == pytest.approx(
        0.2 / np.sqrt(2), rel=1e-2
    )
    # no jump of 2 m/s² and more
    assert np.linalg.norm(np.diff(pushes[3:-3], axis=0), axis=1).max() < 0.1
    at = np.searchsorted(times, plan.arrivals[:2])
    np.testing.assert_allclose(
        np.linalg.norm(places[at] - CORNERS[1:3], axis=1), apart.min(), rtol=1e-2
    )
    np.testing.assert_allclose(places[-1], CORNERS[3], atol=1e-6)


def test_zones_turn_the_tool_on_and_work_on_arcs(arm):
    turned = [[*CORNERS[1], 0.3, 0.0, np.pi], [*CORNERS[2], 0.3, 0.4, np.pi]]
    plan = arm.plan.move_l(turned, wobj="table", zone="z10", speed=0.1)

    end = arm.frame("table") @ transform_from_pose(turned[-1])

    np.testing.assert_allclose(arm.chain.forward(plan.end)[0], end.GetAsMatrix4(), atol=1e-6)

    middles, targets = [[0.1, 0.12, 0.05], [0.17, 0.15, 0.05]], CORNERS[1:3]
    arcs = arm.plan.move_c(middles, targets, wobj="table", zone="z10", speed=0.1)

    _, places, speeds, _ = tool_way(arm, arcs)

    for middle in middles:
        assert np.linalg.norm(places - middle, axis=1).min() < 1e-4
    assert np.linalg.norm(speeds, axis=1)[400:-400].min() > 0.03  # it does not rest


def test_zones_of_joints_pass_beside_their_postures(arm):
    passing = arm.plan.move_abs_j(ROWS, zone="z30")
    resting = arm.plan.move_abs_j(ROWS, zone="fine")

    at = resting.trajectory.MakeDerivative(1).vector_values(resting.arrivals)

    np.testing.assert_allclose(at, 0, atol=1e-9)

    v = passing.trajectory.MakeDerivative(1).vector_values(passing.arrivals)
    assert np.abs(v[:, :2]).max(axis=0).min() > 0.1
    np.testing.assert_allclose(passing.end, ROWS[-1], atol=1e-12)

    tool = arm.chain.forward(passing.postures(np.linspace(0, passing.duration, 2000)))[:, :3, 3]
    for row in ROWS[:2]:
        away = np.linalg.norm(tool - arm.chain.forward(row)[0, :3, 3], axis=1).min()
        assert 1e-4 < away < 0.03


@pytest.mark.long
def test_a_program_runs_with_them_on_both_kinds_of_station(dynamic):
    for cell in (Workcell("irb120_workcell"), dynamic.cell):
        arm = cell.arm(tool="pencil" if "pencil" in cell.config.pieces else None)
        arm.move_abs_j([[0.2, 0.2, 0.1, 0.0, 1.3, 0.0], HOME], zone="z10", speed=0.3)
        result = arm.move_l([[0.0, 0.0, -0.05], [0.05, 0.0, -0.05]], wobj=arm, speed=0.1, zone="z5")
        assert result.ending == "completed"
        arm.cell.tape.record()
        arm.move_l([0.0, 0.0, 0.02], wobj=arm, speed=0.1)
        (again,) = arm.replay()
        np.testing.assert_array_equal(again.axes("q")[-1], arm.position)


def test_a_saved_move_keeps_its_corners_of_speed(arm):
    plan = arm.plan.move_l(CORNERS[1], wobj="table", speed=0.15, profile="trapezoid")
    times, *values = hermite_samples(plan.trajectory, 0.0, plan.duration, 200.0)
    again = hermite(times, *values)
    looks = np.linspace(0, plan.duration, 777)

    pushes = [
        reference.MakeDerivative(2).vector_values(looks) for reference in (plan.trajectory, again)
    ]

    np.testing.assert_allclose(pushes[1], pushes[0], atol=1e-2 * np.abs(pushes[0]).max())


def test_zones_are_rapid_s():
    found = [zone_size(zone) for zone in ("fine", "z0", "z1", "z10", "z200", 0.015)]
    assert found == [0.0, 3e-4, 1e-3, 1e-2, 0.2, 0.015]


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (
            {"zone": "z60"},
            r"zone is 60 mm; it must be at most 50 mm at targets\[0\]: half of the shorter of the two paths",
        ),
        ({"zone": "z201"}, "zone is 'z201'; it must be 'fine', 'z0' to 'z200'"),
        ({"zone": "ten"}, "zone is 'ten'"),
        ({"zone": -0.1}, "zone is -0.1; it must be a positive number"),
        (
            {"zone": "z10", "times": [1, 2, 3]},
            "times: the tool passes targets with a zone .*; leave it out",
        ),
        (
            {"profile": "sine"},
            "no profile 'sine'; known: jerk_limited, s_curve, smooth, time_optimal, trapezoid",
        ),
        (
            {"acceleration": 1.0},
            "acceleration: only a move that reaches a cruising speed has it; set speed",
        ),
        ({"speed": 0.1, "acceleration": 0.0}, "acceleration is 0.0; it must be a positive number"),
        (
            {"speed": 0.1, "profile": "smooth", "acceleration": 1.0},
            "only a move that reaches a cruising speed has it",
        ),
    ],
)
def test_wrong_ways_of_doing_it(arm, how, message):
    with pytest.raises(SimrobError, match=message):
        arm.plan.move_l(CORNERS[1:], wobj="table", **how)


def test_what_one_call_cannot_do(arm):
    with pytest.raises(
        SimrobError, match="zone: a move rests at its last target; give several targets in one call"
    ):
        arm.plan.move_l(CORNERS[1], wobj="table", zone="z10")
    with pytest.raises(SimrobError, match=r"stop: .* zone.*; give one of the two"):
        arm.plan.move_abs_j(ROWS, zone="z10", stop=True)
    with pytest.raises(
        SimrobError, match=r"profile: .* has no cruising speed; set stop=True or a zone"
    ):
        arm.plan.move_abs_j(ROWS, profile="s_curve")


def test_speeds_beyond_the_joints_are_refused_with_one_that_would_do(arm):
    for how, error, told in (
        (
            {"speed": 0.5, "acceleration": 100.0},
            AccelerationLimitExceeded,
            r"give the move an acceleration of [\d.]+ m/s²",
        ),
        (
            {"speed": 1.9, "profile": "smooth"},
            SpeedLimitExceeded,
            r"a speed of [\d.]+ m/s or less$",
        ),
    ):
        with pytest.raises(
            error, match=rf"point \d+ of 10 on the way to the target: joint_\d would .*{told}"
        ):
            arm.plan.move_l(CORNERS[2], wobj="table", **how)
    with pytest.raises(
        AccelerationLimitExceeded, match=r"speed of .* m/s or less, or a larger zone"
    ):
        arm.plan.move_l(CORNERS[1:], wobj="table", speed=0.5, zone="z1")


@pytest.mark.parametrize(
    ("how", "order", "advice"),
    [
        ({"speed": 0.6, "acceleration": 8.0}, 2, "an acceleration of 2 m/s² or less"),
        ({"speed": 0.6, "acceleration": 8.0}, 1, "a speed of 0.3 m/s or less"),
        ({"speed": 0.6}, 2, "a speed of 0.3 m/s or less"),
        ({}, 2, "a duration of 5 s or more"),
    ],
)
def test_a_move_that_takes_twice_as_long_has_half_the_speed_and_a_quarter_of_the_acceleration(
    how, order, advice
):
    text = remedy(how, order, slower=2.0, duration=5.0)

    assert f"give the move {advice}" in text
