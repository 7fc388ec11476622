"""Moves on the kinematic station: the way of the tool, its times, and what comes of bad input."""

import re

import numpy as np
import pytest
from pydrake.math import RigidTransform

from simrob_drake import Arm, LeggedRobot, Program, SimrobError, Workcell, load_station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import transform_from_pose
from simrob_drake.base.interpolation import Arc, turned_by
from simrob_drake.kinematics import IncrementalSolver, NoClosedForm, Unreachable
from simrob_drake.kinematics.numeric import NumericSolver
from simrob_drake.programs import stateful_station
from simrob_drake.programs.errors import (
    BrokenPath,
    JointLimitExceeded,
    PathCollision,
    SpeedLimitExceeded,
)
from simrob_drake.programs.plan import check_moves
from tests.programs.conftest import DOWN, HOME, positions_between


def off_line(points, start, end):
    way = (end - start) / np.linalg.norm(end - start)
    offsets = points - start
    return np.linalg.norm(offsets - np.outer(offsets @ way, way), axis=1)


@pytest.mark.parametrize("solver", ["auto", "analytic", "numeric", "incremental", "constrained"])
@pytest.mark.parametrize("points", [1, 10])
def test_move_l_keeps_to_its_line_between_the_points(kinematic, solver, points):
    kinematic.move_j([0.05, 0.05, 0.02, *DOWN], wobj="table", check=None)
    start, end_there = kinematic.pose(), [0.25, 0.2, 0.05, 0.4, 0.2, np.pi - 0.3]
    result = kinematic.move_l(end_there, wobj="table", solver=solver, points=points, check=None)
    chain = kinematic.chain
    poses = chain.forward(positions_between(result))

    end = kinematic.frame("table") @ transform_from_pose(end_there)

    assert off_line(poses[:, :3, 3], start[:3], end.translation()).max() < 1e-4  # asked for
    np.testing.assert_allclose(poses[-1], end.GetAsMatrix4(), atol=1e-5)

    # about one axis: the parts of the turn add up
    whole = turned_by(poses[0, :3, :3], poses[-1, :3, :3])
    for pose in poses[::100]:
        parts = [
            turned_by(poses[0, :3, :3], pose[:3, :3]),
            turned_by(pose[:3, :3], poses[-1, :3, :3]),
        ]
        assert sum(parts) == pytest.approx(whole, abs=1e-3)


@pytest.mark.parametrize("points", [2, 20])
def test_move_c_keeps_to_its_circle_between_the_points(kinematic, points):
    kinematic.move_j([0.12, 0.15, 0.02, *DOWN], wobj="table")
    table, start = kinematic.frame("table"), kinematic.pose()
    via, end = [0.17, 0.2, 0.02], [0.12, 0.18, 0.05]
    result = kinematic.move_c(via, end, wobj="table", points=points, check=None)
    poses = kinematic.chain.forward(positions_between(result))
    arc = Arc.through(start[:3], table @ via, table @ end)
    offsets = poses[:, :3, 3] - arc.centre
    # over the plane of the circle
    height = offsets @ np.cross(arc.first, arc.across) / arc.radius**2

    away = np.hypot(height, np.sqrt((offsets**2).sum(axis=1) - height**2) - arc.radius)

    assert away.max() < 1e-4  # asked for
    np.testing.assert_allclose(kinematic.pose()[:3], table @ end, atol=1e-6)
    np.testing.assert_allclose(
        poses[:, :3, :3], np.broadcast_to(poses[0, :3, :3], (len(poses), 3, 3)), atol=1e-4
    )


def test_a_circle_of_two_arcs_comes_back(kinematic):
    kinematic.move_j([0.12, 0.15, 0.02, *DOWN], wobj="table")
    start = kinematic.pose()

    result = kinematic.move_c(
        [[0.17, 0.2, 0.02], [0.17, 0.1, 0.02]],
        [[0.22, 0.15, 0.02], [0.12, 0.15, 0.02]],
        wobj="table",
    )

    np.testing.assert_allclose(kinematic.pose(), start, atol=1e-6)
    assert result.stop_time == pytest.approx(4.0)  # 20 points of 0.1 s an arc


def test_motion_is_smooth_and_rests_at_both_ends_and_at_corners(kinematic):
    kinematic.move_j([0.05, 0.1, 0.02, *DOWN], wobj="table")
    trajectory = kinematic.plan.move_l(
        [[0.15, 0.1, 0.02], [0.15, 0.2, 0.02]], wobj="table", times=[1.0, 2.5]
    ).trajectory
    times = np.linspace(0, 2.5, 5001)

    q, v, a = (trajectory.MakeDerivative(order).vector_values(times) for order in (0, 1, 2))

    # no jump of q
    np.testing.assert_allclose(np.gradient(q, times, axis=1)[:, 1:-1], v[:, 1:-1], atol=1e-5)
    np.testing.assert_allclose(
        np.gradient(v, times, axis=1)[:, 1:-1], a[:, 1:-1], atol=2e-3 * np.abs(a).max()
    )
    # in 0.5 ms; a jump would be some tenths
    assert np.abs(np.diff(a, axis=1)).max() < 0.02 * np.abs(a).max()
    rests = np.searchsorted(times, [0.0, 1.0, 2.5])
    np.testing.assert_allclose(v[:, rests], 0, atol=1e-9)
    np.testing.assert_allclose(a[:, rests], 0, atol=1e-7)


def test_move_abs_j_goes_through_postures_or_stops_at_each(kinematic):
    rows = [
        [0.3, 0.2, -0.1, 0.2, 1.2, 0.5],
        [0.6, 0.1, 0.1, 0.4, 1.0, 0.0],
        [0.2, 0.0, 0.0, 0.0, 1.5, -0.4],
    ]
    times = [1.0, 2.0, 3.5]

    through = kinematic.move_abs_j(rows, times=times)

    at = np.searchsorted(through.times, np.array(times) - 1e-9)
    np.testing.assert_allclose(through.axes("q")[at], rows, atol=1e-9)
    assert np.abs(through.axes("v")[at[0]]).max() > 0.1

    kinematic.move_abs_j(HOME)
    stopping = kinematic.move_abs_j(rows, times=times, stop=True)

    np.testing.assert_allclose(stopping.axes("q")[at], rows, atol=1e-9)
    np.testing.assert_allclose(stopping.axes("v")[at], 0, atol=1e-9)
    np.testing.assert_array_equal(kinematic.position, kinematic.reference)
    np.testing.assert_allclose(kinematic.position, rows[-1], atol=1e-12)


def test_move_j_is_straight_in_the_joints_and_ends_at_the_pose(kinematic):
    target = RigidTransform(transform_from_pose([0.1, 0.35, 0.3, 0.3, 0.2, np.pi]))
    result = kinematic.move_j(target)

    q = result.axes("q")

    np.testing.assert_allclose(kinematic.chain.forward(q[-1])[0], target.GetAsMatrix4(), atol=1e-9)
    way = q[-1] - q[0]
    parts = (q - q[0]) @ way / (way @ way)
    np.testing.assert_allclose(q - q[0], np.outer(parts, way), atol=1e-9)


def test_times_come_from_points_duration_speed_or_joint_limits(kinematic):
    kinematic.move_j([0.05, 0.1, 0.05, *DOWN], wobj="table")
    plan = kinematic.plan

    goal = [0.15, 0.1, 0.05]

    assert plan.move_l(goal, wobj="table").duration == pytest.approx(1.0)  # 10 points of 0.1 s
    assert plan.move_l(goal, wobj="table", points=25).duration == pytest.approx(2.5)
    assert plan.move_l(goal, wobj="table", duration=0.7).duration == pytest.approx(0.7)

    result = kinematic.move_l(goal, wobj="table", speed=0.15)
    speed = np.linalg.norm(np.gradient(result.pose("tcp")[:, :3], result.times, axis=0), axis=1)

    assert speed.max() == pytest.approx(0.15, rel=1e-3)

    far = kinematic.plan.move_abs_j([2.8, 0, 0, 0, 1.5, 0], points=2)  # 0.2 s would be too fast
    ratio = (
        np.abs(
            far.trajectory.MakeDerivative(1).vector_values(np.linspace(0, far.duration, 500))
        ).max()
        / 4.36332
    )

    assert ratio == pytest.approx(0.98, abs=0.01)


@pytest.mark.parametrize("form", ["matrix", "transform", "arm", "frame"])
def test_work_objects_in_all_forms(kinematic, form):
    table = kinematic.frame("table")
    wobj = {
        "matrix": table.GetAsMatrix4(),
        "transform": table,
        "frame": "table.tcp",
        "arm": kinematic,
    }[form]
    expected = (table if form != "arm" else kinematic.frame(kinematic)) @ [0.02, 0.05, 0.01]

    plan = kinematic.plan.move_j([0.02, 0.05, 0.01], wobj=wobj)

    np.testing.assert_allclose(kinematic.chain.forward(plan.end)[0, :3, 3], expected, atol=1e-9)
    np.testing.assert_allclose(
        kinematic.pose(plan.end, wobj=wobj)[:3], [0.02, 0.05, 0.01], atol=1e-9
    )


def test_pose_and_joint_are_inverses_in_batches(kinematic):
    random = np.random.default_rng(3)
    q = np.array(HOME) + random.uniform(-0.4, 0.4, (20, 6))

    poses = kinematic.pose(q, wobj="table")
    assert poses.shape == (20, 6)

    again = kinematic.joint(poses, wobj="table")
    np.testing.assert_allclose(kinematic.pose(again, wobj="table")[:, :3], poses[:, :3], atol=1e-8)

    single = kinematic.joint(poses[0], wobj="table", start=q[0])
    np.testing.assert_allclose(single, q[0], atol=1e-7)

    places = kinematic.joint(poses[:, :3] * 0.0 + [0.1, 0.1, 0.1], wobj="table", solver="numeric")
    np.testing.assert_allclose(
        kinematic.pose(places)[:, 3:], np.tile(kinematic.pose()[3:], (20, 1)), atol=1e-6
    )


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_every_transform_of_a_list_gets_its_posture(kinematic, count):
    poses = [RigidTransform(matrix) for matrix in kinematic.chain.forward([HOME] * count)]

    q = kinematic.joint(poses)

    np.testing.assert_allclose(
        kinematic.pose(q), np.tile(kinematic.pose(HOME), (count, 1)), atol=1e-6
    )


def test_the_jacobian_and_the_torques_are_those_of_the_plant(kinematic):
    q, step = np.array([0.2, 0.3, -0.1, 0.4, 1.0, 0.5]), 1e-6
    jacobian = kinematic.jacobian(q)

    columns = [
        (kinematic.pose(q + row)[:3] - kinematic.pose(q - row)[:3]) / (2 * step)
        for row in step * np.eye(6)
    ]

    np.testing.assert_allclose(jacobian[:3], np.transpose(columns), atol=1e-6)
    assert kinematic.jacobian([q, q]).shape == (2, 6, 6)

    thirty = kinematic.inverse_dynamics(np.full(6, np.pi / 6))
    # facts of the arm with both loads
    np.testing.assert_allclose(thirty[1:3], [-20.79, -9.61], atol=0.005)

    result = kinematic.move_abs_j(np.full(6, np.pi / 6), duration=1.5)
    row = 75
    acceleration = np.gradient(result.axes("v"), result.times, axis=0)[row]

    moving = kinematic.inverse_dynamics(result.axes("q")[row], result.axes("v")[row], acceleration)

    np.testing.assert_allclose(moving, result.axes("tau")[row], atol=0.02)


def test_the_tool_can_change(kinematic):
    assert kinematic.tools == ["tool0", "gripper", "load"]

    at_pencil = kinematic.pose()
    kinematic.tool("gripper")
    np.testing.assert_allclose(at_pencil[:3] - kinematic.pose()[:3], [0, 0, -0.148], atol=1e-12)

    kinematic.tool([0, 0, 0.1, 0, 0, 0.5])
    np.testing.assert_allclose(at_pencil[:3] - kinematic.pose()[:3], [0, 0, -0.048], atol=1e-12)

    result = kinematic.move_j([0.1, 0.1, 0.1, *DOWN], wobj="table")
    goal = kinematic.frame("table") @ [0.1, 0.1, 0.1]
    # the result follows the same point
    np.testing.assert_allclose(result.pose("tcp")[-1, :3], goal, atol=1e-8)

    kinematic.tool("tool0")
    # facts of the arm
    assert Arm("irb120_kinematic", tool="tool0").pose()[2] == pytest.approx(0.63)

    kinematic.tool("link_3")  # any link, too
    kinematic.move_abs_j(np.zeros(6), check=None)
    np.testing.assert_allclose(kinematic.pose()[:3], [0, 0, 0.56], atol=1e-9)


def test_what_is_printed_fits_a_line():
    cell = Workcell("two_arms")

    assert re.fullmatch(
        r"<Workcell two_arms, \w+: left \(irb120\), right \(irb120\), pieces .*>", repr(cell)
    )
    assert re.fullmatch(
        r"<Arm left: irb120 in two_arms, 6 axes, tool left_gripper at \S+ \S+ \S+ m, Rz Ry Rx \S+ \S+ \S+ deg>",
        str(cell.arm("left")),
    )

    robot = LeggedRobot("humanoid_dynamic")
    robot.insert(0, {"HomDF": 3})

    assert (
        str(robot)
        == "<LeggedRobot robot: humanoid in humanoid_dynamic, 18 axes, feet spheres_C, program of 1 move>"
    )

    robot.insert(1, {"act": "bow"})
    robot.add_reference({"HomDF": 3})

    assert str(robot.program) == "<Program of 2 moves: target_deg, act; 1 reference>"
    assert repr(Program()) == "<Program of 0 moves>"


def test_a_station_comes_by_name_file_or_configuration(tmp_path):
    config = load_station("irb120_kinematic")
    for station in ("irb120_kinematic", config, Workcell(config)):
        assert Arm(station).axes[0] == "joint_1"
    with pytest.raises(
        SimrobError, match="robot is not named; it must be one of left, right, such as robot='left'"
    ):
        Arm("two_arms")


class TestBadInput:
    """Each is refused with a named exception, and the arm and the station stay as they were."""

    @pytest.fixture(autouse=True)
    def _unchanged(self, kinematic):
        kinematic.move_j([0.1, 0.1, 0.02, *DOWN], wobj="table")
        self.arm = kinematic
        before = kinematic.cell.state, kinematic.cell.config, kinematic.position
        yield
        assert kinematic.cell.state is before[0]
        assert kinematic.cell.config is before[1]
        np.testing.assert_array_equal(kinematic.position, before[2])

    def test_a_target_out_of_reach(self):
        with pytest.raises(
            Unreachable, match=r"the target cannot be reached: .*the error of the best solution is"
        ):
            self.arm.move_j([2.0, 0, 0.3, *DOWN])
        with pytest.raises(Unreachable, match=r"^the pose cannot be reached: "):
            self.arm.joint([2.0, 0, 0.3, *DOWN])
        with pytest.raises(Unreachable, match=r"targets\[1\] cannot be reached"):
            self.arm.move_j([[0.1, 0.1, 0.05], [3.0, 0, 0]], wobj="table")

    @pytest.mark.parametrize("solver", ["analytic", "numeric"])
    def test_the_first_point_of_a_line_that_is_out_of_reach_is_named(self, solver):
        with pytest.raises(
            Unreachable, match=r"point \d+ of 10 on the way to the target \(at .* m\)"
        ) as caught:
            self.arm.move_l([0.1, 1.5, 0.02], wobj="table", solver=solver)
        error = caught.value
        assert 0 < error.index < 9
        assert error.position_error > 1e-4
        assert error.positions.shape == (6,)

    def test_a_posture_beyond_the_limits(self):
        with pytest.raises(
            JointLimitExceeded, match=r"^targets\[1\]: joint_3 would be at 91\.673 deg.* 70 deg$"
        ) as caught:
            self.arm.move_abs_j([HOME, [0, 0, 1.6, 0, 1.5, 0]], times=[2, 4], stop=True)
        assert (caught.value.axis, caught.value.point, caught.value.time) == ("joint_3", 10, 4)

    def test_a_way_beyond_the_limits_between_targets(self):
        over = [[0, 0, angle, 0, 1.5, 0] for angle in (1.2, 1.2, 0.0)]
        with pytest.raises(
            JointLimitExceeded,
            match=r"point \d+ of 10 on the way to targets\[1\]: joint_3 .* 70 deg$",
        ):
            self.arm.move_abs_j(over, times=[2, 4, 6])

    def test_degrees_by_mistake(self):
        with pytest.raises(
            JointLimitExceeded, match=r"^the target: joint_2 .* 1718\.9 deg, .*if these are degrees"
        ):
            self.arm.move_abs_j([0, 30, 0, 0, 30, 0])
        with pytest.raises(
            JointLimitExceeded, match=r"^the target: joint_2 .* deg$"
        ):  # they would not fit either
            self.arm.move_abs_j([0, 300, 0, 0, 30, 0])

    def test_a_move_that_is_too_fast(self):
        with pytest.raises(
            SpeedLimitExceeded, match=r"joint_1 would move at .* deg/s.*duration of"
        ) as caught:
            self.arm.move_abs_j([2.0, 0, 0, 0, 1.5, 0], duration=0.2)
        assert (
            self.arm.plan.move_abs_j(
                [2.0, 0, 0, 0, 1.5, 0], duration=caught.value.duration
            ).duration
            > 0.2
        )

    @pytest.mark.parametrize("via", [[0.15, 0.1, 0.02], [0.1, 0.1, 0.02], [0.2, 0.1, 0.02]])
    def test_arc_points_on_one_line(self, via):
        with pytest.raises(
            SimrobError,
            match=r"the arc to the target is straight; .* three points .* \[\S+, \S+, \S+\] m",
        ):
            self.arm.move_c(via, [0.2, 0.1, 0.02], wobj="table")

    def test_a_line_through_a_singular_posture(self):
        arm = self.arm
        over = arm.chain.forward(arm.position)[0]

        over[:2, 3] *= -1  # the other side of axis 1, the tool turned as it is

        with pytest.raises((BrokenPath, Unreachable), match=r"point \d+ of 10"):
            arm.move_l(over)

    @pytest.mark.parametrize(
        ("kwargs", "message"),
        [
            (
                {"duration": 1, "speed": 0.1},
                "the time of the move is given by duration and speed; it must be given by one",
            ),
            ({"duration": 0}, "duration is 0; it must be a positive time"),
            ({"speed": -1}, "speed is -1"),
            ({"times": [1, 2]}, "1 times"),
            ({"times": [[np.nan]]}, "1 times"),
            ({"points": 0}, "points is 0"),
            ({"durations": 1}, "no option of a move 'durations'; did you mean 'duration'"),
            ({"points": 2.5}, "points is 2.5"),
            ({"check": "colision"}, "did you mean 'collision'"),
            ({"solver": "analytc"}, "did you mean 'analytic'"),
            ({"wobj": "tabel"}, "there is no work object 'tabel'; did you mean 'table'"),
            ({"wobj": "table.tpc"}, "there is no frame of table 'tpc'; did you mean 'tcp'"),
            ({"wobj": [1, 2, 3]}, "pose is"),
        ],
    )
    def test_wrong_ways_of_doing_it(self, kwargs, message):
        with pytest.raises(SimrobError, match=message):
            self.arm.move_l([0.1, 0.12, 0.05], **{"wobj": "table", **kwargs})

    @pytest.mark.parametrize(
        "targets",
        [[1, 2], [[1, 2, 3, 4]], [np.nan, 0, 0], "up", [[0, 0, 0], [0, 0]], np.zeros((4, 4)), []],
    )
    def test_wrong_shapes(self, targets):
        with pytest.raises(SimrobError, match="targets"):
            self.arm.move_l(targets)
        with pytest.raises(
            SimrobError, match=r"targets .* must be 6 finite numbers|no posture of irb120 'up'"
        ):
            self.arm.move_abs_j(targets)

    def test_a_solver_of_another_tool(self):
        solver = NumericSolver(Arm(self.arm.cell.config, tool="tool0").chain)
        with pytest.raises(SimrobError, match=r"a solver made for arm\.chain"):
            self.arm.move_j([0.1, 0.1, 0.1], wobj="table", solver=solver)

    def test_a_plan_made_for_another_place(self, kinematic):
        stale = Arm(self.arm.cell.config).plan.move_abs_j(HOME)
        with pytest.raises(SimrobError, match="plan of robot: it begins in another posture"):
            self.arm.cell.run(stale)
        with pytest.raises(SimrobError, match=r"run: neither plans nor a duration are given"):
            self.arm.cell.run()


def test_a_move_to_where_the_tool_is_takes_its_time_and_turns_alone_too(kinematic):
    here = kinematic.pose()

    for how in ({}, {"speed": 0.1}, {"duration": 0.3}):
        result = kinematic.move_l(here, **how)
        np.testing.assert_allclose(
            result.axes("q"), np.tile(kinematic.position, (len(result.times), 1)), atol=1e-9
        )

    kinematic.move_l([*here[:3], *DOWN], speed=0.1)
    np.testing.assert_allclose(kinematic.pose()[:3], here[:3], atol=1e-9)
    assert np.abs(kinematic.position - np.array(HOME)).max() > 1.0


@pytest.mark.parametrize("solver", ["auto", "numeric", "incremental"])
def test_a_line_on_which_the_wrist_straightens_is_passed(kinematic, solver):
    """Axes 4 and 6 line up on the way, and joint 5 changes its sign: no posture jumps."""
    kinematic.move_abs_j([0, 0.1, 0.2, 0, -0.15, 0])
    start = kinematic.pose()[:3]
    end = start + np.array([0, 0, 0.12])
    result = kinematic.move_l(end, solver=solver)

    q = positions_between(result)

    assert q[0, 4] * q[-1, 4] < 0

    points = kinematic.chain.forward(q)[:, :3, 3]
    assert off_line(points, start, end).max() < 1e-4
    assert np.abs(np.diff(q, axis=0)).max() < 0.01


def test_a_solver_with_weights_of_its_own(kinematic):
    place = NumericSolver(kinematic.chain, weights=[1, 1, 1, 0, 0, 0], position_tolerance=1e-8)
    before = kinematic.pose()

    kinematic.move_l([0.1, 0.1, 0.02, *DOWN], wobj="table", solver=place)

    np.testing.assert_allclose(kinematic.pose(wobj="table")[:3], [0.1, 0.1, 0.02], atol=1e-7)
    # the tool was free to turn
    assert np.linalg.norm(kinematic.pose(wobj="table")[3:] - np.array(DOWN)) > 0.01
    assert np.linalg.norm(kinematic.pose()[:3] - before[:3]) > 0.05


def test_the_closed_form_is_refused_for_seven_axes_and_the_numeric_one_found():
    arm = Arm("irb120_on_belt")

    with pytest.raises(NoClosedForm):
        arm.move_j([0.3, 0.6, 0.4], solver="analytic")

    result = arm.move_l([0.0, 0.2, -0.1], wobj=arm)
    assert result.ending == "completed"

    far = arm.move_j([0.1, 1.6, 0.5])  # only the belt gets it there
    assert far["q.belt"][-1] > 0.5


def test_the_incremental_solver_passes_a_singular_posture_only_where_it_may_stray(kinematic):
    kinematic.move_abs_j([0, 0.1, 0.2, 0, -0.15, 0])
    start = kinematic.pose()[:3]

    end = start + np.array([0, 0.005, 0.12])  # past the straight wrist, not through it
    with pytest.raises(Unreachable, match=r"point \d+ of 10 .* the error of the best solution is"):
        kinematic.move_l(end, solver="incremental")
    with pytest.raises(Unreachable, match=r"point \d+ of 10"):
        kinematic.move_l(end, solver=IncrementalSolver(kinematic.chain, stray=2e-4))

    points = kinematic.chain.forward(
        positions_between(
            kinematic.move_l(
                end, solver=IncrementalSolver(kinematic.chain, stray=5e-3), check="nothing"
            )
        )
    )[:, :3, 3]
    assert 2e-4 < off_line(points, start, end).max() < 5e-3
    with pytest.raises(SimrobError, match=r"stray is -1; it must be a distance"):
        IncrementalSolver(kinematic.chain, stray=-1)


class TestCollisions:
    def test_a_move_into_the_table_names_the_first_point(self, kinematic):
        kinematic.move_j([0.1, 0.15, 0.05, *DOWN], wobj="table")

        with pytest.raises(
            PathCollision, match=r"point \d+ of 10 .*: load would collide with table, .* mm deep"
        ) as caught:
            kinematic.move_l([0.1, 0.15, -0.05], wobj="table", check="collision")
        assert 5 <= caught.value.point <= 7  # the tip meets the surface half-way
        assert 1e-3 < caught.value.depth < 0.02

        kinematic.move_l([0.1, 0.15, 0.001], wobj="table", check="collision")

    def test_what_touches_at_the_beginning_does_not_count(self, kinematic):
        kinematic.move_j([0.1, 0.15, 0.05, *DOWN], wobj="table")
        kinematic.move_l([0.1, 0.15, -0.01], wobj="table", check=None)
        kinematic.move_l([0.1, 0.15, 0.05], wobj="table", check="collision")

    def test_a_plan_is_looked_at_once_unless_something_has_changed(self, kinematic, monkeypatch):
        looks, cell = [], kinematic.cell
        monkeypatch.setattr(
            stateful_station, "check_moves", lambda *known: looks.append(check_moves(*known))
        )

        def plan(height):
            return kinematic.plan.move_j([0.1, 0.15, height, *DOWN], wobj="table")

        cell.run(plan(0.05))
        assert len(looks) == 1
        first, _ = plan(0.06), plan(0.07)
        cell.run(first)
        assert len(looks) == 4  # the other plan was looked at last
        again = plan(0.05)
        cell.change(cell.config.model_copy())
        cell.run(again)
        assert len(looks) == 6

    @pytest.fixture
    def into_the_middle(self):
        """Two arms that face each other, and how each goes to the middle between them and back."""
        cell = Workcell("two_arms")

        def to_middle(name, **how):
            arm = cell.arm(name)
            home = arm.pose()
            return arm.plan.move_l([[0.0, 0.0, 0.35, *home[3:]], home], check="collision", **how)

        return cell, to_middle

    def test_moves_at_once_are_checked_against_each_other(self, into_the_middle):
        cell, to_middle = into_the_middle
        plans = to_middle("left"), to_middle("right")

        with pytest.raises(
            PathCollision,
            match=r"point \d+ of 10 .*: (left|right).* would collide with (left|right).*",
        ) as hit:
            cell.run(*plans)
        assert {body.split(".")[0].split("_")[0] for body in hit.value.bodies} == {"left", "right"}
        # nothing moved
        assert cell.state is None or np.array_equal(cell.position("left"), plans[0].start)

    def test_the_same_moves_do_one_after_the_other(self, into_the_middle):
        cell, to_middle = into_the_middle
        assert cell.run(to_middle("left")).ending == "completed"
        assert (
            cell.run(to_middle("right"), to_middle("left", duration=20.0), duration=0.2).ending
            == "completed"
        )

    def test_an_arm_that_came_after_the_plan_was_made_is_seen(self, into_the_middle):
        cell, to_middle = into_the_middle
        plan, right = to_middle("left"), cell.arm("right")

        right.move_l([0.0, 0.0, 0.35])

        for _ in range(2):
            with pytest.raises(PathCollision, match=r"left.* would collide with right"):
                cell.run(plan)
            with pytest.raises(PathCollision, match=r"left.* would collide with right"):
                to_middle("left")


def test_a_method_is_no_attribute_to_assign_to():
    with pytest.raises(AttributeError, match=r"tool is a method of Arm: call tool\('gripper'\)"):
        Arm("irb120_kinematic").tool = "gripper"


class TestUnits:
    """Numbers that can only be of other units are told so."""

    @pytest.mark.parametrize(
        ("target", "how", "text"),
        [
            ([0.3, 0, 0.4, 0, 0, 180], {}, "a value of 180 rad seems to be in degrees"),
            ([300, 0, 400, 0, 0, np.pi], {}, "a value of 300 m seems to be in millimetres"),
            ([300, 0, 400], {}, "a value of 300 m seems to be in millimetres"),
            ([[0.3, 0, 0.4], [0.3, 0, 400]], {}, "400 m"),
            (
                [0.3, 0, 0.1, *DOWN],
                {"wobj": [0, 0, 0, 90, 0, 0]},
                "wobj: a value of 90 rad seems to be in degrees",
            ),
            (
                [0.3, 0, 0.3],
                {"speed": 50},
                r"speed is 50 m/s; .* if these are mm/s, give 0.05",
            ),
        ],
    )
    def test_degrees_and_millimetres(self, kinematic, target, how, text):
        with pytest.raises(InvalidParameter, match=text):
            kinematic.move_l(target, **how)

    @pytest.mark.parametrize("form", [list, transform_from_pose])
    @pytest.mark.parametrize("place", [(0.0, 1e14, 0.0), (0.0, 0.0, -120.0)])
    def test_a_tool_far_from_its_flange_is_refused(self, kinematic, place, form):
        with pytest.raises(
            InvalidParameter, match=r"tool: a value of .* m seems to be in millimetres"
        ):
            kinematic.tool(form([*place, 0.0, 0.0, 0.0]))

    def test_a_piece_far_from_its_hand_is_refused(self):
        cell = Workcell("irb120_gripper")
        with pytest.raises(InvalidParameter, match=r"pose: a value of 1e\+14 m"):
            cell.attach("cube_1", pose=[0.0, 1e14, 0.0, 0.0, 0.0, 0.0])

    def test_other_forms_of_poses_are_left_alone(self, kinematic):
        poses = [kinematic.tool_pose()] * 3  # as many as a place has numbers
        assert kinematic.plan.move_l(poses).robot == kinematic.name
        with pytest.raises(SimrobError):
            kinematic.plan.move_l([[0.3, 0], [0.3, 0, 0.4]])
