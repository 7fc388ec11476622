"""The stations that programs are made for: where things are, and that every tool has its port."""

import shutil
import subprocess
import sys

import numpy as np
import pytest

from simrob_drake import Arm, Workcell, build_station, load_station, simulate, three_point_frame
from simrob_drake.base.files import models_root
from tests.programs.conftest import DOWN, HOME

STATIONS = ("irb120_workcell", "irb120_chess", "irb120_on_belt", "belt_pick", "two_arms")


@pytest.mark.parametrize("name", STATIONS)
def test_ports_carry_every_tool(name):
    station = build_station(load_station(name))
    cell = Workcell(name)
    for robot in cell.model.robots.values():
        tools = [*robot.model.tools, *(p for p in cell.config.pieces if p in robot.tools)]
        assert list(robot.tools) == tools
        for tool in tools:
            port = station.GetOutputPort(f"{robot.prefix}tcp_pose.{tool}")
            assert port.size() == 7


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("mode", ["kinematic", "dynamic"])
def test_a_station_runs_in_both_modes(name, mode):
    result = simulate(load_station(name, {"mode": mode}))

    assert result.ending == "completed"
    assert result.stop_time == 1.0
    for robot in result.plant.robots:
        # they sag
        assert np.abs(result.axes("q", robot) - result.axes("q_ref", robot)).max() < 0.05


class TestWorkcell:
    @pytest.fixture(scope="class", autouse=True)
    def _cell(self, request):
        request.cls.cell = Workcell("irb120_workcell")

    def test_pieces_stand_where_the_exercises_have_them(self):
        places = {"half_sphere": (0, -0.35, 0), "cylinder": (0, 0.3, 0.9), "board": (0, 0.2, 0.1)}
        for piece, place in places.items():
            origin = self.cell.model.pose(self.cell.model.piece_origin(piece))
            np.testing.assert_allclose(origin.translation(), place, atol=1e-12)

    def test_the_table_has_the_frame_of_its_three_points(self):
        taught = three_point_frame(
            [0.4000, 0.1330, 0], [0.1500, -0.3000, 0], [0.7232, -0.0536, 0.1000]
        )
        np.testing.assert_allclose(
            self.cell.frame("inclined_table").GetAsMatrix4(), taught.GetAsMatrix4(), atol=5e-5
        )

    def test_the_pencil_is_where_the_facts_have_it(self):
        arm = self.cell.arm(tool="pencil")

        np.testing.assert_allclose(arm.position, HOME, atol=1e-12)
        np.testing.assert_allclose(arm.pose()[:3], [0.302, 0, 0.340], atol=1e-12)
        np.testing.assert_allclose(np.rad2deg(np.abs(arm.pose()[3:])), [90, 0, 180], atol=1e-9)


class TestOnTheBelt:
    def test_the_arm_stands_upright_and_looks_along_the_belt(self):
        arm = Arm("irb120_on_belt", tool="tool0")
        assert arm.axes == ["belt", *(f"joint_{i}" for i in range(1, 7))]
        np.testing.assert_allclose(arm.pose()[:3], [0.1, 0.15 + 0.302, 0.165 + 0.558], atol=1e-12)

    def test_the_belt_carries_it(self):
        arm = Arm("irb120_on_belt", tool="tool0")
        before = arm.pose()

        result = arm.move_abs_j([1.5, *HOME])  # m, then rad

        np.testing.assert_allclose(arm.pose()[:3] - before[:3], [0, 1.5, 0], atol=1e-9)
        force = result["tau.belt"]
        assert np.abs(force).max() > 10  # N, to speed 19 kg up
        np.testing.assert_allclose(arm.chain.lower[0], 0)
        np.testing.assert_allclose(arm.chain.upper[0], 1.5)

    def test_the_urdf_is_that_of_belt_and_arm(self, tmp_path):
        for robot in ("belt", "irb120", "irb120_on_belt"):
            shutil.copytree(models_root() / robot, tmp_path / robot)
        script = tmp_path / "irb120_on_belt" / "make_urdf.py"
        (script.parent / "irb120_on_belt.urdf").unlink()
        subprocess.run([sys.executable, script], check=True)

        kept = models_root() / "irb120_on_belt" / "irb120_on_belt.urdf"

        assert (script.parent / kept.name).read_bytes() == kept.read_bytes(), "run make_urdf.py"


def test_the_belt_brings_its_rook():
    cell = Workcell("belt_pick")
    belt, arm = cell.arm("belt"), cell.arm("arm")
    before = cell.frame("rook")

    belt.move_abs_j([0.5])

    np.testing.assert_allclose(
        cell.frame("rook").translation() - before.translation(), [0, 0.5, 0], atol=1e-12
    )
    # it stands
    np.testing.assert_allclose(cell.frame("rook").rotation().matrix(), np.eye(3), atol=1e-12)

    arm.move_j([0, 0, 0.1, *DOWN], wobj="rook")
    np.testing.assert_allclose(arm.pose(wobj="rook")[:3], [0, 0, 0.1], atol=1e-9)
