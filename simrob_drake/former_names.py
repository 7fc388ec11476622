"""Former names of modules, which can still be imported, with a DeprecationWarning, until version 0.2."""

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.abc import Loader, MetaPathFinder
else:
    # The module of the abstract classes takes 0.04 s to import, and Python only asks for their methods.
    Loader = type("Loader", (), {})
    MetaPathFinder = type("MetaPathFinder", (), {})

_PACKAGE = "simrob_drake"
_MOVED_PACKAGES = {
    "comparison": "extensions.comparison",
    "course": "extensions.course",
    "learning": "extensions.learning",
    "legged": "extensions.legged",
    "linear": "extensions.linear",
    "mujoco": "extensions.mujoco",
    "rapid": "extensions.rapid",
    "simulink": "extensions.simulink",
    "teach": "extensions.pendant",
    "tuning": "extensions.tuning",
    "importer.mjcf": "extensions.mujoco.mjcf",
    "importer.options": "robots.imports",
    "importer.packages": "base.packages",
    "parts.controllers.policy": "extensions.learning.policy",
    "stations.mujoco": "extensions.mujoco",
}
_MOVED_MODULES = (
    "arguments",
    "constants",
    "distributions",
    "errors",
    "extras",
    "files",
    "folders",
    "frames",
    "interpolation",
    "interrupts",
    "lifetime",
    "progress",
    "sampling",
    "sections",
    "signals",
    "yaml_files",
)
_NEW_NAMES = _MOVED_PACKAGES | {name: f"base.{name}" for name in _MOVED_MODULES}
"""Former name of a module or package below ``simrob_drake``, and its present one."""


class FormerNames(MetaPathFinder, Loader):
    """Import a moved module under its former name: the present module itself, so that its classes are the same."""

    def __init__(self) -> None:
        self._specs: dict[str, ModuleSpec | None] = {}  # by present name

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module of a former name. Returns None for all other names, which are left to Python."""
        return None if _present_name(fullname) is None else ModuleSpec(fullname, self)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Import the module by its present name, with a warning, and remember its specification for `exec_module`."""
        present = _present_name(spec.name)
        assert present is not None  # find_spec found it
        message = f"{spec.name} is now {present}; the former name works until simrob_drake 0.2"
        # Python leaves its own import functions out of the stack of a warning, so level 2 is the import statement.
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        module = import_module(present)
        self._specs[present] = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Give a module its own specification back, which Python has replaced by that of the former name.

        The module itself was executed when it was imported by its present name.
        """
        module.__spec__ = self._specs[module.__name__]


def _present_name(name: str) -> str | None:
    """Find the present name of a module. Returns None if the name is not a former one.

    Args:
        name: full name of the module, such as ``simrob_drake.teach.form``, whose present name is
            ``simrob_drake.extensions.pendant.form``.
    """
    top, *parts = name.split(".")
    if top != _PACKAGE:
        return None
    # Packages come before the modules in them: all modules of a package that has moved have moved with it.
    for count in range(1, len(parts) + 1):
        present = _NEW_NAMES.get(".".join(parts[:count]))
        if present is not None:
            return ".".join([_PACKAGE, present, *parts[count:]])
    return None


def install() -> None:
    """Make Python find modules by their former names.

    The finder comes first: a package that was imported by its former name would otherwise load its modules twice.
    """
    if not any(isinstance(finder, FormerNames) for finder in sys.meta_path):
        sys.meta_path.insert(0, FormerNames())
