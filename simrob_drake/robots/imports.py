"""What a user may choose about an import, and what it did to a robot: every repair, default and loss, in words."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import field_validator

from simrob_drake.base.errors import InvalidConfig, InvalidModel
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.messages import as_data, compound, from_data, join_texts, message
from simrob_drake.base.sections import ORIGIN, Boolean, Pose, Positive, Strict
from simrob_drake.base.yaml_files import parse_json

REPORT_FILE = "report.json"  # name of the file with the report of an import, in the folder that the import has written
_LARGEST_REPORT = 10_000_000  # largest size of that file [bytes]; thousands of links take some hundred thousand


class ImportOptions(Strict):
    """Choices of an import; the defaults suit most robots."""

    mesh_path: tuple[Path, ...] = ()
    """Further folders in which meshes and packages are looked for; those in a station's file start at its folder."""
    packages: tuple[str, ...] = ()
    """Folder of a package of ROS, as in `arm_description=/opt/arm`; a station's file has `packages` for that."""
    collision: Literal["hull", "box", "none"] = "hull"
    """Collision meshes become their convex hull, the tightest box around them, or nothing."""
    estimate_inertia: Boolean = False
    """Estimate missing and impossible inertias from the geometry, at `density`."""
    density: Positive = 1000.0
    """Density of links whose inertia is estimated [kg/m³]."""
    base: Literal["auto", "fixed", "floating"] = "auto"
    """Whether the root link is fixed to the world; `auto` decides by the file and the shape of the robot."""
    friction_as_damping: Boolean = False
    """Add the joints' Coulomb friction, which is left out otherwise, to their viscous damping."""
    xacro_arg: tuple[str, ...] = ()
    """Value of an argument of a xacro file, as in `ur_type:=ur5e`."""
    model: str = ""
    """Which robot of an MJCF file with several, by the name of its body, or of an SDF file, by that of its model."""
    hand: Path | None = None
    """A file of a hand, of any kind that is read, which is put on the arm; a relative path starts at the station's."""
    hand_link: str = ""
    """Link of the arm that carries the hand; its first tool unless given."""
    hand_pose: Pose = ORIGIN
    """Pose of the hand's root there, [x y z Rz Ry Rx]."""
    gripper: str = ""
    """Name of the joint of the hand's only moving jaw; found by usual names unless given."""
    srdf: Path | None = None
    """An SRDF of the robot: named postures, home, hands, links that do not mind each other; that of its name beside it,
    or in `srdf` or `config` next to its folder, unless given."""
    drop_loops: Boolean = False
    """Leave joints out that close a loop, which no tree of motored joints has, instead of refusing the robot."""
    couple: Boolean = False
    """Replace joints that close a loop by couplings of the robot's first station, instead of refusing the robot."""

    @field_validator("packages")
    @classmethod
    def _check_packages(cls, entries: tuple[str, ...]) -> tuple[str, ...]:
        """Check that each package has a name and a folder."""
        for entry in entries:
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
        """Folders of the packages that the user names, by the name of the package."""
        pairs = (entry.partition("=") for entry in self.packages)
        return {name: Path(folder).absolute() for name, _, folder in pairs}


EntryKind = Literal["read", "repaired", "approximated", "defaulted", "dropped", "open", "lost", "refused"]
ENTRY_KINDS: tuple[EntryKind, ...] = get_args(EntryKind)

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
"""The kinds of entries, as a summary counts them."""

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
"""The kinds of entries, in front of the text of one entry."""


@dataclass(frozen=True)
class Entry:
    """One thing that was done to one element."""

    # what was done: ``read`` as it was (worth knowing), ``repaired``, ``approximated`` (by a likeness), ``defaulted``
    # (a figure was made up), ``dropped`` (it does not change the motion), ``open`` (left to the user, such as inertias
    # that are missing), ``lost`` (the motion is another without it), or ``refused``
    kind: EntryKind
    element: str  # which element, as in ``joint 'elbow' <limit>``; empty for the whole file
    text: str  # in words, with the old and the new figure

    def as_json(self) -> dict[str, Any]:
        """Entry for a report file: its English texts, and its messages with their ids, for other languages."""
        messages = {"element": as_data(self.element), "text": as_data(self.text)}
        return {"kind": self.kind, "element": self.element, "text": self.text, "messages": messages}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Entry":
        """Entry of a report file. Those of versions before 0.2 have English texts only.

        Raises:
            LookupError: a key is missing.
            TypeError: the content is no mapping, or a message is damaged.
        """
        messages = content.get("messages", content)
        return cls(content["kind"], from_data(messages["element"]), from_data(messages["text"]))


@dataclass
class ImportReport:
    """All that an import did, in the order it was done."""

    source: Path  # the file that was imported
    entries: list[Entry] = field(default_factory=list)

    def add(self, kind: EntryKind, element: str, text: str) -> None:
        """Note one thing that was done."""
        self.entries.append(Entry(kind, element, text))

    def refusal(self, element: str, problem: str) -> InvalidModel:
        """Return the error for what can't be repaired; it names file and element."""
        return InvalidModel(self.source, element, problem)

    def of(self, kind: EntryKind) -> list[Entry]:
        """Return the entries of one kind."""
        return [entry for entry in self.entries if entry.kind == kind]

    @property
    def changed(self) -> bool:
        """Whether anything of the source is different in the result."""
        return any(entry.kind in ("repaired", "approximated", "defaulted", "dropped", "lost") for entry in self.entries)

    def summary(self) -> str:
        """Return the counts in one line, as in ``3 repaired, 6 defaulted``."""
        counts = Counter(entry.kind for entry in self.entries)
        parts = [
            compound("{count} {changes}", count=counts[kind], changes=CHANGES[kind])
            for kind in ENTRY_KINDS
            if counts[kind] and kind != "read"
        ]
        return join_texts(parts) if parts else message("robots.nothing_to_repair", "nothing to repair")

    def as_json(self) -> dict[str, Any]:
        """Return what is written to the report file."""
        return {
            "source": str(self.source),
            "summary": self.summary(),
            "entries": [entry.as_json() for entry in self.entries],
        }


def read_report(folder: Path) -> ImportReport | None:
    """Read the report that an import has written into the folder of a robot.

    Returns:
        the report; None if there is no report, or if it cannot be read.
    """
    try:
        content = parse_json(text_of(folder / REPORT_FILE, _LARGEST_REPORT), folder)
        entries = [Entry.from_json(entry) for entry in content["entries"]]
        return ImportReport(Path(content["source"]), entries)
    except (NotRead, InvalidConfig, LookupError, TypeError, AttributeError, ValueError):
        return None
