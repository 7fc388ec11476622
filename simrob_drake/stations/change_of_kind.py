"""What becomes of the keys of a section, such as ``reference``, when its ``kind`` is changed.

Keys of the same name mean different things in sections of different kinds: the
``target_deg`` to which a ramp goes is where a hold stands from the first moment. So a
section of a new kind begins from that kind's defaults, and keys that were given for the
old kind are left out and named.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel

from simrob_drake.parts import controllers, couplings, forces, monitors, references, sensors
from simrob_drake.parts.kinds import Kinds
from simrob_drake.stations.solver_config import ContinuousSolver, DiscreteSolver, MujocoSolver

_SOLVERS: dict[str, type[BaseModel]] = {
    "continuous": ContinuousSolver,
    "discrete": DiscreteSolver,
    "mujoco": MujocoSolver,
}
# The kinds of the entries of sections that hold entries by name.
_FAMILIES: dict[str, Kinds] = {
    "controllers": controllers.KINDS,
    "couplings": couplings.KINDS,
    "forces": forces.KINDS,
    "monitors": monitors.KINDS,
    "prescribed": references.KINDS,
    "sensors": sensors.KINDS,
}
_KIND = "kind"


class KeysLeftOut(UserWarning):
    """Keys of a section that were given for its old kind, and that its new kind begins without.

    Attributes:
        label: what the command line prints before the message.
    """

    label = "note"


def kind_of(section: Mapping[str, Any], path: list[str]) -> str | None:
    """Kind of the section at a path of keys, or None if it has none.

    The name of an entry, such as ``monitors.fall``, stands for its kind unless the entry
    gives one.
    """
    if _KIND in section:
        return str(section[_KIND])
    if len(path) == 2 and path[0] in _FAMILIES and path[1] in _FAMILIES[path[0]]:
        return path[1]
    return None


@dataclass
class KeyLosses:
    """The keys that sections lose because their kinds change, while a station is changed."""

    # Whether a key with the default value of the old kind counts: in a station's file it
    # does, since somebody wrote it. A configuration has all keys.
    counts_defaults: bool
    texts: list[str] = field(default_factory=list)  # what to warn of

    def begin_new_kind(self, section: dict[str, Any], path: list[str], kind: str) -> None:
        """Empty a section whose kind is about to change, and note the keys that it loses.

        Args:
            section: the section, which is changed.
            path: its keys from the top of the station's file.
            kind: the new kind.
        """
        old_kind = kind_of(section, path)
        if old_kind is None or old_kind == kind:
            return
        lost = [key for key in section if key != _KIND]
        if not self.counts_defaults:
            lost = [key for key in lost if not _is_default(section, key, _model(path, old_kind))]
        section.clear()
        if lost:
            where = ".".join(path)
            self.texts.append(
                f"{where}.kind is {kind} in place of {old_kind}: {where} begins from the defaults of {kind}, "
                f"without what was given for {old_kind} ({', '.join(lost)}); set {where}.<key> for the new kind"
            )

    def warn(self) -> None:
        """Warn of the keys, once for each section."""
        for text in dict.fromkeys(self.texts):
            warnings.warn(text, KeysLeftOut, stacklevel=2)


def _is_default(section: Mapping[str, Any], key: str, model: type[BaseModel] | None) -> bool:
    """Tell whether a section of a known class has the default value under a key."""
    declared = None if model is None else model.model_fields.get(key)
    return declared is not None and not declared.is_required() and section[key] == declared.get_default()


def _model(path: list[str], kind: str) -> type[BaseModel] | None:
    """Class of the sections of a kind at a path, or None if it is not known."""
    if path[-1] == "solver":
        return _SOLVERS.get(kind)
    family = references.KINDS if path[-1] == "reference" else _FAMILIES.get(path[0])
    return family.model(kind) if family is not None and kind in family else None


def settings_with(settings: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by dotted key, with changes that come later.

    A change of a section's kind takes away the settings that were made for its old kind.
    """
    kept = dict(settings)
    for key, value in changes.items():
        section, kind = _section_of(key, value)
        if kind is None or kept.get(f"{section}.{_KIND}") == kind:
            continue
        for other in settings:
            if other.startswith(f"{section}.") and other not in changes:
                kept.pop(other, None)
    return {**kept, **changes}


def _section_of(key: str, value: Any) -> tuple[str, str | None]:
    """Section that a setting gives a kind, and that kind; None if the setting gives none."""
    section, _, last = key.rpartition(".")
    if last == _KIND and section and isinstance(value, str):
        return section, value
    if isinstance(value, Mapping) and isinstance(value.get(_KIND), str):
        return key, value[_KIND]
    return key, None
