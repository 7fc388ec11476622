"""The contact forces of a run as arrows in its recording: where they act, and their sum on each body."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set

import numpy as np
from pydrake.geometry import (
    Cylinder,
    GeometryId,
    Meshcat,
    MeshcatCone,
    Rgba,
    Role,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.frames import Vector
from simrob_drake.results.colours import FORCE, SUM_OF_FORCES, rgb
from simrob_drake.results.record.run import RecordedRun

_ARROW, _RADIUS = 0.12, 0.003  # m: length of the arrow of a typical large force, and its thickness
_LARGE = 95  # percentile of the forces that is drawn at that length: a blow may be longer
_SPHERE = Rgba(*rgb(FORCE), 0.6)  # through which the arrow shows
_SMALLEST = 0.01  # part of that force that is still drawn
_SUM = Rgba(*rgb(SUM_OF_FORCES), 0.8)
_HEAD = 0.02  # m

_Pair = tuple[GeometryId, GeometryId]
_Force = tuple[Vector, Vector]  # where it acts, shape (3,) [m], and its size [N]


def draw_contact_forces(meshcat: Meshcat, result: RecordedRun, times: Vector, shown: Sequence[float]) -> None:
    """Draw the contact forces at times of a run (k,) into a window that records, as arrows that appear at ``shown``.

    They are computed from the recorded states; nothing is drawn in a station without contact. Where a body stands on
    several points, which may lie beyond what is seen of it, their sum stands at its centre of pressure.
    """
    if result.contacts_at is None:
        return
    moments = [Contacts.of(results) for results in result.contacts_at(times)]
    contacts = Contacts.together(moments)
    sizes = np.linalg.norm(contacts.forces, axis=1)
    if not sizes.size:
        return
    inspector = result.plant.scene_graph.model_inspector()
    _draw_spheres(meshcat, inspector, {each for pair in contacts.pairs for each in pair})
    large = max(float(np.percentile(sizes, _LARGE)), np.finfo(float).tiny)
    for number, forces in enumerate(_each(moments, _SMALLEST * large)):
        _draw_arrow(meshcat, f"contact_forces/{number}", forces, shown, large, Rgba(*rgb(FORCE)))
    sums = [_sums(inspector, now) for now in moments]
    for number, bodies in enumerate(sorted({bodies for now in sums for bodies in now})):
        own = [now.get(bodies) for now in sums]
        _draw_arrow(meshcat, f"contact_forces/sum_{number}", own, shown, large, _SUM)


def _draw_spheres(meshcat: Meshcat, inspector: SceneGraphInspector, touched: Set[GeometryId]) -> None:
    """Show the contact spheres that ever touched anything on their bodies, where the body's looks do not show them."""
    for shape in touched:
        sphere, frame = inspector.GetShape(shape), inspector.GetFrameId(shape)
        looks = [inspector.GetShape(look) for look in inspector.GetGeometries(frame, Role.kIllustration)]
        if isinstance(sphere, Sphere) and not any(
            isinstance(look, Sphere) and look.radius() >= sphere.radius() for look in looks
        ):
            body = inspector.GetName(frame).replace("::", "/")
            path = f"station/{body}/contact_sphere_{shape.get_value()}"
            meshcat.SetObject(path, sphere, _SPHERE)
            meshcat.SetTransform(path, inspector.GetPoseInFrame(shape))


def _each(moments: Sequence[Contacts], least: float) -> Iterator[list[_Force | None]]:
    """Yield the force of each point and surface of contact over time; None where it is less than that [N]."""
    places = [list(_numbered(now.pairs)) for now in moments]
    for place in dict.fromkeys(place for now in places for place in now):
        rows = [now.index(place) if place in now else None for now in places]
        yield [
            None if row is None or np.linalg.norm(now.forces[row]) < least else (now.points[row], now.forces[row])
            for now, row in zip(moments, rows, strict=True)
        ]


def _numbered(pairs: Iterable[_Pair]) -> Iterator[tuple[_Pair, int]]:
    """Yield pairs of shapes with a number each, since two shapes may touch at several points."""
    seen = Counter[_Pair]()
    for pair in pairs:
        yield pair, seen[pair]
        seen[pair] += 1


def _sums(inspector: SceneGraphInspector, contacts: Contacts) -> dict[tuple[str, str], _Force]:
    """Return the forces between bodies that touch at several points, on the first of their names; not the world."""
    world, rows = inspector.GetName(inspector.world_frame_id()), dict[tuple[str, str], list[tuple[int, float]]]()
    for row, pair in enumerate(contacts.pairs):
        first, second = (inspector.GetName(inspector.GetFrameId(shape)) for shape in pair)
        turned = (first == world, first) > (second == world, second)
        bodies = (second, first) if turned else (first, second)
        rows.setdefault(bodies, []).append((row, -1.0 if turned else 1.0))
    found = {}
    for bodies, entries in rows.items():
        places, senses = [row for row, _ in entries], np.array([sense for _, sense in entries])
        pressed = np.linalg.norm(contacts.normal_forces[places], axis=1)
        if len(places) > 1 and pressed.any():
            centre = pressed @ contacts.points[places] / pressed.sum()
            found[bodies] = centre, senses @ contacts.forces[places]
    return found


def _draw_arrow(
    meshcat: Meshcat, path: str, forces: Sequence[_Force | None], shown: Sequence[float], large: float, colour: Rgba
) -> None:
    """Draw a force over the times at which it is ``shown``, None where there is none."""
    meshcat.SetObject(f"{path}/shaft", Cylinder(_RADIUS, 1.0), colour)
    meshcat.SetObject(f"{path}/head/cone", MeshcatCone(_HEAD, _HEAD / 2, _HEAD / 2), colour)
    meshcat.SetTransform(f"{path}/head/cone", RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, _HEAD]))
    for part in ("shaft", "head/cone"):
        meshcat.SetProperty(f"{path}/{part}/<object>", "material.depthTest", False)  # it is seen through the body
    for time, force in zip(shown, forces, strict=True):
        meshcat.SetProperty(path, "visible", force is not None, time)
        if force is None or not force[1].any():
            continue
        point, along = force
        length = float(np.linalg.norm(along)) / large * _ARROW
        meshcat.SetTransform(path, RigidTransform(RotationMatrix.MakeFromOneVector(along, 2), point), time)
        meshcat.SetProperty(f"{path}/shaft", "scale", [1.0, 1.0, length], time)
        meshcat.SetProperty(f"{path}/shaft", "position", [0.0, 0.0, length / 2], time)
        meshcat.SetProperty(f"{path}/head", "position", [0.0, 0.0, length], time)
