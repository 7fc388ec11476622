"""The process that measures an answer point by point, with limits of memory and processor time.

It gets a job as a line of JSON, and gives a line for each point. The answer runs in yet another process, so that it
cannot change what measures it. What the checks print is discarded.
"""

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from simrob_drake.course.limits import apply_limits
from simrob_drake.course.measuring import Reading
from simrob_drake.course.remote_answer import AnswerEnded, AnswerFailed, RemoteAnswer
from simrob_drake.errors import shortened

LONGEST_PROBLEM = 300
"""Letters of an error that are passed on."""


def main() -> None:
    """Serve one job."""
    job = json.loads(sys.stdin.readline())
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    # Drake prints from C++ as well, so the file descriptor itself is redirected.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    apply_limits(int(job["memory"]), int(job["seconds"]))
    try:
        for reply in _replies(job):
            replies.write(json.dumps(reply) + "\n")
    except AnswerEnded as end:
        _end_likewise(end.code)
    replies.flush()
    os._exit(0)  # without waiting for threads that are left


def _replies(job: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a reply for each point; or, once, why the answer cannot be measured."""
    sys.dont_write_bytecode = True
    try:
        checks = _load_checks(Path(job["checks"]))
        answer = RemoteAnswer(Path(job["answer"]), memory=int(job["memory"]), seconds=int(job["seconds"]))
        for point in job["points"]:
            yield {"point": point, **_measure(getattr(checks, point), answer)}
    except MemoryError:
        yield {"problem": "memory"}
    except AnswerEnded:
        raise
    except (Exception, SystemExit) as problem:
        yield {"problem": _describe(problem)}


def _measure(check: Callable[[ModuleType], Reading], answer: ModuleType) -> dict[str, Any]:
    """Measure a point. Returns the reading, or the problem that kept it from being measured."""
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
    """Describe an error on one line. One of the answer names its own class and line already."""
    if isinstance(problem, AnswerFailed):
        return str(problem)
    return shortened(f"{type(problem).__name__}: {problem}", LONGEST_PROBLEM)


def _end_likewise(code: int) -> None:
    """End this process as that of the answer ended, by an exit code or a signal (negative): its caller says why."""
    if code < 0:
        signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code)


def _load_checks(file: Path) -> ModuleType:
    """Load the checks of an exercise; modules in their folder can be imported there."""
    sys.path.insert(0, str(file.parent))
    spec = spec_from_file_location("check", file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file.name} is no Python file")
    module = module_from_spec(spec)
    sys.modules["check"] = module
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    main()
