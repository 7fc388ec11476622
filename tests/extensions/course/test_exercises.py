"""The course: each template fails, each solution passes, and what an answer may not do is told in one line."""

import ast
import csv
import json
import re
from ast import literal_eval
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import set_output_language
from simrob_drake.cli import ExitCode
from simrob_drake.cli.app import run_command
from simrob_drake.extensions.course.exercise import (
    ExerciseFolder,
    checked_points,
    exercise_of,
    exercises,
)
from simrob_drake.extensions.course.measuring import Reading, at_least, at_most, between, near
from simrob_drake.extensions.course.wire import decode, encode

ROOT = Path(__file__).parents[3]
SOLUTIONS = ROOT / "examples" / "course"
ENTRIES = {entry.folder.name: entry for entry in exercises()}

pytestmark = pytest.mark.usefixtures("no_plots")
each_exercise = pytest.mark.parametrize("name", ENTRIES)


@pytest.fixture(autouse=True)
def _english_afterwards():
    yield
    set_output_language("en")


def own_exercise(folder, *points):
    """Write an exercise whose points are lines of Python that make a reading of the answer."""
    folder.mkdir()
    texts = {
        f"point_{number}": {"en": f"point {number}", "es": f"punto {number}"}
        for number, _ in enumerate(points)
    }
    content = {"number": 1, "title": {"en": "own", "es": "propio"}, "hours": 1, "points": texts}
    (folder / "exercise.yaml").write_text(json.dumps(content))
    lines = [f"def point_{number}(answer):\n    {point}\n" for number, point in enumerate(points)]
    (folder / "check.py").write_text(
        "from simrob_drake.extensions.course.measuring import *\n" + "\n".join(lines)
    )
    return ExerciseFolder(folder)


def checked(entry, tmp_path, text, **limits):
    answer = tmp_path / "answer.py"
    answer.write_text(text)
    return list(checked_points(entry, answer, allow_code=True, **limits))


def test_numbers_run_from_one_on():
    assert [entry.exercise.number for entry in exercises()] == list(range(1, len(ENTRIES) + 1))
    assert {file.stem for file in SOLUTIONS.glob("*.py")} == ENTRIES.keys()


@each_exercise
def test_a_point_is_a_function_and_templates_are_alike(name):
    entry = ENTRIES[name]
    functions = {
        node.name
        for node in ast.parse(entry.checks.read_text()).body
        if isinstance(node, ast.FunctionDef)
    }
    assert entry.exercise.points.keys() <= functions
    trees = [
        ast.parse((entry.folder / f"template_{language}.py").read_text())
        for language in ("en", "es")
    ]
    names = [
        [node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        for tree in trees
    ]
    assert names[0] == names[1]


@pytest.mark.long  # quick exercises of the tests below pass and fail in all ways
@each_exercise
def test_a_solution_holds_all_points_and_zeros_few(name, tmp_path):
    entry = ENTRIES[name]
    solved = list(checked_points(entry, SOLUTIONS / f"{name}.py", allow_code=True))
    assert [point for point in solved if not point.ok] == []
    zeros = tmp_path / "answer.py"
    zeros.write_text(
        (entry.folder / "template_es.py")
        .read_text()
        .replace("raise NotImplementedError", "return 0")
    )
    assert (
        sum(point.ok for point in checked_points(entry, zeros, allow_code=True))
        <= len(entry.exercise.points) / 2
    )


TEACHERS = {"en": ROOT / "docs/course/teachers.md", "es": ROOT / "docs/es/curso/profesores.md"}
ACCEPTED = re.compile(r"`(\w+)\((.*?)\) = (.+?)`")
"""A value that a page states to be accepted, such as `payload(30) = 0.973`."""


def accepted_values(language, number):
    """Values that the page for teachers states for an exercise: name of the function, arguments, value."""
    sections = re.split(
        r"^## (\d+)\. ", TEACHERS[language].read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    text = dict(zip(map(int, sections[1::2]), sections[2::2], strict=True))[number]
    return [
        (name, literal_eval(f"({given},)") if given else (), literal_eval(value))
        for name, given, value in ACCEPTED.findall(text)
    ]


def test_both_pages_for_teachers_state_the_same_values():
    stated = {name: accepted_values("en", entry.exercise.number) for name, entry in ENTRIES.items()}
    assert ("torque_limit", (), 23.2) in stated["pd_and_saturation"]
    assert stated == {
        name: accepted_values("es", entry.exercise.number) for name, entry in ENTRIES.items()
    }


@pytest.mark.long
@each_exercise
def test_answers_for_teachers_are_accepted(name, tmp_path):
    """A value of a function without arguments goes to the check, others are those of the solution, to 1 %."""
    entry = ENTRIES[name]
    values = accepted_values("en", entry.exercise.number)
    if not values:
        pytest.skip("its functions have no single values")
    solution = SOLUTIONS / f"{name}.py"
    spec = spec_from_file_location(name, solution)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    text = solution.read_text(encoding="utf-8")
    for function, given, value in values:
        if given:
            assert getattr(module, function)(*given) == pytest.approx(value, rel=0.01)
        else:
            text += f"\n\ndef {function}():\n    return {value!r}\n"
    answer = tmp_path / "answer.py"
    answer.write_text(text, encoding="utf-8")
    assert [point for point in checked_points(entry, answer, allow_code=True) if not point.ok] == []


@pytest.mark.long
def test_the_limit_that_still_swings_is_refused(tmp_path):
    """The page for teachers says why 22.9 N·m is too little: 3.3 degrees are left."""
    entry = ENTRIES["pd_and_saturation"]
    points = checked(entry, tmp_path, "def torque_limit():\n    return 22.9\n")
    enough = next(point for point in points if point.name == "enough")
    assert enough.state == "fails"
    assert enough.reading.most == 1.5
    assert enough.reading.value == pytest.approx(3.3, abs=0.05)


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "es"])
@each_exercise
def test_a_template_holds_no_point(name, language):
    """The first one in Spanish is checked below, as a user does it."""
    template = ENTRIES[name].folder / f"template_{language}.py"
    assert not any(point.ok for point in checked_points(ENTRIES[name], template, allow_code=True))


@pytest.mark.long  # quick exercises of the tests below pass and fail in all ways
@each_exercise
def test_a_solution_draws_its_figure(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    spec = spec_from_file_location(name, SOLUTIONS / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main()
    picture = Path(capsys.readouterr().out.splitlines()[-1])
    assert picture == Path("runs/course") / f"{name}.png"
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_an_answer_is_begun_checked_and_passes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_command(["course", "list"]) == 0
    assert "Kinematics of an arm" in capsys.readouterr().out
    assert run_command(["course", "start", "1", "--out", "mine", "--language", "es"]) == 0
    assert "Ejercicio 1" in Path("mine/answer.py").read_text()
    assert "course check 1 mine/answer.py --allow-code --language es" in capsys.readouterr().out
    assert run_command(["course", "start", "1", "--out", "mine"]) == ExitCode.BAD_INPUT
    assert (
        run_command(["course", "check", "1", "mine/answer.py", "--allow-code"]) == ExitCode.BEYOND
    )
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith("missing tool_position(q)")
    assert shown[0].endswith("not written yet")
    assert shown[-1] == "0 of 6 points hold"


def test_lines_say_what_was_asked_and_measured(tmp_path, capsys):
    own_exercise(
        tmp_path / "own", "return at_most(answer.f(), 2, 'N')", "return near(answer.f(), 3, 0.5)"
    )
    (tmp_path / "a.py").write_text("def f():\n    return 1.5\n")
    run_command(
        [
            "course",
            "check",
            str(tmp_path / "own"),
            str(tmp_path / "a.py"),
            "--allow-code",
            "--language",
            "es",
        ]
    )
    assert capsys.readouterr().out.splitlines() == [
        "bien    punto 0: medido 1,5 N; se pide como mucho 2 N",
        "falla   punto 1: medido 1,5; se pide de 2,5 a 3,5",
        "se cumplen 1 de 2 puntos",
    ]


def test_code_is_run_only_where_it_is_allowed(tmp_path, capsys):
    (tmp_path / "a.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    assert run_command(["course", "check", "1", str(tmp_path / "a.py")]) == ExitCode.BAD_INPUT
    assert "--allow-code" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("while True: pass", r"took longer than its 1.5 s; --seconds"),
        ("x = bytearray(3_000_000_000)", r"took more than its 1 GB of memory; --memory"),
        (
            "import os; os._exit(0)",
            r"ended its process before all points were measured \(exit code 0",
        ),
        (
            "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
            r"all points were measured \(exit code -9",
        ),
        ("import sys; sys.exit(0)", r"SystemExit: 0 \(answer.py, line 1\)"),
        (
            'print(\'{"point": "point_0", "value": 1}\')\n1/0',
            r"ZeroDivisionError: .* \(answer.py, line 2\)",
        ),
        ("def f(:", r"SyntaxError: "),
    ],
)
def test_an_answer_that_does_not_end_well_is_told_in_a_line(tmp_path, text, said):
    entry = own_exercise(tmp_path / "own", "return at_least(answer.f(), 0)")
    seconds = 1.5 if "while" in text else 60.0
    with pytest.raises(SimrobError, match=said):
        checked(entry, tmp_path, text, seconds=seconds, memory=1)


def test_a_point_that_fails_leaves_the_others(tmp_path):
    entry = own_exercise(
        tmp_path / "own",
        "return at_least(number(answer, 'f'), 0)",
        "return at_least(number(answer, 'g'), 0)",
        "return at_least(number(answer, 'h'), 0)",
        "return at_least(number(answer, 'k'), 0)",
    )
    points = checked(
        entry,
        tmp_path,
        "def f():\n  return 'x'\ndef g():\n  return {}['a']\ndef h():\n  return 1\n",
    )
    assert [point.ok for point in points] == [False, False, True, False]
    assert "what f() returns is 'x'; it must be a finite number" in points[0].problem
    assert points[1].problem == "KeyError: 'a' (answer.py, line 4)"
    assert "k of the answer is missing; it must be a function" in points[3].problem


def test_the_command_alone_shows_its_help(capsys):
    assert run_command(["course"]) == ExitCode.BAD_INPUT
    shown = capsys.readouterr()
    assert "check" in shown.out
    assert shown.err == ""


def test_what_cannot_be_is_told(tmp_path, capsys):
    assert run_command(["course", "start", "77"]) == ExitCode.BAD_INPUT
    assert "there is no exercise" in capsys.readouterr().err
    assert (
        run_command(["course", "check", "1", str(tmp_path / "none.py"), "--allow-code"])
        == ExitCode.BAD_INPUT
    )
    assert "none.py: cannot be read" in capsys.readouterr().err


def test_errors_are_in_the_language_of_the_course(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_command(["course", "start", "1", "--language", "es"])
    assert run_command(["course", "start", "2", "--language", "es"]) == ExitCode.BAD_INPUT
    assert (
        "ya existe answer.py; elija otra carpeta, como --out exercise-2" in capsys.readouterr().err
    )
    assert (
        run_command(["course", "check", "1", "answer.py", "--language", "es"]) == ExitCode.BAD_INPUT
    )
    assert "es código que se ejecutaría" in capsys.readouterr().err


def test_readings_keep_their_bounds():
    assert at_most(2, 2).ok
    assert not at_most(float("nan"), 2).ok
    assert not at_least(1.9, 2).ok
    assert between(1.5, 1, 2).ok
    assert near(1, 1.5, 0.5) == Reading(1.0, "", 1.0, 2.0)
    assert exercise_of("01").exercise.number == 1


CHEATS = [
    """
import sys
from simrob_drake.extensions.course.measuring import Reading
checks = sys.modules.get("check", sys)
checks.point_0 = lambda answer: Reading(9.0)
checks.at_least = lambda *_: Reading(9.0)
""",
    """
import simrob_drake.extensions.course.measuring as measuring
measuring.Reading.__init__ = lambda self, *_, **__: vars(self).update(value=9.0, unit="", least=0.0, most=99.0)
""",
    """
import gc
for found in gc.get_objects():
    if getattr(found, "__name__", "") == "point_0":
        found.__code__ = (lambda answer: None).__code__
""",
]


@pytest.mark.parametrize("cheat", CHEATS)
def test_an_answer_cannot_change_what_measures_it(tmp_path, cheat):
    entry = own_exercise(tmp_path / "own", "return at_least(number(answer, 'f'), 2)")
    (point,) = checked(entry, tmp_path, f"{cheat}\ndef f():\n    return 1.0\n")
    assert not point.ok
    assert point.reading is not None
    assert point.reading.value == 1.0


def test_values_pass_between_the_processes_whole(tmp_path):
    entry = own_exercise(
        tmp_path / "own",
        "value = {'a': [1, (2.5, None)], 3: 'x'}; return at_least(value_of(answer, 'same', value) == value, 1)",
        "return near(numbers(answer, 'twice', [[1.0, 2.0]], shape=(1, 2))[0, 1], 4, 0)",
        "return near(answer.LENGTH, 0.5, 0)",
        "return at_least(value_of(answer, 'made'), 0)",
    )
    text = """
import numpy as np
LENGTH = 0.5
same = lambda x: x
twice = lambda x: 2 * np.array(x)
made = lambda: object()
"""
    points = checked(entry, tmp_path, text)
    assert [point.ok for point in points] == [True, True, True, False]
    assert "is of object; it must be numbers, texts, lists, mappings or arrays" in points[3].problem


def test_sets_in_sets_pass_between_the_processes():
    value = {"groups": {frozenset({1, 2}), frozenset()}, frozenset({3}): ({4},)}
    assert decode(json.loads(json.dumps(encode(value)))) == value


def test_a_second_exercise_in_the_same_folder_gets_a_folder_proposed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_command(["course", "start", "1"])
    assert run_command(["course", "start", "2"]) == ExitCode.BAD_INPUT
    assert (
        "answer.py exists already; choose another folder, such as --out exercise-2"
        in capsys.readouterr().err
    )
    assert "Exercise 1" in Path("answer.py").read_text()


def test_a_point_is_ok_or_fails_or_is_missing_or_has_an_error(tmp_path):
    entry = own_exercise(
        tmp_path / "own",
        "return at_least(answer.f(), 1)",
        "return at_least(answer.f(), 3)",
        "return at_least(answer.g(), 0)",
        "return at_least(answer.h(), 0)",
    )
    text = "def f():\n  return 2\ndef g():\n  raise NotImplementedError\ndef h():\n  return 1 / 0\n"
    assert [point.state for point in checked(entry, tmp_path, text)] == [
        "ok",
        "fails",
        "missing",
        "error",
    ]


class TestSubmissions:
    """A folder of answers, as a learning platform packs them."""

    @pytest.fixture
    def submissions(self, tmp_path):
        """Five submissions in both shapes, and files that are none."""
        folder = tmp_path / "handed_in"
        files = {
            "ana.py": "def f():\n  return 2\n",
            "bo.py": "def f():\n  return 0\n",
            "=cmd.py": "import sys\nsys.exit(3)\n",
            "Eva_123_file_/work/solution.py": "def f():\n  raise NotImplementedError\n",
            "Dan_124_file_/a.py": "",
            "Dan_124_file_/b.py": "",
            "__pycache__/x.py": "",
            ".hidden.py": "",
            "notes.txt": "",
        }
        for name, text in files.items():
            file = folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        return folder

    def test_all_are_measured_into_one_table(self, submissions, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        own_exercise(tmp_path / "own", "return at_least(answer.f(), 1, 'N')")
        arguments = [
            "course",
            "check",
            str(tmp_path / "own"),
            str(submissions),
            "--allow-code",
            "--csv",
            "points.csv",
        ]
        assert run_command(arguments) == ExitCode.DONE
        rows = list(csv.DictReader(Path("points.csv").read_text().splitlines()))
        columns = ("points that hold", "point 0", "point 0: measured [N]")
        states = {row["submission"]: tuple(row[column] for column in columns) for row in rows}
        assert states == {
            "'=cmd": ("0", "", ""),
            "Dan_124_file_": ("0", "", ""),
            "Eva_123_file_": ("0", "missing", ""),
            "ana": ("1", "ok", "2"),
            "bo": ("0", "fails", "0"),
        }
        problems = {row["submission"]: row["problem"] for row in rows if row["problem"]}
        assert "SystemExit: 3" in problems["'=cmd"]
        assert problems["Dan_124_file_"] == "it contains no answer.py, nor a single Python file"
        shown = capsys.readouterr().out
        assert "1/1     ana" in shown
        assert run_command(arguments) == ExitCode.BAD_INPUT
        assert "points.csv exists already" in capsys.readouterr().err

    def test_the_folder_of_one_student_is_one_answer(self, tmp_path, monkeypatch, capsys):
        """It was taken for a folder of submissions, and nothing but `0/1 answer` was said."""
        monkeypatch.chdir(tmp_path)
        own_exercise(tmp_path / "own", "return at_least(answer.f(), 1, 'N')")
        student = tmp_path / "student"
        student.mkdir()
        (student / "answer.py").write_text("def f():\n  return 2\n")
        (student / "notes.txt").write_text("")

        assert run_command(["course", "check", "own", "student", "--allow-code"]) == ExitCode.DONE

        assert "point 0: measured 2 N" in capsys.readouterr().out
        assert not list(tmp_path.glob("*.csv"))

    def test_the_table_is_in_the_language_of_the_course(
        self, submissions, tmp_path, monkeypatch, capsys
    ):
        """Headings, states and problems; numbers keep their point, which programs read."""
        monkeypatch.chdir(tmp_path)
        (submissions / "cy.py").write_text("def f():\n  return [1, 2]\n")
        (submissions / "di.py").write_text("def f():\n  return 1 / 0\n")
        own_exercise(tmp_path / "own", "return at_least(number(answer, 'f') / 4, 0.3, 'N')")
        arguments = [
            "course",
            "check",
            "own",
            str(submissions),
            "--allow-code",
            "--csv",
            "a.csv",
            "--language",
            "es",
        ]
        assert run_command(arguments) == ExitCode.DONE
        rows = list(csv.DictReader(Path("a.csv").read_text(encoding="utf-8").splitlines()))
        head = [
            "entrega",
            "puntos que se cumplen",
            "puntos del ejercicio",
            "punto 0",
            "punto 0: medido [N]",
            "problema",
        ]
        assert list(rows[0]) == head
        by_name = {row["entrega"]: row for row in rows}
        states = {name: row["punto 0"] for name, row in by_name.items()}
        assert states == {
            "'=cmd": "",
            "Dan_124_file_": "",
            "Eva_123_file_": "falta",
            "ana": "bien",
            "bo": "falla",
            "cy": "error",
            "di": "error",
        }
        assert by_name["ana"]["punto 0: medido [N]"] == "0.5"
        assert (
            by_name["Dan_124_file_"]["problema"]
            == "no contiene answer.py, ni un solo fichero de Python"
        )
        assert (
            "lo que devuelve f() es [1, 2]; debe ser un número finito" in by_name["cy"]["problema"]
        )
        assert by_name["di"]["problema"].endswith("(di.py, línea 2)")

    def test_no_code_runs_and_nothing_is_written_unless_allowed(
        self, submissions, tmp_path, monkeypatch, capsys
    ):
        monkeypatch.chdir(tmp_path)
        assert run_command(["course", "check", "1", str(submissions)]) == ExitCode.BAD_INPUT
        assert "--allow-code" in capsys.readouterr().err
        assert not list(tmp_path.glob("*.csv"))

    def test_bad_input_is_refused(self, submissions, tmp_path, capsys):
        (tmp_path / "empty").mkdir()
        command = ["course", "check", "1", "--allow-code", "--csv"]
        assert (
            run_command([*command, str(tmp_path / "a.csv"), str(tmp_path / "empty")])
            == ExitCode.BAD_INPUT
        )
        assert "a folder of submissions" in capsys.readouterr().err
        assert (
            run_command([*command, str(tmp_path / "a.txt"), str(submissions)]) == ExitCode.BAD_INPUT
        )
        assert "--csv" in capsys.readouterr().err
        assert (
            run_command([*command, str(tmp_path / "a.csv"), str(submissions / "ana.py")])
            == ExitCode.BAD_INPUT
        )
        assert "it is for a folder of submissions" in capsys.readouterr().err
