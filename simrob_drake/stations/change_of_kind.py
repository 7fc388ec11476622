"""Rules for the keys of a section, such as ``reference``, whose ``kind`` is changed.

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
# Kinds of entries, for each section that holds entries by name, such as ``monitors.fall``.
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
    """Warning: keys of a section are dropped because they were given for the section's old kind.

    Attributes:
        label: what the command line prints before the message.
    """

    label = "note"


def kind_of(section: Mapping[str, Any], path: list[str]) -> str | None:
    """Find the kind of a section.

    Args:
        section: content of the section.
        path: keys of the section from the top of the station's file, such as ``["monitors", "fall"]``.

    Returns:
        the value of the key ``kind``. An entry without this key has the kind of its own name if there is such a kind,
        such as ``fall``. Otherwise the section has no kind, and None is returned.
    """
    if _KIND in section:
        return str(section[_KIND])
    if len(path) == 2 and path[0] in _FAMILIES and path[1] in _FAMILIES[path[0]]:
        return path[1]
    return None


@dataclass
class KeyLosses:
    """The keys that sections lose because their kinds change, while a station is changed."""

    # Whether a dropped key with the default value of the old kind counts as lost. In a station's file it does, since a
    # user wrote it. The content of a configuration has all keys, so that defaults there were not given by anybody.
    counts_defaults: bool
    texts: list[str] = field(default_factory=list)  # texts of the warnings

    def begin_new_kind(self, section: dict[str, Any], path: list[str], kind: str) -> None:
        """Empty a section whose kind is about to change, and record the keys that the section loses.

        A section without a kind, or with the new kind already, stays as it is.

        Args:
            section: content of the section, which is changed.
            path: keys of the section from the top of the station's file.
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
        """Issue the recorded warnings."""
        # The same text may be recorded more than once.
        for text in dict.fromkeys(self.texts):
            warnings.warn(text, KeysLeftOut, stacklevel=2)


def _is_default(section: Mapping[str, Any], key: str, model: type[BaseModel] | None) -> bool:
    """Whether a key of a section has its default value; False if the class of the section is not known (None)."""
    declared = None if model is None else model.model_fields.get(key)
    return declared is not None and not declared.is_required() and section[key] == declared.get_default()


def _model(path: list[str], kind: str) -> type[BaseModel] | None:
    """Find the class of a section by its path of keys and its kind. Returns None if the class is not known."""
    if path[-1] == "solver":
        return _SOLVERS.get(kind)
    family = references.KINDS if path[-1] == "reference" else _FAMILIES.get(path[0])
    return family.model(kind) if family is not None and kind in family else None


def settings_with(settings: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Update settings with later changes.

    A change of a section's kind drops the earlier settings of that section, which were made for its old kind.

    Args:
        settings: earlier settings, by dotted key such as ``reference.duration``.
        changes: later settings, by dotted key.
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
    """Find the section whose kind a setting changes.

    A setting changes a kind by a key such as ``solver.kind``, or by a mapping with the key ``kind``.

    Returns:
        the dotted key of the section, and the new kind, or None as the kind if the setting changes no kind.
    """
    section, _, last = key.rpartition(".")
    if last == _KIND and section and isinstance(value, str):
        return section, value
    if isinstance(value, Mapping) and isinstance(value.get(_KIND), str):
        return key, value[_KIND]
    return key, None
