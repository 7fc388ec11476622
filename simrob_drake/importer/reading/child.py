"""A process that works for an import on its own: confined by the system, and with nothing but what it asks for.

Both sides talk by lines of JSON. The process gets a job, asks for what it needs, and ends with a result or with what
is wrong. On Linux Landlock refuses it every file and port (landlock(7)), and a seccomp filter every system call but
those of memory, time, open files and the end (seccomp(2)); both hold for good.
"""

import ctypes
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any, cast

from simrob_drake.base.errors import shortened
from simrob_drake.base.messages import Message, as_data, compound, from_data, join_texts, message, message_of
from simrob_drake.robots.imports import ImportReport

MAX_OUTPUT = 20_000_000  # of one line that the process says [bytes]
_ENVIRONMENT = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")  # without which some builds of Python do not start
_SETTINGS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}  # sets keep one order

Answer = Callable[[str, str], Any]
"""Returns what the process asks for: of a kind, and about what; None if it may not have it."""


class ChildFailed(Exception):
    """The process came to no result; the text says why."""


def in_child(
    module: str, job: dict[str, Any], answer: Answer, report: ImportReport, *, seconds: float
) -> dict[str, Any]:
    """Let a module serve a job in a process of its own, and return the result.

    ``answer`` gives what it asks for; it may take so many seconds. Raises ChildFailed: it does not end in time, dies,
    or says what is wrong with the job.
    """
    environment = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ} | _SETTINGS
    environment["PYTHONPATH"] = os.pathsep.join(folder for folder in sys.path if folder)
    command = [sys.executable, "-P", "-X", "utf8", "-m", module]
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors
        ) as child,
    ):
        timer = threading.Timer(seconds, child.kill)
        timer.start()
        try:
            end = _exchange(job, answer, child)
        finally:
            in_time = timer.is_alive()
            timer.cancel()
            child.kill()
            with suppress(OSError):  # of what it did not hear any more
                cast(IO[bytes], child.stdin).close()
        if end is None and not in_time:
            raise ChildFailed(message("importer.did_not_end", "did not end within {seconds:g} s", seconds=seconds))
        if end is None:
            errors.seek(0)
            text = errors.read(MAX_OUTPUT).decode("utf-8", errors="replace").strip().splitlines()
            raise ChildFailed(
                text[-1]
                if text
                else message("importer.its_process_ended", "its process ended with code {code}", code=child.wait())
            )
    if "problem" in end:
        raise ChildFailed(_received(end["problem"]))
    if end["unconfined"]:
        missing = join_texts(end["unconfined"], message("base.and", " and "))
        report.add(
            "read",
            "",
            message(
                "importer.read_unconfined",
                "read without {missing}, which would confine the process that does it on Linux, too",
                missing=missing,
            ),
        )
    return end


def _exchange(job: dict[str, Any], answer: Answer, child: subprocess.Popen[bytes]) -> dict[str, Any] | None:
    """Talk to the process until it ends; return what it says last, None if it ends without a word."""
    replies, requests = cast(IO[bytes], child.stdout), cast(IO[bytes], child.stdin)
    text: Any = job
    try:
        while True:
            requests.write(json.dumps(text).encode() + b"\n")
            requests.flush()
            line = replies.readline(MAX_OUTPUT)
            if len(line) == MAX_OUTPUT:
                return {
                    "problem": message(
                        "importer.gives_too_much",
                        "it gives more than {megabytes} MB",
                        megabytes=MAX_OUTPUT // 1_000_000,
                    )
                }
            reply = json.loads(line)
            if "ask" not in reply:
                return dict(reply)
            text = answer(reply["ask"], reply["about"])
    except (OSError, ValueError):
        return None


def ask(kind: str, about: str) -> Any:
    """Return, in the process, what was answered."""
    print(json.dumps({"ask": kind, "about": about}), flush=True)
    return json.loads(sys.stdin.readline())


def _received(problem: Any) -> str:
    """Read the problem that the process reported: a message as data, or a text."""
    try:
        return str(from_data(problem))
    except (LookupError, TypeError, ValueError, RecursionError):
        # The process is confined because it may be deceived: what it says is not trusted.
        return shortened(str(problem), _LONGEST_PROBLEM)


def _in_one_line(problem: Exception) -> str:
    """Message of an error, or its text on one line; the name of its class if it has no text."""
    found = message_of(problem)
    if isinstance(found, Message):
        return found.limited_to(_LONGEST_PROBLEM)
    return shortened(" ".join(found.split()), _LONGEST_PROBLEM) or type(problem).__name__


_LONGEST_PROBLEM = 400
"""Largest count of characters of a problem that the process reports."""


def serve(work: Callable[[dict[str, Any]], dict[str, Any]], seconds: int) -> None:
    """Serve one job, in the process: confined from now on, with so much processor time."""
    missing = confine(seconds)
    try:
        end = {**work(json.loads(sys.stdin.readline())), "unconfined": missing}
    except MemoryError:
        too_much = message(
            "importer.takes_too_much_memory",
            "it takes more than {megabytes} MB of memory",
            megabytes=MEMORY // 1_000_000,
        )
        end = {"problem": as_data(too_much)}
    except OSError as problem:
        why = compound("{filename}: {strerror}", filename=problem.filename, strerror=problem.strerror)
        end = {"problem": as_data(why)}
    except Exception as problem:
        end = {"problem": as_data(_in_one_line(problem))}
    print(json.dumps(end), flush=True)


MEMORY = 1_000_000_000  # what a confined process may take [bytes]
_COMPLAINTS = 1_000_000  # bytes that it may write to a file that is open already, as standard errors may be

_NO_NEW_PRIVILEGES, _SET_SECCOMP, _FILTER_MODE = 38, 22, 2  # of prctl(2)
_CREATE_RULESET, _RESTRICT_SELF = 444, 446  # the same on every machine
_FILES = {1: 0x1FFF, 2: 0x3FFF, 3: 0x7FFF, 4: 0x7FFF}  # rights that a version of Landlock knows; later ones 0xFFFF
_PORTS, _SIGNALS_AND_SOCKETS = 0x3, 0x3  # from the versions 4 and 6 on
_LOAD, _EQUAL, _RETURN = 0x20, 0x15, 0x06  # BPF: load a word, jump if equal, return
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | 1  # the call, or the error EPERM
_CALLS = {  # by machine: its number for the kernel, and the numbers of
    # read write close fstat lseek mmap mprotect munmap brk rt_sigaction rt_sigprocmask rt_sigreturn mremap madvise
    # sched_yield getpid exit futex clock_gettime exit_group getrandom
    "x86_64": (0xC000003E, (0, 1, 3, 5, 8, 9, 10, 11, 12, 13, 14, 15, 25, 28, 24, 39, 60, 202, 228, 231, 318)),
    "aarch64": (
        0xC00000B7,
        (63, 64, 57, 80, 62, 222, 226, 215, 214, 134, 135, 139, 216, 233, 124, 172, 93, 98, 113, 94, 278),
    ),
}


def confine(seconds: int) -> list[str]:
    """Confine this process to compute with what is loaded, and read and write what is open; return what was refused."""
    limits = ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_FSIZE, _COMPLAINTS))
    for kind, limit in (*limits, (resource.RLIMIT_CORE, 0)):
        with suppress(ValueError, OSError):  # not every system has each of them
            resource.setrlimit(kind, (limit, limit))
    os.environ.clear()
    if sys.platform != "linux":
        return ["Landlock", "seccomp"]
    system = _system()
    missing = [] if _shut_files(system) else ["Landlock"]
    return missing if _filter_calls(system) else [*missing, "seccomp"]


def _system() -> ctypes.CDLL:
    """Return the C library, after this process has waived all privileges that a program could give it."""
    system = ctypes.CDLL(None)
    system.syscall.restype = ctypes.c_long
    system.prctl(_NO_NEW_PRIVILEGES, *map(ctypes.c_ulong, (1, 0, 0, 0)))  # without this the others refuse
    return system


def _shut_files(system: ctypes.CDLL) -> bool:
    """Let Landlock refuse every file and port, and signals to others; return whether it does."""
    version = int(system.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), 1))
    if version < 1:
        return False
    rights = (_FILES.get(version, 0xFFFF), _PORTS * (version >= 4), _SIGNALS_AND_SOCKETS * (version >= 6))
    known = rights[: 3 if version >= 6 else 2 if version >= 4 else 1]  # a kernel refuses fields that it does not know
    ruleset = (ctypes.c_uint64 * len(known))(*known)
    descriptor = int(system.syscall(_CREATE_RULESET, ctypes.byref(ruleset), ctypes.c_size_t(8 * len(known)), 0))
    return descriptor >= 0 and int(system.syscall(_RESTRICT_SELF, descriptor, 0)) == 0


class _Step(ctypes.Structure):
    """One step of a filter's program, ``sock_filter``."""

    _fields_ = (("code", ctypes.c_uint16), ("yes", ctypes.c_uint8), ("no", ctypes.c_uint8), ("value", ctypes.c_uint32))


class _Program(ctypes.Structure):
    """A filter's program, ``sock_fprog``."""

    _fields_ = (("length", ctypes.c_uint16), ("steps", ctypes.POINTER(_Step)))


def _filter_calls(system: ctypes.CDLL) -> bool:
    """Let the kernel refuse all system calls but a few; return whether it does."""
    machine, calls = _CALLS.get(platform.machine(), (0, ()))
    if not calls:
        return False
    steps = [_Step(_LOAD, 0, 0, 4), _Step(_EQUAL, 1, 0, machine), _Step(_RETURN, 0, 0, _REFUSE), _Step(_LOAD, 0, 0, 0)]
    steps += [_Step(_EQUAL, len(calls) - place, 0, call) for place, call in enumerate(calls)]
    steps += [_Step(_RETURN, 0, 0, _REFUSE), _Step(_RETURN, 0, 0, _ALLOW)]
    program = _Program(len(steps), (_Step * len(steps))(*steps))
    return int(system.prctl(_SET_SECCOMP, ctypes.c_ulong(_FILTER_MODE), ctypes.byref(program), 0, 0)) == 0
