"""Moves of RAPID programs: what the arm does, by its own kinematics, and what is refused or told."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from simrob_drake.base.frames import transform_from_xyz_quaternion
from simrob_drake.extensions.rapid.configuration import (
    configuration,
    has_configuration,
    postures_like,
)
from simrob_drake.extensions.rapid.importing import Imported, import_rapid
from simrob_drake.extensions.rapid.syntax import RapidError
from simrob_drake.extensions.rapid.values import robtarget_of, texted
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.every_branch import branches
from simrob_drake.programs.arm import Workcell
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.load import bare_station

FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"
DATA = f"""
    PERS tooldata tPen:=[TRUE,[[0,0,100],[1,0,0,0]],[0.1,[0,0,50],[1,0,0,0],0,0,0]];
    PERS wobjdata wTable:=[FALSE,TRUE,"",[[300,0,200],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
    CONST robtarget pA:=[[50,-100,200],[0,0,1,0],[-1,0,-1,0],{FREE}];
    CONST robtarget pB:=[[50,100,200],[0,0,1,0],[0,0,0,0],{FREE}];
    CONST jointtarget jHome:=[[0,0,0,0,90,0],{FREE}];
"""
STATION = bare_station("irb120")


@pytest.fixture
def done(tmp_path):
    """Return what imports a program of a main procedure."""

    def imported(main: str, more: str = DATA, **options: object) -> Imported:
        file = tmp_path / "Test.mod"
        file.write_text(f"MODULE Test\n{more}\nPROC main()\n{main}\nENDPROC\nENDMODULE\n")
        return import_rapid(file, STATION, **options)

    return imported


def end_of(imported: Imported) -> np.ndarray:
    """Return the posture to which a program leads."""
    cell = Workcell(STATION)
    cell.rehearse(imported.program)
    return cell.reference("robot")


def test_a_target_is_where_controllers_have_it(done):
    """The pose of tool0 at zero is printed in the product manual: 374 mm out, 630 mm up, z forward."""
    chain = Chain.of_robot(load_robot("irb120"))
    manual = transform_from_xyz_quaternion([0.374, 0, 0.63, 0.5**0.5, 0, 0.5**0.5, 0])
    np.testing.assert_allclose(chain.forward(np.zeros(6))[0], manual.GetAsMatrix4(), atol=1e-6)
    moved = done(
        f"MoveAbsJ jHome,v500,fine,tool0; MoveJ [[374,0,500],[0,0,1,0],[0,0,0,0],{FREE}],v500,fine,tool0;"
    )
    pose = chain.forward(end_of(moved))[0]
    np.testing.assert_allclose(pose[:3, 3], [0.374, 0, 0.5], atol=1e-9)
    np.testing.assert_allclose(pose[:3, :3], np.diag([-1.0, 1.0, -1.0]), atol=1e-9)


def test_tools_and_work_objects_count(done):
    moved = done(r"MoveJ pA,v500,fine,tPen\WObj:=wTable;")
    pose = Chain.of_robot(load_robot("irb120")).forward(end_of(moved))[0]
    # the flange is 100 mm above the tool
    np.testing.assert_allclose(pose[:3, 3], [0.35, -0.1, 0.5], atol=1e-9)


@pytest.mark.long
def test_moves_joined_by_zones_are_one_and_each_kind_is_its_own(done):
    moved = done(r"""
        ConfL\Off;
        MoveJ pA,v500,fine,tPen\WObj:=wTable;
        MoveL Offs(pA,0,0,-50),v200,z10,tPen\WObj:=wTable;
        MoveL Offs(pA,50,50,-50),v200,z10,tPen\WObj:=wTable;
        MoveL Offs(pA,50,100,0),v200,fine,tPen\WObj:=wTable;
        WaitTime 0.5;
        MoveC RelTool(pB,20,20,0),RelTool(pB,40,0,0),v100\T:=2,fine,tPen\WObj:=wTable;
        MoveAbsJ jHome,v500,z50,tool0;
    """)
    kinds = [move.key for move in moved.program.moves]
    assert kinds == ["tool", "move_j", "move_l", "wait", "move_c", "tool", "move_abs_j"]
    line, arc = moved.program.moves[2], moved.program.moves[4]
    assert (len(line.targets), line.zone, line.speed) == (3, "z10", 0.2)
    assert (arc.duration, arc.speed) == (2.0, None)
    assert moved.remarks == ()
    assert Workcell(STATION).perform(moved.program).times[-1] == pytest.approx(moved.time)


def test_a_zone_between_moves_of_other_kinds_is_told_to_be_a_rest(done):
    moved = done(
        r"MoveJ pA,v500,z10,tPen\WObj:=wTable; MoveL Offs(pA,0,0,-50),v200,fine,tPen\WObj:=wTable;"
    )
    assert "rests at its target" in str(moved.remarks[0])
    assert not moved.lost


def test_zones_are_no_larger_than_half_of_their_ways(done):
    moved = done(r"""ConfL\Off; MoveJ pA,v500,fine,tPen\WObj:=wTable;
        MoveL Offs(pA,0,10,0),v50,z200,tPen\WObj:=wTable; MoveL Offs(pA,0,30,0),v50,fine,tPen\WObj:=wTable;""")
    assert moved.program.moves[-1].zone == pytest.approx(0.499 * 0.01)


def test_a_turn_of_the_tool_takes_the_time_that_its_speed_asks_for(done):
    moved = done(
        r"MoveJ pA,v500,fine,tPen\WObj:=wTable; MoveL RelTool(pA,0,0,0\Rz:=60),[100,30,1,1],fine,tPen\WObj:=wTable;"
    )
    assert moved.program.moves[-1].duration == pytest.approx(2.0)


def test_what_axes_cannot_do_is_slower_and_told(done):
    moved = done(
        f"MoveAbsJ [[0,0,0,0,90,-170],{FREE}],v500,fine,tool0; MoveAbsJ [[0,0,0,0,90,170],{FREE}],v7000,fine,tool0;"
    )
    assert "is slower than asked for" in str(moved.remarks[0])
    assert Workcell(STATION).perform(moved.program).ending == "completed"


@pytest.mark.long
def test_configurations_tell_all_postures_for_a_pose_apart():
    chain, chance = Chain.of_robot(load_robot("irb120")), np.random.default_rng(0)
    assert has_configuration(chain)
    assert configuration(chain, np.zeros(6)) == (0, 0, 0, 0)
    seen = set()
    for _ in range(50):
        posture = chance.uniform(chain.lower, chain.upper)
        pose = chain.forward(posture)[0]
        wanted = configuration(chain, posture)
        found, _ = postures_like(chain, pose, np.zeros(6), wanted)
        assert len(found) == 1
        np.testing.assert_allclose(found[0], posture, atol=1e-6)
        for axis, quadrants, count in (
            (1, 1, 1),
            (2, -1, 1),
            (1, 2, 0),
        ):  # a neighbour stands for a quadrant
            asked = [*wanted]
            asked[axis] += quadrants
            near = postures_like(chain, pose, np.zeros(6), asked)[0]
            assert len(near) == count
            np.testing.assert_allclose(near, np.reshape([posture] * count, (-1, 6)), atol=1e-6)
        every = [
            configuration(chain, row)[3]
            for row in branches(chain, pose[np.newaxis], np.zeros(6))[0]
        ]
        assert len(set(every)) == len(every)
        seen.add(wanted[3])
    assert seen == set(range(8))


def test_the_configuration_chooses_the_posture(done):
    """The same pose with the wrist flipped: axes 4 and 6 half a turn away, axis 5 negative."""
    chain = Chain.of_robot(load_robot("irb120"))
    near = np.array([0.3, 0.2, 0.1, 0.8, 0.9, 0.5])
    flipped = near * [1, 1, 1, 1, -1, 1] - [0, 0, 0, np.pi, 0, np.pi]
    for posture, kind in ((near, "move_j"), (flipped, "move_abs_j")):
        target = robtarget_of(
            RigidTransform(chain.forward(posture)[0]), configuration(chain, posture)
        )
        moved = done(f"MoveJ {texted(target)},v200,fine,tool0;")
        np.testing.assert_allclose(end_of(moved), posture, atol=1e-8)
        assert moved.program.moves[-1].key == kind
        assert ["written as move_abs_j" in str(remark) for remark in moved.remarks] == [True] * (
            posture is flipped
        )
        np.testing.assert_allclose(
            end_of(done(f"ConfJ\\Off; MoveJ {texted(target)},v200,fine,tool0;")), near, atol=1e-8
        )


@pytest.mark.parametrize(
    ("main", "message"),
    [
        (
            f"MoveJ [[374,0,500],[0,0,1,0],[1,1,1,3],{FREE}],v200,fine,tool0;",
            "configuration [1, 1, 1, 3], which has only",
        ),
        (
            f"MoveJ [[3740,0,500],[0,0,1,0],[0,0,0,0],{FREE}],v200,fine,tool0;",
            "target cannot be reached",
        ),
        (
            f"MoveL [[3740,0,500],[0,0,1,0],[0,0,0,0],{FREE}],v200,fine,tool0;",
            "cannot be reached: out of reach",
        ),
        (
            f"MoveAbsJ [[200,0,0,0,0,0],{FREE}],v200,fine,tool0;",
            "joint_1 would be at 200 deg, beyond its limits",
        ),
        (
            'MoveJ pA,v200,fine,tPen\\WObj:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
            "a work object that",
        ),
    ],
)
def test_a_move_that_the_robot_cannot_make_is_left_out_and_the_program_goes_on(done, main, message):
    home, after = (f"MoveAbsJ [[{angle},0,0,0,90,0],{FREE}],v500,fine,tool0;" for angle in (0, 20))
    moved = done("\n".join([home, main, after]))
    assert [remark.line for remark in moved.lost] == [5 + DATA.count("\n")]
    assert message in moved.lost[0].text
    assert moved.lost[0].text.endswith("left out")
    turns = [
        np.rad2deg(move.targets[0]) for move in moved.program.moves if hasattr(move, "targets")
    ]
    assert turns == pytest.approx([0, 20])


def test_moves_that_zones_join_are_left_out_together(done):
    way = "".join(f"MoveL Offs(pA,0,0,{up}),v200,{zone},tPen\\WObj:=wTable;\n" for up, zone in
                  ((-20, "z10"), (3000, "z10"), (-40, "fine")))  # fmt: skip
    moved = done(f"MoveJ pA,v500,fine,tPen\\WObj:=wTable;\n{way}")
    assert len(moved.lost) == 1
    assert moved.lost[0].text.endswith("left out, with the 2 before that its zones join")


def test_a_first_line_from_nowhere_goes_by_the_axes(done, monkeypatch):
    """The program begins where all axes are at 0: the wrist is singular there, so no line leads away from it."""
    robot = STATION.robots["robot"].model_copy(update={"initial_deg": 0.0})
    stretched = STATION.model_copy(update={"robots": {"robot": robot}})
    monkeypatch.setitem(globals(), "STATION", stretched)
    target = f"[[15,455,96],[0.5129,-0.1998,0.8271,-0.1140],[1,-1,1,0],{FREE}]"
    low = f"MoveL {target},v200,fine,tool0;"
    moved, plain = done(low), done(low.replace("MoveL", "MoveJ"))
    assert [remark.text.partition(",")[0] for remark in moved.remarks if not remark.lost][:1] == [
        "is the first move"
    ]
    np.testing.assert_allclose(end_of(moved), end_of(plain), atol=1e-9)
    again = done(f"MoveAbsJ jHome,v500,fine,tool0;\n{low}")
    assert not [remark for remark in again.remarks if "first move" in remark.text]


@pytest.mark.parametrize(
    ("main", "message"),
    [
        (
            f"MoveJ [[374,0,500],[0,0,0,0],[0,0,0,0],{FREE}],v200,fine,tool0;",
            "an orient of four zeros",
        ),
        ("MoveAbsJ jHome,v200,fine;", "MoveAbsJ with 3 arguments"),
        ("MoveAbsJ jHome,200,fine,tool0;", "a num where a speeddata is asked for"),
        ("MoveAbsJ jHome,[0,0,0,0],fine,tool0;", "a speeddata without a speed of the tool"),
    ],
)
def test_moves_that_cannot_be_are_refused_with_their_line(done, main, message):
    with pytest.raises(RapidError) as refused:
        done(f"MoveAbsJ jHome,v500,fine,tool0;\n{main}")
    line = 5 + DATA.count("\n") + 0
    assert f"Test.mod: line {line}: " in str(refused.value)
    assert message in str(refused.value)


def test_what_is_not_known_is_left_out_and_named(done):
    moved = done('MoveAbsJ jHome,v500,fine,tool0;\nSocketSend s;\nTPWrite "at home";')
    assert [remark.text for remark in moved.lost] == ["SocketSend is not known, and left out"]
    assert [remark.text for remark in moved.remarks if not remark.lost] == ["says at home"]
    moved = done("MoveAbsJ jHome,v500,fine,tool0;\nPeculiar 1;", f"{DATA} VAR odd x;")
    texts = [remark.text.partition(";")[0] for remark in moved.lost]
    assert texts == ["the type odd is not known", "Peculiar is not known, and left out"]


def test_what_a_controller_would_do_and_is_not_done_is_told_with_its_line(done):
    lines = [
        "Stop;",
        "EOffsOn;",
        "SingArea\\Wrist;",
        "SingArea\\Off;",
        "WorldAccLim\\On:=3;",
        "TPErase;",
        "StartMove;",
    ]
    moved = done("\n".join([*lines, "MoveAbsJ jHome,v500,fine,tool0;"]))
    first = 4 + DATA.count("\n")
    remarks = [(remark.line - first, remark.text.partition(" ")[0]) for remark in moved.remarks]
    assert remarks == [
        (0, "Stop"),
        (1, "EOffsOn"),
        (2, "SingArea"),
        (4, "WorldAccLim"),
        (6, "StartMove"),
    ]
    assert "until somebody goes on" in moved.remarks[0].text
    assert not moved.lost


@pytest.mark.parametrize(("between", "targets"), [("", 3), ("WaitRob\\InPos;", 2)])
def test_waiting_for_the_robot_ends_a_zone(done, between, targets):
    first, *rest = (f"MoveL Offs(pA,0,0,{height}),v200,{zone},tPen\\WObj:=wTable;" for height, zone in
                    ((-20, "z10"), (-40, "z10"), (-60, "fine")))  # fmt: skip
    moved = done(
        "\n".join(["ConfL\\Off;", "MoveJ pA,v500,fine,tPen\\WObj:=wTable;", first, between, *rest])
    )
    assert len(np.reshape(moved.program.moves[-1].targets, (-1, 6))) == targets


def test_where_the_robot_is_can_be_asked(done):
    moved = done(r"""
        VAR robtarget here;
        MoveJ pA,v500,z10,tPen\WObj:=wTable;
        here:=CRobT(\Tool:=tPen\WObj:=wTable);
        MoveL Offs(here,0,0,20),v100,fine,tPen\WObj:=wTable;
        MoveJ CalcRobT(CJointT(),tool0),v100,fine,tool0;
    """)
    assert moved.program.moves[2].targets[2] == pytest.approx(0.22)


def test_speeds_and_accelerations_are_scaled(done):
    moved = done(r"""
        MoveAbsJ jHome,v500,fine,tool0;
        VelSet 50,100; PathAccLim TRUE\AccMax:=1,TRUE\DecelMax:=1;
        MoveJ pA,v500,fine,tool0\WObj:=wTable;
        VelSet 50,5000; AccSet 40,100;
        MoveJ pB,v500,fine,tool0\WObj:=wTable;
    """)
    first, second = moved.program.moves[1:]
    assert (first.speed, first.acceleration) == (0.1, 1.0)
    assert (second.speed, second.acceleration) == (0.25, 0.8)


def test_clocks_run_with_the_program(done):
    moved = done(
        'ClkReset clock1; ClkStart clock1; WaitTime 2; ClkStop clock1; WaitTime 1; TPWrite "t "\\Num:=ClkRead(clock1);'
    )
    assert moved.remarks[0].text == "says t 2"


def test_a_tool_or_work_object_that_no_module_declares_is_told_and_left_out(done):
    moved = done(f"MoveJ [[374,0,500],[0,0,1,0],[0,0,0,0],{FREE}],v500,fine,tool9\\WObj:=qqqq;")
    plain = done(f"MoveJ [[374,0,500],[0,0,1,0],[0,0,0,0],{FREE}],v500,fine,tool0;")
    np.testing.assert_allclose(end_of(moved), end_of(plain), atol=1e-12)
    assert [remark.text for remark in moved.lost] == [
        "there is no data 'tool9'; did you mean 'tool0'?; tool0 in its place",
        "there is no data 'qqqq'; wobj0 in its place",
    ]


def test_flags_and_meetings_of_other_tasks_have_no_effect(done):
    moved = done(
        "VAR bool lock; VAR syncident s;\nSyncMoveOn s,s;\nIF TestAndSet(lock) MoveAbsJ jHome,v500,fine,tool0;\n"
        "WaitTestAndSet lock;\nIF TestAndSet(lock) MoveAbsJ jNone,v500,fine,tool0;\nSyncMoveOff s;"
    )
    np.testing.assert_allclose(end_of(moved), np.deg2rad([0, 0, 0, 0, 90, 0]), atol=1e-9)
    assert not moved.lost
    assert [remark.text.partition(":")[0] for remark in moved.remarks] == [
        "SyncMoveOn has no effect", "WaitTestAndSet waits for what no other task releases", "SyncMoveOff has no effect",
    ]  # fmt: skip


FLANGE_DOWN = "[0, 0.7071068, 0, 0.7071068], [0,0,0,0], [9E9,9E9,9E9,9E9,9E9,9E9]"


@pytest.mark.parametrize("instruction", ["MoveJ", "MoveL"])
@pytest.mark.parametrize(
    ("place", "is_hinted"), [("0.3, 0.1, 0.4", True), ("3000, 100, 400", False)]
)
def test_a_target_in_metres_that_is_not_reached_gets_a_hint(done, instruction, place, is_hinted):
    moved = done(
        f"MoveAbsJ [[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"
        f"{instruction} [[{place}],{FLANGE_DOWN}],v100,fine,tool0;"
    )
    (remark,) = moved.lost
    assert ("lengths of RAPID are in millimetres: were these metres?" in remark.text) == is_hinted


def test_a_target_in_millimetres_near_its_frame_gets_no_hint(done):
    """Places of up to 2 mm from a work object are right where the robot reaches them."""
    wobj = 'PERS wobjdata bench:=[FALSE,TRUE,"",[[400,0,400],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];'
    moved = done(
        f"ConfJ\\Off;\nMoveJ [[0,1,0.5],{FLANGE_DOWN}],v100,fine,tool0\\WObj:=bench;", wobj
    )
    assert not [remark for remark in moved.remarks if "metres" in remark.text]
