"""The frames of an SDF model: which frame each name stands for, and where each frame is.

The rules are those of sdformat.org, "Pose frame semantics". Every link, joint, model and ``<frame>`` is a frame. Its
``<pose>`` may be given in any other frame, also in one that follows later in the file.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake.base.errors import shortened
from simrob_drake.base.frames import has_wrong_norm
from simrob_drake.base.messages import compound, message
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import name_of
from simrob_drake.robots.urdf_check import numbers_in

SCOPE = "::"
"""Separator between the name of a model and the name of a frame in that model, as in ``hand::finger``."""

MODEL = "__model__"
"""Name of a model's own frame within that model."""

WORLD = "world"
"""Name of the world's frame, in all models."""

_JOINT_SUFFIX = "_joint"
"""Suffix for the name of a joint that has the name of a link. Old versions of the format allow such names."""

_MOST_FRAMES = 500
"""Largest count of frames that are given in each other one after the other. A longer chain is taken for a circle."""

_NEWEST_VERSION = (1, 12)
"""Newest version of the SDF format that this reader supports."""


def version_of(root: ET.Element) -> tuple[int, ...]:
    """Version of an ``sdf`` element, such as (1, 9). Text that is no version counts as the newest supported version."""
    try:
        return tuple(int(part) for part in root.get("version", "").split("."))
    except ValueError:
        return _NEWEST_VERSION


def own_pose(element: ET.Element | None, report: ImportReport, where: str) -> RigidTransform:
    """Read the ``<pose>`` of an element, in the frame in which the file gives it.

    Args:
        element: the element. Without an element or a ``<pose>``, the pose is the identity.
        report: gets an entry if the norm of a quaternion is not 1.
        where: the element, for the report and the error.

    Raises:
        InvalidModel: the text is no pose.
    """
    pose = None if element is None else element.find("pose")
    # An empty <pose> may still name a frame with relative_to: then the element is where that frame is.
    if pose is None or not (pose.text or "").strip():
        return RigidTransform()
    numbers = numbers_in(pose.text or "") or []
    position = numbers[:3]
    rotation = np.array(numbers[3:])
    # A quaternion of zeros has no direction. It is left for the error below.
    is_quaternion = pose.get("rotation_format") == "quat_xyzw" and len(rotation) == len("xyzw")
    if is_quaternion and rotation.any():
        norm = np.linalg.norm(rotation)
        if has_wrong_norm(rotation):
            report.add(
                "repaired",
                where,
                message(
                    "importer.quaternion_norm",
                    "the quaternion of its <pose> has a norm of {norm:.6g}; it is normalised",
                    norm=norm,
                ),
            )
        unit_quaternion = rotation / norm
        # SDF writes x y z w, Drake takes w x y z.
        wxyz = unit_quaternion[[3, 0, 1, 2]]
        return RigidTransform(Quaternion(wxyz), position)
    if len(numbers) != len(("x", "y", "z", "roll", "pitch", "yaw")):
        raise report.refusal(
            where,
            message(
                "importer.no_pose",
                "<pose>{text}</pose> is no pose",
                text=shortened(" ".join((pose.text or "").split())),
            ),
        )
    # Roll, pitch and yaw about fixed axes, as in a URDF.
    angles = np.deg2rad(rotation) if pose.get("degrees") == "true" else rotation
    return RigidTransform(RollPitchYaw(angles), position)


class ScopedJoint(NamedTuple):
    """A joint, and the model that contains it.

    Attributes:
        prefix: prefix of the full names of everything in that model: empty, or ending with ``::``.
        element: the ``joint`` element.
    """

    prefix: str
    element: ET.Element


@dataclass(frozen=True)
class _Frame:
    """A frame of the model.

    Attributes:
        element: link, joint, model or ``frame`` element.
        pose: its pose in the frame `base`.
        base: full name of the frame in which the pose is given. The base of the top model's own frame is itself.
        carrier: full name of the link or frame to which it is attached, and with which it moves.
    """

    element: ET.Element
    pose: RigidTransform
    base: str
    carrier: str


@dataclass
class Frames:
    """The frames of one model and of the models nested in it, by their full names, such as ``hand::finger``.

    Attributes:
        report: report of the import.
        place: pose of the model in the world.
        links: ``link`` elements, by the full name of their frame.
        joints: joints, by the full name of their frame.
    """

    report: ImportReport
    place: RigidTransform
    links: dict[str, ET.Element] = field(default_factory=dict, init=False)
    joints: dict[str, ScopedJoint] = field(default_factory=dict, init=False)
    _models: set[str] = field(default_factory=set, init=False)
    """Full names of the nested models."""
    _frames: dict[str, _Frame] = field(default_factory=dict, init=False)
    _poses: dict[str, RigidTransform] = field(default_factory=dict, init=False)
    """Poses in the model that are known already, by the full name of the frame."""

    def add_model(self, model: ET.Element, prefix: str = "") -> None:
        """Add the frames of a model, and of the models nested in it.

        Args:
            model: the ``model`` element.
            prefix: prefix of the full names. It is empty for the top model, and ends with ``::`` for a nested one.

        Raises:
            InvalidModel: two frames have the same name, or a pose is no pose.
        """
        model_frame = prefix + MODEL
        if not prefix:
            # All poses are computed in the top model. They begin at its own frame, and at the world's.
            self._poses[model_frame] = RigidTransform()
            self._poses[WORLD] = self.place.inverse()
            self._add(model_frame, model, model_frame, self._canonical_link(model, prefix))
        for link in model.iterfind("link"):
            # A link is a frame to which others are attached: it moves with itself.
            name = prefix + name_of(link)
            self._add(name, link, self._base_of_pose(link, prefix, model_frame), name)
            self.links[name] = link
        for joint in model.iterfind("joint"):
            self._add_joint_frame(joint, prefix)
        for frame in model.iterfind("frame"):
            # Without relative_to, the pose of a frame is given in the frame to which it is attached.
            carrier = full_name(prefix, frame.get("attached_to") or MODEL)
            base = self._base_of_pose(frame, prefix, carrier)
            self._add(prefix + name_of(frame), frame, base, carrier)
        for nested in model.iterfind("model"):
            nested_name = prefix + name_of(nested)
            # The own frame of a nested model is given in the outer model, and moves with a link of the nested one.
            nested_prefix = nested_name + SCOPE
            self._models.add(nested_name)
            carrier = self._canonical_link(nested, nested_prefix)
            base = self._base_of_pose(nested, prefix, model_frame)
            self._add(nested_prefix + MODEL, nested, base, carrier)
            self.add_model(nested, nested_prefix)

    def _add_joint_frame(self, joint: ET.Element, prefix: str) -> None:
        """Add the frame of a joint, which moves with the joint's child.

        Args:
            joint: the ``joint`` element. The links of its model have been added already.
            prefix: prefix of the full names in its model.
        """
        name = prefix + name_of(joint)
        if name in self.links:
            name += _JOINT_SUFFIX
        child = full_name(prefix, (joint.findtext("child") or "").strip())
        # Unlike the poses of links, the pose of a joint is given in its child unless the file names another frame.
        self._add(name, joint, self._base_of_pose(joint, prefix, child), child)
        self.joints[name] = ScopedJoint(prefix, joint)

    def _canonical_link(self, model: ET.Element, prefix: str) -> str:
        """Full name of the link, or of the nested model, with which a model's own frame moves.

        By default this is the first link, or the first nested model of a model without links. The name is empty after
        the prefix if the model has neither.

        Args:
            model: the ``model`` element.
            prefix: prefix of the full names in the model.
        """
        candidates = map(name_of, (*model.iterfind("link"), *model.iterfind("model")))
        return prefix + (model.get("canonical_link") or next(candidates, ""))

    def _add(self, name: str, element: ET.Element, base: str, carrier: str) -> None:
        """Add a frame.

        Args:
            name: full name of the frame.
            element: element of the frame, with its pose.
            base: full name of the frame in which the pose is given.
            carrier: full name of the link or frame with which the frame moves.

        Raises:
            InvalidModel: there is a frame of this name already, or the pose is no pose.
        """
        # A model is named in messages, and not its own frame: hand and not hand::__model__.
        where = compound("{tag} '{name}'", tag=element.tag, name=name.removesuffix(SCOPE + MODEL))
        if name in self._frames:
            raise self.report.refusal(
                where,
                message(
                    "importer.names_differ",
                    "exists twice; links, joints, frames and models must have different names",
                ),
            )
        # The <pose> of the top model is that in the world, which `place` contains.
        pose = RigidTransform() if base == name else own_pose(element, self.report, where)
        self._frames[name] = _Frame(element, pose, base, carrier)

    def _base_of_pose(self, element: ET.Element, prefix: str, default: str) -> str:
        """Full name of the frame in which an element's pose is given.

        Args:
            element: the element.
            prefix: prefix of the full names in its model.
            default: full name of the frame that counts if the file names no frame.
        """
        pose = element.find("pose")
        # The frame is named within the model that contains the element.
        relative_to = None if pose is None else pose.get("relative_to")
        return full_name(prefix, relative_to) if relative_to else default

    def pose(self, name: str) -> RigidTransform:
        """Pose of a frame in the top model.

        Args:
            name: full name of the frame.

        Raises:
            InvalidModel: there is no such frame, or frames are given in each other.
        """
        # From the frame to the first base whose pose is known, which is at last the top model or the world.
        # A loop, because a call for each frame could exceed Python's limit of recursion.
        chain = list[str]()
        base = name
        while base not in self._poses:
            frame = self._find(base)
            if len(chain) > _MOST_FRAMES:
                raise self.report.refusal(
                    message("importer.frame_called", "frame '{name}'", name=base),
                    message(
                        "importer.given_in_each_other",
                        "has a <pose> in a frame whose own <pose> depends on this frame",
                    ),
                )
            chain.append(base)
            base = self._frame_name(frame.base)
        # Back from there: each base is known when the frame that is given in it is computed.
        for inner in reversed(chain):
            frame = self._frames[inner]
            base_pose = self._poses[self._frame_name(frame.base)]
            self._poses[inner] = base_pose @ frame.pose @ self._from_placement(inner, frame)
        return self._poses[name]

    def link_of(self, name: str) -> str:
        """Full name of the link with which a frame moves, or ``world``.

        Args:
            name: full name of the frame.

        Raises:
            InvalidModel: there is no such frame, or frames are attached to each other.
        """
        for _ in range(_MOST_FRAMES):
            # A frame may be attached to a whole model: to the link with which the model's own frame moves.
            name = self._frame_name(name)
            if name == WORLD or name in self.links:
                return name
            name = self._find(name).carrier
        raise self.report.refusal(
            message("importer.frame_called", "frame '{name}'", name=name),
            message(
                "importer.attached_to_each_other",
                "is attached to a frame that is itself attached to this frame",
            ),
        )

    def _find(self, name: str) -> _Frame:
        """Find a frame by its full name.

        Raises:
            InvalidModel: the model has no such frame.
        """
        if name not in self._frames:
            raise self.report.refusal(
                "",
                message(
                    "importer.no_such_frame",
                    "there is no link, joint or frame '{name}', to which another element refers",
                    name=name,
                ),
            )
        return self._frames[name]

    def _frame_name(self, name: str) -> str:
        """Full name of a frame, if the given name may also be that of a nested model, which means its own frame."""
        return name + SCOPE + MODEL if name in self._models else name

    def _from_placement(self, name: str, frame: _Frame) -> RigidTransform:
        """Pose of a nested model's own frame in its placement frame. The identity for all other frames.

        The ``<pose>`` of a nested model is that of its placement frame P, if it names one: with the base B, the file
        gives X_BP, and the model is at X_BM = X_BP X_MP^-1.

        Args:
            name: full name of the frame.
            frame: the frame.
        """
        placement_frame = frame.element.get("placement_frame") if name.endswith(MODEL) else None
        if not placement_frame:
            return RigidTransform()
        # The pose of the nested model itself is not known yet, so X_MP is computed within that model alone.
        return self._relative_pose(name.removesuffix(MODEL) + placement_frame, name).inverse()

    def _relative_pose(self, name: str, base: str) -> RigidTransform:
        """Compute the pose of a frame in another one, from poses that are given in each other.

        Args:
            name: full name of the frame.
            base: full name of the other frame.

        Raises:
            InvalidModel: no chain of poses leads from the frame to the other one.
        """
        pose = RigidTransform()
        for _ in range(_MOST_FRAMES):
            if name == base:
                return pose
            frame = self._find(self._frame_name(name))
            # X_BaseName = X_BaseNext X_NextName.
            pose = frame.pose @ pose
            name = frame.base
            # The chain has left the nested model: its own frame is not on the way.
            if name == WORLD or self._frame_name(name) not in self._frames:
                break
        raise self.report.refusal(
            message("importer.placement_frame", "placement_frame '{name}'", name=name),
            message("importer.no_frame_of_model", "is not a frame of its model"),
        )


def full_name(prefix: str, name: str) -> str:
    """Full name of a frame, for a name that is used within a model. The world has the same name in all models.

    Args:
        prefix: prefix of the full names in the model.
        name: name of the frame in the model.
    """
    return WORLD if name == WORLD else prefix + name
