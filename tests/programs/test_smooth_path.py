"""Paths that an optimisation makes faster, also those of arms whose axes turn against their joints."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from simrob_drake import Arm, load_station
from simrob_drake.base.files import models_root
from simrob_drake.base.frames import Vector
from simrob_drake.programs import smooth_path
from simrob_drake.programs.free_path import Search
from simrob_drake.programs.smooth_path import RateLimits, find_faster_path


def path_of_elbow(folder: Path, *, sign: int) -> tuple[Vector, Vector, Vector]:
    """Make a path faster that turns joint 3 to -100 deg; its axis turns with it or against it.

    Returns:
        the postures along the path, shape (k, n) [rad], and the lower and upper limits of the axes, shape (n,).
    """
    copied = shutil.copytree(models_root() / "irb120", folder / f"irb120_{sign}")
    file = copied / "robot.yaml"
    content = yaml.safe_load(file.read_text())
    content["axes"] = {
        name: {"joint": name, "sign": sign if name == "joint_3" else 1} for name in content["axes"]
    }
    file.write_text(yaml.safe_dump(content))
    overrides = {"robot.model": str(file), "robot.initial_deg": {"joint_5": 90}}
    arm = Arm(load_station("irb120_kinematic", overrides))
    model = arm.cell.robot(arm.name).model
    lower, upper = model.axis_limits
    search = Search(
        space=arm.cell.free_space([arm.name]),
        lower=lower,
        upper=upper,
        scale=np.ones(6),
        seed=0,
        seconds=5.0,
    )
    start = np.array(arm.position)
    middle = start + np.array([0.6, 0.3, 0.0, 0.0, 0.0, 0.0])
    end = start.copy()
    end[1] = -0.5
    end[2] = np.deg2rad(-sign * 100.0)
    corners = np.vstack([np.linspace(start, middle, 20), np.linspace(middle, end, 20)[1:]])

    path = find_faster_path(search, corners, 3, RateLimits(model.speed_limits, model.accelerations))

    assert path is not None
    assert path.postures[0] == pytest.approx(start, abs=1e-6)
    assert path.postures[-1] == pytest.approx(end, abs=1e-6)
    return path.postures, np.array(lower), np.array(upper)


def test_the_path_of_an_axis_that_turns_against_its_joint_is_the_mirror_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Joint 3 turns from -110 to 70 deg, so that the axis against it turns from -70 to 110 deg."""
    monkeypatch.setattr(smooth_path, "_ITERATIONS", 10)

    along, lower, upper = path_of_elbow(tmp_path, sign=1)
    against, lower_against, upper_against = path_of_elbow(tmp_path, sign=-1)

    mirror = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    assert lower_against[2] == -upper[2]
    assert (against >= lower_against - 1e-6).all()
    assert (against <= upper_against + 1e-6).all()
    assert (along >= lower - 1e-6).all()
    assert against * mirror == pytest.approx(along, abs=1e-6)
