"""Groups of bodies without moving joints as pieces of a station."""

from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Box, Capsule, Convex, Cylinder, HalfSpace, Mesh, Shape, Sphere
from pydrake.math import RigidTransform

from simrob_drake.base.frames import Vector, pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.extensions.drake_scenes.mesh_copies import MeshCopies
from simrob_drake.extensions.drake_scenes.plant_parts import BodyShape, GroupLink, PlantGroup
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import six_moments

_UPRIGHT = 1e-9  # how far the normal of a half-space may be from the world's z


class PieceWriter:
    """Describes one piece.

    Attributes:
        contact: section ``contact`` of the piece; empty if it touches nothing, or has Drake's defaults.
        half_space: pose of a half-space among its shapes in the world. None if there is none.
    """

    def __init__(
        self, group: PlantGroup, folder: Path, meshes: MeshCopies, report: ImportReport
    ) -> None:
        """Begin with a group.

        Args:
            group: bodies without moving joints.
            folder: folder of the piece.
            meshes: copies of its meshes in that folder.
            report: record of what is changed or lost.
        """
        self._group = group
        self._folder = folder
        self._meshes = meshes
        self._report = report
        self.contact: dict[str, Any] = {}
        self.half_space: RigidTransform | None = None

    def content(self, description: str) -> dict[str, Any]:
        """Make the content of the file ``piece.yaml``, and copy the meshes."""
        poses = _link_poses(self._group)
        content: dict[str, Any] = {"description": description, **_inertia(self._group, poses)}
        shapes = list[dict[str, Any]]()
        for link in self._group.links:
            for shape in link.shapes:
                shapes += self._shape_entries(link, shape, poses[link.name] @ shape.pose)
                if shape.contact:
                    self._read_contact(shape.contact)
        if shapes:
            content["shapes"] = shapes
        return content

    def _shape_entries(
        self, link: GroupLink, shape: BodyShape, pose: RigidTransform
    ) -> list[dict[str, Any]]:
        """Describe a shape as entries of ``shapes``. Empty if a piece has no such shape.

        Args:
            link: its link, for the report.
            shape: the shape.
            pose: its pose in the piece.
        """
        if isinstance(shape.shape, HalfSpace):
            self._read_half_space(pose)
            return []
        use: dict[str, Any] = (
            {"visible": False} if shape.contact is not None else {"collides": False}
        )
        if shape.colour is not None:
            use["colour"] = tuple(float(value) for value in shape.colour)
        entries = self._geometry(shape.shape, pose)
        if not entries:
            kind = type(shape.shape).__name__
            text = message("drake_scenes.no_shape", "{link}: a {shape}", link=link.name, shape=kind)
            self._report.add(
                "lost" if shape.contact is not None else "dropped", self._group.name, text
            )
        return [{**entry, **use} for entry in entries]

    def _geometry(self, shape: Shape, pose: RigidTransform) -> list[dict[str, Any]]:
        """Describe a shape and its pose. Empty if a piece has no such shape."""
        entries = list[dict[str, Any]]()
        match shape:
            case Box():
                entries = [{"box": tuple(shape.size().tolist())}]
            case Cylinder() | Capsule():
                entries = [{"cylinder": (shape.radius(), shape.length())}]
            case Sphere():
                entries = [{"sphere": shape.radius()}]
            case Mesh() | Convex():
                scales = np.asarray(shape.scale3())
                if np.all(scales == scales[0]) and scales[0] > 0:
                    entries = [{"mesh": str(self._meshes.copy(shape)), "scale": float(scales[0])}]
        poses = [pose] * len(entries)
        if isinstance(shape, Capsule):
            # A capsule is a cylinder with two balls at its ends.
            for sign in (-1.0, 1.0):
                entries.append({"sphere": shape.radius()})
                poses.append(pose @ RigidTransform(np.array([0.0, 0.0, sign * shape.length() / 2])))
        return [
            {**entry, "pose": tuple(pose_from_transform(at).tolist())}
            for entry, at in zip(entries, poses, strict=True)
        ]

    def _read_half_space(self, pose: RigidTransform) -> None:
        """Note a half-space, if it is the world's ground at z = 0; report any other one as lost."""
        in_world = self._group.pose @ pose
        normal = in_world.rotation().matrix()[:, 2]
        is_ground = abs(normal[2] - 1) < _UPRIGHT and abs(in_world.translation()[2]) < _UPRIGHT
        if is_ground and not self._group.is_free:
            self.half_space = in_world
            text = message(
                "drake_scenes.floor_of_half_space", "its half-space is the station's floor"
            )
            self._report.add("read", self._group.name, text)
        else:
            text = message(
                "drake_scenes.half_space_lost", "a half-space that is not the ground at z = 0"
            )
            self._report.add("lost", self._group.name, text)

    def _read_contact(self, properties: dict[str, float | None]) -> None:
        """Read the section ``contact`` from the properties of a shape. The first shape with any of them counts."""
        if self.contact:
            return
        static = properties.get("mu_static")
        dynamic = properties.get("mu_dynamic")
        if static is not None and dynamic is not None:
            self.contact["friction"] = {"static": static, "dynamic": dynamic}
        stiffness = properties.get("point_contact_stiffness")
        if stiffness:
            # A station's stiffness is that of two equal surfaces, which Drake takes in series.
            self.contact["stiffness"] = stiffness / 2
        dissipation = properties.get("hunt_crossley_dissipation")
        if dissipation is not None:
            self.contact["dissipation"] = dissipation
        modulus = properties.get("hydroelastic_modulus")
        if modulus and np.isfinite(modulus):  # a rigid shape has none
            self.contact["hydroelastic_modulus"] = modulus


def _link_poses(group: PlantGroup) -> dict[str, RigidTransform]:
    """Compute the poses of the links in the root link, by name."""
    poses = {group.root.name: RigidTransform()}
    for joint in group.joints:  # in the order of the tree
        poses[joint.child] = poses[joint.parent] @ joint.origin
    return poses


def _inertia(group: PlantGroup, poses: dict[str, RigidTransform]) -> dict[str, Any]:
    """Sum up the masses of the links: mass [kg], centre of mass [m], and moments about it [kg m²], in the root link.

    Args:
        group: the piece.
        poses: poses of the links in the root link.
    """
    links = [link for link in group.links if link.mass > 0]
    if not links:
        return {}
    mass = sum(link.mass for link in links)
    centres = [np.asarray(poses[link.name] @ link.com) for link in links]
    com = sum(link.mass * centre for link, centre in zip(links, centres, strict=True)) / mass
    moments: Vector = np.zeros((3, 3))
    for link, centre in zip(links, centres, strict=True):
        turn = poses[link.name].rotation().matrix()
        offset = centre - com
        # Parallel axis theorem: about a point at an offset, m (|r|² 1 - r rᵀ) is added.
        shift = link.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
        moments = moments + turn @ link.moments @ turn.T + shift
    return {
        "mass": float(mass),
        "com": tuple(np.asarray(com).tolist()),
        "inertia": tuple(six_moments(moments).tolist()),
    }
