"""Names of files: what a file is, and in what form one is written, is judged alike by all commands and functions."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidParameter, OutputError
from simrob_drake.base.files import models_root
from simrob_drake.base.folders import check_ending, check_new_file
from simrob_drake.base.sections import is_file_name
from simrob_drake.cli.app import run_command
from simrob_drake.results.block_diagram.picture import save_block_picture
from simrob_drake.results.plots.own import save_figure
from simrob_drake.results.result import SimulationResult

TOO_LONG = "x" * 300  # file systems take 255 bytes
STATION = "{name: one, robot: {model: irb120}}\n"
PROGRAM = "moves:\n- {move_abs_j: [[0, 0, 0, 0, 0, 0]]}\n"


@pytest.mark.parametrize("ending", [".yaml", ".YAML", ".yml", ".Yml"])
def test_stations_in_files_with_capital_letters(ending: str, tmp_path: Path):
    file = tmp_path / f"station{ending}"
    file.write_text(STATION)

    assert load_station(file).name == "one"


def test_stations_of_programs_and_robots_in_files_with_capital_letters(tmp_path: Path):
    """A program names its station, and a station its robot: names with capital letters are paths there, too."""
    from simrob_drake.stations.file_paths import station_with_absolute_path

    robot = tmp_path / "ARM.YAML"
    robot.write_text((models_root() / "tx40" / "robot.yaml").read_text())
    station = tmp_path / "STATION.YAML"
    station.write_text(STATION.replace("irb120", robot.name))
    program = tmp_path / "PROGRAM.YAML"

    assert station_with_absolute_path(station.name, program) == str(station)
    assert [entry.model for entry in load_station(station).robots.values()] == [str(robot)]


def test_each_command_recognises_a_program_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """`simrob run` and `simrob teach` share one test; a name that no file can have is no program for both."""
    from simrob_drake.extensions.pendant.subjects import program_of
    from simrob_drake.programs.program_files import is_program_file

    program = tmp_path / "PROGRAM.YML"
    program.write_text("station: irb120_kinematic\n" + PROGRAM)
    station = tmp_path / "station.yaml"
    station.write_text(STATION)

    assert is_program_file(program)
    assert program_of(program) == (program, "irb120_kinematic")
    for other in (
        station,
        tmp_path,
        f"{TOO_LONG}.yaml",
        "irb120_kinematic",
        tmp_path / "missing.yaml",
    ):
        assert not is_program_file(other)
        assert program_of(other) is None


@pytest.mark.parametrize("command", ["run", "check"])
def test_commands_refuse_a_name_that_no_file_can_have(
    command: str, capsys: pytest.CaptureFixture[str]
):
    code = run_command([command, f"{TOO_LONG}.yaml"])

    assert code != 0
    assert "Traceback" not in capsys.readouterr().err


def test_pictures_and_films_in_files_with_capital_letters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The ending says the form whatever its letters: the functions for pictures, plots and films agree."""
    picture = save_block_picture(load_station("bouncing_ball"), tmp_path / "BALL.SVG")
    figure = Figure()
    plot = save_figure(figure, tmp_path / "PLOT.PNG")
    films: list[str] = []
    for name in ("save_film_strip", "save_video"):
        monkeypatch.setattr(
            f"simrob_drake.results.animation.pictures.{name}",
            lambda *_, name=name, **__: films.append(name),
        )
    run = SimpleNamespace()
    for file in ("FILM.PNG", "FILM.Mp4"):
        SimulationResult.film(run, tmp_path / file)  # type: ignore[arg-type]

    assert picture.read_text().startswith("<svg")
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert films == ["save_film_strip", "save_video"]


def test_endings():
    assert check_ending(Path("A.XML"), [".xml"], "--mjcf") == ".xml"
    with pytest.raises(
        InvalidParameter,
        match=r"--film is a/walk\.gif; it must be a file that ends in \.png or \.mp4",
    ):
        check_ending(Path("a/walk.gif"), [".png", ".mp4"], "--film")
    with pytest.raises(InvalidParameter, match="--mjcf is xml"):
        check_ending(Path("xml"), [".xml"], "--mjcf")


def test_new_files(tmp_path: Path):
    file = tmp_path / "there"
    check_new_file(file, force=False)
    file.write_text("mine")

    with pytest.raises(
        OutputError, match="there exists already; choose another file or replace it with --force"
    ):
        check_new_file(file, force=False)
    check_new_file(file, force=True)
    check_new_file(tmp_path / TOO_LONG, force=False)  # is refused when it is written


def test_exports_to_names_that_no_file_can_have(tmp_path: Path):
    """The reason is that of the file system, in one line; before, ``Path.exists`` raised an OSError."""
    from simrob_drake.extensions.mujoco.export import save_mjcf

    with pytest.raises(OutputError, match="cannot be written: File name too long"):
        save_mjcf(load_station("bouncing_ball"), tmp_path / f"{TOO_LONG}.xml")


@pytest.mark.parametrize(
    ("name", "is_valid"),
    [
        ("x" * 200, True),
        ("x" * 201, False),
        ("á" * 100, True),  # two bytes each
        ("á" * 100 + "x", False),
        ("", False),
        ("..", False),
        ("a/b", False),
    ],
)
def test_a_name_has_at_most_200_bytes(name: str, is_valid: bool):
    assert is_file_name(name) is is_valid
