"""Limits of memory and processor time of the processes that measure an answer."""

import resource
from contextlib import suppress


def apply_limits(memory: int, seconds: int) -> None:
    """Limit this process: its address space [bytes] and its processor time [s]; it writes no core dumps.

    Systems that do not have one of these limits do without.
    """
    limits = {
        resource.RLIMIT_AS: memory,
        resource.RLIMIT_CPU: seconds + 1,
        resource.RLIMIT_CORE: 0,
    }
    for kind, limit in limits.items():
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (limit, limit))
