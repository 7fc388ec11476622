"""Bodies without joints as pieces: what stands in the world, and what falls free."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.math import RigidTransform

from simrob_drake.files import PIECE_FILE
from simrob_drake.frames import Vector, pose_from_transform
from simrob_drake.simulink.mechanics.shapes import Weight
from simrob_drake.simulink.mechanics.solids import SolidBody, moved, possible_moments, together
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.writing.urdf import UrdfWriter


def write_piece(
    folder: Path, name: str, solids: list[SolidBody], colliding: set[Node], writer: UrdfWriter, *, weighs: bool = True
) -> bool:
    """Write a piece's file.

    Args:
        folder: of the piece.
        name: of the piece.
        solids: with their poses in the piece's frame.
        colliding: those of them that take part in contact.
        writer: of its meshes.
        weighs: whether its mass matters; what stands fixed has none.

    Returns:
        whether there is anything to it.
    """
    shapes = [entry for solid in solids if (entry := _shape(solid, solid.node in colliding, writer)) is not None]
    weight = together([moved(solid.weight, solid.pose) for solid in solids])
    if not shapes and weight.mass <= 0:
        return False
    content: dict[str, Any] = {"description": f"{name}, of a Simulink model"}
    if weighs and weight.mass > 0:
        content |= _weight_keys(weight, possible_moments(name, weight, solids[0].node.findings.report))
    content["shapes"] = shapes
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)
    (folder / PIECE_FILE).write_text(text, encoding="utf-8")
    return True


def _weight_keys(weight: Weight, inertia: Vector) -> dict[str, Any]:
    products = [inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    moments = [*inertia.diagonal(), *(products if np.abs(products).max() > 1e-9 * inertia.max() else [])]
    return {
        "mass": float(weight.mass),
        "com": [float(value) for value in weight.com],
        "inertia": [float(value) for value in moments],
    }


def _shape(solid: SolidBody, collides: bool, writer: UrdfWriter) -> dict[str, Any] | None:
    """Return a solid as a shape of a `piece.yaml`; None where nothing is seen of it and it does not touch."""
    if not solid.visible and not collides:
        return None
    entry: dict[str, Any] = {}
    shape = solid.shape
    if shape is not None and shape.mesh is None and shape.kind != "plane":
        size = [float(value) for value in shape.size]
        entry[shape.kind] = size[0] if shape.kind == "sphere" else size
    else:
        mesh = writer.mesh(solid)
        if mesh is None:
            return None
        entry["mesh"] = mesh
    entry["pose"] = pose_list(solid.pose)
    entry["colour"] = [round(value, 4) for value in solid.colour]
    if not collides:
        entry["collides"] = False
    if not solid.visible:
        entry["visible"] = False
    return entry


def pose_list(pose: RigidTransform) -> list[float]:
    """Return a pose as files have it, [x y z Rz Ry Rx]."""
    return [float(f"{value:.15g}") + 0.0 for value in pose_from_transform(pose)]
