"""Options of an import, and the report of its changes of a robot: every repair, default and loss, in words."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import field_validator

from simrob_drake.base.errors import InvalidConfig, InvalidModel
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.messages import as_data, compound, from_data, join_texts, message
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.base.sections import ORIGIN, Boolean, Pose, Positive, Strict
from simrob_drake.base.yaml_files import parse_json

REPORT_FILE = "report.json"
"""Name of the file with the report of an import, in the folder that the import writes."""

_LARGEST_REPORT = 10_000_000
"""Largest size of that file [bytes]. A robot with thousands of links needs some hundred thousand."""


class ImportOptions(Strict):
    """Options of an import. The defaults suit most robots."""

    mesh_path: tuple[Path, ...] = ()
    """Further folders in which meshes and packages are looked for. In a station's file, relative to its folder."""
    packages: tuple[str, ...] = ()
    """Folder of a ROS package, as in `arm_description=/opt/arm`. A station's file has the key `packages` for this."""
    collision: Literal["hull", "box", "none"] = "hull"
    """Shape that replaces a collision mesh: its convex hull, the tightest box around it, or none."""
    estimate_inertia: Boolean = False
    """Estimate missing and impossible inertias from the geometry, with the given `density`."""
    density: Positive = 1000.0
    """Density of links whose inertia is estimated [kg/m³]."""
    base: Literal["auto", "fixed", "floating"] = "auto"
    """Whether the root link is fixed to the world. With `auto`, the file and the shape of the robot decide."""
    friction_as_damping: Boolean = False
    """Add the Coulomb friction of joints, which is left out otherwise, to their viscous damping."""
    xacro_arg: tuple[str, ...] = ()
    """Value of an argument of a xacro file, as in `ur_type:=ur5e`."""
    model: str = ""
    """Name of the robot, if a file has several: of its body in an MJCF file, of its model in an SDF file."""
    hand: Path | None = None
    """File of a hand that is put on the arm, in any format that the import reads. Relative to the station's folder."""
    hand_link: str = ""
    """Link of the arm that carries the hand; its first tool unless given."""
    hand_pose: Pose = ORIGIN
    """Pose of the hand's root in that link, [x y z Rz Ry Rx]."""
    gripper: str = ""
    """Name of the joint of the hand's only moving jaw; found by usual names unless given."""
    srdf: Path | None = None
    """SRDF file of the robot, with named postures, hands, and links whose contacts are ignored. Unless given, a file
    with the name of the robot next to the robot's file, or in a folder `srdf` or `config` next to the file's folder."""
    drop_loops: Boolean = False
    """Leave out joints that close a loop. Without this and `couple`, such a robot is refused."""
    couple: Boolean = False
    """Replace joints that close a loop by couplings in the robot's first station. Without this and `drop_loops`, such a
    robot is refused."""

    @field_validator("packages")
    @classmethod
    def _check_packages(cls, entries: tuple[str, ...]) -> tuple[str, ...]:
        """Check that each package has a name and a folder. Raises ValueError, which pydantic reports with the key."""
        for entry in entries:
            # An equals sign without a folder would mean the current folder, which is hardly meant.
            name, equals, folder = entry.partition("=")
            if not (name and equals and folder):
                raise ValueError(
                    message(
                        "robots.package_and_folder",
                        "{entry} must be a package and its folder, such as arm_description=/opt/arm",
                        entry=repr(entry),
                    )
                )
        return entries

    @property
    def package_folders(self) -> dict[str, Path]:
        """Absolute folders of the packages that the user names, by the name of the package."""
        pairs = (entry.partition("=") for entry in self.packages)
        return {name: Path(folder).absolute() for name, _, folder in pairs}


EntryKind = Literal[
    "read", "repaired", "approximated", "defaulted", "dropped", "open", "lost", "refused"
]
"""What an import does to an element; see :class:`Entry`."""
ENTRY_KINDS: tuple[EntryKind, ...] = get_args(EntryKind)
"""Kinds of entries, in the order of a summary."""

# Two tables, since in Spanish the word has the plural after a count and the singular in front of one entry.
CHANGES: dict[EntryKind, str] = {
    "read": message("robots.changes_read", "read"),
    "repaired": message("robots.changes_repaired", "repaired"),
    "approximated": message("robots.changes_approximated", "approximated"),
    "defaulted": message("robots.changes_defaulted", "defaulted"),
    "dropped": message("robots.changes_dropped", "dropped"),
    "open": message("robots.changes_open", "open"),
    "lost": message("robots.changes_lost", "lost"),
    "refused": message("robots.changes_refused", "refused"),
}
"""Words for the kinds of entries in the counts of a summary."""

CHANGE: dict[EntryKind, str] = {
    "read": message("robots.change_read", "read"),
    "repaired": message("robots.change_repaired", "repaired"),
    "approximated": message("robots.change_approximated", "approximated"),
    "defaulted": message("robots.change_defaulted", "defaulted"),
    "dropped": message("robots.change_dropped", "dropped"),
    "open": message("robots.change_open", "open"),
    "lost": message("robots.change_lost", "lost"),
    "refused": message("robots.change_refused", "refused"),
}
"""Words for the kinds of entries in front of the text of one entry."""


@dataclass(frozen=True)
class Entry:
    """One change of an element of the file by an import, or one finding about it.

    Attributes:
        kind: kind of the change:
            ``read``: nothing was changed, but the user should know;
            ``repaired``: a defect was removed;
            ``approximated``: the element was replaced by something similar;
            ``defaulted``: a value was missing, and a usual one was taken;
            ``dropped``: the element was left out, and the motion is the same without it;
            ``open``: the user has to give a value, such as a missing inertia;
            ``lost``: the element was left out, and the motion is different without it;
            ``refused``: the import cannot go on.
        element: the element, such as ``joint 'elbow' <limit>``; empty for the whole file.
        text: description of the change, with the old and the new value.
    """

    kind: EntryKind
    element: str
    text: str

    def as_json(self) -> dict[str, Any]:
        """Convert the entry for a report file: its English texts, and its messages with ids for other languages."""
        messages = {"element": as_data(self.element), "text": as_data(self.text)}
        return {"kind": self.kind, "element": self.element, "text": self.text, "messages": messages}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Entry":
        """Convert an entry of a report file. Those of versions before 0.2 have English texts only.

        Raises:
            AttributeError: the content is no mapping.
            LookupError: a key is missing.
            TypeError: ``messages`` is no mapping, or the fields or the template of a message have a wrong type.
            ValueError: the template of a message is one that no message may have, or a field of it has no value.
        """
        # A report without ids can be read, but it is shown in English only.
        messages = content.get("messages", content)
        return cls(content["kind"], from_data(messages["element"]), from_data(messages["text"]))


@dataclass
class ImportReport:
    """Report of an import.

    Attributes:
        source: the file that was imported.
        entries: changes and findings, in the order in which the import made them.
    """

    source: Path
    entries: list[Entry] = field(default_factory=list)

    def add(self, kind: EntryKind, element: str, text: str) -> None:
        """Add an entry.

        Args:
            kind: kind of the change, such as ``repaired``; see :class:`Entry`.
            element: the element, such as ``joint 'elbow' <limit>``; empty for the whole file.
            text: description of the change, with the old and the new value.
        """
        self.entries.append(Entry(kind, element, text))

    def refusal(self, element: str, problem: str) -> InvalidModel:
        """Make the error for a problem that cannot be repaired, for the caller to raise. No entry is added.

        Args:
            element: the element, such as ``joint 'elbow'``; empty for the whole file.
            problem: the problem in words.
        """
        return InvalidModel(self.source, element, problem)

    def of(self, kind: EntryKind) -> list[Entry]:
        """List the entries of one kind."""
        return [entry for entry in self.entries if entry.kind == kind]

    @property
    def has_changes(self) -> bool:
        """Whether the result differs from the source in anything."""
        return any(
            entry.kind in ("repaired", "approximated", "defaulted", "dropped", "lost")
            for entry in self.entries
        )

    def summary(self) -> str:
        """Write the counts of entries in one line, such as ``3 repaired, 6 defaulted``.

        Entries of the kind ``read`` are not counted. If there are no others, the text is ``nothing to repair``.
        """
        counts = Counter(entry.kind for entry in self.entries)
        # Entries of the kind "read" have changed nothing, and would be the larger part of a summary.
        parts = [
            compound("{count} {changes}", count=counts[kind], changes=CHANGES[kind])
            for kind in ENTRY_KINDS
            if counts[kind] and kind != "read"
        ]
        if not parts:
            return message("robots.nothing_to_repair", "nothing to repair")
        return join_texts(parts)

    def as_json(self) -> dict[str, Any]:
        """Convert the report to the content of a report file."""
        return {
            "source": str(self.source),
            "summary": self.summary(),
            "entries": [entry.as_json() for entry in self.entries],
        }


keep_former_attributes(ImportReport, changed="has_changes")


def read_report(folder: Path) -> ImportReport | None:
    """Read the report that an import has written into the folder of a robot.

    Args:
        folder: the folder.

    Returns:
        the report, or None if there is no report or if it cannot be read.
    """
    # The file may be damaged in any way, or be of another version. A robot is usable without its report, so that no
    # fault of the file is an error.
    try:
        content = parse_json(text_of(folder / REPORT_FILE, _LARGEST_REPORT), folder)
        entries = [Entry.from_json(entry) for entry in content["entries"]]
        return ImportReport(Path(content["source"]), entries)
    except (NotRead, InvalidConfig, LookupError, TypeError, AttributeError, ValueError):
        return None
