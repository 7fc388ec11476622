"""The package in `examples/extension`, as somebody else would build, install, use and uninstall it."""

import os
import shutil
import site
import subprocess
import sys
import venv
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]
EXAMPLE = TOP / "examples" / "extension"


def run(command, folder, **environment):
    """Run a command in a folder and return its exit code, output and errors."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    variables = {**kept, **environment}
    return subprocess.run(
        command, cwd=folder, env=variables, capture_output=True, text=True, timeout=600, check=False
    )


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """An environment with this checkout, all its dependencies, and the wheel of the example."""
    folder = tmp_path_factory.mktemp("extension")
    shutil.copytree(EXAMPLE, folder / "source")
    build = [
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--no-isolation",
        "--outdir",
        str(folder),
        str(folder / "source"),
    ]
    built = run(build, folder)
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "venv", with_pip=True)
    (packages,) = (folder / "venv").glob("lib/*/site-packages")
    (packages / "others.pth").write_text("\n".join([str(TOP), *site.getsitepackages()]))
    python = folder / "venv" / "bin" / "python"
    installed = run([python, "-m", "pip", "install", "--quiet", "--no-deps", str(wheel)], folder)
    assert installed.returncode == 0, installed.stderr
    return folder, python


@pytest.mark.long
def test_the_example_works_when_installed_and_is_gone_when_uninstalled(environment):
    folder, python = environment
    simrob = [python, "-m", "simrob_drake.cli"]

    listed = run([*simrob, "extensions", "--check"], folder)
    assert listed.returncode == 0, listed.stdout + listed.stderr
    assert "sensors: joint_power" in listed.stdout
    assert "power" in run([*simrob, "--help"], folder).stdout
    assert "nodding_arm" in run([*simrob, "list"], folder).stdout
    assert '"joint_power"' in run([*simrob, "schema"], folder).stdout
    assert run([*simrob, "check", "nodding_arm"], folder).returncode == 0

    done = run([*simrob, "run", "nodding_arm", "--out", "result"], folder)
    assert done.returncode == 0, done.stderr
    assert (
        "joint_power.joint_power.joint_5"
        in (folder / "result" / "signals.csv").read_text().partition("\n")[0]
    )
    assert (folder / "result" / "plots" / "sensors.png").is_file()
    assert (folder / "result" / "plots" / "joint_power.png").is_file()
    assert "standstill" in (folder / "result" / "summary.json").read_text()

    own_tests = [
        python,
        "-m",
        "pytest",
        "-q",
        "-c",
        "/dev/null",
        "--rootdir",
        ".",
        str(folder / "source" / "tests"),
    ]
    tested = run(own_tests, folder)
    assert tested.returncode == 0, tested.stdout

    removed = run(
        [python, "-m", "pip", "uninstall", "--quiet", "--yes", "simrob-playground"], folder
    )
    assert removed.returncode == 0, removed.stderr
    assert "simrob-playground" not in run([*simrob, "extensions"], folder).stdout
    station = shutil.copy(
        EXAMPLE / "simrob_playground" / "stations" / "nodding_arm.yaml", folder / "arm.yaml"
    )
    refused = run([*simrob, "run", str(station)], folder)
    assert refused.returncode == 2
    assert (
        "the station needs the package simrob-playground, which is not installed" in refused.stderr
    )
