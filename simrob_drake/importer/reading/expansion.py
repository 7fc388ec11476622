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
    check_value,
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
        # Functions of the namespace "xacro" in expressions. All others of the package xacro do not exist for a file.
        functions = {
            "abs_filename": xacro.abs_filename_spec,
            "arg": _argument,
            "load_yaml": _load_yaml,
            "fatal": lambda *words: _refuse(" ".join(map(str, words))),
            "message": self._keep_message,
            "warning": self._keep_message,
            "error": self._keep_message,
            # It would print the place in the file to the standard error, which no user sees.
            "print_location": lambda: "",
        }
        self._symbols = symbols(**functions)

        # Expressions ${...} are evaluated by the interpreter of this package.
        xacro._global_symbols = self._symbols
        xacro.safe_eval = evaluate
        # Files, lists of files and packages come from the parent: this process can open nothing.
        xacro.parse = self._document
        xacro.glob = SimpleNamespace(glob=partial(_ask, "files"))
        # The same for $(eval ...), $(find ...) and $(env ...).
        substitution_args._eval = self._eval
        substitution_args._eval_find = partial(_ask, "package")
        substitution_args._eval_env = _environment
        for unit, factor in _UNITS.items():
            _Loader.add_constructor(f"!{unit}", partial(self._with_unit, factor=factor))
        # An expression can have no dates. A serial number such as 2020-01-01 stays the text that it is meant to be.
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
        # $(cwd) would ask for the working folder, which has no meaning for a file, and which the system refuses here.
        xacro.root_dir = "/"
        try:
            document = xacro.process_file(job["file"], mappings=job["arguments"])
        # xacro wraps errors in errors of its own, which add the expression.
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
        # The parent's parser refuses entities in the outermost file. An included file gets here first.
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
        """Evaluate the expression of ``$(eval ...)``, which can use the arguments of the file by their names."""
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
        # Later names replace earlier ones: an argument cannot hide a function. The launch files of ROS, from which
        # $(eval ...) comes, write true and false in lower case.
        names = {**arguments, **self._symbols, **functions, "true": True, "false": False}
        return str(evaluate(text, names))

    def _keep_message(self, *words: Any, **_: Any) -> str:
        """Keep a message of the file. Returns the value of the expression that contains the call: an empty text."""
        # A file that calls itself could fill the memory with messages.
        if len(self.messages) < _MOST_MESSAGES:
            self.messages.append(" ".join(map(str, words))[:_LONGEST_MESSAGE])
        return ""


def _argument(name: str) -> Any:
    """Value of an argument of the file, for ``xacro.arg()`` in an expression."""
    return substitution_args._eval_arg(name, xacro.substitution_args_context["arg"])


def _load_yaml(file: str) -> Any:
    """Content of a YAML file, for ``xacro.load_yaml()`` in an expression.

    Raises:
        NotAllowed: the content is too large, or contains other values than numbers, texts, lists and mappings.
        FileNotFoundError: the file does not exist.
        LookupError: it may not or cannot be read.
        YAMLError: it is not YAML.
    """
    content = yaml.load(_ask("yaml", xacro.abs_filename_spec(file)), Loader=_Loader)
    return check_value(content)


def _environment(name: str) -> str:
    """Refuse to read an environment variable, which may contain a secret of the user."""
    return _refuse(
        message(
            "importer.environment_variable",
            "a xacro file may not read the environment variable {name}",
            name=name,
        )
    )


def _refuse(why: str) -> NoReturn:
    """End the expansion with a reason. A function, because an expression in a lambda cannot raise an error."""
    raise NotAllowed(why)


def _ask(kind: str, about: str) -> Any:
    """Request from the parent the text of a file, the files that fit a pattern, or the folder of a package.

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
    # xacro keeps the wrapped error in the attribute `exc`.
    cause: Any = problem
    while getattr(cause, "exc", None) is not None:
        cause = cause.exc
    # The messages of these errors are complete. For other errors, such as a ZeroDivisionError, the text of xacro also
    # contains the expression.
    is_complete = isinstance(cause, NotAllowed | LookupError | MemoryError | OSError | SyntaxError)
    return cause if is_complete else problem


if __name__ == "__main__":
    for name in _MODULES_LOADED_LATE:
        importlib.import_module(name)
    warnings.simplefilter("ignore")  # Python would load modules to show a warning
    serve(_Expansion().run, SECONDS)
