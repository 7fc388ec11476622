"""The exercises of the course, as the folders describe them, and answers to them, checked point by point."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, cast

from pydantic import Field

from simrob_drake.base.errors import InvalidConfig, OutputError, SimrobError, UnknownName, shorten
from simrob_drake.base.files import EXERCISE_FILE, NotRead, content_of, exercise_files, text_of
from simrob_drake.base.folders import written_at_once
from simrob_drake.base.messages import compound, message, output_language
from simrob_drake.base.sections import Integer, Number, Strict, validate_section
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.course.measuring import Reading

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
    measured (:mod:`simrob_drake.extensions.course.measuring`).
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
        self.folder, self.exercise = folder, validate_section(Exercise, read_yaml(file), file)

    @property
    def checks(self) -> Path:
        """The file whose functions measure an answer."""
        return self.folder / CHECKS_FILE

    def start(self, target: Path, language: Language, *, force: bool) -> Path:
        """Copy the template of an answer to a folder.

        Args:
            target: the folder.
            language: language of the template's comments.
            force: whether an answer that is there may be replaced.

        Returns:
            the new file.

        Raises:
            OutputError: the folder has an answer already, or cannot be written.
        """
        answer = target / ANSWER_FILE
        if answer.exists() and not force:
            proposal = target.parent / f"exercise-{self.exercise.number}"
            raise OutputError(
                message(
                    "course.answer_exists",
                    "{answer} exists already; choose another folder, such as --out {proposal},"
                    " or replace the answer with --force",
                    answer=answer,
                    proposal=proposal,
                )
            )
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
        raise UnknownName(
            message(
                "course.no_exercise",
                "exercise, nor folder with an {file}, called",
                file=EXERCISE_FILE,
            ),
            name,
            known,
        )
    return known[number]


SECONDS, MEMORY = 120.0, 2.0
"""What an answer may take unless asked otherwise: time [s], and memory [GB]. A Drake process begins with half a GB."""
_CHILD = "simrob_drake.extensions.course.child"
_SETTINGS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}


class AnswerStopped(SimrobError):
    """An answer that could not be measured to its end: it cannot be loaded, or passed a limit."""


PointState = Literal["ok", "fails", "missing", "error"]
"""State of a point: it holds; its value is out of bounds; its function is not written yet; or it cannot be measured."""


@dataclass(frozen=True)
class CheckedPoint:
    """A point of an exercise, measured on an answer.

    Attributes:
        name: name of the point.
        reading: the measured value with its bounds. None if it could not be measured.
        problem: why it could not be measured; empty if it was, or if its function is not written yet.
    """

    name: str
    reading: Reading | None
    problem: str = ""

    @property
    def ok(self) -> bool:
        """Whether the point holds."""
        return self.state == "ok"

    @property
    def state(self) -> PointState:
        """State of the point."""
        if self.reading is not None:
            return "ok" if self.reading.ok else "fails"
        return "error" if self.problem else "missing"


def checked_points(
    entry: ExerciseFolder,
    answer: Path,
    *,
    allow_code: bool,
    seconds: float = SECONDS,
    memory: float = MEMORY,
) -> Iterator[CheckedPoint]:
    """Yield what became of each point of an exercise, once it was measured on an answer, a Python file that is run.

    The limits are of all points: ``seconds`` [s], ``memory`` [GB]. Raises InvalidConfig: the file cannot be read, or
    code is not allowed; AnswerStopped: it cannot be loaded, or passed a limit.
    """
    try:
        content_of(answer)
    except NotRead as problem:
        raise InvalidConfig(
            answer,
            "",
            message("course.cannot_be_read", "cannot be read ({problem})", problem=problem),
        ) from problem
    if not allow_code:
        raise InvalidConfig(
            answer,
            "",
            message(
                "course.code_to_run", "is code that would be run; if you trust it, say --allow-code"
            ),
        )
    names = list(entry.exercise.points)
    job = {
        "checks": str(entry.checks.resolve()), "answer": str(answer.resolve()), "points": names,
        "language": output_language(), "memory": memory * 1e9, "seconds": seconds,
    }  # fmt: skip
    for name, reply in zip(names, _replies(job, answer, seconds, memory), strict=True):
        failed = reply.pop("problem", None)
        yield (
            CheckedPoint(name, None, failed)
            if failed is not None
            else CheckedPoint(name, Reading(**reply))
        )


def _replies(
    job: dict[str, Any], answer: Path, seconds: float, memory: float
) -> Iterator[dict[str, Any]]:
    """Yield what the process says of each point."""
    path = os.pathsep.join(folder for folder in sys.path if folder)
    command = [sys.executable, "-P", "-X", "utf8", "-m", _CHILD]
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            command,
            env={**os.environ, **_SETTINGS, "PYTHONPATH": path},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,  # so that what it starts ends with it
        ) as child,
    ):
        late = threading.Event()
        timer = threading.Timer(seconds, _end_late, (child, late))
        timer.start()
        try:
            requests = cast(IO[bytes], child.stdin)
            requests.write(json.dumps(job).encode() + b"\n")
            requests.close()
            for _ in job["points"]:
                line = cast(IO[bytes], child.stdout).readline()
                reply = (
                    json.loads(line)
                    if line
                    else {"problem": _why(child, errors, late.is_set(), seconds, memory)}
                )
                if "point" not in reply:
                    problem = (
                        _out_of_memory(memory) if reply["problem"] == "memory" else reply["problem"]
                    )
                    raise AnswerStopped(
                        compound("{answer}: {problem}", answer=answer, problem=problem)
                    )
                yield {key: value for key, value in reply.items() if key != "point"}
        finally:
            timer.cancel()
            _end(child)


def _end_late(child: subprocess.Popen[bytes], late: threading.Event) -> None:
    late.set()
    _end(child)


def _end(child: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)


def _out_of_memory(memory: float) -> str:
    return message(
        "course.took_too_much_memory",
        "took more than its {memory:g} GB of memory; --memory gives it another limit",
        memory=memory,
    )


def _why(
    child: subprocess.Popen[bytes], errors: IO[bytes], late: bool, seconds: float, memory: float
) -> str:
    """Return why a process said nothing more."""
    code = child.wait()
    if late or code == -signal.SIGXCPU:
        return message(
            "course.took_too_long",
            "took longer than its {seconds:g} s; --seconds gives it another limit",
            seconds=seconds,
        )
    errors.seek(0)
    lines = errors.read(100_000).decode("utf-8", errors="replace").strip().splitlines()
    said = shorten(lines[-1], 300) if lines else message("course.without_a_word", "without a word")
    if "bad_alloc" in said or "MemoryError" in said:
        return _out_of_memory(memory)
    return message(
        "course.ended_too_early",
        "ended its process before all points were measured (exit code {code}, {said})",
        code=code,
        said=said,
    )
