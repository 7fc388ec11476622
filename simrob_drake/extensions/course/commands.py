"""The commands of the course: course list, start and check."""

from collections.abc import Mapping, Sequence
from math import isinf
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from simrob_drake.base.errors import InvalidConfig, Unsuitable
from simrob_drake.base.folders import check_ending, check_new_file, written_at_once
from simrob_drake.base.messages import in_language, message, set_output_language, with_decimal_sign
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.cli import ExitCode
from simrob_drake.cli.language import LANGUAGE_VARIABLE
from simrob_drake.cli.options import Force
from simrob_drake.cli.screen import console, errors, say, table
from simrob_drake.extensions.course.exercise import (
    MEMORY,
    SECONDS,
    CheckedPoint,
    ExerciseFolder,
    Language,
    PointState,
    checked_points,
    exercise_of,
    exercises,
)
from simrob_drake.extensions.course.measuring import Reading
from simrob_drake.extensions.course.submissions import (
    CheckedSubmission,
    check_submission,
    find_submissions,
    only_answer,
    points_table,
)

_STYLES: dict[PointState, str] = {
    "ok": "green",
    "fails": "red",
    "missing": "yellow",
    "error": "red",
}
_STATE_WIDTH = 8  # characters; the longest word for a state and a space

_ExerciseArgument = Annotated[
    str,
    typer.Argument(
        metavar="EXERCISE",
        help=message(
            "course.help_exercise_argument",
            "A number of `simrob course list`, or the folder of one of your own.",
        ),
    ),
]
_Spoken = Annotated[
    Language,
    typer.Option(
        "--language",
        envvar=LANGUAGE_VARIABLE,
        help=message("course.help_spoken", "Language of titles, templates, points and errors."),
    ),
]


def teaching() -> None:
    """Work through the course: list its exercises, start an answer, check it."""


def list_exercises(language: _Spoken = "en") -> None:
    """List the exercises, and how long each takes a student."""
    set_output_language(language)
    words = _words(language)
    rows = []
    for entry in exercises():
        exercise = entry.exercise
        rows.append(
            (
                str(exercise.number),
                exercise.title.of(language),
                with_decimal_sign(f"{exercise.hours:g}"),
            )
        )
    console.print(table(("", words["exercise"], words["hours"]), *rows, numbers=False))


def start(
    exercise: _ExerciseArgument,
    out: Annotated[
        Path,
        typer.Option(
            help=message("course.help_start_out", "Folder that takes the template, as answer.py.")
        ),
    ] = Path(),
    language: _Spoken = "en",
    force: Force = False,
) -> None:
    """Begin an answer: copy the template of an exercise.

    For example:

        simrob course start 3 --out exercise-3
    """
    set_output_language(language)
    words = _words(language)
    answer = exercise_of(exercise).start(out, language, force=force)
    say(f"{words['answer']:<10}{answer}")
    language_option = "" if language == "en" else f" --language {language}"
    say(f"{words['next']:<10}simrob course check {exercise} {answer} --allow-code{language_option}")


def check(
    exercise: _ExerciseArgument,
    answer: Annotated[
        Path,
        typer.Argument(
            metavar="ANSWER",
            help=message(
                "course.help_check_answer",
                "A Python file, which is run, or a folder with answer.py alone; or a folder of submissions.",
            ),
        ),
    ],
    allow_code: Annotated[
        bool,
        typer.Option(
            "--allow-code",
            help=message("course.help_check_allow_code", "Run the code of the answer."),
        ),
    ] = False,
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            help=message(
                "course.help_check_csv",
                "File for the points of all submissions; only for a folder.",
            ),
        ),
    ] = None,
    language: _Spoken = "en",
    seconds: Annotated[
        float,
        typer.Option(
            min=1,
            max=86400,
            help=message("course.help_check_seconds", "Time limit of all points of an answer [s]."),
        ),
    ] = SECONDS,
    memory: Annotated[
        float,
        typer.Option(
            min=0.6,
            max=1000,
            help=message("course.help_check_memory", "Memory limit of an answer [GB]."),
        ),
    ] = MEMORY,
    force: Force = False,
) -> ExitCode:
    """Measure an answer, in one line a point; the exit code is 0 if all points hold, and 4 if not.

    A point is ok, fails (its value is out of bounds), is missing (its function is not written yet), or has an error.
    The answer runs in a process of its own, with limits of time and memory. For a folder of submissions, one Python
    file or one folder a student, the points of all of them are written to a table, and the exit code is 0 once it is
    written.

    For example:

        simrob course check 3 exercise-3/answer.py --allow-code
        simrob course check 3 submissions/ --allow-code --csv points.csv
    """
    set_output_language(language)
    entry = exercise_of(exercise)
    # The folder of one answer, as `course start` makes it, is that answer.
    only_file = only_answer(answer)
    if only_file is not None and csv is None:
        answer = only_file
    if answer.is_dir():
        _check_folder(
            entry,
            answer,
            csv,
            language,
            allow_code=allow_code,
            seconds=seconds,
            memory=memory,
            force=force,
        )
        return ExitCode.DONE
    if csv is not None:
        problem = message(
            "course.only_for_folders",
            "it is for a folder of submissions, and this is a single answer",
        )
        raise Unsuitable("--csv", problem)
    words = _words(language)
    texts = entry.exercise.points
    passed = 0
    with errors.status(Text(f"{entry.exercise.title.of(language)}: {answer}")):
        for point in checked_points(
            entry, answer, allow_code=allow_code, seconds=seconds, memory=memory
        ):
            passed += point.ok
            mark = (f"{words[point.state]:{_STATE_WIDTH}}", _STYLES[point.state])
            say(
                Text.assemble(mark, f"{texts[point.name].of(language)}: {_result(point, language)}")
            )
    console.print(words["points"].format(passed, len(texts)), highlight=False)
    return ExitCode.DONE if passed == len(texts) else ExitCode.BEYOND


def _check_folder(
    entry: ExerciseFolder,
    folder: Path,
    csv: Path | None,
    language: Language,
    *,
    allow_code: bool,
    seconds: float,
    memory: float,
    force: bool,
) -> None:
    """Measure all submissions in a folder, print a line for each, and write the table of their points.

    The options are those of the command. The table is written after each submission, so that an interrupt loses
    nothing.

    Raises:
        InvalidConfig: code is not allowed.
        InvalidParameter: the folder has no submission, or the name of the table does not end in ``.csv``.
        OutputError: the table exists, or cannot be written.
    """
    words = _words(language)
    if not allow_code:
        problem = message(
            "course.code_in_folder",
            "contains code that would be run; if you trust it, say --allow-code",
        )
        raise InvalidConfig(folder, "", problem)
    file = Path(f"exercise-{entry.exercise.number}.csv") if csv is None else csv
    check_ending(file, (".csv",), "--csv")
    check_new_file(file, force=force)
    submissions = find_submissions(folder)
    checked: list[CheckedSubmission] = []
    for number, submission in enumerate(submissions, start=1):
        with errors.status(Text(f"{number}/{len(submissions)} {submission.name}")):
            checked.append(check_submission(entry, submission, seconds=seconds, memory=memory))
        written_at_once(file, points_table(entry, checked, words, language))
        say(_submission_line(checked[-1], len(entry.exercise.points), language))
    say(f"{words['table']:<10}{file}")


def _submission_line(submission: CheckedSubmission, count: int, language: Language) -> Text:
    """Line that reports a submission: its points, or why it could not be measured."""
    words = _words(language)
    is_complete = submission.passed == count
    style = "red" if submission.problem else "green" if is_complete else "yellow"
    mark = words["error"] if submission.problem else f"{submission.passed}/{count}"
    problem = in_language(submission.problem, language)
    text = f"{submission.name}: {problem}" if problem else submission.name
    return Text.assemble((f"{mark:{_STATE_WIDTH}}", style), text)


def _result(point: CheckedPoint, language: Language) -> str:
    """Measured value of a point and its bounds in words; or why there is none."""
    words = _words(language)
    if point.reading is None:
        return in_language(point.problem, language) or words["unwritten"]
    value = _with_unit(with_decimal_sign(f"{point.reading.value:.4g}"), point.reading.unit)
    return f"{words['measured']} {value}; {words['asked']} {_bounds(point.reading, words)}"


def _bounds(reading: Reading, words: Mapping[str, str]) -> str:
    """Bounds of a value in words, with its unit: "at most 2 N", "2.5 to 3.5"."""
    ends: Sequence[float] = [bound for bound in (reading.least, reading.most) if not isinf(bound)]
    if isinf(reading.least):
        template = words["most"]
    elif isinf(reading.most):
        template = words["least"]
    else:
        template = words["near"]
    text = template.format(*(with_decimal_sign(f"{bound:.4g}") for bound in ends))
    return _with_unit(text, reading.unit)


def _with_unit(text: str, unit: str) -> str:
    """Number with its unit, if it has one."""
    return f"{text} {unit}".strip()


def _words(language: Language) -> dict[str, str]:
    """Words of the course's output in a language."""
    words: dict[str, str] = read_yaml(Path(__file__).with_suffix(".yaml"))[language]
    return words
