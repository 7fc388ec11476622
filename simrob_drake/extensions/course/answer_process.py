"""The process in which a student's answer to an exercise runs: it calls functions of the answer.

An answer is a Python file. The process that measures it sends requests here and gets replies, both as lines of JSON, so
that the answer knows nothing of what is measured. The first line is the job: the file and the limits of the process.
Each request after it loads the file, calls a function, reads a variable, or takes a sample of a sampled block (a Drake
block with memory that is updated periodically) which a function has returned. Whatever the answer prints is discarded.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from simrob_drake.base.messages import message, translate
from simrob_drake.blocks.sampled import BlockFails, RunEnds, SampledBlock
from simrob_drake.extensions.course.process import (
    apply_limits,
    error_text,
    load_module,
    take_over_output,
    write_in_language,
)
from simrob_drake.extensions.course.wire import decode, encode

Request = dict[str, Any]
"""A request: the key ``do`` names an action of `ServedAnswer`, and the other keys are its arguments."""
Reply = dict[str, Any]
"""A reply: the result of an action, or the key ``failed`` with the reason, and ``problem`` in words."""


def main() -> None:
    """Read the job and serve requests from the standard input until it is closed, and end the process."""
    replies = take_over_output()
    job = json.loads(sys.stdin.readline())
    write_in_language(str(job["language"]))
    apply_limits(int(job["memory"]), int(job["seconds"]))
    # The limits hold before any code of the answer runs.
    answer = ServedAnswer(Path(job["answer"]))
    for line in sys.stdin:
        reply = answer.reply(json.loads(line))
        replies.write(json.dumps(reply) + "\n")
    replies.flush()
    os._exit(0)  # without waiting for threads that the answer has started


class ServedAnswer:
    """An answer and the sampled blocks that its functions have returned.

    Attributes:
        file: file of the answer.
    """

    def __init__(self, file: Path) -> None:
        """Prepare to load an answer; the request `load` loads it."""
        self.file = file
        self._module: ModuleType | None = None
        self._blocks: list[SampledBlock] = []
        self._actions: dict[str, Callable[[Request], Reply]] = {
            "load": self._load,
            "call": self._call,
            "get": self._get,
            "sample": self._sample,
        }

    def reply(self, request: Request) -> Reply:
        """Carry out a request. Returns its result, or the reason why it failed; no error of the answer is raised."""
        try:
            return self._actions[request["do"]](request)
        except NotImplementedError:  # raised by a function that the student has not written yet
            return {"failed": "not written"}
        except MemoryError:
            return {"failed": "memory"}
        except RunEnds as reason:
            return {"failed": "run ends", "problem": str(reason)}
        except BlockFails as problem:
            return {"failed": "block", "block": problem.block, "problem": str(problem)}
        # An answer that calls sys.exit() ends neither this process nor the measurement.
        except (Exception, SystemExit) as problem:
            return {"failed": "error", "problem": self._describe(problem)}

    def _load(self, request: Request) -> Reply:
        """Load the answer. The reply lists its names, each with true if it is a function or class, else false."""
        self._module = load_module(self.file, "answer")
        names = {
            name: callable(value)
            for name, value in vars(self._module).items()
            if not name.startswith("__")
        }
        return {"names": names}

    def _call(self, request: Request) -> Reply:
        """Call the function `name` of the answer. The reply has the returned value.

        A sampled block cannot be passed on. It stays in this process, and the reply describes it: its index among the
        blocks, and what is needed to make a block with the same ports in the other process.
        """
        function = getattr(self._module, request["name"])
        value = function(*decode(request["arguments"]))
        if not isinstance(value, SampledBlock):
            return {"value": encode(value)}
        self._blocks.append(value)
        description = {
            "number": len(self._blocks) - 1,
            "name": value.get_name(),
            "units": dict(value.units),
            "arguments": value.arguments(),
        }
        return {"block": encode(description)}

    def _get(self, request: Request) -> Reply:
        """Read the variable `name` of the answer. The reply has its value."""
        return {"value": encode(getattr(self._module, request["name"]))}

    def _sample(self, request: Request) -> Reply:
        """Take a sample of the block with the index `number`. The reply has the changes of its memory.

        The request has the memory of the block and the vectors that it reads, by name.
        """
        block = self._blocks[request["number"]]
        changes = block.sample(decode(request["memory"]), decode(request["read"]))
        return {"value": encode(dict(changes))}

    def _describe(self, problem: BaseException) -> str:
        """Describe an error on one line, with the line of the answer where it happened.

        That is the innermost line of the traceback that belongs to the answer, as later ones are those of libraries.
        """
        line = None
        trace = problem.__traceback__
        while trace is not None:
            if Path(trace.tb_frame.f_code.co_filename) == self.file:
                line = trace.tb_lineno
            trace = trace.tb_next
        text = error_text(problem)
        if line is None:
            return text
        place = message("course.in_line", " ({file}, line {line})", file=self.file.name, line=line)
        return text + translate(place)


if __name__ == "__main__":
    main()
