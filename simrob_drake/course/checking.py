"""Measure an answer to an exercise in a process of its own, with limits of time and memory."""

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
from typing import IO, Any, cast

from simrob_drake.course.exercise import ExerciseFolder
from simrob_drake.course.measuring import Reading
from simrob_drake.errors import InvalidConfig, SimrobError, shortened
from simrob_drake.files import NotRead, content_of

SECONDS, MEMORY = 120.0, 2.0
"""What an answer may take unless asked otherwise: time [s], and memory [GB]. A Drake process begins with half a GB."""
_CHILD = "simrob_drake.course.child"
_SETTINGS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}


class AnswerStopped(SimrobError):
    """An answer that could not be measured to its end: it cannot be loaded, or passed a limit."""


@dataclass(frozen=True)
class CheckedPoint:
    """What became of one point."""

    name: str  # of the point
    reading: Reading | None  # what was measured; None where measuring failed
    problem: str = ""  # why it failed; empty where the answer is not written yet

    @property
    def ok(self) -> bool:
        """Whether the point holds."""
        return self.reading is not None and self.reading.ok


def checked_points(
    entry: ExerciseFolder, answer: Path, *, allow_code: bool, seconds: float = SECONDS, memory: float = MEMORY
) -> Iterator[CheckedPoint]:
    """Yield what became of each point of an exercise, once it was measured on an answer, a Python file that is run.

    The limits are of all points: ``seconds`` [s], ``memory`` [GB]. Raises InvalidConfig: the file cannot be read, or
    code is not allowed; AnswerStopped: it cannot be loaded, or passed a limit.
    """
    try:
        content_of(answer)
    except NotRead as problem:
        raise InvalidConfig(answer, "", f"cannot be read ({problem})") from problem
    if not allow_code:
        raise InvalidConfig(answer, "", "is code that would be run; if you trust it, say --allow-code")
    names = list(entry.exercise.points)
    job = {
        "checks": str(entry.checks.resolve()), "answer": str(answer.resolve()), "points": names,
        "memory": memory * 1e9, "seconds": seconds,
    }  # fmt: skip
    for name, reply in zip(names, _replies(job, answer, seconds, memory), strict=True):
        failed = reply.pop("problem", None)
        yield CheckedPoint(name, None, failed) if failed is not None else CheckedPoint(name, Reading(**reply))


def _replies(job: dict[str, Any], answer: Path, seconds: float, memory: float) -> Iterator[dict[str, Any]]:
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
                reply = json.loads(line) if line else {"problem": _why(child, errors, late.is_set(), seconds, memory)}
                if "point" not in reply:
                    problem = _out_of_memory(memory) if reply["problem"] == "memory" else reply["problem"]
                    raise AnswerStopped(f"{answer}: {problem}")
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
    return f"took more than its {memory:g} GB of memory; --memory gives it another limit"


def _why(child: subprocess.Popen[bytes], errors: IO[bytes], late: bool, seconds: float, memory: float) -> str:
    """Return why a process said nothing more."""
    code = child.wait()
    if late or code == -signal.SIGXCPU:
        return f"took longer than its {seconds:g} s; --seconds gives it another limit"
    errors.seek(0)
    lines = errors.read(100_000).decode("utf-8", errors="replace").strip().splitlines()
    said = shortened(lines[-1], 300) if lines else "without a word"
    if "bad_alloc" in said or "MemoryError" in said:
        return _out_of_memory(memory)
    return f"ended its process before all points were measured (exit code {code}, {said})"
