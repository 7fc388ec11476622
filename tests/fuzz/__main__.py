"""Give a thousand cases to the command line, a process each: ``python -m tests.fuzz [COUNT [SEED [KIND...]]]``.

Fails where one of them ends with anything else than an exit code and one line, takes 20 s or 1 GB.
"""

import itertools
import os
import resource
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.fuzz.cases import case, kind_of
from tests.fuzz.verdicts import ALLOWED, ended, run

SECONDS, PATIENCE = 20, 240
"""Of the processor's time, and of the clock's: others may want the machine, too."""
MEMORY = 1_000_000  # kB
_ADDRESSES = 8 * 2**30
"""More than a case may take, so that it is measured; less than would hurt the machine [bytes]."""


@dataclass(frozen=True)
class Attempt:
    """A case that is being tried."""

    number: int
    folder: Path
    began: float


def begin(number: int, seed: int, folder: Path) -> int:
    """Start a case in a process of its own, and return its id."""
    process = os.fork()
    if process:
        return process
    code = 99
    try:
        (folder / "work").mkdir(parents=True)
        for stream, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT), stream)
        os.chdir(folder / "work")
        resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        made = case(number, seed)
        made.put(Path())
        code = run(made)
    finally:
        sys.stderr.flush()
        os._exit(code)


def verdict(attempt: Attempt, status: int, memory: int) -> str:
    """Return what became of a case, in a word or two if it is well, with its last line if it is not."""
    told = (
        (attempt.folder / "stderr").read_text(errors="replace")
        if (attempt.folder / "stderr").exists()
        else ""
    )
    if memory > MEMORY:
        return f"takes {memory / 1e6:.1f} GB"
    if os.WIFSIGNALED(status):
        late = "takes too long, " if os.WTERMSIG(status) in (9, 24) else ""
        return f"{late}ends by signal {os.WTERMSIG(status)}"
    return ended(os.WEXITSTATUS(status), told)


def main(count: int = 1000, seed: int = 1, *kinds: str) -> int:
    """Try the cases, two at a time on two processors, and print a table of what became of them.

    If there are ``kinds``, only cases of these are tried.
    """
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    found: Counter[tuple[str, str]] = Counter()
    console = Console(width=160, markup=False)
    began, slowest, largest = time.monotonic(), 0.0, 0
    with tempfile.TemporaryDirectory(prefix="fuzz-") as top:
        os.environ["XDG_CACHE_HOME"] = f"{top}/cache"
        numbers = (number for number in itertools.count() if not kinds or kind_of(number) in kinds)
        waiting = list(itertools.islice(numbers, count))[::-1]
        running = dict[int, Attempt]()
        while waiting or running:
            while waiting and len(running) < (os.cpu_count() or 1):
                number = waiting.pop()
                folder = Path(top) / str(number)
                running[begin(number, seed, folder)] = Attempt(number, folder, time.monotonic())
            process, status, usage = os.wait4(-1, os.WNOHANG)
            if process in running:
                attempt = running.pop(process)
                kind, said = kind_of(attempt.number), verdict(attempt, status, usage.ru_maxrss)
                found[kind, said if said in ALLOWED else "BAD"] += 1
                if said not in ALLOWED:
                    console.print(f"case {attempt.number} ({kind}): {said}", soft_wrap=True)
                slowest, largest = max(slowest, usage.ru_utime), max(largest, usage.ru_maxrss)
                continue
            for process, attempt in running.items():
                if time.monotonic() - attempt.began > PATIENCE:
                    os.kill(process, 9)
            time.sleep(0.02)
    table = Table(
        "input",
        *ALLOWED,
        "BAD",
        title=f"{count} cases of seed {seed} in {time.monotonic() - began:.0f} s",
    )
    for kind in sorted({kind for kind, _ in found}):
        table.add_row(kind, *(str(found[kind, word]) for word in (*ALLOWED, "BAD")))
    console.print(table)
    console.print(
        f"the slowest took {slowest:.1f} s of the processor, the largest {largest / 1e6:.2f} GB"
    )
    return 1 if any(word == "BAD" for _, word in found) else 0


if __name__ == "__main__":  # processes of a case's own import this file again
    sys.exit(main(*map(int, sys.argv[1:3]), *sys.argv[3:]))
