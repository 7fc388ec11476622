"""The expansion of a xacro file, in a process of its own that computes and opens nothing.

``python -m simrob_drake.importer.reading.expansion`` talks as :mod:`simrob_drake.importer.reading.child` does: it is
given a file and its arguments, and asks for each text, each package and each list of files that it needs. The package
xacro expands macros; all of it that evaluates, opens or looks around is replaced.
"""

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
from simrob_drake.importer.reading.expressions import Function, NotAllowed, bounded, evaluate, symbols

SECONDS = 20  # of processor time that an expansion may take: a xacro can call itself for ever
_LATE = ("encodings.latin_1", "unicodedata", "xml.dom.expatbuilder")  # modules that are loaded when first needed
_MOST_MESSAGES = 20
_UNITS = {
    "radians": 1.0,
    "degrees": math.pi / 180,
    "meters": 1.0,
    "millimeters": 0.001,
    "foot": 0.3048,
    "inches": 0.0254,
}


class _Loader(yaml.CSafeLoader):
    """A safe loader that knows xacro's units; dates stay texts."""


class _Expansion:
    """One expansion, and what it may ask of the process that started it."""

    def __init__(self) -> None:
        self.messages: list[str] = []  # what the file says to its reader
        own = {
            "abs_filename": xacro.abs_filename_spec,
            "arg": lambda name: substitution_args._eval_arg(name, xacro.substitution_args_context["arg"]),
            "load_yaml": lambda file: bounded(yaml.load(_ask("yaml", xacro.abs_filename_spec(file)), Loader=_Loader)),
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
        """Return a job's ``urdf``, of its ``file`` and ``arguments``, and ``messages``; raises whatever xacro does."""
        xacro.root_dir = "/"
        try:
            document = xacro.process_file(job["file"], mappings=job["arguments"])
        except Exception as problem:
            raise _cause(problem) from problem
        return {"urdf": document.documentElement.toxml(), "messages": self.messages}

    def _document(self, _: None, file: str) -> minidom.Document:
        try:
            document = minidom.parseString(_ask("xml", file))
        except OSError as problem:
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
        return float(evaluate(loader.construct_scalar(node), self._symbols)) * factor

    def _eval(self, text: str, context: dict[str, Any]) -> str:
        """Return the value of ``$(eval ...)``, in which arguments are names."""
        arguments = {key: substitution_args.convert_value(value, "auto") for key, value in context["arg"].items()}
        functions = {
            "arg": Function("arg", arguments.__getitem__),
            "env": Function("env", _environment),
            "find": Function("find", partial(_ask, "package")),
            "optenv": Function("optenv", substitution_args._eval_optenv),
        }
        names = {**arguments, **self._symbols, **functions, "true": True, "false": False}
        return str(evaluate(text, names))

    def _say(self, *words: Any, **_: Any) -> str:
        if len(self.messages) < _MOST_MESSAGES:
            self.messages.append(" ".join(map(str, words))[:1000])
        return ""


def _environment(name: str) -> str:
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
    """Return the text of a file, the files that a pattern names, or the folder of a package, as it was answered."""
    answer = ask(kind, about)
    if "missing" in answer:
        raise FileNotFoundError(2, answer["missing"], about)
    if "refused" in answer:
        raise LookupError(from_data(answer["refused"]))
    return answer["found"]


def _cause(problem: Exception) -> Exception:
    """Return an error of xacro, or what lies behind it where xacro only repeats that."""
    cause: Any = problem
    while getattr(cause, "exc", None) is not None:
        cause = cause.exc
    return cause if isinstance(cause, NotAllowed | LookupError | MemoryError | OSError | SyntaxError) else problem


if __name__ == "__main__":
    for name in _LATE:
        importlib.import_module(name)
    warnings.simplefilter("ignore")  # to show one, modules would be loaded
    serve(_Expansion().run, SECONDS)
