"""Quaternions of RAPID data whose norm is not 1: reported, normalised, or taken for a loss."""

from pathlib import Path

import numpy as np
import pytest

from simrob_drake.cli.app import run_command
from simrob_drake.extensions.rapid.importing import Imported, import_rapid
from simrob_drake.kinematics.chain import Chain
from simrob_drake.programs.arm import Workcell
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.load import bare_station

FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"
STATION = bare_station("irb120")
HOME = f"MoveAbsJ [[0,0,0,0,90,0],{FREE}],v500,fine,tool0;"
GO = "MoveJ pA,v500,fine,tool0;"
DOWN = "[0,0,1,0]"  # the tool points down


def target(quaternion: str) -> str:
    return f"[[374,0,500],{quaternion},[0,0,0,0],{FREE}]"


def tool(quaternion: str = "[1,0,0,0]", load: str = "[1,0,0,0]") -> str:
    return f"[TRUE,[[0,0,100],{quaternion}],[0.1,[0,0,50],{load},0,0,0]]"


def work_object(user: str = "[1,0,0,0]", own: str = "[1,0,0,0]") -> str:
    return f'[FALSE,TRUE,"",[[0,0,0],{user}],[[0,0,0],{own}]]'


def module(folder: Path, data: str, moves: str) -> Path:
    file = folder / "Test.mod"
    file.write_text(f"MODULE Test\n{data}\nPROC main()\n{HOME}\n{moves}\nENDPROC\nENDMODULE\n")
    return file


def imported(folder: Path, data: str, moves: str = GO) -> Imported:
    return import_rapid(module(folder, data, moves), STATION)


def turn_at_end(program: Imported) -> np.ndarray:
    """Return the rotation of tool0 to which a program leads, (3, 3)."""
    cell = Workcell(STATION)
    cell.rehearse(program.program)
    chain = Chain.of_robot(load_robot("irb120"))
    return np.asarray(chain.forward(cell.reference("robot"))[0][:3, :3])


# The two quaternions, and others of the same fault, with their norms.
WRONG = {
    "[0,0,0.959,0]": "0.959",
    "[0,0,2,0.5]": "2.06155",
    "[0,0,-1.0011,0]": "1.0011",
    "[0.7,0,0.7,0]": "0.989949",
}


@pytest.mark.parametrize(("quaternion", "norm"), WRONG.items())
def test_a_norm_far_from_1_is_a_loss_with_its_line(
    tmp_path: Path, quaternion: str, norm: str
) -> None:
    # A turn that the arm can reach is not the point here: the target may be left out, too.
    program = imported(tmp_path, f"CONST robtarget pA:={target(quaternion)};")
    (remark, *_) = program.lost
    assert remark.line == 5
    assert (
        f"of pA.rot has a norm of {norm}; it must be 1 within 0.001; it is normalised here"
        in remark.text
    )


@pytest.mark.parametrize(
    ("data", "moves", "name"),
    [
        (
            f"PERS tooldata t1:={tool('[0.9,0,0,0]')};",
            f"MoveJ {target(DOWN)},v500,fine,t1;",
            "t1.tframe.rot",
        ),
        (
            f"PERS tooldata t1:={tool(load='[0,0,0,0]')};",
            f"MoveJ {target(DOWN)},v500,fine,t1;",
            "t1.tload.aom",
        ),
        (
            f"PERS wobjdata w1:={work_object(user='[1.1,0,0,0]')};",
            rf"MoveJ {target(DOWN)},v500,fine,tool0\WObj:=w1;",
            "w1.uframe.rot",
        ),
        (
            f"PERS wobjdata w1:={work_object(own='[1.1,0,0,0]')};",
            rf"MoveJ {target(DOWN)},v500,fine,tool0\WObj:=w1;",
            "w1.oframe.rot",
        ),
        ("PERS loaddata l1:=[1,[0,0,1],[1,1,0,0],0,0,0];", "GripLoad l1;", "l1.aom"),
        (f"VAR robtarget p:={target(DOWN)};", "p.rot.q3:=0.5; MoveJ p,v500,fine,tool0;", "p.rot"),
        (
            f"VAR robtarget p:={target(DOWN)};",
            "p.rot:=[0,0,0.5,0]; MoveJ Offs(p,0,0,-10),v500,fine,tool0;",
            "p.rot",
        ),
        ("VAR pose p:=[[0,0,0],[0.9,0,0,0]]; VAR pose o;", "o:=PoseInv(p);", "p.rot"),
        ("", f"MoveJ {target('[0,0,0.9,0]')},v500,fine,tool0;", "rot"),
    ],
)
def test_every_kind_of_data_is_looked_at_where_it_is_used(
    tmp_path: Path, data: str, moves: str, name: str
) -> None:
    program = imported(tmp_path, data, moves)
    assert [remark for remark in program.lost if f"of {name} has a norm of" in remark.text], (
        program.remarks
    )


def test_a_small_deviation_is_normalised_and_noted(tmp_path: Path) -> None:
    program = imported(tmp_path, f"CONST robtarget pA:={target('[0,0,1.0005,0]')};")
    assert not program.lost
    (note,) = [remark.text for remark in program.remarks if "norm" in remark.text]
    assert "has a norm of 1.0005" in note
    np.testing.assert_allclose(turn_at_end(program), np.diag([-1.0, 1.0, -1.0]), atol=1e-9)


@pytest.mark.parametrize(
    "quaternion", [DOWN, "[0.0001,0,1,0]", "[0.7071,0,0.7071,0]", "[-0.5,0.5,-0.5,0.5]"]
)
def test_decimals_are_no_deviation(tmp_path: Path, quaternion: str) -> None:
    program = imported(tmp_path, f"CONST robtarget pA:={target(quaternion)};")
    assert not [remark for remark in program.remarks if "norm" in remark.text]


def test_norient_normalises_without_a_word(tmp_path: Path) -> None:
    """It is RAPID's own function for quaternions that were computed."""
    data = f"VAR robtarget p:={target(DOWN)};"
    program = imported(tmp_path, data, "p.rot:=NOrient([0,0,0.5,0]); MoveJ p,v500,fine,tool0;")
    assert not program.lost
    np.testing.assert_allclose(turn_at_end(program), np.diag([-1.0, 1.0, -1.0]), atol=1e-9)


@pytest.mark.long
def test_the_command_line_rejects_it_unless_losses_are_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = module(tmp_path, f"CONST robtarget pA:={target('[0,0,0.959,0]')};", GO)
    command = ["run", str(file), "--robot", "irb120", "--no-recording", "--out", "result"]
    assert run_command(command) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "Test.mod: line 5" in said
    assert "norm of 0.959" in said
    assert "--allow-losses" in said
    assert not (tmp_path / "result").exists()
    assert run_command([*command, "--allow-losses"]) == 0
