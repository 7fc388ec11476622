"""RAPID itself: data, arithmetic, loops and routines, by what a program tells of them; and what is refused."""

import time

import pytest

from simrob_drake.extensions.rapid.importing import Interpreter
from simrob_drake.extensions.rapid.syntax import RapidError, modules_of, predefined


def module(main: str, more: str = "") -> str:
    return f"MODULE Test\n{more}\nPROC main()\n{main}\nENDPROC\nENDMODULE\n"


def told(
    main: str, more: str = "", cycles: int = 1, inputs: dict[str, float] | None = None
) -> list[object]:
    """Return what a main procedure gives to its instruction Tell."""
    found = []
    instructions = {"tell": lambda call: found.append(call.value(0))}
    modules = modules_of(module(main, more), "Test.mod")
    Interpreter(modules, instructions, {}, (inputs or {}).get, cycles).run()
    return found


def interpreter(main: str, more: str = "", cycles: int = 1) -> Interpreter:
    done = Interpreter(
        modules_of(module(main, more), "Test.mod"), {}, {}, lambda name: None, cycles
    )
    done.run()
    return done


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1+2*3-4/2", 5.0),
        ("17 DIV 5", 3.0),
        ("17 MOD 5", 2.0),
        ("-(2)*-3", 6.0),
        ('"a"+"b""c"', 'ab"c'),
        ("1<2 AND NOT 3<2", True),
        ("FALSE OR 1=1", True),
        ("0x1F+0b11", 34.0),
        ("Sqrt(16)+Abs(-1)", 5.0),
        ("Round(2.345\\Dec:=2)", 2.35),
        ("Trunc(-2.7)", -2.0),
        ("ATan2(1,1)", 45.0),
        ('StrLen("four")', 4.0),
        ('StrPart("robot",2,3)', "obo"),
        ("NumToStr(1.256,2)", "1.26"),
        ("ValToStr([1,2]=[1,2])", "TRUE"),
        ("pi", 3.14159265358979),
        ("v200.v_tcp", 200.0),
        ("z10.pzone_tcp", 10.0),
        ("fine.finep", True),
        ("tool0.tframe.rot.q1", 1.0),
        ("ValToStr(Offs(p,1,2,3).trans)", "[1,2,3]"),
        ("EulerZYX(\\Z,OrientZYX(30,20,10))", 30.0),
        ("VectMagn([3,4,0]+[0,0,12])", 13.0),
        ("DotProd([1,2,3],[1,0,1])", 4.0),
        ("Distance(PoseVect([[10,0,0],[1,0,0,0]],[5,0,0]),[15,0,0])", 0.0),
        ("Fac(5)", 120.0),
        ('StrMatch("robotics",1,"tic")', 5.0),
        ('StrMatch("robotics",6,"bo")', 9.0),
        ('StrToVal("-3.5",reg1)', True),
        ('StrToVal("12 ",p)', False),
        ('StrToVal("x;",reg1)', False),
    ],
)
def test_expressions_are_worked_out(expression, value):
    more = """
    CONST robtarget p:=[[0,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
    FUNC num Fac(num n) IF n<=1 RETURN 1; RETURN n*Fac(n-1); ENDFUNC
    """
    (found,) = told(f"Tell {expression};", more)
    assert found == pytest.approx(value) if isinstance(value, float) else found == value


def test_statements_are_done_in_order():
    main = """
    VAR num i:=3;
    IF i=1 THEN Tell "no"; ELSEIF i=3 THEN Tell "three"; ELSE Tell "no"; ENDIF
    FOR k FROM 2 TO 0 DO Tell k; ENDFOR
    FOR k FROM 0 TO 4 STEP 2 DO IF k=2 GOTO out; ENDFOR
    out:
    WHILE i>1 DO i:=i-1; ENDWHILE
    TEST i CASE 5,6: Tell "no"; CASE 1: Tell "one"; DEFAULT: Tell "no"; ENDTEST
    Twice i;
    Tell i;
    %"Lo"+"w"%;
    CallByVar "Kind",3;
    Optional 1;
    Optional 1\\more:=2;
    """
    more = """
    PROC Twice(INOUT num x) x:=2*x; ENDPROC
    PROC Low() Tell "low"; ENDPROC
    PROC Kind3() Tell "third"; ENDPROC
    PROC Optional(num a\\num more) IF Present(more) THEN Tell a+more; ELSE Tell a; ENDIF ENDPROC
    """
    assert told(main, more) == ["three", 2.0, 1.0, 0.0, "one", 2.0, "low", "third", 1.0, 3.0]


def test_records_and_arrays_are_copied_and_changed_by_part():
    main = """
    VAR pair one:=[1,[1,2,3]];
    VAR pair other;
    VAR num grid{2,3};
    other:=one;
    other.at.y:=7;
    grid{2,3}:=other.at.y;
    Tell ValToStr(one);
    Tell ValToStr(other);
    Tell grid{2,3}+Dim(grid,2);
    """
    assert told(main, "RECORD pair num name; pos at; ENDRECORD") == [
        "[1,[1,2,3]]",
        "[1,[1,7,3]]",
        10.0,
    ]


def test_an_endless_loop_is_done_as_often_as_asked_and_told():
    assert told("WHILE TRUE DO Tell 1; ENDWHILE", cycles=3) == [1.0] * 3
    (remark,) = interpreter("WHILE TRUE DO ENDWHILE", cycles=3).remarks
    assert str(remark).startswith("Test.mod: line 4: WHILE TRUE is done 3 times")
    assert not remark.lost


def test_inputs_that_no_data_hides_are_read_by_name():
    assert told("IF diPart=1 Tell 5;", inputs={"diPart": 1.0}) == [5.0]


@pytest.mark.parametrize(
    ("main", "more", "message"),
    [
        ("Tell 1/(2-2);", "", "line 4: division by zero"),
        ("Tell Sqrt(-1);", "", "line 4: cannot be worked out: "),
        ('reg1:="x";', "", "line 4: a string where a num is asked for"),
        ("reg1.x:=1;", "", "line 4: a num has no component 'x'"),
        ("Tell p.z.x;", "VAR pos p;", "line 4: a num has no component 'x'"),
        ("Tell a{3};", "VAR num a{2};", "line 4: there is no element 3 of 2"),
        ("VAR pos p:=[1,2];", "", "line 4: an aggregate of 2 where a pos has 3 components"),
        (
            "Sub;",
            "PROC Sub() Sub; ENDPROC",
            "line 2: Sub is called 40 deep: it calls itself without an end",
        ),
        ("Sub 1,2;", "PROC Sub(num a) ENDPROC", "line 4: Sub with 2 arguments, of 1 that it has,"),
        ("Sub 1\\on;", "PROC Sub(num a\\switch off) ENDPROC", "line 4: Sub has no option 'on'"),
        ("Tell Low();", "FUNC num Low() ENDFUNC", "line 4: FUNC Low ends without RETURN"),
        ("GOTO there;", "", "there is no label 'there' in main"),
        ("VAR strange x;", "", "line 4: the type strange is not known"),
        (
            "Tell a;",
            "CONST num a:=b; CONST num b:=a;",
            "line 2: data whose value depends on itself",
        ),
        ("a{1}:=1;", "VAR num a{100000,100000};", "line 2: an array of 100000×100000 elements"),
        ("reg1:=" + "-" * 5000 + "1;", "", "is nested too deeply"),
        ("VAR r x;", "RECORD r r x; ENDRECORD", "is nested too deeply"),
        (
            'VAR string s:="a"; FOR i FROM 1 TO 40 DO s:=s+s; ENDFOR',
            "",
            "line 4: a string of more than 1000 letters",
        ),
        ("WHILE 1=1 DO ENDWHILE", "", "line 4: a loop that does not end within 1000 rounds"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(main, more, message, monkeypatch):
    monkeypatch.setattr("simrob_drake.extensions.rapid.importing._MOST_STATEMENTS", 1000)
    with pytest.raises(RapidError) as refused:
        told(main, more)
    assert message in str(refused.value)
    assert "Test.mod" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_statements_that_are_none_are_left_out_and_named():
    faulty = module("VAR num i:=1;\n i := := 2;\n Tell i;")
    (read,) = modules_of(faulty, "Test.mod")
    assert [str(fault) for fault in read.faults] == [
        "Test.mod: line 5: ':= 2;' is not understood here"
    ]


def test_what_no_module_declares_leaves_its_statement_out_and_is_told():
    main = "Tell regg1+1;\nIF Qqqq()=1 Tell 2;\nIF 1=1 THEN\n qqqq:=3; Tell 4;\nENDIF\nTell 5;"
    found = []
    done = Interpreter(
        modules_of(module(main), "Test.mod"),
        {"tell": lambda call: found.append(call.value(0))},
        {},
        {}.get,
        1,
    )
    done.run()
    assert found == [4.0, 5.0]
    assert [(remark.line, remark.text, remark.lost) for remark in done.remarks] == [
        (4, "there is no data 'regg1'; did you mean 'reg1'?; left out", True),
        (5, "there is no function 'Qqqq'; left out", True),
        (7, "there is no data 'qqqq'; left out", True),
    ]


def test_what_depends_on_what_was_left_out_is_left_out_and_told():
    main = "p:=[1,2,3];\np.x:=qqqq;\nTell p;\nTell Low();\np:=[4,5,6];\nTell p.y;"
    found = []
    modules = modules_of(
        module(main, "VAR pos p;\nFUNC num Low() RETURN qqqq; ENDFUNC"), "Test.mod"
    )
    done = Interpreter(modules, {"tell": lambda call: found.append(call.value(0))}, {}, {}.get, 1)
    done.run()
    assert found == [5.0]
    assert [remark.line for remark in done.remarks] == [6, 7, 8]


def test_a_loop_that_waits_for_what_was_left_out_is_left_and_told():
    done = interpreter(
        "VAR bool more:=TRUE;\nWHILE more DO\n more:=Qqqq();\n reg1:=reg1+1; more:=TRUE;\nENDWHILE"
    )
    assert [(remark.line, remark.text) for remark in done.remarks] == [
        (6, "there is no function 'Qqqq'; left out"),
        (5, "a loop that does not end within 100 rounds is left: see what is lost"),
    ]


def test_texts_become_values():
    assert told('IF StrToVal("[1,2,3]",p) Tell p.y; Tell StrToVal("TRUE",b); Tell b;', "VAR pos p; VAR bool b;") == [
        2.0, True, True,
    ]  # fmt: skip


def test_a_loop_without_a_round_is_left():
    assert told("FOR i FROM 3 TO 1 STEP 1 DO Tell i; ENDFOR Tell 9;") == [9.0]


def test_an_error_after_what_was_left_out_is_left_out_too():
    main = "reg1:=qqqq;\nTell 1;\nTell reg2.x;\nTell 3;"
    found = []
    done = Interpreter(
        modules_of(module(main), "Test.mod"),
        {"tell": lambda call: found.append(call.value(0))}, {}, {}.get, 1,
    )  # fmt: skip
    done.run()
    assert found == [1.0, 3.0]


def test_a_parameter_that_is_a_signal_has_its_level_in_expressions():
    sub = "PROC Sub(VAR signaldi at)\n Tell at; IF at=1 Tell 7;\nENDPROC"
    assert told("Sub diPart;", sub, inputs={"diPart": 1.0}) == [1.0, 7.0]


def test_data_that_begins_with_what_nobody_declares_is_told_each_time_it_is_asked_for():
    done = interpreter("reg1:=a;\nreg2:=a;", "VAR num a:=qqqq;")
    assert [remark.line for remark in done.remarks] == [4, 5]
    assert {remark.text for remark in done.remarks} == {"there is no data 'qqqq'; left out"}


def test_what_stands_after_the_module_is_named_once():
    (read,) = modules_of(module("Tell 1;") + "MoveL a;\nMoveL b;\n" * 30, "Test.mod")
    assert [(fault.line, fault.text) for fault in read.faults] == [
        (7, "'MoveL a;' is not understood here")
    ]


def test_a_module_may_be_called_by_a_number():
    (read,) = modules_of("MODULE 1_T_ROB1 PROC main() ENDPROC ENDMODULE", "Test.mod")
    assert read.name == "1_T_ROB1"


def test_the_only_procedure_that_nothing_calls_is_the_program():
    text = "MODULE A PROC go() Sub; Tell 3; ENDPROC PROC Sub() Tell 2; ENDPROC ENDMODULE"
    found = []
    done = Interpreter(
        modules_of(text, "A.mod"), {"tell": lambda call: found.append(call.value(0))}, {}, {}.get, 1
    )
    done.run()
    assert found == [2.0, 3.0]
    assert [(remark.text, remark.lost) for remark in done.remarks] == [
        ("there is no PROC main(): go() is done", False)
    ]
    two = "MODULE A PROC a() ENDPROC PROC b() ENDPROC PROC c(num d) ENDPROC ENDMODULE"
    with pytest.raises(
        RapidError, match=r"there is no PROC main\(\), but a\(\), b\(\): call one in a main"
    ):
        Interpreter(modules_of(two, "A.mod"), {}, {}, {}.get, 1).run()


@pytest.mark.parametrize(
    ("text", "line"), [("MODULE A PROC main()", 1), ("305.2", 1), ("\nMoveL p,v1;", 2), ("", 1)]
)
def test_what_is_no_module_is_refused(text, line):
    with pytest.raises(RapidError, match=rf"^A.mod: line {line}: "):
        modules_of(text, "A.mod")


def test_a_program_without_main_is_refused():
    with pytest.raises(RapidError, match=r"^A.mod: line 1: there is no PROC main"):
        Interpreter(modules_of("MODULE A ENDMODULE", "A.mod"), {}, {}, lambda name: None, 1).run()


def test_all_that_every_program_knows_is_as_its_types_say():
    names = [
        str(item.children[0])
        for node in predefined().declarations
        if node.data == "data"
        for item in node.children[3:]
    ]
    assert {"v5", "v7000", "vmax", "fine", "z0", "z200", "tool0", "wobj0", "load0"} <= set(names)
    assert len(told("\n".join(f"Tell {name};" for name in names))) == len(names)


def test_a_procedure_with_parameters_is_not_called_by_a_variable():
    with pytest.raises(RapidError, match="Kind3 with 0 arguments, of 1 that it has"):
        told('CallByVar "Kind",3;', "PROC Kind3(num x) Tell x; ENDPROC")


BODY = "MODULE T\nPROC main()\n{}\nENDPROC\nENDMODULE\n"


FIRST_FAULTS = {
    BODY.format(" MoveJ p1,v100,z10,tool0\n MoveL p2,v100,z10,tool0;"): (
        "3: a ';' is missing after 'MoveJ p1,v100,z10,tool0'"
    ),
    BODY.format(
        " MoveJ p1,v1\n ! a comment; and more\n MoveL p2,v1;"
    ): "3: a ';' is missing after 'MoveJ p1,v1'",
    BODY.format(
        " WHILE TRUE DO\n a;\n b;"
    ): "3: the WHILE of line 3 has no ENDWHILE before 'ENDPROC' in line 6",
    BODY.format(" IF a=1 THEN\n a;\n FOR i FROM 1 TO 3 DO\n b;\n ENDIF"): (
        "5: the FOR of line 5 has no ENDFOR before 'ENDIF' in line 7"
    ),
    "MODULE T\nPROC main()\n a;\n\nPROC b()\n c;\nENDPROC\nENDMODULE\n": (
        "2: the PROC of line 2 has no ENDPROC before line 5"
    ),
    "MODULE T\nCONST num a:=1\nPROC main()\nENDPROC\nENDMODULE": "2: a ';' is missing after 'CONST num a:=1'",
    BODY.format(" a;\n ENDWHILE\n b;"): "4: ENDWHILE ends nothing that was begun",
}


@pytest.mark.parametrize(("text", "first"), FIRST_FAULTS.items())
def test_the_first_fault_comes_first_with_what_was_expected(text, first):
    module, *_ = modules_of(text, "T.mod")
    assert str(module.faults[0]) == f"T.mod: line {first}"
    assert len(module.faults) == 1
    routines = [node for node in module.declarations if node.data == "routine"]
    assert len(routines) == 1 + text.count("PROC b()")


def test_a_module_without_an_end_is_refused_with_its_line():
    with pytest.raises(
        RapidError, match="line 1: the MODULE of line 1 has no ENDMODULE before the end of the file"
    ):
        modules_of("MODULE T\nPROC main()\n a;\nENDPROC\n", "T.mod")


def test_a_module_of_tens_of_thousands_of_moves_is_refused_at_once():
    move = "MoveAbsJ [[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"
    began = time.process_time()
    with pytest.raises(
        RapidError, match="has 20000 statements, more than 10000: split it into modules"
    ):
        modules_of(f"MODULE M\nPROC main()\n{20_000 * move}ENDPROC\nENDMODULE\n", "M.mod")
    assert time.process_time() - began < 1
