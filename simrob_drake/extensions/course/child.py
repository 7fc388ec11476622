"""The process that measures an answer point by point, with limits of memory and processor time.

An answer is a student's Python file. The file of checks of an exercise has a function for each of its points: it calls
functions of the answer, and returns a reading (a value with its bounds). The process gets a job as a line of JSON and
writes a line of JSON for each point. The answer runs in yet another process, so that it cannot change what measures it.
What the checks print is discarded.
"""

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any

from simrob_drake.extensions.course.measuring import Reading
from simrob_drake.extensions.course.process import (
    apply_limits,
    error_text,
    load_module,
    take_over_output,
    write_in_language,
)
from simrob_drake.extensions.course.remote_answer import AnswerEnded, AnswerFailed, RemoteAnswer

Reply = dict[str, Any]
"""Result of a point: its name, with the fields of the reading or the problem. A problem without a point concerns all
points: the answer cannot be measured."""


def main() -> None:
    """Read the job from the standard input, measure all its points, and end the process."""
    job = json.loads(sys.stdin.readline())
    write_in_language(str(job["language"]))
    replies = take_over_output()
    apply_limits(int(job["memory"]), int(job["seconds"]))
    # Each reply is written at once, so that points that are measured count even if a later one ends the process.
    try:
        for reply in _measure_points(job):
            replies.write(json.dumps(reply) + "\n")
    except AnswerEnded as end:
        _end_as_answer_did(end.code)
    replies.flush()
    os._exit(0)  # without waiting for threads that are left


def _measure_points(job: Mapping[str, Any]) -> Iterator[Reply]:
    """Load the checks and the answer, and yield a reply for each point; or a single problem if that is not possible.

    Args:
        job: files of the checks and of the answer, names of the points, the language of problems, and limits of
            memory [bytes] and processor time [s] of the answer's process.

    Raises:
        AnswerEnded: the process of the answer has ended.
    """
    sys.dont_write_bytecode = True  # no files next to the exercise
    try:
        checks = load_module(Path(job["checks"]), "check")
        answer = RemoteAnswer(
            Path(job["answer"]), memory=int(job["memory"]), seconds=int(job["seconds"])
        )
        for point in job["points"]:
            check = getattr(checks, point)
            yield {"point": point, **_measure(check, answer)}
    except MemoryError:
        yield {"problem": "memory"}
    except AnswerEnded:
        raise
    except (Exception, SystemExit) as problem:
        yield {"problem": _describe(problem)}


def _measure(check: Callable[[ModuleType], Reading], answer: ModuleType) -> dict[str, Any]:
    """Measure a point.

    Args:
        check: function of the checks that measures the point.
        answer: the answer, as a module.

    Returns:
        the fields of the reading; or the problem that kept it from being measured, empty if the answer's function is
        not written yet.

    Raises:
        AnswerEnded, MemoryError: no further point can be measured.
    """
    try:
        reading = check(answer)
    except NotImplementedError:
        return {"problem": ""}
    except (AnswerEnded, MemoryError):
        raise
    except (Exception, SystemExit) as problem:
        return {"problem": _describe(problem)}
    return asdict(reading)  # infinite bounds are as Python's JSON writes them


def _describe(problem: BaseException) -> str:
    """Describe an error on one line."""
    if isinstance(problem, AnswerFailed):
        return str(problem)  # names the class of the answer's error and its line already
    return error_text(problem)


def _end_as_answer_did(code: int) -> None:
    """End this process in the same way as the answer's process has ended: by the same signal or exit code.

    The process that has started this one explains to the user how it ended.

    Args:
        code: exit code of the answer's process; if it is negative, the number of the signal that ended that process.
    """
    if code < 0:
        # The signal must not be handled in another way. SIGKILL cannot be handled at all, so that this fails for it.
        with suppress(OSError):
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code)


if __name__ == "__main__":
    main()
