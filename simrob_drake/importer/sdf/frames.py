"""The frames of an SDF model: who names whom, and where everything is (sdformat.org, "Pose frame semantics")."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.base.errors import shorten
from simrob_drake.base.frames import has_wrong_norm
from simrob_drake.base.messages import compound, message
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import name_of
from simrob_drake.robots.urdf_check import numbers_in

SCOPE = "::"  # between the name of a model and the name of what is in it
MODEL = "__model__"
WORLD = "world"
_OF_JOINT = "_joint"
_DEEPEST = 500  # frames that are given in each other


def version_of(root: ET.Element) -> tuple[int, ...]:
    """Return the version of an ``sdf`` element; the newest one that this reader knows where it is no version."""
    try:
        return tuple(int(part) for part in root.get("version", "").split("."))
    except ValueError:
        return 1, 12


def own_pose(element: ET.Element | None, report: ImportReport, where: str) -> RigidTransform:
    """Return the pose that an element's ``<pose>`` gives, wherever it is measured from; raises InvalidModel: none."""
    pose = None if element is None else element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return RigidTransform()
    numbers = numbers_in(pose.text or "") or []
    position, rest = numbers[:3], np.array(numbers[3:])
    if pose.get("rotation_format") == "quat_xyzw" and len(rest) == len("xyzw") and rest.any():
        norm = np.linalg.norm(rest)
        if has_wrong_norm(rest):
            report.add(
                "repaired",
                where,
                message(
                    "importer.quaternion_norm",
                    "the quaternion of its <pose> has a norm of {norm:.6g}; it is normalised",
                    norm=norm,
                ),
            )
        x, y, z, w = rest / norm
        return RigidTransform(Quaternion(w, x, y, z), position)
    if len(numbers) != len(("x", "y", "z", "roll", "pitch", "yaw")):
        raise report.refusal(
            where,
            message(
                "importer.no_pose",
                "<pose>{text}</pose> is no pose",
                text=shorten(" ".join((pose.text or "").split())),
            ),
        )
    return RigidTransform(
        RollPitchYaw(np.deg2rad(rest) if pose.get("degrees") == "true" else rest), position
    )


@dataclass(frozen=True)
class _Frame:
    """A named frame: its pose in another one, and the link that it moves with."""

    element: ET.Element
    pose: RigidTransform
    within: str
    carrier: str


@dataclass
class Frames:
    """All frames of one model and of the models within it, by their full names."""

    report: ImportReport
    place: RigidTransform  # of the model in the world
    links: dict[str, ET.Element] = field(default_factory=dict, init=False)
    joints: dict[str, tuple[str, ET.Element]] = field(default_factory=dict, init=False)
    """By the full name of its frame: what stands before the names of the model that the joint is in, and the joint."""
    _models: set[str] = field(default_factory=set, init=False)
    _frames: dict[str, _Frame] = field(default_factory=dict, init=False)
    _poses: dict[str, RigidTransform] = field(default_factory=dict, init=False)

    def add_model(self, model: ET.Element, prefix: str = "") -> None:
        """Add what is in a model; ``prefix`` stands before its names, and ends with ``::`` unless it is empty."""
        base = prefix + MODEL
        if not prefix:
            self._poses[WORLD] = self.place.inverse()
            self._add(base, model, base, self._first_in(model, prefix))
        for link in model.iterfind("link"):
            full = prefix + name_of(link)
            self._add(full, link, self._within(link, prefix, base), full)
            self.links[full] = link
        for joint in model.iterfind("joint"):
            full, child = (
                prefix + name_of(joint),
                named(prefix, (joint.findtext("child") or "").strip()),
            )
            full += _OF_JOINT * (full in self.links)  # which old versions allow
            self._add(full, joint, self._within(joint, prefix, child), child)
            self.joints[full] = prefix, joint
        for frame in model.iterfind("frame"):
            held = named(prefix, frame.get("attached_to") or MODEL)
            self._add(prefix + name_of(frame), frame, self._within(frame, prefix, held), held)
        for nested in model.iterfind("model"):
            full = prefix + name_of(nested)
            self._models.add(full)
            carrier = self._first_in(nested, full + SCOPE)
            self._add(full + SCOPE + MODEL, nested, self._within(nested, prefix, base), carrier)
            self.add_model(nested, full + SCOPE)

    def _first_in(self, model: ET.Element, prefix: str) -> str:
        """Return the link, or the model, that a model's own frame moves with."""
        inside = map(name_of, (*model.iterfind("link"), *model.iterfind("model")))
        return prefix + (model.get("canonical_link") or next(inside, ""))

    def _add(self, name: str, element: ET.Element, within: str, carrier: str) -> None:
        where = compound("{tag} '{name}'", tag=element.tag, name=name.removesuffix(SCOPE + MODEL))
        if name in self._frames:
            raise self.report.refusal(
                where,
                message(
                    "importer.names_differ",
                    "stands twice; the names of links, joints, frames and models differ",
                ),
            )
        pose = RigidTransform() if within == name else own_pose(element, self.report, where)
        self._frames[name] = _Frame(element, pose, within, carrier)

    def _within(self, element: ET.Element, prefix: str, default: str) -> str:
        pose = element.find("pose")
        relative_to = None if pose is None else pose.get("relative_to")
        return named(prefix, relative_to) if relative_to else default

    def pose(self, name: str, depth: int = 0) -> RigidTransform:
        """Return a frame's pose in the model, ``depth`` frames deep; raises InvalidModel: no frame, or a circle."""
        if name not in self._poses:
            frame = self._known(name)
            if depth > _DEEPEST:
                raise self.report.refusal(
                    message("importer.frame_called", "frame '{name}'", name=name),
                    message(
                        "importer.given_in_each_other", "is given in frames that are given in it"
                    ),
                )
            top = frame.within == name
            base = RigidTransform() if top else self.pose(self._full(frame.within), depth + 1)
            self._poses[name] = (
                base if top else base @ frame.pose @ self._from_placement(name, frame)
            )
        return self._poses[name]

    def link_of(self, name: str) -> str:
        """Return the link that a frame moves with, or ``world``; raises InvalidModel: no such frame, or a circle."""
        for _ in range(_DEEPEST):
            name = self._full(name)
            if name == WORLD or name in self.links:
                return name
            name = self._known(name).carrier
        raise self.report.refusal(
            message("importer.frame_called", "frame '{name}'", name=name),
            message(
                "importer.attached_to_each_other", "is attached to frames that are attached to it"
            ),
        )

    def _known(self, name: str) -> _Frame:
        """Return the entry of a frame by its full name. A name that the model does not have refuses the model."""
        if name not in self._frames:
            raise self.report.refusal(
                "",
                message(
                    "importer.no_such_frame",
                    "there is no link, joint or frame '{name}', which others name",
                    name=name,
                ),
            )
        return self._frames[name]

    def _full(self, name: str) -> str:
        """Return the name of a frame: of a model it is that of its own one."""
        return name + SCOPE + MODEL if name in self._models else name

    def _from_placement(self, name: str, frame: _Frame) -> RigidTransform:
        """Return the pose of a nested model in the frame of it that its own pose is meant for."""
        placed = frame.element.get("placement_frame") if name.endswith(MODEL) else None
        if not placed:
            return RigidTransform()
        return self._relative(name.removesuffix(MODEL) + placed, name).inverse()

    def _relative(self, name: str, base: str) -> RigidTransform:
        """Return the pose of a frame in another one that it is given in, step by step."""
        pose = RigidTransform()
        for _ in range(_DEEPEST):
            if name == base:
                return pose
            frame = self._known(self._full(name))
            pose, name = frame.pose @ pose, frame.within
            if name == WORLD or self._full(name) not in self._frames:
                break
        raise self.report.refusal(
            message("importer.placement_frame", "placement_frame '{name}'", name=name),
            message("importer.no_frame_of_model", "is no frame of its model"),
        )


def named(prefix: str, name: str) -> str:
    """Return the full name of what a model calls so."""
    return WORLD if name == WORLD else prefix + name
