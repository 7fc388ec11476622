"""The wheel as others get it: what its page says, and its types in a user's script."""

import os
import re
import site
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
import yaml

TOP = Path(__file__).resolve().parents[1]
SCRIPT = """
from simrob_drake import Arm, LeggedRobot, Runner, SimulationResult, load_station, simulate

def last(result: SimulationResult, signal: str) -> float:
    return float(result[signal][-1])

station = load_station("irb120_dynamic", {"reference.target_deg": {"joint_2": 45}})
result = simulate(station, duration=2.0)
print(last(result, "q.joint_2"), result.message, result.save("there"))
print(Runner(station).run().message, LeggedRobot("humanoid_dynamic").walk(2).message)
arm = Arm("irb120_dynamic")
moved: SimulationResult = arm.move_j(arm.pose())
"""
WRONG = "simulate(load_station(3), durations=2.0)\n"


def built(folder, **environment):
    """Build the wheel into a folder."""
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(TOP)]
    subprocess.run(
        command, check=True, capture_output=True, timeout=300, env={**os.environ, **environment}
    )
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """An environment with the wheel, and all else from the one that runs this."""
    folder = tmp_path_factory.mktemp("wheel")
    file = built(folder)
    venv.create(folder / "venv")
    (place,) = (folder / "venv").glob("lib/*/site-packages")
    with zipfile.ZipFile(file) as wheel:
        wheel.extractall(place)
    (place / "others.pth").write_text("\n".join(site.getsitepackages()))
    return folder / "venv" / "bin" / "python", place


@pytest.mark.long
def test_its_page_has_no_link_that_leads_nowhere(installed, tmp_path):
    (metadata,) = installed[1].glob("*.dist-info/METADATA")

    without = metadata.read_text()
    assert "Author: the simrob_drake developers" in without

    with zipfile.ZipFile(built(tmp_path, SIMROB_URL="https://example.org/it/")) as wheel:
        (name,) = (name for name in wheel.namelist() if name.endswith("dist-info/METADATA"))
        released = wheel.read(name).decode()
    assert "](https://example.org/it/docs/stations.md)" in released
    for text in (without, released):
        assert "# simrob_drake" in text
        assert re.findall(r"\]\((?!https?:|#)[^)]*\)", text) == []


@pytest.mark.long
def test_a_script_of_a_user_is_checked_strictly(installed, tmp_path):
    python, _ = installed
    script = tmp_path / "script.py"

    def check(text):
        script.write_text(text)
        command = [
            sys.executable,
            "-m",
            "mypy",
            "--strict",
            "--python-executable",
            str(python),
            "script.py",
        ]
        return subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
        )

    assert check(SCRIPT).stdout.startswith("Success")
    wrong = check(SCRIPT + WRONG).stdout
    assert 'Unexpected keyword argument "durations"' in wrong
    assert '"load_station" has incompatible type "int"' in wrong


def test_each_robot_and_piece_has_its_licence_and_its_source():
    notice = (TOP / "NOTICE").read_text()
    files = sorted((TOP / "models").glob("**/robot.yaml")) + sorted(
        (TOP / "models").glob("**/piece.yaml")
    )

    assert len(files) > 40
    for file in files:
        assert "# SPDX-License-Identifier: BSD-3-Clause\n" in file.read_text(), file
        if file.name == "robot.yaml":
            source = " ".join(yaml.safe_load(file.read_text())["source"].split())
            assert source in " ".join(notice.split()), file
