"""The process in which an answer runs: it calls functions of the answer, and knows nothing of what is measured.

Requests and replies are lines of JSON. The first request names the file; each other one calls a function, makes a
sampled block, or takes a sample of such a block. Whatever the answer prints is discarded.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from simrob_drake.blocks.sampled import BlockFails, RunEnds, SampledBlock
from simrob_drake.course.limits import apply_limits
from simrob_drake.course.wire import decode, encode
from simrob_drake.errors import shortened

LONGEST_PROBLEM = 300
"""Letters of an error that are passed on."""


def main() -> None:
    """Serve requests until there are no more."""
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    # Drake prints from C++ as well, so the file descriptor itself is redirected.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    job = json.loads(sys.stdin.readline())
    apply_limits(int(job["memory"]), int(job["seconds"]))
    served = ServedAnswer(Path(job["answer"]))
    for line in _lines():
        replies.write(json.dumps(served.reply(line)) + "\n")
    replies.flush()
    os._exit(0)  # without waiting for threads that the answer has left


def _lines() -> Iterator[dict[str, Any]]:
    """Yield the requests."""
    for line in sys.stdin:
        yield json.loads(line)


class ServedAnswer:
    """An answer and the blocks that it has made.

    Attributes:
        file: of the answer.
    """

    def __init__(self, file: Path) -> None:
        """Prepare to load an answer; the request `load` loads it."""
        self.file = file
        self._module: ModuleType | None = None
        self._blocks: list[SampledBlock] = []
        self._actions: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
            "load": self._load,
            "call": self._call,
            "get": self._get,
            "sample": self._sample,
        }

    def reply(self, request: dict[str, Any]) -> dict[str, Any]:
        """Carry out a request and describe its result, or why it failed."""
        try:
            return self._actions[request["do"]](request)
        except NotImplementedError:
            return {"failed": "not written"}
        except MemoryError:
            return {"failed": "memory"}
        except RunEnds as reason:
            return {"failed": "run ends", "problem": str(reason)}
        except BlockFails as problem:
            return {"failed": "block", "block": problem.block, "problem": str(problem)}
        except (Exception, SystemExit) as problem:
            return {"failed": "error", "problem": self._describe(problem)}

    def _load(self, request: dict[str, Any]) -> dict[str, Any]:
        """Load the answer and list its names: true for those that can be called."""
        sys.path.insert(0, str(self.file.parent))
        spec = spec_from_file_location("answer", self.file)
        if spec is None or spec.loader is None:
            raise ImportError(f"{self.file.name} is no Python file")
        module = module_from_spec(spec)
        sys.modules["answer"] = module
        spec.loader.exec_module(module)
        self._module = module
        names = {name: callable(value) for name, value in vars(module).items() if not name.startswith("__")}
        return {"names": names}

    def _call(self, request: dict[str, Any]) -> dict[str, Any]:
        """Call a function of the answer. A sampled block that it returns stays here, and is described."""
        function = getattr(self._module, request["name"])
        returned = function(*decode(request["arguments"]))
        if not isinstance(returned, SampledBlock):
            return {"value": encode(returned)}
        self._blocks.append(returned)
        description = {
            "number": len(self._blocks) - 1,
            "name": returned.get_name(),
            "units": dict(returned.units),
            "arguments": returned.arguments(),
        }
        return {"block": encode(description)}

    def _get(self, request: dict[str, Any]) -> dict[str, Any]:
        """Give a value of the answer."""
        return {"value": encode(getattr(self._module, request["name"]))}

    def _sample(self, request: dict[str, Any]) -> dict[str, Any]:
        """Take a sample of a block."""
        block = self._blocks[request["number"]]
        changes = block.sample(decode(request["memory"]), decode(request["read"]))
        return {"value": encode(dict(changes))}

    def _describe(self, problem: BaseException) -> str:
        """Describe an error on one line, with the line of the answer where it happened."""
        place = ""
        trace = problem.__traceback__
        while trace is not None:
            if Path(trace.tb_frame.f_code.co_filename) == self.file:
                place = f" ({self.file.name}, line {trace.tb_lineno})"
            trace = trace.tb_next
        return shortened(f"{type(problem).__name__}: {problem}", LONGEST_PROBLEM) + place


if __name__ == "__main__":
    main()
