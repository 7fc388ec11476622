"""What a robot stands on: contact spheres made from the shapes of its feet, in frames that are upright as it stands."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.legged.anatomy import Anatomy, NamedLeg
from simrob_drake.robots.bodies import bodies
from simrob_drake.robots.urdf import add_joint, name_of
from simrob_drake.stations.clearance import outline
from simrob_drake.stations.legs import put_upright
from simrob_drake.stations.stances import Stance

_NEAR = (
    0.02  # part of the height of the root within which points over the lowest one are of the sole
)
_SMALL = 0.05  # part of it that a sole measures at least either way; less is a ball
_ROUND = 0.01, 0.1  # radius of spheres under a sole, and the largest of a ball, as parts of it
EDGED = "soles"  # kind of feet whose edges touch, too
_BALL = 0.06  # part of it within which points about a tip tell its roundness


@dataclass(frozen=True)
class FootSole:
    """What a foot stands on."""

    pose: RigidTransform  # of the sole in its body: z up and x ahead while the robot stands, the origin on the ground
    points: Vector  # middles of its spheres there, shape (k, 3) [m]
    radius: float  # of these [m]
    flat: bool  # whether it lies on the ground, or is a ball


def soles_of(anatomy: Anatomy, stance: Stance) -> list[FootSole]:
    """Compute the sole of each foot from the outlines of its shapes.

    Args:
        anatomy: the limbs of the robot.
        stance: posture in which the robot stands, with the frame of its root near the hips.

    Raises:
        SimrobError: a foot has no shape.
    """
    put_upright(anatomy.clearance, anatomy.robot, stance.posture, stance.height)
    return [_sole(anatomy, limb, stance.height) for limb in anatomy.legs]


def _sole(anatomy: Anatomy, limb: NamedLeg, height: float) -> FootSole:
    clearance, body = anatomy.clearance, limb.leg.foot
    pose = clearance.plant.EvalBodyPoseInWorld(clearance.context, body)
    ahead = RotationMatrix.MakeZRotation(anatomy.facing)
    outside = outline(clearance.station, body)
    if not len(outside):
        raise SimrobError(
            message(
                "legged.foot_without_shape",
                "the foot {body} has no collision shape; give it one, such as a sphere or a box",
                body=body.name(),
            )
        )
    points = (
        outside @ (ahead.inverse() @ pose.rotation()).matrix().T
        + ahead.inverse() @ pose.translation()
    )
    lowest = points[:, 2].min()
    under = points[points[:, 2] < lowest + _NEAR * height]
    low, high = under.min(axis=0), under.max(axis=0)
    ball = _ball(anatomy, limb)
    if (
        ball is None
        and min(high[:2] - low[:2]) >= _SMALL * height / 2
        and max(high[:2] - low[:2]) >= _SMALL * height
    ):
        radius = _ROUND[0] * height
        inner = (
            np.minimum(low[:2] + radius, (low + high)[:2] / 2),
            np.maximum(high[:2] - radius, (low + high)[:2] / 2),
        )
        middle = np.array([*(low + high)[:2] / 2, lowest])
        corners = [
            (x, y, radius) for x in (inner[0][0], inner[1][0]) for y in (inner[0][1], inner[1][1])
        ]
        spheres, flat = np.array(corners) - [*middle[:2], 0.0], True
    else:
        centre, radius = ball or _roundness(points, height)
        seen = centre if ball is None else ahead.inverse() @ (pose @ centre)
        middle, flat = np.array([*seen[:2], seen[2] - radius]), False
        spheres = np.array([[0.0, 0.0, radius]])
    return FootSole(
        pose.inverse() @ RigidTransform(ahead, ahead @ middle), spheres, float(radius), flat
    )


def _ball(anatomy: Anatomy, limb: NamedLeg) -> tuple[Vector, float] | None:
    """Return middle, in its body, and radius of the sphere that a foot stands on; None where it is no sphere."""
    clearance, inspector = (
        anatomy.clearance,
        anatomy.clearance.station.scene_graph.model_inspector(),
    )
    pose = clearance.plant.EvalBodyPoseInWorld(clearance.context, limb.leg.foot)
    found = []
    for shape in clearance.plant.GetCollisionGeometriesForBody(limb.leg.foot):
        sphere = inspector.GetShape(shape)
        if isinstance(sphere, Sphere):
            centre = inspector.GetPoseInFrame(shape).translation()
            found.append(((pose @ centre)[2] - sphere.radius(), centre, sphere.radius()))
    if not found:
        return None
    low, centre, radius = min(found, key=lambda one: one[0])
    points = outline(clearance.station, limb.leg.foot)
    alone = sum(other[0] < low + radius / 4 for other in found) == 1
    return (centre, radius) if alone and low <= (pose @ points.T)[2].min() + radius / 4 else None


def _roundness(points: Vector, height: float) -> tuple[Vector, float]:
    """Return middle and radius [m] of the ball that the lowest of points (k, 3) are on."""
    tip = points[points[:, 2].argmin()]
    near = points[np.linalg.norm(points - tip, axis=1) < _BALL * height]
    half = float(np.ptp(near[:, :2], axis=0).max()) / 2
    radius = float(np.clip(half, _ROUND[0] * height, _ROUND[1] * height))
    middle = (near.min(axis=0) + near.max(axis=0)) / 2
    return np.array([*middle[:2], tip[2] + radius]), radius


def write_soles(urdf: Path, anatomy: Anatomy, soles: list[FootSole]) -> list[str]:
    """Add a link for each sole to a URDF, in place of the shapes of its foot; return their names."""
    tree = ET.parse(urdf)  # written by the importer
    robot = tree.getroot()
    parts, names = bodies(robot), []
    taken = {name_of(link) for link in robot.iterfind("link")} | {
        name_of(joint) for joint in robot.iterfind("joint")
    }
    for limb, sole in zip(anatomy.legs, soles, strict=True):
        body = limb.leg.foot.name()
        for link in parts[body]:
            for shape in link.findall("collision"):
                link.remove(shape)
        name = next(
            name for name in (f"{limb.name}_sole", f"{limb.name}_contact_sole") if name not in taken
        )
        ET.SubElement(robot, "link", name=name)
        add_joint(robot, f"{name}_mount", parent=body, child=name, pose=sole.pose)
        names.append(name)
    ET.indent(robot)
    tree.write(urdf, encoding="utf-8", xml_declaration=True)
    return names


def feet_section(soles: list[FootSole], names: list[str], load: float) -> dict[str, object]:
    """Return the key ``feet`` of a ``robot.yaml``: spheres, and of flat ones soles with edges, which may be worn, too.

    Contacts give way by a 500th of its height under the robot.

    The ``load`` is its weight over that height, of the centre of mass [N/m].
    """
    points = {
        name: [[round(float(x), 5) for x in point] for point in sole.points]
        for name, sole in zip(names, soles, strict=True)
    }
    radius = round(float(np.mean([sole.radius for sole in soles])), 5)
    stiffness = float(f"{max(1e5, 500 * load):.2g}")
    contacts: dict[str, object] = {
        "spheres": {"radius": radius, "stiffness": stiffness, "points": points}
    }
    if all(sole.flat for sole in soles):
        contacts[EDGED] = {
            "boxes": {name: _box(sole) for name, sole in zip(names, soles, strict=True)}
        }
    return {"default": "spheres", "contacts": contacts}


def _box(sole: FootSole) -> dict[str, list[float]]:
    """Return the box around the spheres of a sole."""
    low, high = sole.points.min(axis=0) - sole.radius, sole.points.max(axis=0) + sole.radius
    return {"size": (high - low).round(5).tolist(), "centre": ((low + high) / 2).round(5).tolist()}
