"""A student's answer that runs in a process of its own, as the checks of an exercise see it: a module with functions.

So the answer cannot change what measures it: only arguments and returned values pass between the processes. Each use of
the module sends a request to the module `answer_process` as a line of JSON, and waits for its reply.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import IO, Any, cast

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message, output_language
from simrob_drake.blocks.sampled import TIME, BlockFails, Changes, Named, RunEnds, SampledBlock
from simrob_drake.extensions.course.wire import decode, encode

PROCESS = "simrob_drake.extensions.course.answer_process"
"""Python module that the process of the answer runs."""


class AnswerFailed(SimrobError):
    """An error in the answer: it failed to load, or a function of it raised an error."""


class AnswerEnded(AnswerFailed):
    """The process of the answer has ended.

    Attributes:
        code: its exit code; negative if a signal ended it.
    """

    def __init__(self, code: int) -> None:
        """Make the error from the exit code of the process."""
        super().__init__(
            message(
                "course.answer_ended_process",
                "the answer ended its process (exit code {code})",
                code=code,
            )
        )
        self.code = code


class RemoteAnswer(ModuleType):
    """An answer in its own process. Its functions are attributes, as those of a module."""

    def __init__(self, file: Path, *, memory: int, seconds: int) -> None:
        """Start the process and load the answer.

        Args:
            file: file of the answer.
            memory: memory that the process may use [bytes].
            seconds: processor time that the process may use [s].

        Raises:
            AnswerFailed: the answer cannot be loaded.
            MemoryError: the answer uses too much memory.
        """
        super().__init__("answer")
        command = [sys.executable, "-P", "-X", "utf8", "-m", PROCESS]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._write(
            {
                "answer": str(file),
                "language": output_language(),
                "memory": memory,
                "seconds": seconds,
            }
        )
        # Names of the answer; true for functions and classes.
        self._is_callable: dict[str, bool] = self.request({"do": "load"})["names"]

    def __getattr__(self, name: str) -> Any:
        """Look up a name of the answer: a function that calls the answer's, or the present value of a variable.

        Raises:
            AttributeError: the answer has no such name.
        """
        # Python itself asks modules for names such as `__path__`: these are not looked up in the answer.
        if name.startswith("__") or name not in self._is_callable:
            raise AttributeError(name)
        if self._is_callable[name]:
            return self._make_function(name)
        return decode(self.request({"do": "get", "name": name})["value"])

    def _make_function(self, name: str) -> Callable[..., Any]:
        """Make a function that calls the answer's function of this name, with positional arguments."""

        def call(*arguments: Any) -> Any:
            """Call the function in the answer's process. Returns its value, or a block that stands for its block."""
            reply = self.request({"do": "call", "name": name, "arguments": encode(list(arguments))})
            if "block" in reply:
                return RemoteBlock(self, decode(reply["block"]))
            return decode(reply["value"])

        return call

    def request(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Send a request to the process and wait for its reply.

        Raises:
            NotImplementedError: the function is not written yet.
            MemoryError: the process took too much memory.
            RunEnds, BlockFails: a block of the answer raised it.
            AnswerEnded: the process has ended.
            AnswerFailed: any other error.
        """
        self._write(request)
        line = cast(IO[bytes], self._process.stdout).readline()
        if not line:
            raise AnswerEnded(self._process.wait())
        reply: dict[str, Any] = json.loads(line)
        match reply.get("failed"):
            case None:
                return reply
            case "not written":
                raise NotImplementedError
            case "memory":
                raise MemoryError
            case "run ends":
                raise RunEnds(reply["problem"])
            case "block":
                raise BlockFails(reply["block"], reply["problem"])
        raise AnswerFailed(reply["problem"])

    def _write(self, request: Mapping[str, Any]) -> None:
        """Write a line to the process.

        If the process has ended, nothing is raised here: reading the reply finds that out.
        """
        stream = cast(IO[bytes], self._process.stdin)
        try:
            stream.write(json.dumps(request).encode() + b"\n")
            stream.flush()
        except BrokenPipeError:
            return


class RemoteBlock(SampledBlock):
    """A sampled block in this process whose samples are computed by a block of the answer, in the answer's process.

    A sampled block has memory, which it updates periodically from its inputs.
    """

    def __init__(self, answer: RemoteAnswer, description: Mapping[str, Any]) -> None:
        """Make a block with the ports and the memory of a block of the answer.

        Args:
            answer: answer that has made the block.
            description: number by which the answer's process finds the block, its name, the units of its outputs, and
                the arguments of `SampledBlock`.
        """
        self.units = description["units"]
        super().__init__(**description["arguments"])
        self.set_name(description["name"])
        self._answer = answer
        self._number = description["number"]
        self._read_names = [*description["arguments"]["reads"], TIME]

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the changes of the memory at a sample in the answer's process; see :meth:`SampledBlock.sample`."""
        request = {
            "do": "sample",
            "number": self._number,
            "memory": encode({name: memory[name] for name in self.memory_names}),
            "read": encode({name: read[name] for name in self._read_names}),
        }
        changes: Changes = decode(self._answer.request(request)["value"])
        return changes
