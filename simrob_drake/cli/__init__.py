"""The command line: ``simrob list | run | walk | act | check | linearize | diagram | import | view | station | teach``.

Exit codes: 0 done, a monitor's stop included; 2 bad input, with one line on the error stream that says what, where and
what would be right; 3 the simulation diverged, with the partial result saved; 130 the user interrupted it. What was
simulated until then is saved; what was being written is finished, unless the user interrupts again.
"""

import gc
import os
import signal
import sys
from enum import IntEnum
from pathlib import Path


class ExitCode(IntEnum):
    """What ``simrob`` leaves with; a monitor's stop is a success, a block that fails a divergence."""

    DONE = 0
    BAD_INPUT = 2
    DIVERGED = 3
    INTERRUPTED = 130


def main() -> None:
    """Run the command line and leave with its exit code."""
    _use_one_blas_thread()
    for stream in ("stdout", "stderr"):  # None where the caller has closed them
        setattr(sys, stream, getattr(sys, stream) or Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
    interruptible = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else the caller wants it ignored
    if interruptible:
        signal.signal(signal.SIGINT, _leave)
    gc.disable()  # what is loaded stays: there is no rubbish to look for in it, now or later
    from simrob_drake.cli.app import run_command  # loads Drake, inside of which an interrupt may come as any error

    gc.freeze()
    gc.enable()

    if interruptible:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(run_command(sys.argv[1:]))


def _use_one_blas_thread() -> None:
    """Let numpy and scipy, not yet loaded, work in one thread, unless the user's environment says otherwise.

    The matrices of a robot are small: more threads only wait for each other, and take a sixth of the CPU time for it.
    """
    if not {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"} & os.environ.keys():
        os.environ["OPENBLAS_NUM_THREADS"] = "1"


def _leave(*_: object) -> None:
    print("simrob: interrupted", file=sys.stderr, flush=True)
    os._exit(ExitCode.INTERRUPTED)
