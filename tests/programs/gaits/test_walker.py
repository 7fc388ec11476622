"""Gaits are planned for the robot that is given, not for one of the package with its name."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from simrob_drake import LeggedRobot, load_station
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.files import ROBOT_FILE, models_root
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.legged_gait import planned_gait
from simrob_drake.robots.catalog import load_robot_file
from simrob_drake.robots.gaits_file import GAITS_FILE

LONGER = 0.02  # of the copy's steps [m]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A zjudancer of the user's own: its shanks are 1 cm longer, and so are its steps, by 2 cm."""
    folder = tmp_path / "zjudancer"
    shutil.copytree(models_root() / "zjudancer", folder)
    urdf, gaits = folder / "zjudancer.urdf", folder / GAITS_FILE
    own = Walker.of("zjudancer")
    ankle = own.model.axes["left_ankle_pitch"].joint
    text = urdf.read_text()
    at = text.index('xyz="', text.index(f'name="{ankle}"'))
    end = text.index('"', at + 5)
    x, y, z = text[at + 5 : end].split()
    text = text.replace(text[at:end], f'xyz="{x} {y} {float(z) - 0.01}')
    urdf.write_text(text)
    length = own.gaits.section("walks")["walk"]["step_length"]
    gaits.write_text(
        gaits.read_text().replace(
            f"step_length: {length:.2f}", f"step_length: {length + LONGER:.2f}", 1
        )
    )
    return folder / ROBOT_FILE


def way(motion: JointMotion) -> float:
    return float(np.ptp(motion.root[:, :2, 3], axis=0).max())


def test_a_copy_of_a_robot_walks_with_its_own_legs_and_figures(copy: Path) -> None:
    theirs, own = walk(load_robot_file(copy), 6), walk("zjudancer", 6)

    assert way(theirs) == pytest.approx(
        way(own)
        * (1 + LONGER / Walker.of("zjudancer").gaits.section("walks")["walk"]["step_length"])
    )

    knee = Walker.of("zjudancer").model.axis_index("left_knee")
    bend = theirs.positions[0, knee] - own.positions[0, knee]
    assert bend > np.deg2rad(2)  # a longer leg under a trunk as high as before
    assert theirs.station().robots["robot"].model == str(copy)


def test_a_station_with_a_copy_walks_as_the_copy(copy: Path) -> None:
    robot = LeggedRobot(load_station("zjudancer_dynamic", {"robot.model": str(copy)}))
    planned = planned_gait(robot, None, {}, steps=6)
    np.testing.assert_array_equal(planned.positions, walk(load_robot_file(copy), 6).positions)


def test_a_copy_without_gaits_has_none(copy: Path) -> None:
    (copy.parent / GAITS_FILE).unlink()
    with pytest.raises(
        InvalidParameter, match=r"robot zjudancer is a robot without gaits.*gaits\.yaml"
    ):
        walk(load_robot_file(copy), 6)
