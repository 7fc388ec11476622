"""Modules that are not given, but lie near a program and declare what it names."""

import numpy as np
import pytest

from simrob_drake.extensions.rapid.importing import import_rapid
from simrob_drake.extensions.rapid.syntax import RapidError
from simrob_drake.programs.arm import Workcell
from simrob_drake.stations.load import bare_station

FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"
STATION = bare_station("irb120")
MAIN = f"""MODULE Main
PROC main()
  MoveAbsJ [[0,0,0,0,90,0],{FREE}],v500,fine,tPen;
  Down;
ENDPROC
ENDMODULE"""
CALIBRATION = """MODULE CalibData
PERS tooldata tPen:=[TRUE,[[0,0,100],[1,0,0,0]],[0.1,[0,0,50],[1,0,0,0],0,0,0]];
ENDMODULE"""
ROUTINES = f"""MODULE Routines(SYSMODULE)
PROC Down()
  MoveAbsJ [[10,0,0,0,90,0],{FREE}],v500,fine,tool0;
ENDPROC
ENDMODULE"""
OTHER = f"""MODULE Other
PERS tooldata tPen:=[TRUE,[[0,0,999],[1,0,0,0]],[0.1,[0,0,50],[1,0,0,0],0,0,0]];
PROC main()
  MoveAbsJ [[20,0,0,0,90,0],{FREE}],v500,fine,tPen;
ENDPROC
ENDMODULE"""


@pytest.fixture
def task(tmp_path):
    """Return a folder as a controller keeps a task: a program, its tools, routines of the system, another program."""
    for folder, name, text in (
        ("PROGMOD", "Main.mod", MAIN),
        ("PROGMOD", "CalibData.mod", CALIBRATION),
        ("PROGMOD", "Broken.mod", "MODULE Broken PROC"),
        ("PROGMOD", "AOther.mod", OTHER),
        ("SYSMOD", "user.sys", ROUTINES),
    ):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / name).write_text(text)
    return tmp_path


def test_they_are_read_too_and_named(task):
    done = import_rapid(task / "PROGMOD" / "Main.mod", STATION)
    assert not done.lost
    cell = Workcell(STATION)
    cell.rehearse(done.program)
    np.testing.assert_allclose(cell.reference("robot")[0], np.deg2rad(10), atol=1e-9)
    assert [str(remark) for remark in done.remarks[:2]] == [
        "Main.mod: line 1: CalibData.mod near it is read, too, for tpen",
        "Main.mod: line 1: user.sys near it is read, too, for down",
    ]
    tools = [move for move in done.program.moves if move.key == "tool"]
    assert "100" in str(tools) or "0.1" in str(tools)  # not 999 mm, which another program has


def test_a_program_that_has_all_it_names_reads_no_other(task):
    text = MAIN.replace("tPen", "tool0").replace("  Down;\n", "")
    (task / "PROGMOD" / "Main.mod").write_text(text)
    assert [
        remark
        for remark in import_rapid(task / "PROGMOD" / "Main.mod", STATION).remarks
        if "near" in str(remark)
    ] == []


def test_a_file_called_as_a_folder_and_what_is_nested_deeply_are_no_trouble(task):
    nested = MAIN.replace("PROC main()", "PROC main()\n reg1:=" + "-" * 5000 + "1;")
    (task / "PROGMOD" / "Main.mod").write_text(nested)
    (task / "SYSMOD" / "user.sys").rename(task / "PROGMOD" / "user.sys")
    (task / "SYSMOD").rmdir()
    (task / "SYSMOD").write_text("no folder")
    with pytest.raises(RapidError, match="is nested too deeply"):
        import_rapid(task / "PROGMOD" / "Main.mod", STATION)
