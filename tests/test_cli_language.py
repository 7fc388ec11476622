"""The command line in Spanish: tables, verdict, remedies, errors, and the list of what comes with the package."""

import re
import shutil

import pytest

from simrob_drake.base.files import models_root, piece_files, robot_files, station_files
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.cli.language import LANGUAGE_VARIABLE
from tests.widths import too_wide

pytestmark = pytest.mark.usefixtures("no_plots")
WEAK = [
    "run",
    "irb120_dynamic",
    "--duration",
    "0.5",
    "--set",
    "servo.torque_limit=10",
    "--no-recording",
]


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(LANGUAGE_VARIABLE, raising=False)


def test_a_run_is_reported_in_spanish(capsys):
    assert run_command([*WEAK, "--language", "es"]) == ExitCode.DONE
    shown = capsys.readouterr()
    assert shown.out.startswith("eje ")
    assert "aviso: irb120_dynamic: llegó al final a los 0,5 s." in shown.out
    assert "criterio" in shown.out
    assert re.search(r"× tiempo real, \d+ pasos", shown.out)
    assert "resultado runs/" in shown.out
    assert "aviso   joint_2" in shown.err
    assert "warning" not in shown.out + shown.err


def test_the_language_of_one_command_is_not_that_of_the_next(capsys):
    run_command(["list", "--language", "es"])

    assert capsys.readouterr().out.startswith("estación")

    run_command(["list"])
    assert capsys.readouterr().out.startswith("station")


def test_the_environment_may_name_the_language(capsys, monkeypatch):
    monkeypatch.setenv(LANGUAGE_VARIABLE, "es")
    run_command(["list"])
    assert "cinta que trae una torre" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("servo.Kp=3", "simrob: --set servo.Kp: clave desconocida; ¿quería decir 'kp'?"),
        ("robot.initial_deg={joint_9: 1}", "joint_9"),
    ],
)
def test_errors_are_in_the_language(capsys, setting, text):
    assert (
        run_command(["run", "irb120_dynamic", "--language", "es", "--set", setting])
        == ExitCode.BAD_INPUT
    )
    shown = capsys.readouterr().err
    assert text in shown
    assert "did you mean" not in shown


def test_a_command_without_the_option_follows_the_environment_alone(capsys, monkeypatch):
    wrong = ["check", "irb120_dynamic", "--set", "servo.Kp=3"]
    run_command(["list", "--language", "es"])

    run_command(wrong)

    assert "did you mean 'kp'" in capsys.readouterr().err

    monkeypatch.setenv(LANGUAGE_VARIABLE, "es")
    run_command(wrong)

    assert "¿quería decir 'kp'?" in capsys.readouterr().err


def test_an_unknown_language_is_refused(capsys):
    assert run_command(["list", "--language", "fr"]) == ExitCode.BAD_INPUT
    assert "'fr'" in capsys.readouterr().err


def test_all_that_comes_with_the_package_is_described_in_spanish():
    known = read_yaml(
        station_files()["irb120_dynamic"].parents[1]
        / "simrob_drake/base/languages/es/descriptions.yaml"
    )
    kinds = {"station": station_files(), "robot": robot_files(), "piece": piece_files()}

    needed = {f"descriptions.{kind}_{name}" for kind, files in kinds.items() for name in files}
    assert known.keys() == needed


URDF = str(models_root() / "irb120" / "irb120.urdf")
FEET = str(models_root() / "yobotics" / "yobotics.urdf")
COMMANDS = {
    "check of a station": ["check", "irb120_dynamic"],
    "check of a station with warnings": [
        "check",
        "irb120_dynamic",
        "--set",
        "servo.torque_limit=10",
    ],
    "check of a station with many axes": ["check", "humanoid_balance"],
    "check of a robot": ["check", "puma560"],
    "check of a file": ["check", URDF],
    "import": ["import", URDF, "--out", "made"],
    "station": ["station", URDF],
    "acts": ["act", "roid1_dynamic"],
    "act without a station": ["act"],
    "walk without a station": ["walk"],
    "a legged robot with feet of its own": ["legged", FEET, "--out", "made"],
    "a missing argument": ["plot"],
    "a wrong value": ["run", "irb120_dynamic", "--duration", "long"],
    "an unknown option": ["run", "irb120_dynamic", "--durationn", "1"],
    "an unknown command": ["rum"],
    "too many arguments": ["check", "irb120_dynamic", "irb120_kinematic"],
    "--converge": ["run", "double_pendulum", "--duration", "0.1", "--no-recording", "--converge"],
    "linearize": ["linearize", "double_pendulum", "--out", "linear"],
    "a station that is wrong": ["check", "double_pendulum.yaml", "--set", "duration=-1"],
}
ENGLISH = re.compile(
    r"\b(the|of|and|with|is|are|at|not|must|should|to|limit|holding|reference|joint|axis|unit)\b"
)


def test_positions_of_pieces_have_a_decimal_comma(capsys, monkeypatch):
    monkeypatch.setenv(LANGUAGE_VARIABLE, "es")

    assert run_command(["check", "belt_pick"]) == ExitCode.DONE

    shown = " ".join(capsys.readouterr().out.split())
    assert "con su origen en -0,05 0,48 0,0626 m" in shown


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_an_output_has_no_english_words(command, capsys, monkeypatch, tmp_path):
    shutil.copy(station_files()["double_pendulum"], tmp_path)
    monkeypatch.setenv(LANGUAGE_VARIABLE, "es")

    run_command(command)

    shown = capsys.readouterr()
    text = shown.out + shown.err
    assert text
    # Names of axes and files are the same in each language, and so are commands.
    assert ENGLISH.findall(re.sub(r"\S*/\S+|\w*[_.]\w+|simrob \w+", "", text)) == []
    assert too_wide(shown.out) == []


def test_a_legged_robot_is_reported_in_spanish(capsys, monkeypatch):
    monkeypatch.setenv(LANGUAGE_VARIABLE, "es")
    assert run_command(["act", "humanoid_fixed", "wave", "--no-recording"]) == ExitCode.DONE
    assert "para varios movimientos, escríbalos en un program.yaml" in capsys.readouterr().out
