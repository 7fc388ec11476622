"""Registration of the environments with Gymnasium, which is not imported for it.

The toolbox imports this package whenever it looks for extensions, and Gymnasium takes a quarter of a second to load. So
the environments are registered at once if Gymnasium is there already, and otherwise as soon as it is imported.
"""

import importlib.util
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.abc import Loader, MetaPathFinder
else:
    # The module of the abstract classes takes 0.04 s to import, and Python only asks for their methods.
    Loader = type("Loader", (), {})
    MetaPathFinder = type("MetaPathFinder", (), {})

ENVIRONMENTS = {"Walk": "walk", "Reach": "reach", "HandGuide": "hand_guide", "Balance": "balance"}
"""The tasks of the environments, by the names in their ids."""

_GYMNASIUM = "gymnasium"


def register_with_gymnasium() -> None:
    """Register the environments now, or as soon as Gymnasium is imported."""
    gymnasium = sys.modules.get(_GYMNASIUM)
    if gymnasium is None:
        sys.meta_path.insert(0, _GymnasiumFinder())
    else:
        _register(gymnasium)


def _register(gymnasium: ModuleType) -> None:
    """Register the environments with Gymnasium, under ids such as ``simrob/Walk-v0``.

    Args:
        gymnasium: the imported package ``gymnasium``.
    """
    for name, task in ENVIRONMENTS.items():
        gymnasium.register(
            f"simrob/{name}-v0",
            entry_point="simrob_drake.extensions.learning.environment:StationEnvironment",
            vector_entry_point="simrob_drake.extensions.learning.vector:StationVectorEnvironment",
            kwargs={"task": task},
        )


class _GymnasiumFinder(MetaPathFinder):
    """Find Gymnasium as Python does, and give it a loader that registers the environments afterwards."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find Gymnasium, once. Returns None for all other modules, which are left to Python.

        Args:
            fullname: full name of the module that is imported.
            path: not used; folders of the package above the module.
            target: not used; module that is imported again.
        """
        if fullname != _GYMNASIUM:
            return None
        # This finder is needed once, and the search below must not ask it again.
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            spec.loader = _RegisteringLoader(spec.loader)
        return spec


class _RegisteringLoader(Loader):
    """Load a module by another loader, and register the environments with it."""

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Create the module as the other loader does."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Execute the module by the other loader, and register the environments.

        The other loader is the module's only one from then on, so that nothing that looks at it notices a difference.
        """
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        _register(module)
