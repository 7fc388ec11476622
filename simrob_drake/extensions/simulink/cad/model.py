r"""An exported CAD assembly as a model of Simscape Multibody blocks: what MATLAB's ``smimport`` makes of it.

Each constraint between two bodies forbids velocities: rows :math:`a` with :math:`a^\top (\omega, v) = 0` for the
turning rate and the velocity of the origin of one body seen from the other. What all of them leave over is a joint, by
the directions in which the body can turn and slide.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from scipy.cluster.hierarchy import DisjointSet

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.cad.assembly import End, Instance, Tie, read_assembly
from simrob_drake.extensions.simulink.mechanics.joints import PRIMITIVES, xyz_angles
from simrob_drake.extensions.simulink.reading.graph import Model, Port, SimulinkBlock, System
from simrob_drake.robots.imports import EntryKind

_JOINTS = {
    kind.removesuffix(" Joint").replace(" ", ""): kind
    for kind in PRIMITIVES
    if kind != "6-DOF Joint"
}
"""What joints are called there."""
_APART = 1e-4  # m: what frames of a joint may be apart in an assembly without a word


def read_cad_model(path: Path) -> Model:
    """Return an exported assembly as a model.

    Raises:
        InvalidModel: as :func:`read_assembly`; a joint that is not known, or constraints that leave no joint's freedom.
    """
    writer = _Writer(path, *read_assembly(path))
    return Model(path, "Assembly", writer.system(), notes=writer.notes)


class _Writer:
    def __init__(self, path: Path, root: Instance, ties: list[Tie]) -> None:
        self._path, self._root, self._ties = path, root, ties
        self._system, self.notes = System(), list[tuple[EntryKind, str, str]]()
        self._bodies = DisjointSet(root.all())
        self._sids: dict[Instance, str] = {}

    def system(self) -> System:
        self._hold(self._root)
        joints = [tie for tie in self._ties if tie.joins]
        for tie in joints:
            if tie.kind not in _JOINTS:
                known = ", ".join(_JOINTS)
                raise InvalidModel(
                    self._path,
                    tie.name,
                    message(
                        "simulink.unknown_joint",
                        "a joint {kind} is not known here; {known} are",
                        kind=tie.kind,
                        known=known,
                    ),
                )
            if tie.kind == "Weld":
                self._bodies.merge(tie.base.instance, tie.follower.instance)
        pairs = self._constrained([tie for tie in self._ties if not tie.joins])
        self._add_bodies()
        joined = {pair for tie in joints if (pair := self._pair(tie))}
        for tie in joints:
            if self._pair(tie):
                self._joint(tie, _JOINTS[tie.kind], tie.base.pose, tie.follower.pose)
        for pair, constraints in pairs.items():
            if pair in joined:
                names = ", ".join(tie.name for tie in constraints)
                self.notes.append(
                    (
                        "dropped",
                        constraints[0].name,
                        message(
                            "simulink.beside_a_joint",
                            "{names}: beside a joint of the same parts",
                            names=names,
                        ),
                    )
                )
            elif self._left_free(constraints):
                joined.add(pair)
        self._free_the_others(joined)
        return self._system

    def _hold(self, parent: Instance, rigid: bool = False) -> None:
        """Unite what is fixed in assemblies, all of rigid ones, and groups."""
        rigid = rigid or parent.rigid
        groups: dict[str, Instance] = {}
        for child in parent.inside.values():
            if rigid or child.held:
                self._bodies.merge(child, parent)
            if child.group:
                self._bodies.merge(child, groups.setdefault(child.group, child))
            self._hold(child, rigid)

    def _constrained(self, constraints: list[Tie]) -> dict[frozenset[Instance], list[Tie]]:
        """Return constraints by the bodies that they join, after what they fix to each other is one body."""
        while True:
            pairs: dict[frozenset[Instance], list[Tie]] = {}
            for tie in constraints:
                if pair := self._pair(tie):
                    pairs.setdefault(pair, []).append(tie)
            fixed = [
                pair
                for pair, ties in pairs.items()
                if (self._joint_of(ties) or [""])[0] == "Weld Joint"
            ]
            if not fixed:
                return pairs
            for pair in fixed:
                self._bodies.merge(*pair)

    def _joint_of(self, ties: list[Tie]) -> tuple[str, RigidTransform] | None:
        try:
            return joint_of(ties)
        except ValueError as problem:
            raise InvalidModel(self._path, ties[0].name, str(problem)) from problem

    def _left_free(self, ties: list[Tie]) -> bool:
        """Add the joint that constraints leave; tell them as refused, and return False, where that is none."""
        names, found = ", ".join(tie.name for tie in ties), self._joint_of(ties)
        if found is None:
            text = message(
                "simulink.odd_freedoms",
                "leave freedoms between two parts that no joint has; export a joint instead",
            )
            self.notes.append(
                (
                    "refused",
                    ties[0].name,
                    message(
                        "simulink.its_constraints",
                        "its constraints ({names}) {problem}",
                        names=names,
                        problem=text,
                    ),
                )
            )
            return False
        self.notes.append(
            (
                "read",
                ties[0].name,
                message("simulink.is_a_joint", "{names}: a {kind}", names=names, kind=found[0]),
            )
        )
        self._joint(ties[0], found[0], found[1], found[1])
        return True

    def _pair(self, tie: Tie) -> frozenset[Instance]:
        """Return the two bodies that something joins; empty if they are one."""
        pair = frozenset(self._bodies[end.instance] for end in (tie.base, tie.follower))
        return pair if len(pair) > 1 else frozenset()

    def _add_bodies(self) -> None:
        """Add the parts, those of one body joined rigidly with the first of them, or with the world."""
        root = self._root
        self._sids[root] = self._add("sm_lib/Frames and Transforms/World Frame", "World", {})
        self._first = {self._bodies[root]: root}
        for instance in root.all():
            if instance.part is not None:
                self._sids[instance] = self._add(
                    "sm_lib/Body Elements/File Solid", instance.name, _solid(instance)
                )
                first = self._first.setdefault(self._bodies[instance], instance)
                if first is not instance:
                    pose = first.pose.inverse() @ instance.pose
                    self._transform(
                        f"{instance.name} place", self._port(first), pose, self._port(instance)
                    )

    def _joint(self, tie: Tie, kind: str, base: RigidTransform, follower: RigidTransform) -> None:
        sid = self._add(
            f"sm_lib/Joints/{kind}", tie.name, self._targets(tie, kind, base.inverse() @ follower)
        )
        for end, frame, name, side in (
            (tie.base, base, "base", "lconn"), (tie.follower, follower, "follower", "rconn")):  # fmt: skip
            first = self._first.get(self._bodies[end.instance])
            if first is None:
                text = message(
                    "simulink.no_part_is_fixed",
                    "its {name} is on {instance}, in which no part is fixed",
                    name=name,
                    instance=end.instance.name or message("simulink.the_assembly", "the assembly"),
                )
                raise InvalidModel(self._path, tie.name, text)
            self._transform(
                f"{tie.name} {name}",
                self._port(first),
                first.pose.inverse() @ frame,
                Port(sid, side, 1),
            )

    def _targets(self, tie: Tie, kind: str, pose: RigidTransform) -> dict[str, str]:
        places = ("Px", "Py", "Pz", "Rx", "Ry", "Rz")
        values = dict(zip(places, (*pose.translation(), *xyz_angles(pose.rotation())), strict=True))
        primitives = PRIMITIVES[kind]
        apart = np.linalg.norm([values[name] for name in places[:3] if name not in primitives])
        if apart > _APART:
            text = message(
                "simulink.frames_apart",
                "its frames are {distance:.3g} mm apart in the assembly: put together",
                distance=1e3 * apart,
            )
            self.notes.append(("repaired", tie.name, text))
        targets: dict[str, str] = {}
        for name in primitives:
            target = f"{name if len(primitives) > 1 else ''}PositionTarget"
            rows = _row(pose.rotation().matrix().reshape(-1))
            matrix = {"RotationMethod": "RotationMatrix", "RotationMatrix": rows}
            values_of = matrix if name == "S" else {"Value": repr(float(values[name]))}
            targets |= {
                f"{target}{key}": value for key, value in {"Specify": "on", **values_of}.items()
            }
        return targets

    def _free_the_others(self, joined: Iterable[frozenset[Instance]]) -> None:
        """Let bodies that no chain of joints leads to from the world move freely, each group as one."""
        groups, root = DisjointSet(self._first), self._root
        for pair in joined:
            groups.merge(*pair)
        held = groups[self._bodies[root]]
        for body, first in self._first.items():
            if not groups.connected(body, held):
                sid = self._add("sm_lib/Joints/6-DOF Joint", f"{first.name} free", {})
                self._transform(
                    f"{first.name} start", self._port(root), first.pose, Port(sid, "lconn", 1)
                )
                self._system.nets.append([Port(sid, "rconn", 1), self._port(first)])
                self.notes.append(
                    (
                        "read",
                        first.name,
                        message(
                            "simulink.nothing_joins",
                            "nothing joins it to what is fixed: it is free",
                        ),
                    )
                )
                groups.merge(body, held)

    def _port(self, instance: Instance) -> Port:
        return Port(self._sids[instance], "rconn", 1)

    def _transform(self, name: str, start: Port, pose: RigidTransform, end: Port) -> None:
        sid = self._add("sm_lib/Frames and Transforms/Rigid Transform", name, {
            "TranslationMethod": "Cartesian", "TranslationCartesianOffset": _row(pose.translation()),
            "RotationMethod": "RotationMatrix", "RotationMatrix": _row(pose.rotation().matrix().reshape(-1)),
        })  # fmt: skip
        self._system.nets += [[start, Port(sid, "lconn", 1)], [Port(sid, "rconn", 1), end]]

    def _add(self, kind: str, name: str, parameters: dict[str, str]) -> str:
        sid = str(len(self._system.blocks) + 1)
        self._system.blocks[sid] = SimulinkBlock(
            sid, name, kind, linked=True, parameters=parameters
        )
        return sid


def _solid(instance: Instance) -> dict[str, str]:
    part = instance.part
    assert part is not None
    weight = {"InertiaType": "CalculateFromGeometry"}
    if part.mass is not None:
        weight = {
            "InertiaType": "Custom", "Mass": repr(part.mass), "CenterOfMass": _row(part.com),
            "MomentsOfInertia": _row(part.inertia[:3]), "ProductsOfInertia": _row(part.inertia[3:]),
        }  # fmt: skip
    return {
        **weight, "ExtGeomFileName": part.geometry, "ExtGeomFileUnits": part.unit,
        "GraphicType": "FromGeometry" if instance.visible else "None",
        "GraphicDiffuseColor": _row(part.colour[:3]), "GraphicOpacity": repr(float(part.colour[3])),
    }  # fmt: skip


def _row(values: Vector) -> str:
    return f"[{' '.join(repr(float(value)) for value in values)}]"


_SAME = 1e-5  # of directions, and of metres: what counts as parallel or in one place
_SHAPES = {
    **dict.fromkeys(("point", "sphere"), "point"), **dict.fromkeys(("line", "cylinder", "circle", "cone"), "line"),
    "plane": "plane",
}  # fmt: skip
"""What the geometry of a constraint counts as: shapes of few freedoms stand first."""


def joint_of(ties: Sequence[Tie]) -> tuple[str, RigidTransform] | None:
    """Return the joint block that constraints between two bodies leave, and its frame; None if there is none such.

    Raises ValueError: a constraint that is not known; the text says which.
    """
    rows = np.vstack([np.zeros((1, 6)), *(_rows(tie) for tie in ties)])
    _, sizes, directions = np.linalg.svd(rows)
    free = directions[int((sizes > _SAME).sum()) :]
    if not len(free):
        return "Weld Joint", ties[0].base.pose
    turns, slides = _split(free)
    make = _LEFT_OVER.get((len(turns), len(slides)))
    made = make(turns, slides) if make else None
    if (
        made is not None and len(slides) + (made[0] == "Prismatic Joint") > 1
    ):  # any place will do: one at the bodies
        made[1].set_translation(ties[0].base.pose.translation())
    return made


def _split(free: Vector) -> tuple[Vector, Vector]:
    """Return free motions (n, 6) as those that turn, and pure slides (m, 3), orthonormal."""
    left, sizes, _ = np.linalg.svd(free[:, :3])
    count = int((sizes > _SAME).sum())
    mixed = left.T @ free
    slides = mixed[count:, 3:]
    if len(slides):
        slides = np.linalg.svd(slides)[2][: len(slides)]
    turns = mixed[:count]
    turns = turns / np.linalg.norm(turns[:, :3], axis=1, keepdims=True)
    turns[:, 3:] -= turns[:, 3:] @ slides.T @ slides if len(slides) else 0.0
    return turns, slides


def _hinge(turns: Vector, slides: Vector) -> tuple[str, RigidTransform] | None:
    """Return a hinge, or with slides across a planar joint, along a cylindrical one."""
    axis, speed = turns[0, :3], turns[0, 3:]
    along = slides @ axis
    if abs(axis @ speed) > _SAME or not (
        len(slides) == 0 or np.allclose(np.abs(along), len(slides) == 1, atol=_SAME)
    ):
        return None
    kind = ("Revolute Joint", "Cylindrical Joint", "Planar Joint")[len(slides)]
    return kind, RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), np.cross(axis, speed))


def _slider(_: Vector, slides: Vector) -> tuple[str, RigidTransform]:
    kind = ("Prismatic Joint", "Rectangular Joint", "Cartesian Joint")[len(slides) - 1]
    axis = np.cross(slides[0], slides[1]) if len(slides) == 2 else slides[0]
    return kind, RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), np.zeros(3))


def _ball(turns: Vector, _: Vector) -> tuple[str, RigidTransform] | None:
    """Return a ball joint about the point c that stays: v = c × ω for every turn."""
    across = np.vstack([-np.cross(np.eye(3), turn[:3]) for turn in turns])
    middle = np.linalg.lstsq(across, turns[:, 3:].reshape(-1), rcond=None)[0]
    if np.abs(across @ middle - turns[:, 3:].reshape(-1)).max() > _SAME:
        return None
    return "Spherical Joint", RigidTransform(middle)


_LEFT_OVER: dict[tuple[int, int], Callable[[Vector, Vector], tuple[str, RigidTransform] | None]] = {
    **dict.fromkeys([(1, 0), (1, 1), (1, 2)], _hinge),
    **dict.fromkeys([(0, 1), (0, 2), (0, 3)], _slider),
    (3, 0): _ball,
}


def _rows(tie: Tie) -> Vector:
    """Return what a constraint forbids, shape (n, 6)."""
    for end in (tie.base, tie.follower):
        if end.kind not in _SHAPES:
            raise ValueError(
                message(
                    "simulink.unknown_geometry",
                    "the geometry '{kind}' of a {constraint} is not known here",
                    kind=end.kind,
                    constraint=tie.kind,
                )
            )
    one, other = sorted(
        (tie.base, tie.follower),
        key=lambda end: ("point", "line", "plane").index(_SHAPES[end.kind]),
    )
    shapes = _SHAPES[one.kind], _SHAPES[other.kind]
    if tie.kind not in _KINDS:
        raise ValueError(
            message(
                "simulink.unknown_constraint",
                "a constraint {kind} is not known here; {known} are",
                kind=tie.kind,
                known=", ".join(sorted(_KINDS)),
            )
        )
    if tie.kind in ("Fixed", "Lock", "Rigid"):
        return np.eye(6)
    a, b = (_axis(end) for end in (one, other))
    if tie.kind in ("Perpendicular", "Angle"):
        across = np.cross(a, b)
        size = float(np.linalg.norm(across))
        return _turning(across / size) if size > _SAME else _turning(*_perpendicular(a))
    if tie.kind == "Parallel":
        return _parallel(shapes, a, b)
    return np.vstack([_parallel(shapes, a, b), _touching(tie.kind, shapes, one, other)])


def _parallel(shapes: tuple[str, str], a: Vector, b: Vector) -> Vector:
    """Return the turns that lines and planes forbid which stay parallel; points forbid none."""
    if "point" in shapes:
        return np.zeros((0, 6))
    if shapes == ("line", "plane"):
        across = np.cross(a, b)
        return _turning(across / max(float(np.linalg.norm(across)), 1e-12))
    return _turning(*_perpendicular(b))


def _touching(kind: str, shapes: tuple[str, str], one: End, other: End) -> Vector:
    """Return the slides that are forbidden where shapes touch, or keep their distance."""
    place, normal = one.pose.translation(), _axis(other)
    between = place - other.pose.translation()
    if shapes[1] == "plane":
        return _sliding(place, normal)
    if shapes[1] == "line":
        between = between - (between @ normal) * normal
    far = float(np.linalg.norm(between)) > _SAME
    if kind in ("Distance", "Tangent") and far:
        return _sliding(place, between / np.linalg.norm(between))
    return _sliding(place, *(_perpendicular(normal) if shapes[1] == "line" else np.eye(3)))


def _axis(end: End) -> Vector:
    return np.asarray(end.pose.rotation().matrix()[:, 2])


def _perpendicular(axis: Vector) -> Vector:
    return np.asarray(RotationMatrix.MakeFromOneVector(axis, 2).matrix()[:, :2].T)


def _turning(*directions: Vector) -> Vector:
    return np.hstack([np.array(directions), np.zeros((len(directions), 3))])


def _sliding(place: Vector, *directions: Vector) -> Vector:
    """Return rows for the velocity v + ω × p of a place p along directions."""
    return np.array(
        [np.concatenate([np.cross(place, direction), direction]) for direction in directions]
    )


_KINDS = {
    "Coincident", "Concentric", "Distance", "Tangent", "Parallel", "Perpendicular", "Angle", "Fixed", "Lock", "Rigid",
}  # fmt: skip
