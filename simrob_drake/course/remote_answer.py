"""An answer that runs in a process of its own, as the checks of an exercise see it: a module with functions.

So an answer cannot replace what measures it: it sees arguments and gives values, and nothing else of it is shared.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import IO, Any, cast

from simrob_drake.blocks.sampled import TIME, BlockFails, Changes, Named, RunEnds, SampledBlock
from simrob_drake.course.wire import decode, encode
from simrob_drake.errors import SimrobError

PROCESS = "simrob_drake.course.answer_process"


class AnswerFailed(SimrobError):
    """An error in the answer: it failed to load, or a function of it raised an error."""


class AnswerEnded(AnswerFailed):
    """The process of the answer has ended.

    Attributes:
        code: its exit code; negative if a signal ended it.
    """

    def __init__(self, code: int) -> None:
        """Describe how the process ended."""
        super().__init__(f"the answer ended its process (exit code {code})")
        self.code = code


class RemoteAnswer(ModuleType):
    """An answer in its own process. Its functions are attributes, as those of a module."""

    def __init__(self, file: Path, *, memory: int, seconds: int) -> None:
        """Start the process and load the answer.

        Args:
            file: of the answer.
            memory: that the process may take [bytes].
            seconds: of processor time that it may take.

        Raises:
            AnswerFailed: the answer cannot be loaded.
            MemoryError: it takes too much memory.
        """
        super().__init__("answer")
        command = [sys.executable, "-P", "-X", "utf8", "-m", PROCESS]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._write({"answer": str(file), "memory": memory, "seconds": seconds})
        self._names: dict[str, bool] = self.request({"do": "load"})["names"]

    def __getattr__(self, name: str) -> Any:
        """Give a function that calls that of the answer, or a value of the answer."""
        if name.startswith("__") or name not in self._names:
            raise AttributeError(name)
        if self._names[name]:
            return self._function(name)
        return decode(self.request({"do": "get", "name": name})["value"])

    def _function(self, name: str) -> Callable[..., Any]:
        """Make the function that calls one of the answer."""

        def call(*arguments: Any) -> Any:
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
        """Write a line to the process. One that has ended is found when its reply is read."""
        stream = cast(IO[bytes], self._process.stdin)
        try:
            stream.write(json.dumps(request).encode() + b"\n")
            stream.flush()
        except BrokenPipeError:
            return


class RemoteBlock(SampledBlock):
    """A sampled block whose law is that of a block of the answer, in the answer's process."""

    def __init__(self, answer: RemoteAnswer, description: Mapping[str, Any]) -> None:
        """Make a block like one of the answer.

        Args:
            answer: that has made the block.
            description: its number, name, units, and the arguments of `SampledBlock`.
        """
        self.units = description["units"]
        super().__init__(**description["arguments"])
        self.set_name(description["name"])
        self._answer = answer
        self._number = description["number"]
        self._read_names = [*description["arguments"]["reads"], TIME]

    def sample(self, memory: Named, read: Named) -> Changes:
        """Take a sample of the block in the answer's process."""
        request = {
            "do": "sample",
            "number": self._number,
            "memory": encode({name: memory[name] for name in self.remembered}),
            "read": encode({name: read[name] for name in self._read_names}),
        }
        changes: Changes = decode(self._answer.request(request)["value"])
        return changes
