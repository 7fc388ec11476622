"""A run's motion as one HTML file that any browser plays, with its contact forces as arrows."""

import gc
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import (
    Cylinder,
    GeometryId,
    Meshcat,
    MeshcatAnimation,
    MeshcatCone,
    Rgba,
    Role,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.folders import replaced_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.blocks.contacts import Contacts
from simrob_drake.results.animation.camera import WINDOW_ASPECT, camera_on, frame_times, side, walked_way
from simrob_drake.results.animation.drawn import draw_searches, draw_tool_paths, look, open_meshcat, path_colour
from simrob_drake.results.animation.scene import SPACING, ViewedStation, floor_lines, with_floor_under
from simrob_drake.results.colours import AXES, FORCE, SEARCH, SUM_OF_FORCES, rgb
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun

_SCRIPT = Path(__file__).with_suffix(".js")
_OVER_FLOOR = 0.002  # m
_LOOPS = 1_000_000  # "for ever", which Meshcat cannot say


def save_recording(result: RecordedRun, file: Path, *, frames_per_second: float = 32.0) -> Path:
    """Write a run's motion and tools' paths as a looping ``.html``; raises InvalidParameter: the rate; OutputError."""
    page = _page(result, frame_times(result.stop_time, frames_per_second, begin=result.start_time), frames_per_second)
    gc.collect()  # Drake's diagrams are cycles: without this Meshcat would go on listening for a while
    with replaced_at_once(file) as work:
        work.write_text(page, encoding="utf-8")
    return file


def _page(result: RecordedRun, times: Vector, frames_per_second: float) -> str:
    meshcat, way = open_meshcat(), walked_way(result)
    meshcat.SetProperty("/Axes", "visible", True)
    meshcat.SetProperty("/Axes/<object>", "position", [0.0, 0.0, _OVER_FLOOR])
    gone = np.zeros((len(times), 3)) if way is None else way(times)
    config = with_floor_under(result.config, gone)
    scene = ViewedStation(config, meshcat=meshcat)
    _record(meshcat, scene, result, times, frames_per_second)
    for number, part in enumerate(result.parts):  # the tool may change in between
        draw_tool_paths(meshcat, part, number)
        draw_searches(meshcat, part, number)
    points = scene.extents_of_run(result, way)
    look(meshcat, camera_on(points, aspect=WINDOW_ASPECT, azimuth=side(scene.station)))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    tilt = scene.station.ground.floor_pose.rotation().matrix()
    lines = floor_lines(gone @ tilt, size=config.floor.size) if config.floor else np.zeros((0, 2, 3))
    run = {
        "way": [] if way is None else np.round(gone, 4).tolist(),
        "rate": frames_per_second,
        "middle": middle.tolist(),
        "radius": float(np.linalg.norm(points - middle, axis=1).max()),
        "lines": (lines @ tilt.T).round(4).tolist(),
        "spacing": SPACING,
        "name": result.config.name,
        "message": result.end_in_words,
        "stopped": result.stopped_by is not None,
        "begin": result.start_time,
        "end": result.stop_time,
        "legend": _legend(result),
        "axes": AXES,
    }
    known = json.dumps(run).replace("</", "<\\/")  # a name may be anything
    script = f"<script>const RUN = {known};\n{_SCRIPT.read_text(encoding='utf-8')}</script>\n"
    before, end, after = meshcat.StaticHtml().rpartition("</body>")
    return f"{before}{script}{end}{after}"


def _legend(result: RecordedRun) -> list[tuple[str, str]]:
    """Return what of the colours in the picture stands for what."""
    robots = [robot for robot in result.plant.robots.values() if robot.tcp]
    whose = {robot.name: f" of {robot.name}" if len(result.plant.robots) > 1 else "" for robot in robots}
    found = [(path_colour(result, robot.name), f"way of the tool{whose[robot.name]}") for robot in robots]
    if any(len(move.search) for part in result.parts for move in part.moves):
        found.append((SEARCH, "what the search tried"))
    if result.contacts_at is not None:
        found += [(FORCE, "contact forces"), (SUM_OF_FORCES, "their sum on a body")]
    return found


def _record(meshcat: Meshcat, scene: ViewedStation, run: RecordedRun, times: Vector, frames_per_second: float) -> None:
    visualizer = scene.visualizer
    assert visualizer is not None
    animation = visualizer.StartRecording(set_transforms_while_recording=False)
    shown = [(frame + 0.5) / frames_per_second for frame in range(len(times))]  # Meshcat rounds down to frames
    for time, positions in zip(shown, positions_in(scene.station, run, times), strict=True):
        scene.draw(positions, time)
    draw_contact_forces(meshcat, run, times, shown)
    animation.set_autoplay(True)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(_LOOPS)
    visualizer.StopRecording()
    visualizer.PublishRecording()


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
    contacts = Contacts.concatenate(moments)
    sizes = np.linalg.norm(contacts.forces, axis=1)
    if not sizes.size:
        return
    inspector = result.plant.scene_graph.model_inspector()
    # contact spheres that ever touched anything, where the looks of their bodies do not show them
    for shape in {each for pair in contacts.pairs for each in pair}:
        sphere, frame = inspector.GetShape(shape), inspector.GetFrameId(shape)
        looks = [inspector.GetShape(look) for look in inspector.GetGeometries(frame, Role.kIllustration)]
        if isinstance(sphere, Sphere) and not any(
            isinstance(look, Sphere) and look.radius() >= sphere.radius() for look in looks
        ):
            body = inspector.GetName(frame).replace("::", "/")
            path = f"station/{body}/contact_sphere_{shape.get_value()}"
            meshcat.SetObject(path, sphere, _SPHERE)
            meshcat.SetTransform(path, inspector.GetPoseInFrame(shape))
    large = max(float(np.percentile(sizes, _LARGE)), np.finfo(float).tiny)
    for number, forces in enumerate(_each(moments, _SMALLEST * large)):
        _draw_arrow(meshcat, f"contact_forces/{number}", forces, shown, large, Rgba(*rgb(FORCE)))
    sums = [_sums(inspector, now) for now in moments]
    for number, bodies in enumerate(sorted({bodies for now in sums for bodies in now})):
        own = [now.get(bodies) for now in sums]
        _draw_arrow(meshcat, f"contact_forces/sum_{number}", own, shown, large, _SUM)


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
