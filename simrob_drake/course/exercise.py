"""An exercise of the course: a folder with its description, its templates and its checks."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.files import EXERCISE_FILE, exercise_files, text_of
from simrob_drake.folders import written_at_once
from simrob_drake.sections import Integer, Number, Strict, validated
from simrob_drake.yaml_files import read_yaml

Language = Literal["en", "es"]
CHECKS_FILE, ANSWER_FILE = "check.py", "answer.py"
"""What the checks of an exercise are called, and an answer that is begun from its template."""


class BothLanguages(Strict):
    """A text in English and in Spanish."""

    en: str
    es: str

    def of(self, language: Language) -> str:
        """Return the text in a language."""
        return self.en if language == "en" else self.es


class Exercise(Strict):
    """What ``exercise.yaml`` holds: the number and title of an exercise, and the text of each point.

    Each point is a function of ``check.py`` of the same name: it takes the answer, a module, and returns what it
    measured (:mod:`simrob_drake.course.measuring`).
    """

    number: Integer = Field(ge=1, le=99)
    """In the order of the course."""
    title: BothLanguages
    hours: Number = Field(gt=0, le=10)
    """That it takes a student, about [h]."""
    points: dict[str, BothLanguages] = Field(min_length=1)
    """What each point asks, by the name of its function."""


class ExerciseFolder:
    """An exercise and where it lies.

    Attributes:
        folder: with ``exercise.yaml``, ``check.py`` and a ``template_<language>.py`` for each language.
        exercise: what ``exercise.yaml`` holds.
    """

    def __init__(self, folder: Path) -> None:
        """Read the description of an exercise; raises InvalidConfig: it cannot be read, or an entry cannot be."""
        file = folder / EXERCISE_FILE
        self.folder, self.exercise = folder, validated(Exercise, read_yaml(file), file)

    @property
    def checks(self) -> Path:
        """The file whose functions measure an answer."""
        return self.folder / CHECKS_FILE

    def start(self, target: Path, language: Language, *, force: bool) -> Path:
        """Copy an answer's template to a folder, return it; raises InvalidParameter: one is there; OutputError."""
        answer = target / ANSWER_FILE
        if answer.exists() and not force:
            raise InvalidParameter("--out", str(target), f"without an {ANSWER_FILE}, or say --force to replace it")
        written_at_once(answer, text_of(self.folder / f"template_{language}.py"))
        return answer


def exercises() -> list[ExerciseFolder]:
    """Return the exercises that come with the package, in the order of the course."""
    found = [ExerciseFolder(file.parent) for file in exercise_files()]
    return sorted(found, key=lambda entry: entry.exercise.number)


def exercise_of(name: str) -> ExerciseFolder:
    """Return an exercise by its number, or by its folder: a teacher's own.

    Raises UnknownName: there is none of this number, and no folder with an ``exercise.yaml``; InvalidConfig: its
    description cannot be.
    """
    if (Path(name) / EXERCISE_FILE).is_file():
        return ExerciseFolder(Path(name))
    known = {str(entry.exercise.number): entry for entry in exercises()}
    number = name.lstrip("0")
    if number not in known:
        raise UnknownName(f"exercise, nor folder with an {EXERCISE_FILE}, called", name, known)
    return known[number]
