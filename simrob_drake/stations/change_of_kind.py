"""Rules for the keys of a section, such as ``reference``, whose ``kind`` is changed.

A section is a mapping of keys in a station's file. Its key ``kind`` selects one of several classes, each with keys of
its own. Keys of the same name mean different things in sections of different kinds: the ``target_deg`` of a ramp is
where the ramp ends, the ``target_deg`` of a hold is where the robot stands from the first moment. So a section of a new
kind begins from that kind's defaults. Keys that were given for the old kind are dropped, and a warning names them.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pydantic import BaseModel

from simrob_drake.base.messages import message
from simrob_drake.parts import controllers, couplings, forces, monitors, references, sensors
from simrob_drake.parts.kinds import Kinds
from simrob_drake.stations.solver_config import SOLVERS

# Sections that hold entries by name, such as ``monitors.fall``: the kinds that their entries may have.
_ENTRY_KINDS: dict[str, Kinds] = {
    "controllers": controllers.KINDS,
    "couplings": couplings.KINDS,
    "forces": forces.KINDS,
    "monitors": monitors.KINDS,
    "prescribed": references.KINDS,
    "sensors": sensors.KINDS,
}
_KIND = "kind"  # the key that selects the class of a section


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
    if _is_entry(path) and path[1] in _ENTRY_KINDS[path[0]]:
        return path[1]
    return None


def _is_entry(path: list[str]) -> bool:
    """Whether a path of keys is that of an entry of _ENTRY_KINDS, such as ``["monitors", "fall"]``."""
    return len(path) == 2 and path[0] in _ENTRY_KINDS


@dataclass
class KeyLosses:
    """A record of the keys that sections lose because their kinds change.

    Attributes:
        counts_defaults: whether a dropped key with the default value of the old kind counts as lost. True for the
            content of a station's file, where a user wrote the key. False for the content of a `StationConfig`, which
            has all keys, also those that no user gave.
        texts: texts of the warnings.
    """

    counts_defaults: bool
    texts: list[str] = field(default_factory=list)

    def begin_new_kind(self, section: dict[str, Any], path: list[str], kind: str) -> None:
        """Empty a section whose kind is about to change, and record a warning if keys are lost by this.

        The caller writes the new kind into the section. A section without a kind, or with the new kind already, stays
        as it is. Which keys count as lost depends on the attribute `counts_defaults`.

        Args:
            section: content of the section, which is changed.
            path: keys of the section from the top of the station's file.
            kind: the new kind.
        """
        old_kind = kind_of(section, path)
        # An explicit kind that only repeats the present one must not cost the section its keys.
        if old_kind is None or old_kind == kind:
            return
        lost = [key for key in section if key != _KIND]
        if not self.counts_defaults:
            section_class = _class_of(path, old_kind)
            lost = [key for key in lost if not _is_default(section, key, section_class)]
        # Emptied in place: the section is a part of the station's content, which the caller keeps.
        section.clear()
        if lost:
            where = ".".join(path)
            self.texts.append(
                message(
                    "stations.change_of_kind",
                    "{where}.kind changes from {old_kind} to {kind}, so the keys that were given for {old_kind} "
                    "are dropped: {lost}; to change a default of {kind}, set {where}.<key>",
                    where=where,
                    kind=kind,
                    old_kind=old_kind,
                    lost=", ".join(lost),
                )
            )

    def warn(self) -> None:
        """Issue the recorded warnings, equal ones once."""
        # A dict drops repeated texts and keeps their order.
        for text in dict.fromkeys(self.texts):
            warnings.warn(text, KeysLeftOut, stacklevel=2)


def _is_default(
    section: Mapping[str, Any],
    key: str,
    section_class: type[BaseModel] | None,
) -> bool:
    """Whether a key of a section has its default value.

    Returns False if the section's class is not known (None), or has no such key.
    """
    if section_class is None or key not in section_class.model_fields:
        return False
    declared = section_class.model_fields[key]
    # A required key has no default. A default may be a value or, for sections and mappings, a function that makes it.
    return not declared.is_required() and section[key] == declared.get_default(
        call_default_factory=True
    )


def _class_of(path: list[str], kind: str) -> type[BaseModel] | None:
    """Find the class of a section by its path of keys and its kind.

    Only the solver, references and entries of _ENTRY_KINDS are known here. Returns None for a section at another path,
    such as a block of a signal flow, or if no class of this kind is installed.
    """
    if path == ["solver"]:
        kinds = SOLVERS
    elif _is_entry(path):
        kinds = _ENTRY_KINDS[path[0]]
    elif path[-1] == "reference":
        # The reference of the only robot or, as robots.<name>.reference, of one of several.
        kinds = references.KINDS
    else:
        return None
    # A kind of an extension that is not installed has no class here.
    return kinds.model(kind) if kind in kinds else None


def settings_with(settings: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Combine earlier settings of a station with later ones, which replace them.

    A later setting of a section's kind drops the earlier settings below that section, since they may be meant for
    another kind. It drops nothing if an earlier setting ``<section>.kind`` has the same value. A later number, such as
    ``servo.kp`` for all axes, drops earlier settings below its key, such as ``servo.kp.joint_2``. Keys that are in both
    mappings have the later value.

    Args:
        settings: earlier settings, by dotted key such as ``reference.duration``.
        changes: later settings, by dotted key.

    Returns:
        the combined settings, by dotted key. The arguments stay as they are.
    """
    kept = dict(settings)
    for key, value in changes.items():
        if isinstance(value, (int, float)):
            # Over `settings`, since `kept` loses entries in this loop.
            for earlier_key in settings:
                # The earlier `servo.kp.joint_2` would otherwise replace the new number at its axis.
                if earlier_key.startswith(f"{key}.") and earlier_key not in changes:
                    kept.pop(earlier_key, None)
        change = _change_of_kind(key, value)
        # A setting that repeats the kind of the earlier settings drops nothing.
        if change is None or kept.get(f"{change.section}.{_KIND}") == change.kind:
            continue
        # Keys that the changes set, too, are meant for the new kind, and stay.
        for earlier_key in settings:
            is_in_section = earlier_key.startswith(f"{change.section}.")
            if is_in_section and earlier_key not in changes:
                kept.pop(earlier_key, None)
    return {**kept, **changes}


class _ChangeOfKind(NamedTuple):
    """A setting that gives the kind of a section.

    Attributes:
        section: dotted key of the section, such as ``solver`` or ``monitors.fall``.
        kind: the kind, which may be a new one.
    """

    section: str
    kind: str


def _change_of_kind(key: str, value: Any) -> _ChangeOfKind | None:
    """Find the section whose kind a setting gives, perhaps a new one. Returns None if the setting gives no kind.

    A setting gives a kind by a key such as ``solver.kind``, or by a mapping with the key ``kind``.

    Args:
        key: dotted key of the setting.
        value: value of the setting.
    """
    # `kind` without a section would be a key of the station itself, which has no kind.
    section, _, last = key.rpartition(".")
    if last == _KIND and section and isinstance(value, str):
        return _ChangeOfKind(section, value)
    if isinstance(value, Mapping) and isinstance(value.get(_KIND), str):
        return _ChangeOfKind(key, value[_KIND])
    return None
