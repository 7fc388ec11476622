"""Expand a xacro file in a confined process. :mod:`simrob_drake.importer.reading.xacro` starts it.

``python -m simrob_drake.importer.reading.expansion`` gets a file and its arguments from its parent, as described in
:mod:`simrob_drake.importer.reading.child`. It asks the parent for each text, each package and each list of files.

The package xacro expands the macros. Its functions that evaluate expressions, open files or read the environment are
replaced by those of this module, because it would evaluate expressions as Python code.
"""

import errno
import importlib
import math
import warnings
from functools import partial
from types import SimpleNamespace
from typing import Any, NoReturn
from xml.dom import minidom

import xacro
import yaml
from xacro import substitution_args

from simrob_drake.base.messages import from_data, message
from simrob_drake.importer.reading.child import ask, serve
from simrob_drake.importer.reading.expressions import (
    Function,
    NotAllowed,
    bounded,
    evaluate,
    symbols,
)

SECONDS = 20
"""Longest processor time of an expansion [s]. A xacro file can call itself without end."""

_MODULES_LOADED_LATE = ("encodings.latin_1", "unicodedata", "xml.dom.expatbuilder")
"""Modules that Python would load at their first use, which the confined process cannot do any more."""

_MOST_MESSAGES = 20
"""Largest count of messages of the file that are reported."""

_LONGEST_MESSAGE = 1000
"""Largest count of characters of such a message."""

_UNITS = {
    "radians": 1.0,
    "degrees": math.pi / 180,
    "meters": 1.0,
    "millimeters": 0.001,
    "foot": 0.3048,
    "inches": 0.0254,
}
"""Factors of units in YAML files, such as ``!degrees 90``, to radians or metres."""


class _Loader(yaml.CSafeLoader):
    """Loads YAML files with the units of xacro. Dates stay texts."""


class _Expansion:
    """One expansion of a xacro file. Creating it replaces functions of the package xacro in this process.

    Attributes:
        messages: messages of the file to its user.
    """

    def __init__(self) -> None:
        self.messages: list[str] = []
        # Functions of the namespace "xacro" in expressions.
        own = {
            "abs_filename": xacro.abs_filename_spec,
            "arg": lambda name: substitution_args._eval_arg(
                name, xacro.substitution_args_context["arg"]
            ),
            "load_yaml": lambda file: bounded(
                yaml.load(_ask("yaml", xacro.abs_filename_spec(file)), Loader=_Loader)
            ),
            "fatal": lambda *words: _refuse(" ".join(map(str, words))),
            "message": self._say,
            "warning": self._say,
            "error": self._say,
            "print_location": lambda: "",
        }
        self._symbols = symbols(**own)
        xacro._global_symbols = self._symbols
        xacro.safe_eval = evaluate
        xacro.parse = self._document
        xacro.glob = SimpleNamespace(glob=partial(_ask, "files"))
        substitution_args._eval = self._eval
        substitution_args._eval_find = partial(_ask, "package")
        substitution_args._eval_env = _environment
        for unit, factor in _UNITS.items():
            _Loader.add_constructor(f"!{unit}", partial(self._with_unit, factor=factor))
        _Loader.add_constructor("tag:yaml.org,2002:timestamp", lambda _, node: str(node.value))

    def run(self, job: dict[str, Any]) -> dict[str, Any]:
        """Expand a file.

        Args:
            job: path of the file under ``file``, and values of its arguments under ``arguments``.

        Returns:
            the URDF under ``urdf``, and the messages of the file under ``messages``.

        Raises:
            Exception: the errors of xacro, of many classes.
        """
        xacro.root_dir = "/"
        try:
            document = xacro.process_file(job["file"], mappings=job["arguments"])
        except Exception as problem:
            raise _cause(problem) from problem
        return {"urdf": document.documentElement.toxml(), "messages": self.messages}

    def _document(self, _: None, file: str) -> minidom.Document:
        """Parse an XML file. Takes the place of ``xacro.parse``, whose first argument is never used here."""
        try:
            document = minidom.parseString(_ask("xml", file))
        except OSError as problem:
            # xacro has put the file on its stack before, and would report it as the place of the error.
            xacro.filestack.pop()
            raise xacro.XacroException(exc=problem) from problem
        if document.doctype is not None:
            _refuse(
                message(
                    "importer.entities_in_file",
                    "{file} declares a document type or entities, which a URDF never needs",
                    file=file,
                )
            )
        return document

    def _with_unit(self, loader: _Loader, node: yaml.ScalarNode, *, factor: float) -> float:
        """Convert a YAML value with a unit to radians or metres."""
        return float(evaluate(loader.construct_scalar(node), self._symbols)) * factor

    def _eval(self, text: str, context: dict[str, Any]) -> str:
        """Evaluate ``$(eval ...)``, in which the names of arguments stand for their values."""
        arguments = {
            key: substitution_args.convert_value(value, "auto")
            for key, value in context["arg"].items()
        }
        functions = {
            "arg": Function("arg", arguments.__getitem__),
            "env": Function("env", _environment),
            "find": Function("find", partial(_ask, "package")),
            "optenv": Function("optenv", substitution_args._eval_optenv),
        }
        names = {**arguments, **self._symbols, **functions, "true": True, "false": False}
        return str(evaluate(text, names))

    def _say(self, *words: Any, **_: Any) -> str:
        """Keep a message of the file. Returns the empty value of the expression."""
        if len(self.messages) < _MOST_MESSAGES:
            self.messages.append(" ".join(map(str, words))[:_LONGEST_MESSAGE])
        return ""


def _environment(name: str) -> str:
    """Refuse to read an environment variable, which may contain a secret of the user."""
    return _refuse(
        message(
            "importer.environment_variable",
            "the environment variable {name} is not for a xacro file to read",
            name=name,
        )
    )


def _refuse(why: str) -> NoReturn:
    raise NotAllowed(why)


def _ask(kind: str, about: str) -> Any:
    """Ask the parent for the text of a file, the files that fit a pattern, or the folder of a package.

    Args:
        kind: ``xml``, ``yaml``, ``files`` or ``package``.
        about: the path, the pattern or the name.

    Raises:
        FileNotFoundError: the file does not exist.
        LookupError: it may not or cannot be read.
    """
    answer = ask(kind, about)
    if "missing" in answer:
        raise FileNotFoundError(errno.ENOENT, answer["missing"], about)
    if "refused" in answer:
        raise LookupError(from_data(answer["refused"]))
    return answer["found"]


def _cause(problem: Exception) -> Exception:
    """Find the first cause of an error of xacro, or return the error itself if xacro adds information to the cause."""
    cause: Any = problem
    while getattr(cause, "exc", None) is not None:
        cause = cause.exc
    return (
        cause
        if isinstance(cause, NotAllowed | LookupError | MemoryError | OSError | SyntaxError)
        else problem
    )


if __name__ == "__main__":
    for name in _MODULES_LOADED_LATE:
        importlib.import_module(name)
    warnings.simplefilter("ignore")  # Python would load modules to show a warning
    serve(_Expansion().run, SECONDS)
