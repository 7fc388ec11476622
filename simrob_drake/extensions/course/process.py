"""Functions that the two processes of a measurement share: their limits, their output, and loading of Python files.

An exercise is measured in two processes: one runs the checks, the other one the answer. See the modules `child` and
`answer_process` of this package.
"""

import os
import resource
import sys
from contextlib import suppress
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import TextIO

from simrob_drake.base.errors import shorten
from simrob_drake.base.messages import compound, message, set_output_language, translate

LONGEST_PROBLEM = 300
"""Longest text of an error that is passed on [characters]."""


def write_in_language(language: str) -> None:
    """Write the problems of this process in a language, such as ``es``.

    The messages of this package are found by the module of extensions, which nothing else imports here.
    """
    import_module("simrob_drake.base.extension")
    set_output_language(language)


def apply_limits(memory: int, seconds: int) -> None:
    """Limit the memory and the processor time of this process, and switch core dumps off.

    A limit that the operating system does not have, or does not allow, is left out.

    Args:
        memory: largest size of the address space [bytes].
        seconds: processor time [s]. The system ends the process one second later, so that the program that has started
            the measurement, and waits as long, ends it first and says why.
    """
    limits = {
        resource.RLIMIT_AS: memory,
        resource.RLIMIT_CPU: seconds + 1,
        resource.RLIMIT_CORE: 0,
    }
    for kind, limit in limits.items():
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (limit, limit))


def take_over_output() -> TextIO:
    """Return a file that writes to the standard output of this process, and discard all that is printed from now on."""
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    # Drake prints from C++ as well, so the file descriptor itself is redirected.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return replies


def load_module(file: Path, name: str) -> ModuleType:
    """Load a Python file as a module of a given name, and let it import modules from its folder.

    An error that the code of the file raises is passed on.

    Raises:
        ImportError: the file's name is not that of a Python file.
    """
    sys.path.insert(0, str(file.parent))
    spec = spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError(
            message("course.no_python_file", "{file} is no Python file", file=file.name)
        )
    module = module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def error_text(problem: BaseException) -> str:
    """Class and message of an error on one line in the language of the output, cut if the line is long."""
    whole = compound("{name}: {problem}", name=type(problem).__name__, problem=problem)
    return translate(shorten(whole, LONGEST_PROBLEM))
