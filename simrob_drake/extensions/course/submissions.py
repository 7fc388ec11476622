"""Submissions of a class: the answers in a folder, and the table of points that a teacher gets for them."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.messages import in_language, message
from simrob_drake.extensions.course.exercise import (
    ANSWER_FILE,
    AnswerStopped,
    CheckedPoint,
    ExerciseFolder,
    Language,
    checked_points,
)

_FORMULA_SIGNS = ("=", "+", "-", "@", "\t")
"""First characters that make a spreadsheet take a cell as a formula. Names of submissions are chosen by students."""


@dataclass(frozen=True)
class Submission:
    """The answer of one student, or of one group.

    Attributes:
        name: name of the file without its ending, or of the folder.
        answer: the Python file with the answer. None if the folder has none, or several and none called ``answer.py``.
    """

    name: str
    answer: Path | None


@dataclass(frozen=True)
class CheckedSubmission:
    """A submission and its points.

    Attributes:
        name: name of the submission.
        points: the points in the order of the exercise; empty if the answer could not be measured.
        problem: why the answer could not be measured; empty if it was.
    """

    name: str
    points: Sequence[CheckedPoint]
    problem: str = ""

    @property
    def passed(self) -> int:
        """Number of points that hold."""
        return sum(point.ok for point in self.points)


def only_answer(folder: Path) -> Path | None:
    """Find the answer in the folder of one student: ``answer.py``, where nothing else could be a submission.

    Returns None for a folder of submissions, and for a file.
    """
    if not folder.is_dir():
        return None
    candidates = [
        entry
        for entry in folder.iterdir()
        if not _is_ignored(entry) and (entry.is_dir() or entry.suffix == ".py")
    ]
    is_only = [candidate.name for candidate in candidates] == [ANSWER_FILE]
    return candidates[0] if is_only else None


def find_submissions(folder: Path) -> list[Submission]:
    """Find the submissions in a folder, ordered by name.

    A Python file is a submission. So is a folder, as learning platforms pack them: its answer is its ``answer.py``, or
    its only Python file, at any depth. Files and folders whose names begin with a dot or an underscore are ignored.

    Raises:
        InvalidParameter: the folder contains no submission.
    """
    submissions = []
    for entry in sorted(folder.iterdir()):
        if _is_ignored(entry):
            continue
        if entry.is_dir():
            submissions.append(Submission(entry.name, _find_answer(entry)))
        elif entry.suffix == ".py":
            submissions.append(Submission(entry.stem, entry))
    if not submissions:
        expected = message(
            "course.file_or_submissions",
            "a Python file, or a folder of submissions: files or folders of students",
        )
        raise InvalidParameter("ANSWER", str(folder), expected)
    return submissions


def check_submission(
    exercise: ExerciseFolder, submission: Submission, *, seconds: float, memory: float
) -> CheckedSubmission:
    """Measure a submission. An answer that cannot be measured is reported in the result, so that the others go on.

    Args:
        exercise: the exercise.
        submission: the submission. Its code is run.
        seconds: time limit of all points of the submission [s].
        memory: memory limit of the submission [GB].
    """
    if submission.answer is None:
        problem = message(
            "course.no_answer", "it contains no {file}, nor a single Python file", file=ANSWER_FILE
        )
        return CheckedSubmission(submission.name, (), problem)
    try:
        points = list(
            checked_points(
                exercise, submission.answer, allow_code=True, seconds=seconds, memory=memory
            )
        )
    except AnswerStopped as stopped:
        return CheckedSubmission(submission.name, (), stopped.message)
    return CheckedSubmission(submission.name, points)


def points_table(
    exercise: ExerciseFolder,
    submissions: Sequence[CheckedSubmission],
    words: Mapping[str, str],
    language: Language,
) -> str:
    """Write the points of all submissions as CSV, one line for each submission.

    The columns are the submission, the number of points that hold, the number of points of the exercise, then for each
    point its state (ok, fails, missing or error) and its measured value, and last the problem that kept the submission
    or its points from being measured. Commas separate the columns, and numbers have a decimal point in any language, so
    that programs read the file without knowing its language.

    Args:
        exercise: the exercise.
        submissions: the submissions that are measured.
        words: words of the language: states and headings.
        language: language of the texts of points and of problems.
    """
    texts = exercise.exercise.points
    names = list(texts)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    point_columns: list[str] = []
    for name in names:
        heading = texts[name].of(language)
        unit = _unit_of(name, submissions)
        point_columns += [heading, f"{heading}: {words['measured']}{f' [{unit}]' if unit else ''}"]
    writer.writerow(
        [words["submission"], words["passed"], words["count"], *point_columns, words["problem"]]
    )
    for submission in submissions:
        by_name = {point.name: point for point in submission.points}
        cells: list[str] = []
        problems = [in_language(submission.problem, language)] if submission.problem else []
        for name in names:
            point = by_name.get(name)
            cells += ["", ""] if point is None else [words[point.state], _value_cell(point)]
            if point is not None and point.problem:
                problems.append(f"{name}: {in_language(point.problem, language)}")
        first_cells = [_text_cell(submission.name), str(submission.passed), str(len(names))]
        writer.writerow([*first_cells, *cells, _text_cell("; ".join(problems))])
    return text.getvalue()


def _is_ignored(entry: Path) -> bool:
    """Whether a file or folder is no submission: hidden, or made by Python or by an operating system."""
    return entry.name.startswith((".", "_"))


def _find_answer(folder: Path) -> Path | None:
    """Find the Python file with the answer in a student's folder. Returns None if it is not clear which it is."""
    files = [
        file
        for file in sorted(folder.rglob("*.py"))
        if not any(_is_ignored(folder / part) for part in file.relative_to(folder).parts)
    ]
    named = [file for file in files if file.name == ANSWER_FILE]
    candidates = named or files
    return candidates[0] if len(candidates) == 1 else None


def _unit_of(name: str, submissions: Sequence[CheckedSubmission]) -> str:
    """Unit of the measured values of a point; empty if they have none, or if no submission has a value."""
    readings = [
        point.reading
        for submission in submissions
        for point in submission.points
        if point.name == name
    ]
    return next((reading.unit for reading in readings if reading is not None), "")


def _value_cell(point: CheckedPoint) -> str:
    """Measured value of a point, without its unit; empty if it could not be measured."""
    return "" if point.reading is None else f"{point.reading.value:.6g}"


def _text_cell(text: str) -> str:
    """Cell with a text that a student can choose. A spreadsheet must not evaluate it as a formula."""
    return f"'{text}" if text.startswith(_FORMULA_SIGNS) else text
