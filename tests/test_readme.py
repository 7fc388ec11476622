"""What the README says is so: its script, its commands, its links."""

import re
import tomllib
from pathlib import Path

import pytest

from simrob_drake import load_station, station_names
from simrob_drake.cli import run_command
from simrob_drake.folders import CACHE_VARIABLE
from simrob_drake.results.robot_view import RobotView

ROOT = Path(__file__).parent.parent
PAGES = sorted(ROOT.glob("README*.md"))
README = (ROOT / "README.md").read_text()


def fenced(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_script_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(fenced("python")[0], "README.md", "exec"), {})
    assert "joint 2 ends at" in capsys.readouterr().out
    assert len(list((tmp_path / "runs").iterdir())) == 1


def test_the_program_runs(capsys):
    script = next(script for script in fenced("python") if "Arm(" in script)
    exec(compile(script, "README.md", "exec"), {})
    assert "ran to its end" in capsys.readouterr().out


def test_the_legged_program_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    script = next(script for script in fenced("python") if "LeggedRobot(" in script)
    exec(compile(script, "README.md", "exec"), {})
    shown = capsys.readouterr().out
    assert "ran to its end at 5 s" in shown
    assert 0.05 < float(shown.splitlines()[-1].split()[0]) < 0.3
    assert [file.name for file in tmp_path.iterdir()] == ["step.yaml"]


COMMANDS = [line.split("#")[0].split() for block in fenced("sh") for line in block.splitlines() if "simrob " in line]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_command_does_its_work(command, tmp_path, monkeypatch, one_joint_urdf):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(RobotView, "run", lambda view: None)  # else it would wait for its user
    (tmp_path / "downloads").mkdir()
    (tmp_path / "downloads" / "arm.urdf").write_text(
        re.sub(r"<transmission.*</transmission>", "", one_joint_urdf, flags=re.DOTALL)
    )
    duration = ["--duration", "0.2"] if command[1] == "run" else []
    assert run_command([*command[1:], *duration]) == 0


def test_the_station_of_the_readme_is_one(tmp_path):
    (tmp_path / "own.yaml").write_text(fenced("yaml")[0])
    assert load_station(tmp_path / "own.yaml").monitors.keys() == {"joint_limit", "settled"}


def test_the_table_of_stations_names_them_all():
    assert set(re.findall(r"\[`(\w+)`\]\(diagrams/", README)) == set(station_names())


def links(page):
    return re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in links(page):
        assert (ROOT / target).exists(), target


def test_the_source_archive_holds_what_the_pages_link_to_and_what_tests_need():
    archive = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["sdist"][
        "include"
    ]
    needed = {target.split("/")[0] for page in PAGES for target in links(page)} | {page.name for page in PAGES}
    assert needed | {".ci", "Makefile", "tests"} <= {*archive, "README.md", "LICENSE"}
    assert all((ROOT / place).exists() for place in archive)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_make_targets_exist(page):
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"(?:^|`)make (\w+)", page.read_text(), flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
