"""Run a job of an import in a confined process, for files that compute, such as xacro files.

The parent starts the process and sends it the job. The process asks the parent for what it needs, such as the texts of
files, and ends with a result or a problem. Both exchange lines of JSON over the standard input and output.

The process confines itself before it reads the job. On Linux, Landlock refuses it all files and network ports
(landlock(7)), and a seccomp filter refuses all system calls but those for memory, time, open files and its end
(seccomp(2)). A process cannot undo either.
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
from typing import IO, Any, NamedTuple, cast

from simrob_drake.base.errors import shorten
from simrob_drake.base.messages import (
    Message,
    as_data,
    compound,
    from_data,
    join_texts,
    message,
    message_of,
)
from simrob_drake.robots.imports import ImportReport

# The URDF of a robot with thousands of links has some million characters.
MAX_OUTPUT = 20_000_000
"""Largest line that the process may send [bytes]."""

# The environment may contain secrets of the user, so the process gets no other variable.
_KEPT_VARIABLES = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")
"""Environment variables that the process inherits, without which some builds of Python do not start."""

# Each thread would need memory of its own, and the process has little. Sets in the same order give the same robot.
_SETTINGS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
"""Environment variables of the process: no threads, and the same order of sets in each run."""

_LONGEST_PROBLEM = 400
"""Largest count of characters of a problem that the process reports."""

Answer = Callable[[str, str], Any]
"""Function of the parent that answers a request of the process. It takes the kind of the request and its subject, such
as ``("xml", "/robots/arm.xacro")``, and returns a value that JSON can represent."""


class ChildFailed(Exception):
    """Raised when the process ends without a result. The text of the error is the reason."""


def in_child(
    module: str, job: dict[str, Any], answer: Answer, report: ImportReport, *, seconds: float
) -> dict[str, Any]:
    """Run a job in a process of its own.

    Args:
        module: name of the module that the process runs. It calls :func:`serve`.
        job: the job, as values that JSON can represent.
        answer: function that answers the requests of the process.
        report: gets an entry if the system cannot confine the process.
        seconds: longest time for the job [s].

    Returns:
        the result of the job.

    Raises:
        ChildFailed: the process does not end in time, crashes, reports a problem, or sends anything else than requests
            and a result, or too much.
    """
    environment = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
    environment |= _SETTINGS
    environment["PYTHONPATH"] = os.pathsep.join(folder for folder in sys.path if folder)
    # -P: modules in the working folder cannot take the place of others. -X utf8: texts are UTF-8 on all systems.
    command = [sys.executable, "-P", "-X", "utf8", "-m", module]
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            command,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
        ) as child,
    ):
        # The limit of processor time does not end a process that waits.
        timer = threading.Timer(seconds, child.kill)
        timer.start()
        try:
            result = _exchange(job, answer, child)
        finally:
            # A timer that has run out has killed the process.
            is_in_time = timer.is_alive()
            timer.cancel()
            child.kill()
            with suppress(OSError):  # what the process did not read any more
                cast(IO[bytes], child.stdin).close()
        if result is None and not is_in_time:
            raise ChildFailed(
                message(
                    "importer.did_not_end",
                    "the process does not end within {seconds:g} s",
                    seconds=seconds,
                )
            )
        if result is None:
            raise ChildFailed(_crash_reason(errors, child))

    # The process ends with a result, or with a problem that it found itself.
    if "problem" in result:
        raise ChildFailed(_read_problem(result["problem"]))
    if result["unconfined"]:
        missing = join_texts(result["unconfined"], message("base.and", " and "))
        report.add(
            "read",
            "",
            message(
                "importer.read_unconfined",
                "read in a process without the protection of {missing}, which this system does not have",
                missing=missing,
            ),
        )
    return result


def _crash_reason(errors: IO[bytes], child: subprocess.Popen[bytes]) -> str:
    """Reason why a process ended without a result: the last line of its standard error, or else its exit code."""
    errors.seek(0)
    # Python writes the error itself in the last line, after its traceback.
    lines = errors.read(MAX_OUTPUT).decode("utf-8", errors="replace").strip().splitlines()
    if lines:
        return lines[-1]
    return message(
        "importer.its_process_ended", "the process ended with exit code {code}", code=child.wait()
    )


def _exchange(
    job: dict[str, Any], answer: Answer, child: subprocess.Popen[bytes]
) -> dict[str, Any] | None:
    """Send the job to the process, and answer its requests until it sends a result or a problem.

    Returns None if the process ends before, or sends something that is no request, no result and no problem.
    """
    replies = cast(IO[bytes], child.stdout)
    requests = cast(IO[bytes], child.stdin)
    to_send: Any = job
    try:
        while True:
            requests.write(json.dumps(to_send).encode() + b"\n")
            requests.flush()
            # A process that sends without end would fill the memory of the parent.
            line = replies.readline(MAX_OUTPUT)
            if len(line) == MAX_OUTPUT:
                return {
                    "problem": message(
                        "importer.gives_too_much",
                        "the result is larger than {megabytes} MB",
                        megabytes=MAX_OUTPUT // 1_000_000,
                    )
                }
            reply = json.loads(line)
            # The file that is read may control the process, and send anything.
            if not isinstance(reply, dict):
                return None
            if "ask" not in reply:
                return reply if {"problem", "unconfined"} & reply.keys() else None
            # A refused request is answered, too: with a reason in place of the content.
            to_send = answer(str(reply["ask"]), str(reply.get("about")))
    except (OSError, ValueError):
        return None


def ask(kind: str, about: str) -> Any:
    """Send a request to the parent, and return its answer. Called in the process.

    Args:
        kind: kind of the request, which the parent's function knows.
        about: subject of the request, such as a file.
    """
    # Flushed, because the process waits for the answer before its buffer is full.
    print(json.dumps({"ask": kind, "about": about}), flush=True)
    return json.loads(sys.stdin.readline())


def _read_problem(problem: Any) -> str:
    """Read the problem that the process reported: a message as data, or a text."""
    try:
        return str(from_data(problem))
    except (LookupError, TypeError, ValueError, RecursionError):
        # The file that is read may control the process, so that its reports are not trusted.
        return shorten(str(problem), _LONGEST_PROBLEM)


def _problem_text(problem: Exception) -> str:
    """Text of an error for the parent, of limited length: its message, which may have several lines, or its text.

    A text that is no message is put on one line. The name of the class is used for an error without a text.
    """
    # A message keeps its id, so that the parent can show it in the user's language.
    found = message_of(problem)
    if isinstance(found, Message):
        return found.limited_to(_LONGEST_PROBLEM)
    return shorten(" ".join(found.split()), _LONGEST_PROBLEM) or type(problem).__name__


def serve(work: Callable[[dict[str, Any]], dict[str, Any]], seconds: int) -> None:
    """Confine this process, read one job, and send its result or its problem. Called in the process.

    Args:
        work: function that computes the result of a job.
        seconds: processor time that the process may take [s].
    """
    # First of all: the job may come from a file that nobody has looked at.
    missing = confine(seconds)
    try:
        job = json.loads(sys.stdin.readline())
        end = {**work(job), "unconfined": missing}
    # What the job has used is free again, so that there is memory for a message.
    except MemoryError:
        too_much = message(
            "importer.takes_too_much_memory",
            "the process needs more than {megabytes} MB of memory",
            megabytes=MEMORY // 1_000_000,
        )
        end = {"problem": as_data(too_much)}
    # Without the number of the error, which the usual text contains.
    except OSError as problem:
        why = compound(
            "{filename}: {strerror}", filename=problem.filename, strerror=problem.strerror
        )
        end = {"problem": as_data(why)}
    # Any error of the job is its problem. The parent shows it to the user.
    except Exception as problem:
        end = {"problem": as_data(_problem_text(problem))}
    print(json.dumps(end), flush=True)


MEMORY = 1_000_000_000
"""Largest memory of a confined process [bytes]."""

# Without this limit, a job could fill the disk through its standard error.
_MOST_WRITTEN = 1_000_000
"""Largest size to which the process can extend a file that is open already, such as its standard error [bytes]."""

# Options of prctl(2), from linux/prctl.h.
_PR_SET_NO_NEW_PRIVS = 38
_PR_SET_SECCOMP = 22
_SECCOMP_MODE_FILTER = 2

# System calls of Landlock, with the same numbers on all machines.
_LANDLOCK_CREATE_RULESET = 444
_LANDLOCK_RESTRICT_SELF = 446
_LANDLOCK_GET_VERSION = 1  # flag of the first call

# The kernel refuses a ruleset with rights that its version does not know.
_FILE_RIGHTS = {1: 0x1FFF, 2: 0x3FFF, 3: 0x7FFF, 4: 0x7FFF}
"""Rights to files, as bits, by the version of Landlock that knows them."""

_LATER_FILE_RIGHTS = 0xFFFF
"""Rights to files in later versions."""

_PORT_RIGHTS = 0x3
"""Rights to bind and to connect to ports, from version 4 on."""

_SCOPES = 0x3
"""Signals and abstract sockets of other processes, from version 6 on."""

# Instructions of the kernel's packet filter, from linux/bpf_common.h.
_BPF_LOAD = 0x20  # load a word of the system call
_BPF_JUMP_IF_EQUAL = 0x15
_BPF_RETURN = 0x06

# Results of a seccomp filter.
_ALLOW = 0x7FFF0000
_REFUSE = 0x00050000 | 1  # the system call fails with EPERM, which is error 1

# Offsets of words in a system call, from struct seccomp_data [bytes].
_CALL_NUMBER = 0
_ARCHITECTURE = 4


class _Machine(NamedTuple):
    """Numbers of the kernel for one processor architecture.

    Attributes:
        architecture: the kernel's number of the architecture, from linux/audit.h.
        calls: numbers of the allowed system calls.
    """

    architecture: int
    calls: tuple[int, ...]


# The allowed calls are, in this order: read, write, close, fstat, lseek, mmap, mprotect, munmap, brk, rt_sigaction,
# rt_sigprocmask, rt_sigreturn, mremap, madvise, sched_yield, getpid, exit, futex, clock_gettime, exit_group, getrandom.
_MACHINES = {
    "x86_64": _Machine(
        0xC000003E,
        (0, 1, 3, 5, 8, 9, 10, 11, 12, 13, 14, 15, 25, 28, 24, 39, 60, 202, 228, 231, 318),
    ),
    "aarch64": _Machine(
        0xC00000B7,
        (
            63,
            64,
            57,
            80,
            62,
            222,
            226,
            215,
            214,
            134,
            135,
            139,
            216,
            233,
            124,
            172,
            93,
            98,
            113,
            94,
            278,
        ),
    ),
}


def confine(seconds: int) -> list[str]:
    """Confine this process for good, as far as the system has protections for it.

    With all of them, the process can only compute, and read and write the files that are open already, and its memory,
    its processor time and what it writes are limited. Its environment variables are always removed.

    Args:
        seconds: processor time that the process may take [s].

    Returns:
        "Landlock", which shuts files, or "seccomp", which refuses calls, or both: those that the system does not have.
    """
    limits = {
        resource.RLIMIT_AS: MEMORY,
        resource.RLIMIT_CPU: seconds,
        resource.RLIMIT_FSIZE: _MOST_WRITTEN,
        resource.RLIMIT_CORE: 0,
    }
    for kind, limit in limits.items():
        with suppress(ValueError, OSError):  # not all systems have all limits
            # Equal soft and hard limits: the process cannot raise them again.
            resource.setrlimit(kind, (limit, limit))
    # The variables that the start of Python needed are not needed any more.
    os.environ.clear()
    if sys.platform != "linux":
        return ["Landlock", "seccomp"]

    # The filter comes last, because it refuses the calls that set up Landlock.
    system = _system()
    missing = []
    if not _shut_files(system):
        missing.append("Landlock")
    if not _filter_calls(system):
        missing.append("seccomp")
    return missing


def _system() -> ctypes.CDLL:
    """Load the C library, and give up new privileges, such as those of a setuid program.

    The kernel lets a process without privileges confine itself only after this.
    """
    # None means the process itself, in which the C library is loaded already.
    system = ctypes.CDLL(None)
    system.syscall.restype = ctypes.c_long
    arguments = map(ctypes.c_ulong, (1, 0, 0, 0))
    system.prctl(_PR_SET_NO_NEW_PRIVS, *arguments)
    return system


def _shut_files(system: ctypes.CDLL) -> bool:
    """Refuse this process all files with Landlock, and ports and signals to other processes where it can do so.

    It refuses ports from version 4 of Landlock on, and signals from version 6 on. Returns whether Landlock is active,
    which a system may lack.
    """
    version = int(
        system.syscall(_LANDLOCK_CREATE_RULESET, None, ctypes.c_size_t(0), _LANDLOCK_GET_VERSION),
    )
    # Old kernels, and some containers, have no Landlock: the call fails with a negative number.
    if version < 1:
        return False
    # The rights that a ruleset contains are refused. A kernel accepts only the fields that its version knows.
    rights = [_FILE_RIGHTS.get(version, _LATER_FILE_RIGHTS)]
    # Each field of the ruleset that is left out permits what it would control.
    if version >= 4:
        rights.append(_PORT_RIGHTS)
    if version >= 6:
        rights.append(_SCOPES)
    ruleset = (ctypes.c_uint64 * len(rights))(*rights)
    size = ctypes.c_size_t(ctypes.sizeof(ruleset))
    # No rule is added to the ruleset, so that nothing at all is allowed.
    descriptor = int(system.syscall(_LANDLOCK_CREATE_RULESET, ctypes.byref(ruleset), size, 0))
    if descriptor < 0:
        return False
    return int(system.syscall(_LANDLOCK_RESTRICT_SELF, descriptor, 0)) == 0


class _Step(ctypes.Structure):
    """One instruction of a filter, the kernel's ``sock_filter``. ``yes`` and ``no`` count the steps to skip."""

    _fields_ = (
        ("code", ctypes.c_uint16),
        ("yes", ctypes.c_uint8),
        ("no", ctypes.c_uint8),
        ("value", ctypes.c_uint32),
    )


class _Program(ctypes.Structure):
    """A filter, the kernel's ``sock_fprog``."""

    _fields_ = (("length", ctypes.c_uint16), ("steps", ctypes.POINTER(_Step)))


def _filter_calls(system: ctypes.CDLL) -> bool:
    """Refuse this process all system calls but a few, with a seccomp filter.

    Returns whether the filter is active. There is none for processors other than x86_64 and aarch64.
    """
    # The numbers of system calls are known for these processors only.
    machine = _MACHINES.get(platform.machine())
    if machine is None:
        return False
    # The numbers of calls differ between architectures, so calls of another one are refused.
    steps = [
        _Step(_BPF_LOAD, 0, 0, _ARCHITECTURE),
        _Step(_BPF_JUMP_IF_EQUAL, 1, 0, machine.architecture),
        _Step(_BPF_RETURN, 0, 0, _REFUSE),
        _Step(_BPF_LOAD, 0, 0, _CALL_NUMBER),
    ]
    # From comparison k of n, a jump over n - k steps leads behind the refusal, to the permission.
    count = len(machine.calls)
    for index, call in enumerate(machine.calls):
        steps.append(_Step(_BPF_JUMP_IF_EQUAL, count - index, 0, call))
    steps.append(_Step(_BPF_RETURN, 0, 0, _REFUSE))
    steps.append(_Step(_BPF_RETURN, 0, 0, _ALLOW))

    # The kernel copies the filter, so the arrays may go when the function ends.
    program = _Program(len(steps), (_Step * len(steps))(*steps))
    mode = ctypes.c_ulong(_SECCOMP_MODE_FILTER)
    return int(system.prctl(_PR_SET_SECCOMP, mode, ctypes.byref(program), 0, 0)) == 0
