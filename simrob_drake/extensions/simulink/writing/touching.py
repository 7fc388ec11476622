"""What touches what (feet, pieces, the floor), and the contact, sensors and monitors of a station."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.bodies import (
    CLOUD,
    GRID,
    ContactPair,
    ContactParameters,
    RigidPart,
    frame_place,
)
from simrob_drake.extensions.simulink.mechanics.shapes import NOTHING, Shape, positive
from simrob_drake.extensions.simulink.mechanics.solids import SolidBody
from simrob_drake.extensions.simulink.mechanics.trees import Tree
from simrob_drake.extensions.simulink.model.nodes import Node, without_file
from simrob_drake.extensions.simulink.simulink_model import SimulinkModel
from simrob_drake.extensions.simulink.writing.spheres import POINT, far_apart, spheres_of
from simrob_drake.extensions.simulink.writing.urdf import RobotFile, UniqueNames
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.terrain import MOST_BOXES
from simrob_drake.robots.imports import ImportReport

_PLANE, _GREY = "Infinite Plane", (0.5, 0.5, 0.5, 1.0)
_MOST_POINTS = 100  # of a cloud that touch
MOST_DISSIPATION = (
    50.0  # s/m: a contact that damps more does not bounce either way, and is hard to integrate
)


def _touching_text(what: str, spheres: str) -> str:
    """Describe the spheres that stand for a shape in a contact.

    Args:
        what: the shape: ``sphere``, ``box``, ``cylinder`` or ``mesh``.
        spheres: the spheres in words, with their radius.
    """
    texts = {
        "sphere": message(
            "simulink.mesh_as_ball",
            "a mesh that touches: nearly a ball, {spheres}",
            spheres=spheres,
        ),
        "box": message(
            "simulink.box_as_spheres",
            "a box that touches: {spheres} in its corners",
            spheres=spheres,
        ),
        "cylinder": message(
            "simulink.cylinder_as_spheres",
            "a cylinder that touches: {spheres} on its rims, on eight of which it stands",
            spheres=spheres,
        ),
        "mesh": message(
            "simulink.mesh_as_spheres",
            "a mesh that touches: {spheres} in corners of its convex hull",
            spheres=spheres,
        ),
    }
    return texts[what]


@dataclass
class Touching:
    """The contacts of a station."""

    ends: list[tuple[ContactPair, tuple[RigidPart, Node], tuple[RigidPart, Node]]] = field(
        default_factory=list
    )
    """Bodies and solids of each contact."""
    floor: bool = False  # whether a plane at z = 0, or a grid of heights, is one of the ends
    laid: Node | None = None  # the block of that grid
    terrain: dict[str, Any] = field(default_factory=dict)  # its section, without its file
    heights: Vector | None = (
        None  # of its tiles, shape (rows along the way, columns from the left) [m]
    )
    slabs: dict[Node, SolidBody] = field(default_factory=dict)
    """Other planes and disks of the world, as what is under them, in the model's world."""
    colliding: set[Node] = field(default_factory=set)  # solids that touch
    standing: set[Node] = field(default_factory=set)  # those of them that are feet of robots


def read_touching(model: SimulinkModel, turn: RigidTransform) -> Touching:
    """Sort contacts by what they connect; ``turn`` places the model's world in ours."""
    touching, network = Touching(), model.network
    for contact in model.contacts:
        one, other = (
            (model.bodies.by_place[frame_place(network, node)], node) for node in contact.pair
        )
        surface = contact.surface
        clouds = {node: body for body, node in (one, other) if node.kind == CLOUD}
        try:
            points = {
                node: node.numbers("CoordinatesMatrix", "[0 0 0]", unit="m").reshape(-1, 3)
                for node in clouds
            }
            if not all(map(len, points.values())):
                raise contact.node.refusal(
                    message("simulink.point_cloud_empty", "its point cloud is empty")
                )
        except (
            InvalidModel,
            ValueError,
        ) as problem:  # which have not three figures, or cannot be computed
            why = without_file(problem, model.report.source)
            contact.node.note(
                "lost",
                message(
                    "simulink.point_cloud_not_read", "its point cloud is not read: {why}", why=why
                ),
            )
            continue
        for node, body in clouds.items():
            if node not in touching.colliding:
                body.solids += _cloud(node, points[node], body.frames[network.net(node, "lconn")])
            share = len(points[node]) / sum(solid.node is node for solid in body.solids)
            surface = replace(
                surface, stiffness=surface.stiffness * share, damping=surface.damping * share
            )
        touching.colliding.update(contact.pair)
        touching.ends.append((replace(contact, surface=surface), one, other))
        for body, node in (one, other):
            if node.kind in (_PLANE, "Disk", GRID):
                _stand(
                    touching,
                    contact.node,
                    node,
                    body,
                    turn,
                    body.frames[network.net(node, "lconn")],
                )
    return touching


def _stand(
    touching: Touching,
    contact: Node,
    node: Node,
    body: RigidPart,
    turn: RigidTransform,
    pose: RigidTransform,
) -> None:
    """Take a surface as the floor, its terrain or a piece; of those that move a disk is part of what carries it."""
    there = turn @ pose
    flat = bool(np.allclose(there.rotation().matrix()[:, 2], [0, 0, 1], atol=1e-6))
    if node.kind == "Disk" and not body.grounded:
        if all(solid.node is not node for solid in body.solids):
            thin = Shape("cylinder", (*positive(node, "Radius", "1", 1), 2 * POINT))
            body.solids.append(SolidBody(node, NOTHING, thin, _GREY, pose=pose))
    elif not body.grounded:
        contact.note(
            "lost",
            message(
                "simulink.contact_of_moving_surface",
                "contact of {path}, a surface that moves",
                path=node.path,
            ),
        )
    elif node.kind == GRID:
        _lay(touching, node, there, flat=flat)
    elif node.kind == _PLANE and flat and abs(there.translation()[2]) < 1e-6:
        touching.floor = True
    elif node not in touching.slabs:
        touching.slabs[node] = _slab(node, pose)


def _lay(touching: Touching, node: Node, pose: RigidTransform, *, flat: bool) -> None:
    """Make a grid of heights in the world the terrain; one that is tilted, or a second one, is lost."""
    try:
        if touching.laid not in (None, node) or not flat:
            raise node.refusal(
                message("simulink.second_grid", "is a second grid")
                if flat
                else message("simulink.tilted_grid", "is tilted: only upright grids are read")
            )
        if touching.laid is None:
            touching.terrain, touching.heights = _field(node, pose)
            touching.laid, touching.floor = node, True
    except InvalidModel as problem:
        node.lose(problem)


def _field(node: Node, pose: RigidTransform) -> tuple[dict[str, Any], Vector]:
    """Return an upright grid as level tiles, as small as a terrain may have them; around it the ground is at z = 0."""
    from scipy.interpolate import RegularGridInterpolator

    x, y = (node.numbers(f"{axis}GridVector", "[0 1]", unit="m") for axis in "XY")
    heights = node.matrix("ZHeights", "[0 0; 0 0]") * node.unit("ZHeights", "m")
    if (
        heights.shape != (x.size, y.size)
        or min(x.size, y.size) < 2
        or min(np.diff(x).min(), np.diff(y).min()) <= 0
    ):
        raise node.refusal(
            message(
                "simulink.heights_of_grid",
                "has {heights} heights for {columns} x {rows} rising places",
                heights=" x ".join(map(str, heights.shape)),
                columns=x.size,
                rows=y.size,
            )
        )
    turn = pose.rotation().matrix()
    x0, y0, z0 = turn.T @ pose.translation()
    surface = RegularGridInterpolator((x + x0, y + y0), heights + z0, bounds_error=False)
    reach = float(np.abs(y + y0).max())
    size = float(
        max(min(np.diff(x).min(), np.diff(y).min()), np.ptp(x) / MOST_BOXES, reach / MOST_BOXES)
    )
    while True:
        rows, half = max(1, round(float(np.ptp(x)) / size)), max(1, round(reach / size))
        along, across = (
            x[0] + x0 + size * (np.arange(rows) + 0.5),
            size * (np.arange(2 * half)[::-1] - half + 0.5),
        )
        tiles = np.round(
            np.nan_to_num(surface(tuple(np.meshgrid(along, across, indexing="ij")))), 4
        )
        if np.count_nonzero(np.diff(tiles, axis=1)) + rows <= MOST_BOXES:
            break
        size *= 1.05
    corners = surface(tuple(np.meshgrid(along - size / 2, across - size / 2, indexing="ij")))
    off = float(np.nanmax(np.abs(corners - tiles), initial=0.0))
    text = message(
        "simulink.level_tiles",
        "level tiles of {size:.3g} m, off by up to {off:.2g} m; around it the ground is at z = 0",
        size=size,
        off=off,
    )
    node.note("approximated", text)
    section = {"kind": "grid", "size": size, "start": float(x[0] + x0)}
    heading = float(np.rad2deg(np.arctan2(turn[1, 0], turn[0, 0])))
    return section | ({"heading_deg": heading} if heading else {}), tiles


def _slab(node: Node, pose: RigidTransform) -> SolidBody:
    """Return what is under a plane, 20 m wide, or under a disk."""
    plane = node.kind == _PLANE
    size = (20.0, 20.0, 1.0) if plane else (*positive(node, "Radius", "1", 1), 0.02)
    under = pose @ RigidTransform([0.0, 0.0, -size[-1] / 2])
    return SolidBody(
        node,
        NOTHING,
        Shape("box" if plane else "cylinder", size),
        _GREY,
        visible=not plane,
        pose=under,
    )


def _cloud(node: Node, points: Vector, pose: RigidTransform) -> list[SolidBody]:
    """Return the points (n, 3) of a cloud as small spheres; of many, those that are farthest apart."""
    taken = far_apart(points, _MOST_POINTS)
    node.note(
        "approximated",
        message(
            "simulink.points_touch",
            "{taken} of its {count} points touch, as spheres of {radius:g} m",
            taken=len(taken),
            count=len(points),
            radius=POINT,
        ),
    )
    sphere, places = (
        Shape("sphere", (POINT,)),
        [pose @ RigidTransform(points[place]) for place in taken],
    )
    return [SolidBody(node, NOTHING, sphere, _GREY, visible=False, pose=place) for place in places]


def feet_of(robot: RobotFile, files: "StationFiles") -> dict[str, Any] | None:
    """Return the feet of a robot as its `robot.yaml` has them: spheres, or None.

    Of the small spheres in the corners of a box four share its spring and damper; of those of a cylinder a rim does.
    """
    points: dict[str, list[list[float]]] = {}
    by_link: dict[str, list[tuple[float, ContactParameters]]] = {}  # by link
    touching, report, seen = files.touching, files.report, set[Node]()
    for contact, *ends in touching.ends:
        for body, node in ends:
            if body not in robot.links or body.grounded or node in seen:
                continue
            seen.add(node)
            solids = [solid for solid in body.solids if solid.node is node]
            try:
                spheres = [spheres_of(solid) for solid in solids]
            except UnreadableMesh as problem:
                report.add(
                    "lost",
                    contact.node.path,
                    message(
                        "simulink.contact_of_unknown_shape",
                        "contact of {path}, whose shape is not known: {problem}",
                        path=node.path,
                        problem=problem,
                    ),
                )
                continue
            touching.standing.add(node)
            _, radius, share, what = spheres[0]
            if what != "sphere" or solids[0].shape is None or solids[0].shape.mesh is not None:
                spheres_text = message(
                    "simulink.spheres_of", "spheres of {radius:.3g} m", radius=radius
                )
                report.add("approximated", node.path, _touching_text(what, spheres_text))
            surface = contact.surface
            for solid, (middles, *_) in zip(solids, spheres, strict=True):
                pose = robot.frames[body].inverse() @ solid.pose
                places = [
                    [round(float(value), 12) for value in pose.multiply(point)] for point in middles
                ]
                points.setdefault(robot.links[body], []).extend(places)
                shared = replace(
                    surface, stiffness=surface.stiffness / share, damping=surface.damping / share
                )
                by_link.setdefault(robot.links[body], []).extend([(radius, shared)] * share)
    if not points:
        return None
    weight = robot.mass * files.gravity / sum(map(len, by_link.values()))
    kind, others = _feet_surfaces(by_link, weight, report, robot.element.get("name", ""))
    return {"default": "spheres", "contacts": {"spheres": kind | {"points": points} | others}}


def _feet_surfaces(
    by_link: dict[str, list[tuple[float, ContactParameters]]],
    weight: float,
    report: ImportReport,
    where: str,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the figures of most feet, and of ``others`` those that differ; ``weight`` [N] is what a sphere carries."""
    written: dict[tuple[float, ContactParameters], dict[str, Any]] = {}
    for link, ones in by_link.items():
        if len(set(ones)) > 1:
            report.add(
                "approximated",
                f"{where}: {link}",
                message(
                    "simulink.contacts_differ",
                    "its contacts differ: all get the figures of the first",
                ),
            )
        if ones[0] not in written:
            radius, surface = ones[0]
            damping = bounded_dissipation(surface, weight, report, where)
            written[ones[0]] = {"radius": float(radius), "stiffness": surface.stiffness, "dissipation": damping,
                                "friction": [surface.static, surface.dynamic]}  # fmt: skip
    first, *_ = written
    others = {link: dict(written[ones[0]]) for link, ones in by_link.items() if ones[0] != first}
    return written[first], {"others": others} if others else {}


def bounded_dissipation(
    surface: ContactParameters, weight: float, report: ImportReport, where: str
) -> float:
    """Return Hunt and Crossley's d [s/m] for a contact with a damper beside its spring, and tell how it differs.

    Simscape adds k x and b dx/dt; Drake multiplies, k x (1 + d dx/dt). They are equal at the depth b / (k d), which is
    put to twice the depth at rest: as deep as a body sinks that is laid down, whose ``weight`` [N] presses on it.
    """
    depth, text = (
        2 * weight / surface.stiffness,
        message("simulink.contact_without_damping", "contact without damping"),
    )
    exact = surface.damping / (surface.stiffness * max(depth, 1e-6))
    taken = float(f"{min(exact, MOST_DISSIPATION):.6g}")
    if taken:
        equal = surface.damping / surface.stiffness / taken
        text = message(
            "simulink.contact_damper",
            "contact damper {damping:g} N·s/m beside the spring as dissipation {taken:g} s/m: ",
            damping=surface.damping,
            taken=taken,
        )
        text += message("simulink.equal_at_depth", "equal at a depth of {equal:.2g} m", equal=equal)
    if exact > MOST_DISSIPATION:
        text += message(
            "simulink.exact_at_depth",
            " (for {depth:.2g} m it would be {exact:.3g}: neither bounces)",
            depth=depth,
            exact=exact,
        )
    report.add("approximated", where, text)
    return taken


@dataclass
class StationFiles:
    """What is written of a model."""

    model: SimulinkModel  # what was read
    turn: RigidTransform  # places the model's world in ours
    gravity: float  # downward there [m/s²]
    names: UniqueNames  # those that are taken
    touching: Touching  # the contacts
    robots: dict[str, RobotFile] = field(default_factory=dict)  # by name, with their `robot.yaml`
    pieces: list[str] = field(default_factory=list)  # names
    groups: dict[str, str] = field(default_factory=dict)
    """Of those that stand in the world, by the subsystem or block that they come from."""
    # of those that nothing holds, by what they are
    free: dict[Tree, str] = field(default_factory=dict)
    content: dict[str, Any] = field(default_factory=dict)
    """Of the station's file; empty where nothing moves, and there is no station."""

    @property
    def report(self) -> ImportReport:
        """What became of the blocks."""
        return self.model.report

    def prefix(self, robot: str) -> str:
        """Return what stands before the names of a robot's axes and links, where there are several robots."""
        return f"{robot}." if len(self.robots) > 1 else ""

    def named(self, body: RigidPart) -> tuple[str, RigidTransform] | None:
        """Return what a body is called in the station, and the pose of its first frame there; None if not in it."""
        if body.grounded:
            return WORLD, self.turn
        for name, robot in self.robots.items():
            if body in robot.links:
                return self.prefix(name) + robot.links[body], robot.frames[body].inverse()
        return next(
            ((name, tree.frame.inverse()) for tree, name in self.free.items() if tree.root is body),
            None,
        )

    def is_of_robot(self, body: RigidPart) -> bool:
        """Tell whether a body is a link of a robot, and moves."""
        return not body.grounded and any(body in robot.links for robot in self.robots.values())


def contact_section(files: StationFiles) -> dict[str, Any]:
    """Return the contact section: the figures of the first contact that no robot's feet tell."""
    touching = files.touching
    own = [
        (contact, ends)
        for contact, *ends in touching.ends
        if not any(files.is_of_robot(body) for body, _ in ends)
    ]
    if not own or not files.pieces:
        return {"model": "point", "stiction_speed": touching.ends[0][0].surface.speed}
    contact, ends = own[0]
    surface = contact.surface
    moving = next((body for body, _ in ends if not body.grounded), None)
    weight = sum(solid.weight.mass for solid in moving.solids) * files.gravity if moving else 1.0
    shared = sum(any(body is moving for body, _ in other) for _, other in own)
    section = {
        "model": "point",
        "stiffness": surface.stiffness,
        "dissipation": bounded_dissipation(
            surface, weight / shared, files.report, contact.node.path
        ),
        "friction": {"static": surface.static, "dynamic": surface.dynamic},
        "stiction_speed": surface.speed,
    }
    if len({other.surface for other, _ in own}) > 1:
        files.report.add(
            "approximated",
            "contact",
            message(
                "simulink.all_contacts_differ",
                "contacts differ: all pieces get the figures of the first",
            ),
        )
    return section


def distance_sensors(files: StationFiles) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return sensors for contacts that sense their distance, and monitors where it stops the simulation."""
    sensors, monitors = dict[str, Any](), dict[str, Any]()
    for contact, *ends in files.touching.ends:
        names = (
            [_end_name(files, body, node) for body, node in ends]
            if contact.senses_distance
            else [""]
        )
        if not all(names):
            continue
        body, other = reversed(names) if names[0] == "floor" else names
        name = files.names.give(contact.node.path)
        sensors[name] = {"kind": "distance", "body": body, "other": other}
        if contact.node in files.model.stopping:
            monitors[f"{name}_stop"] = {"kind": "contact", "sensor": name}
    return sensors, monitors


def _end_name(files: StationFiles, body: RigidPart, node: Node) -> str:
    touching, named = files.touching, files.named(body)
    if files.is_of_robot(body):
        return named[0] if named and node in touching.standing else ""
    if node is touching.laid or (node.kind == _PLANE and node not in touching.slabs):
        return "floor"
    return (
        named[0]
        if named and not body.grounded
        else files.groups.get(node.path.partition("/")[0], "")
    )
