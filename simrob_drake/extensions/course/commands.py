"""The command of the course: course list, start and check."""

from math import isinf
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.cli import ExitCode
from simrob_drake.cli.options import Force
from simrob_drake.cli.screen import console, errors, say, table
from simrob_drake.extensions.course.exercise import MEMORY, SECONDS, Language, checked_points, exercise_of, exercises

_ExerciseArgument = Annotated[
    str, typer.Argument(metavar="EXERCISE", help="A number of `simrob course list`, or the folder of one of your own.")
]
_Spoken = Annotated[Language, typer.Option("--language", help="Of titles, templates and points.")]


def teaching() -> None:
    """Work through the course: list its exercises, start an answer, check it."""


def list_exercises(language: _Spoken = "en") -> None:
    """List the exercises, and how long each takes a student."""
    every = [entry.exercise for entry in exercises()]
    rows = [(str(one.number), one.title.of(language), f"{one.hours:g}") for one in every]
    console.print(table(("", "exercise", "hours"), *rows, numbers=False))


def start(
    exercise: _ExerciseArgument,
    out: Annotated[Path, typer.Option(help="Folder that takes the template, as answer.py.")] = Path(),
    language: _Spoken = "en",
    force: Force = False,
) -> None:
    """Begin an answer: copy the template of an exercise.

    For example:

        simrob course start 3 --out exercise_3
    """
    answer = exercise_of(exercise).start(out, language, force=force)
    say(f"answer  {answer}")
    spoken = "" if language == "en" else f" --language {language}"
    next_step = f"simrob course check {exercise} {answer} --allow-code{spoken}"
    say(f"next    {next_step}")


def check(
    exercise: _ExerciseArgument,
    answer: Annotated[Path, typer.Argument(metavar="ANSWER", help="A Python file, which is run.")],
    allow_code: Annotated[bool, typer.Option("--allow-code", help="Run the code of the answer.")] = False,
    language: _Spoken = "en",
    seconds: Annotated[float, typer.Option(min=1, max=86400, help="That all points may take [s].")] = SECONDS,
    memory: Annotated[float, typer.Option(min=0.6, max=1000, help="That the answer may take [GB].")] = MEMORY,
) -> ExitCode:
    """Measure an answer, in one line a point; the exit code is 0 if all hold, and 4 if one is missing.

    The answer runs in a process of its own, with limits of time and memory.

    For example:

        simrob course check 3 exercise_3/answer.py --allow-code
    """
    entry, words = exercise_of(exercise), read_yaml(Path(__file__).with_suffix(".yaml"))[language]
    texts, held = entry.exercise.points, 0
    with errors.status(Text(f"{entry.exercise.title.of(language)}: {answer}")):
        for point in checked_points(entry, answer, allow_code=allow_code, seconds=seconds, memory=memory):
            held += point.ok
            found = point.problem or words["unwritten"]
            if point.reading is not None:
                value = _with_unit(f"{point.reading.value:.4g}", point.reading.unit)
                kind = "most" if isinf(point.reading.least) else "least" if isinf(point.reading.most) else "near"
                ends = [f"{bound:.4g}" for bound in (point.reading.least, point.reading.most) if not isinf(bound)]
                asked = _with_unit(words[kind].format(*ends), point.reading.unit)
                found = f"{words['measured']} {value}; {words['asked']} {asked}"
            mark, style = (words["ok"], "green") if point.ok else (words["missing"], "red")
            say(Text.assemble((f"{mark:8}", style), f"{texts[point.name].of(language)}: {found}"))
    console.print(words["points"].format(held, len(texts)), highlight=False)
    return ExitCode.DONE if held == len(texts) else ExitCode.BEYOND


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}".strip()
