"""The process in which an answer runs: it measures point by point, with limits of memory and processor time.

It gets a job as a line of JSON, and answers with a line for each point. What the answer prints is let go.
"""

import json
import os
import resource
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from simrob_drake.course.measuring import Reading
from simrob_drake.errors import shortened


def main() -> None:
    """Serve one job."""
    job = json.loads(sys.stdin.readline())
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what the answer prints, in C++ too
    _limit(int(job["memory"]), int(job["seconds"]))
    for reply in _replies(job):
        replies.write(json.dumps(reply) + "\n")
    replies.flush()
    os._exit(0)  # whatever threads the answer has left


def _limit(memory: int, seconds: int) -> None:
    kinds = ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds + 1), (resource.RLIMIT_CORE, 0))
    for kind, limit in kinds:
        with suppress(ValueError, OSError):  # not every system has each of them
            resource.setrlimit(kind, (limit, limit))


def _replies(job: Mapping[str, Any]) -> Any:
    """Yield what is to be said of each point; or, once, why the answer cannot be looked at."""
    sys.dont_write_bytecode = True
    try:
        checks = _loaded("check", Path(job["checks"]))
        answer = _loaded("answer", Path(job["answer"]))
        for point in job["points"]:
            yield {"point": point, **_measured(getattr(checks, point), answer)}
    except MemoryError:
        yield {"problem": "memory"}
    except (Exception, SystemExit) as problem:
        yield {"problem": _in_words(problem)}


def _measured(check: Callable[[ModuleType], Reading], answer: ModuleType) -> dict[str, Any]:
    try:
        reading = check(answer)
    except NotImplementedError:
        return {"problem": ""}
    except MemoryError:
        raise
    except (Exception, SystemExit) as problem:
        return {"problem": _in_words(problem)}
    return asdict(reading)  # infinite bounds are as Python's JSON writes them


def _in_words(problem: BaseException) -> str:
    """Return what was raised on one line, with the line of the answer where that is known."""
    place, trace = "", problem.__traceback__
    while trace is not None:
        if Path(trace.tb_frame.f_code.co_filename).name == _answer_name:
            place = f" ({_answer_name}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return shortened(f"{type(problem).__name__}: {problem}", 300) + place


_answer_name = ""


def _loaded(name: str, file: Path) -> ModuleType:
    """Return a file as a module; what lies beside it can be imported there."""
    global _answer_name  # noqa: PLW0603  # a process looks at one answer
    _answer_name = file.name
    sys.path.insert(0, str(file.parent))
    spec = spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file.name} is no Python file")
    module = module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    main()
