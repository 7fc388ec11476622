"""Read the XML that CAD tools export for Simscape Multibody: parts, where their instances are, and what joins these."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.files import NotRead, content_of, open_regular
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.extensions.simulink.reading.graph import (
    DEEPEST,
    MOST_BLOCKS,
    Unreadable,
    one_line,
    parse_part,
)
from simrob_drake.extensions.simulink.values.units import UnknownUnit, factor

ROOT, OLDER = b"SimscapeMultibodyImportXML", (b"PhysicalModelingXMLFile", b"SimMechanicsImportXML")
_LARGEST = 64 * 2**20  # bytes
_SHORT = {
    "meter": "m", "centimeter": "cm", "millimeter": "mm", "inch": "in", "foot": "ft", "kilogram": "kg", "gram": "g",
    "pound": "lbm",
}  # fmt: skip
_ROTATION = 1e-3  # by how much nine numbers may miss a rotation: exporters round them


@dataclass(frozen=True)
class Part:
    """What instances are made of."""

    mass: float | None  # [kg]; None where the file does not tell
    com: Vector  # its place, shape (3,) [m]
    inertia: Vector  # about that: Ixx Iyy Izz Iyz Izx Ixy, shape (6,) [kg m²]
    geometry: str  # name of its geometry file; empty without
    unit: str  # of lengths in that, where the file itself does not tell
    colour: Vector  # red, green, blue, opacity


@dataclass(eq=False)
class Instance:
    """A part or an assembly where it is."""

    name: str  # with those of the assemblies that it is in
    pose: RigidTransform  # in the root assembly
    part: Part | None = None  # what it is; None of an assembly
    # the instances in an assembly, by their identifiers
    inside: dict[str, Instance] = field(default_factory=dict)
    held: bool = False  # whether it is fixed in the assembly that it is in
    rigid: bool = False  # whether all in it is one body
    group: str = ""  # of its neighbours those that say the same are one body
    visible: bool = True  # whether it is seen

    def all(self) -> Iterator[Instance]:
        """Yield it and all in it."""
        yield self
        for instance in self.inside.values():
            yield from instance.all()


@dataclass(frozen=True)
class End:
    """Where a joint or constraint is on an instance."""

    instance: Instance
    kind: str  # ``frame``, or the geometry of a constraint: ``point``, ``line``, ``plane``, ``cylinder`` ...
    pose: RigidTransform  # in the root assembly; z is the axis of a geometry


@dataclass(frozen=True)
class Tie:
    """A joint or a constraint between two instances."""

    name: str  # with those of the assemblies that it is in
    kind: str  # the name of its element, such as ``Revolute`` or ``Concentric``
    base: End  # its ends; a constraint has no order
    follower: End
    joins: bool  # whether it is a joint


def is_export(path: Path) -> bool:
    """Tell whether an XML file is what a CAD tool exports for Simscape Multibody, of any age."""
    try:
        with open_regular(path) as file:
            beginning = file.read(2000)
    except OSError:
        return False
    return any(name in beginning for name in (ROOT, *OLDER))


def read_assembly(path: Path) -> tuple[Instance, list[Tie]]:
    """Read an exported assembly: the instance that is the world, and its ties, those of assemblies for each instance.

    Raises InvalidModel: it is damaged, of the first generation, or says what cannot be.
    """
    try:
        content = content_of(path, _LARGEST)
        root = parse_part(content)
    except (NotRead, Unreadable) as problem:
        raise InvalidModel(
            path,
            "",
            message("simulink.cannot_be_read", "cannot be read: {problem}", problem=problem),
        ) from problem
    if root.tag != ROOT.decode():
        older = message(
            "simulink.first_generation",
            "is of Simscape Multibody's first generation; export it again with the plug-in of R2016a or later",
        )
        known = root.tag.encode() in OLDER
        raise InvalidModel(
            path,
            one_line(root.tag),
            older
            if known
            else message("simulink.no_assembly_export", "is no export of a CAD assembly"),
        )
    return _Reader(path, root).assembly()


class _Reader:
    def __init__(self, path: Path, root: Element) -> None:
        self._path, self._root, self._count = path, root, 0
        units = root.find("DataUnits")
        self._kg, self._m = (self._unit(units, key) for key in ("mass", "length"))
        self._parts = {
            part.get("uid", ""): self._part(part) for part in root.iterfind("Parts/Part")
        }
        self._kinds = {kind.get("uid", ""): kind for kind in root.iterfind("Assemblies/Assembly")}
        self._ties: list[Tie] = []

    def assembly(self) -> tuple[Instance, list[Tie]]:
        top = self._root.find("RootAssembly")
        if top is None:
            raise self._wrong("", message("simulink.no_root_assembly", "has no RootAssembly"))
        root = Instance("", RigidTransform())
        self._fill(root, top.find("InstanceTree"), 0)
        self._join(root, top, {top.get("uid", "")})
        return root, self._ties

    def _fill(self, parent: Instance, tree: Element | None, depth: int) -> None:
        if depth > DEEPEST:
            raise self._wrong(
                parent.name,
                message(
                    "simulink.assemblies_too_deep",
                    "nests assemblies more than {deepest} deep",
                    deepest=DEEPEST,
                ),
            )
        for element in tree.iterfind("Instance") if tree is not None else ():
            self._count += 1
            if self._count > MOST_BLOCKS:
                raise self._wrong(
                    "InstanceTree",
                    message(
                        "simulink.too_many_instances",
                        "has more than {most} instances",
                        most=MOST_BLOCKS,
                    ),
                )
            name, uid = one_line(element.get("name", "")), element.get("uid", "")
            name = f"{parent.name}/{name.replace('/', '_')}".lstrip("/")
            if uid in parent.inside:
                raise self._wrong(
                    name,
                    message(
                        "simulink.uid_taken",
                        "has the uid '{uid}' of {inside}",
                        uid=uid,
                        inside=parent.inside[uid].name,
                    ),
                )
            entity, held, rigid = (
                element.get(key, "") for key in ("entityUid", "grounded", "rigid")
            )
            instance = Instance(
                name, parent.pose @ self._transform(element, name), self._parts.get(entity), held=held == "true",
                rigid=rigid == "true", group=element.get("rigidGroup", ""), visible=element.get("visible") != "false",
            )  # fmt: skip
            parent.inside[uid] = instance
            if instance.part is None and entity not in self._kinds:
                raise self._wrong(
                    name,
                    message(
                        "simulink.instance_of_neither",
                        "is an instance of '{entity}', which is neither a part nor an assembly here",
                        entity=entity,
                    ),
                )
            if instance.part is None:
                self._fill(instance, element, depth + 1)
                self._join(instance, self._kinds[entity], {entity})

    def _join(self, owner: Instance, element: Element, own: set[str]) -> None:
        """Take the joints and constraints that stand in an assembly; ``own`` is what it calls itself."""
        for section, tags in (
            ("Joints", ("BaseFrame", "FollowerFrame")),
            ("Constraints", ("ConstraintGeometry",)),
        ):
            for tie in element.iterfind(f"{section}/*"):
                name = f"{owner.name}/{one_line(tie.get('name', '') or tie.tag).replace('/', '_')}".lstrip(
                    "/"
                )
                ends = [
                    self._end(owner, end, name, own) for tag in tags for end in tie.iterfind(tag)
                ]
                if len(ends) != 2:
                    raise self._wrong(
                        name,
                        message(
                            "simulink.joins_two",
                            "a {tag} has {count} ends; it joins two",
                            tag=tie.tag,
                            count=len(ends),
                        ),
                    )
                self._ties.append(Tie(name, tie.tag, ends[0], ends[1], section == "Joints"))

    def _end(self, owner: Instance, element: Element, name: str, own: set[str]) -> End:
        here = owner
        for uid in (one_line(uid.text or "") for uid in element.iterfind("InstancePath/Uid")):
            if here is owner and uid in own and uid not in here.inside:
                continue
            if uid not in here.inside:
                known = ", ".join(list(here.inside)[:5]) or "nothing"
                raise self._wrong(
                    name,
                    message(
                        "simulink.joins_missing",
                        "joins '{uid}', which is not in {here}: {known}",
                        uid=uid,
                        here=here.name or message("simulink.the_assembly", "the assembly"),
                        known=known,
                    ),
                )
            here = here.inside[uid]
        kind = element.get("geomType", "frame")
        if kind == "frame":
            return End(here, kind, here.pose @ self._transform(element, name))
        place = self._numbers(element, "Position", 3, name) * self._m
        axis = (
            self._numbers(element, "Axis", 3, name)
            if element.find("Axis") is not None
            else np.array([0, 0, 1.0])
        )
        if not np.linalg.norm(axis) > 0:
            raise self._wrong(name, message("simulink.axis_of_zero", "has an axis of length zero"))
        turn = RotationMatrix.MakeFromOneVector(axis, 2)
        return End(here, kind, here.pose @ RigidTransform(turn, place))

    def _transform(self, element: Element, name: str) -> RigidTransform:
        place = element.find("Transform")
        if place is None:
            return RigidTransform()
        matrix = self._numbers(place, "Rotation", 9, name).reshape(3, 3)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > _ROTATION or np.linalg.det(matrix) < 0:
            raise self._wrong(
                name,
                message(
                    "simulink.no_rotation",
                    "its Rotation is none: nine numbers by rows, right-handed; mirrored parts are not",
                ),
            )
        turn = RotationMatrix.ProjectToRotationMatrix(matrix)
        return RigidTransform(turn, self._numbers(place, "Translation", 3, name) * self._m)

    def _part(self, element: Element) -> Part:
        name, weighs = one_line(element.get("name", "")), element.find("MassProperties")
        mass, com, inertia = None, np.zeros(3), np.zeros(6)
        if weighs is not None:
            mass = float(self._numbers(weighs, "Mass", 1, name)[0]) * self._kg
            com = self._numbers(weighs, "CenterOfMass", 3, name) * self._m
            inertia = self._numbers(weighs, "Inertia", 6, name) * self._kg * self._m**2
        file, look = element.find("GeometryFile"), element.find("VisualProperties/Diffuse")
        shade = "0.5 0.5 0.5 1" if look is None else " ".join(look.get(key, "1") for key in "rgba")
        units = element.find("ModelUnits")
        self._unit(units, "length")
        unit = (
            "m"
            if units is None
            else _SHORT.get(units.get("length", "meter"), units.get("length", "meter"))
        )
        colour = self._floats(shade, 4, f"{name}: Diffuse")
        return Part(mass, com, inertia, "" if file is None else file.get("name", ""), unit, colour)

    def _unit(self, units: Element | None, key: str) -> float:
        like = {"mass": "kg", "length": "m"}[key]
        text = like if units is None else units.get(key, like)
        try:
            return factor(_SHORT.get(text, text), like)
        except UnknownUnit as problem:
            raise self._wrong(
                "units", compound("{key}: {problem}", key=key, problem=problem)
            ) from problem

    def _numbers(self, element: Element, tag: str, size: int, name: str) -> Vector:
        return self._floats(element.findtext(tag) or "", size, f"{name}: {tag}")

    def _floats(self, text: str, size: int, what: str) -> Vector:
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([np.nan])
        if values.size != size or not np.isfinite(values).all():
            expected = (
                message("simulink.numbers_of", "{size} numbers", size=size)
                if size > 1
                else message("simulink.a_number", "a number")
            )
            raise self._wrong(
                what,
                message(
                    "simulink.must_be",
                    "is '{text}'; it must be {expected}",
                    text=one_line(text)[:60],
                    expected=expected,
                ),
            )
        return values

    def _wrong(self, element: str, problem: str) -> InvalidModel:
        return InvalidModel(self._path, element, problem)
