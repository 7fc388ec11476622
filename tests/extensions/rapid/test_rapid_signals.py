"""Signals of RAPID programs: outputs that take pieces, inputs over time, and sensors of the station."""

import re

import pytest

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.extensions.rapid.importing import Imported, import_rapid
from simrob_drake.extensions.rapid.signals import Signals
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.stations.load import bare_station

STATION = bare_station(
    "irb120",
    {
        "robot.initial_deg": 0,  # at home, the arm would begin in the piece
        "pieces.part": {"model": "pencil", "parent": "world", "pose": [0.3, 0, 0.5, 0, 0, 0]},
    },
)
TABLE = """
signals:
  doGrip:
    does:
      1: [{attach: {piece: part, pose: [0, 0, 0, 0, 0, 0]}}]
      0: [{release: {piece: part, fixed: true}}]
  diPart: {is: {0: 0, 2.5: 1, 4: 0}}
  diReady: {is: 1}
"""


@pytest.fixture
def done(tmp_path):
    """Return what imports a program of a main procedure, with a table of signals."""

    def imported(main: str, table: str = TABLE, station: object = STATION) -> Imported:
        (tmp_path / "Test.mod").write_text(
            f"MODULE Test\nPROC main()\n{main}\nENDPROC\nENDMODULE\n"
        )
        (tmp_path / "io.yaml").write_text(table)
        return import_rapid(tmp_path / "Test.mod", station, signals=tmp_path / "io.yaml")

    return imported


def test_a_signal_of_which_nothing_is_known_is_named_once(done):
    asked = [f"IF TestDI({name}) WaitTime 1;" for name in ("diA", "DIA", "diB")]
    moved = done("\n".join(["WaitTime 1;", *asked, "Set doC;", "Reset doC;"]))
    named = [
        (remark.line, remark.text.partition(",")[0].partition(":")[0]) for remark in moved.remarks
    ]
    unknown = "nothing is known of the"
    assert (
        done("WaitTime 1;\nIF diQ=1 WaitTime 1;")
        .lost[0]
        .text.endswith("name it in a table, --io; left out")
    )
    assert named == [
        (4, f"{unknown} input diA"),
        (6, f"{unknown} input diB"),
        (7, f"{unknown} output doC"),
    ]


def keys(imported: Imported) -> list[str]:
    return [move.key for move in imported.program.moves]


@pytest.mark.parametrize(
    ("main", "expected"),
    [
        ("SetDO doGrip,1; WaitTime 1; SetDO doGrip,0;", ["attach", "wait", "release"]),
        ("Set doGrip; WaitTime 1; Reset doGrip;", ["attach", "wait", "release"]),
        ("PulseDO doGrip; WaitTime 1;", ["attach", "release", "wait"]),
        ("InvertDO doGrip; WaitTime 1; InvertDO doGrip;", ["attach", "wait", "release"]),
        ("IF TestDI(diReady) Set doGrip; WaitTime 1;", ["attach", "wait"]),
        ("IF diPart=0 AND DOutput(doGrip)=0 Set doGrip; WaitTime 1;", ["attach", "wait"]),
    ],
)
def test_outputs_do_what_the_table_says(done, main, expected):
    assert keys(done(main)) == expected


@pytest.mark.parametrize(
    ("main", "time"),
    [
        ("WaitDI diPart,1;", 2.5),
        ("WaitTime 3; WaitDI diPart,0;", 4.0),
        ("WaitUntil diPart=1 AND diReady=1;", 2.5),
        ("WaitDI diPart,1\\MaxTime:=1;", 1.0),
    ],
)
def test_inputs_are_waited_for(done, main, time):
    waited = done(main)
    assert waited.time == pytest.approx(time, abs=1e-5)
    assert all(isinstance(move, WaitMove) for move in waited.program.moves)


def test_an_operator_answers_with_an_input_called_as_the_data(done):
    asked = 'TPReadFK reg1,"Part?","A","B","","","";\nTPReadNum reg2,"How many?";\nWaitTime reg1;'
    answered = done(asked, "signals: {reg1: {is: 2}}")
    assert answered.time == pytest.approx(2.0, abs=1e-5)
    assert [str(remark) for remark in answered.lost] == [
        "Test.mod: line 4: nothing is known of the input reg2, it is taken as 0: name it in a table, --io"
    ]


def test_capitals_do_not_tell_signals_apart(done):
    """The table names diPart and doGrip; the program writes them otherwise."""
    moved = done("WaitDI DIPART,1;\nSet DOGRIP;")
    assert not moved.remarks
    assert moved.time == pytest.approx(2.5, abs=1e-5)
    assert len(moved.program.moves) == 2


def test_what_never_comes_or_is_not_known_is_told(done):
    never = done("WaitTime 1; WaitDI diReady,0;\nWaitDI diOther,1;\nSetDO doOther,1;")
    assert [str(remark) for remark in never.remarks] == [
        "Test.mod: line 3: WaitDI waits for what never comes: it is left out; name it in a table, --io",
        "Test.mod: line 4: nothing is known of the input diOther, it is taken as 0: name it in a table, --io",
        "Test.mod: line 4: WaitDI waits for what never comes: it is left out; name it in a table, --io",
        "Test.mod: line 5: nothing is known of the output doOther: name it in a table, --io",
    ]
    assert [remark.lost for remark in never.remarks] == [True, True, True, False]


@pytest.mark.long
def test_an_input_can_watch_a_sensor_of_the_station(done):
    """The tool sinks from 0.5 m until its flange is less than 0.3 m above the floor."""
    target = "[[9E9,9E9,9E9,9E9,9E9,9E9]]"[1:-1]
    main = f"""
    MoveAbsJ [[0,0,0,0,90,0],{target}],v500,fine,tool0;
    FOR i FROM 0 TO 9 DO
        IF diNear=1 GOTO done;
        MoveL Offs(CRobT(\\Tool:=tool0),0,0,-30),v100,fine,tool0;
    ENDFOR
    done:
    """
    sensor = {"kind": "distance", "body": "link_6", "other": "floor"}
    station = bare_station("irb120", {"sensors.height": sensor, "floor": {}})
    table = "signals: {diNear: {sensor: distance.height, below: 0.3}}"
    moved = done(main, table, station)
    result = Workcell(station).perform(moved.program)
    assert 0.27 < result.values[-1, result.names.index("distance.height")] < 0.3


def test_collisions_are_looked_at_unless_told(tmp_path):
    target = "[[0,0,0,0,90,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    moves = f"MoveAbsJ {target},v500,fine,tool0;\nMoveL Offs(CRobT(\\Tool:=tool0),0,0,-60),v100,fine,tool0;"
    module = tmp_path / "Test.mod"
    module.write_text(f"MODULE Test\nPROC main()\n{moves}\nENDPROC\nENDMODULE\n")
    (lost,) = import_rapid(module, STATION).lost
    assert re.search(
        "would collide with part, .* `check: limits` in the move leaves out this check", lost.text
    )
    assert lost.line == 3
    assert "check: limits" in import_rapid(module, STATION, check="limits").program.text()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("signals: {a: {}}", "a signal is told by one of does, is and sensor"),
        ("signals: {a: {sensor: distance.part}}", "a sensor goes with one of below and above"),
        ("signals: {a: {does: {1: [{atach: part}]}}}", "signals.a.does"),
        ("signal: {a: {is: 1}}", "did you mean 'signals'?"),
    ],
)
def test_a_wrong_table_is_refused_by_its_key(tmp_path, table, message):
    (tmp_path / "io.yaml").write_text(table)
    with pytest.raises(InvalidConfig) as refused:
        Signals.load(tmp_path / "io.yaml")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
