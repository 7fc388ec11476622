"""The motion of a run as one HTML file that any browser plays, with the contact forces as arrows.

The page is that of Drake's Meshcat, with a recorded animation, and with a script of ours that adds a clock, a bar to
play by and a legend. A *frame* is one picture of the animation. A *place* is a point or a surface at which two shapes
touch, and a *moment* is the time of a frame.
"""

import gc
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

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
from simrob_drake.results.animation.camera import (
    WINDOW_ASPECT,
    camera_on,
    frame_times,
    side,
    walked_displacement,
)
from simrob_drake.results.animation.drawn import (
    draw_searches,
    draw_tool_paths,
    look,
    open_meshcat,
    path_colour,
)
from simrob_drake.results.animation.scene import (
    SPACING,
    ViewedStation,
    floor_lines,
    with_floor_under,
)
from simrob_drake.results.colours import AXES, FORCE, SEARCH, SUM_OF_FORCES, rgb
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.stations.config import StationConfig

_SCRIPT = Path(__file__).with_suffix(".js")
"""Script that the page has in addition to Meshcat's own. It reads a constant RUN: see :func:`_data_for_script`."""

_OVER_FLOOR = 0.002
"""Height of the world's axes over the floor [m], so that the floor does not hide them."""

_REPETITIONS = 1_000_000
"""Count of repetitions of the animation. Meshcat cannot repeat without end."""

_ARROW = 0.12
"""Length of the arrow of a large force [m]."""

_LARGE = 95
"""Percentile of the forces that counts as large. Blows may be longer."""

_SMALLEST = 0.01
"""A force is drawn if it is at least this part of a large one."""

_RADIUS = 0.003
"""Radius of the shaft of an arrow [m]."""

_HEAD = 0.02
"""Length of the head of an arrow [m]."""

_SPHERE = Rgba(*rgb(FORCE), 0.6)
"""Colour of contact spheres. The arrow is visible through them."""

_SUM = Rgba(*rgb(SUM_OF_FORCES), 0.8)
"""Colour of the arrow of a sum of forces."""


class _Force(NamedTuple):
    """A force in the world: the point where it acts [m], and its components [N], shape (3,) each."""

    point: Vector
    components: Vector


class _ShapePair(NamedTuple):
    """Two shapes that touch each other."""

    first: GeometryId
    second: GeometryId


class _Place(NamedTuple):
    """A point or surface of contact: the shapes, and a number, since two shapes may touch in several places."""

    pair: _ShapePair
    number: int


class _BodyPair(NamedTuple):
    """Names of two bodies that touch each other. The force acts on the first one."""

    first: str
    second: str


class _Touch(NamedTuple):
    """One contact of a pair of bodies: its row among all contacts, and the sign of its force on the first body."""

    row: int
    sign: float


def save_recording(result: RecordedRun, file: Path, *, frames_per_second: float = 32.0) -> Path:
    """Write the motion of a run, with the paths of its tools, as an HTML file that plays it again and again.

    Args:
        result: the run.
        file: the file.
        frames_per_second: rate of the frames [1/s].

    Returns:
        the file.

    Raises:
        InvalidParameter: the rate is not positive.
        OutputError: the file cannot be written.
    """
    times = frame_times(result.stop_time, frames_per_second, begin=result.start_time)
    page = _page(result, times, frames_per_second)
    gc.collect()  # Drake's diagrams are cycles: without this Meshcat would go on listening for a while
    with replaced_at_once(file) as work:
        work.write_text(page, encoding="utf-8")
    return file


def _page(result: RecordedRun, times: Vector, frames_per_second: float) -> str:
    """Make the HTML page of a run.

    Args:
        result: the run.
        times: times of the frames, shape (k,) [s].
        frames_per_second: rate of the frames [1/s].
    """
    meshcat = open_meshcat()
    displacement = walked_displacement(result)
    # Views hide the axes; in a recording they show the directions of the signals' x, y and z.
    meshcat.SetProperty("/Axes", "visible", True)
    meshcat.SetProperty("/Axes/<object>", "position", [0.0, 0.0, _OVER_FLOOR])
    # Displacement of the camera in each frame, shape (k, 3) [m]; zero if it does not move.
    path = np.zeros((len(times), 3)) if displacement is None else displacement(times)
    config = with_floor_under(result.config, path)
    scene = ViewedStation(config, meshcat=meshcat)
    _record(meshcat, scene, result, times, frames_per_second)
    # A program has several runs, between which the tool may change.
    for number, part in enumerate(result.parts):
        draw_tool_paths(meshcat, part, number)
        draw_searches(meshcat, part, number)
    points = scene.extents_of_run(result, displacement)
    look(meshcat, camera_on(points, aspect=WINDOW_ASPECT, azimuth=side(scene.station)))

    data = {
        "way": [] if displacement is None else np.round(path, 4).tolist(),
        "rate": frames_per_second,
        **_data_for_script(result, config, scene, path, points),
    }
    # "</script>" in the name of a station would end the script: "<\\/" is the same text for JavaScript.
    json_data = json.dumps(data).replace("</", "<\\/")
    script = f"<script>const RUN = {json_data};\n{_SCRIPT.read_text(encoding='utf-8')}</script>\n"
    # Meshcat's scripts come first: ours uses the objects that they make.
    before, end, after = meshcat.StaticHtml().rpartition("</body>")
    return f"{before}{script}{end}{after}"


def _data_for_script(
    result: RecordedRun, config: StationConfig, scene: ViewedStation, path: Vector, points: Vector
) -> dict[str, Any]:
    """Collect the data that the script of the page shows. The script's head describes each entry.

    Args:
        result: the run.
        config: the station, with a floor that is large enough.
        scene: the scene of this station.
        path: displacement of the camera in each frame, shape (k, 3) [m].
        points: points around the motion, relative to the camera's displacement, shape (m, 3) [m].
    """
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    tilt = scene.station.ground.floor_pose.rotation().matrix()
    floor = config.floor
    # The lines are computed in the frame of the floor, and shown in the world. Positions are rows here: a product with
    # the rotation turns them from the world to the floor, one with its transpose turns them back.
    lines = floor_lines(path @ tilt, size=floor.size) if floor else np.zeros((0, 2, 3))
    return {
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


class _LegendEntry(NamedTuple):
    """A colour of the picture, "#rrggbb", and what has this colour."""

    colour: str
    text: str


def _legend(result: RecordedRun) -> list[_LegendEntry]:
    """Explain the colours of a recording: paths of tools, searches for a path, and contact forces, if it has them."""
    entries = []
    has_several_robots = len(result.plant.robots) > 1
    for robot in result.plant.robots.values():
        if robot.tcp:
            owner = f" of {robot.name}" if has_several_robots else ""
            entries.append(
                _LegendEntry(path_colour(result, robot.name), f"path of the tool{owner}")
            )
    if any(len(move.search) for part in result.parts for move in part.moves):
        entries.append(_LegendEntry(SEARCH, "paths that the search tried"))
    if result.contacts_at is not None:
        entries.append(_LegendEntry(FORCE, "contact forces"))
        entries.append(_LegendEntry(SUM_OF_FORCES, "sum of the forces on a body"))
    return entries


def _record(
    meshcat: Meshcat,
    scene: ViewedStation,
    run: RecordedRun,
    times: Vector,
    frames_per_second: float,
) -> None:
    """Record the motion of a run, and its contact forces, as an animation of Meshcat.

    Args:
        meshcat: Meshcat of the scene.
        scene: the scene, which draws into Meshcat.
        run: the run.
        times: times of the frames in the run, shape (k,) [s].
        frames_per_second: rate of the frames [1/s].
    """
    visualizer = scene.visualizer
    assert visualizer is not None
    # Bodies need not move in the page while they are recorded: the animation sets all poses.
    animation = visualizer.StartRecording(set_transforms_while_recording=False)
    # Meshcat rounds times of the animation down to frames: half a frame more is safe from errors of the arithmetic.
    animation_times = [(frame + 0.5) / frames_per_second for frame in range(len(times))]
    for time, positions in zip(
        animation_times, positions_in(scene.station, run, times), strict=True
    ):
        scene.draw(positions, time)
    draw_contact_forces(meshcat, run, times, animation_times)
    animation.set_autoplay(True)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(_REPETITIONS)
    visualizer.StopRecording()
    visualizer.PublishRecording()


def draw_contact_forces(
    meshcat: Meshcat, result: RecordedRun, times: Vector, animation_times: Sequence[float]
) -> None:
    """Draw the contact forces of a run as arrows into a Meshcat that records.

    The forces are computed from the recorded states. A body that touches another one at several points also has their
    sum, at the centre of pressure. Nothing is drawn if the run has no contact results, see `RecordedRun.contacts_at`,
    or if nothing touches in any frame. Forces below 1 % of a large one have no arrow.

    Args:
        meshcat: the Meshcat.
        result: the run.
        times: times of the frames in the run, shape (k,) [s].
        animation_times: times of the same frames in the animation [s].
    """
    if result.contacts_at is None:
        return
    moments = [Contacts.of(results) for results in result.contacts_at(times)]
    contacts = Contacts.concatenate(moments)
    # One scale for the whole run, so that arrows of different frames can be compared.
    magnitudes = np.linalg.norm(contacts.forces, axis=1)
    if not magnitudes.size:
        return
    inspector = result.plant.scene_graph.model_inspector()
    _draw_contact_spheres(meshcat, inspector, contacts)

    # The smallest positive number, in place of 0, since forces are divided by the large one.
    large = max(float(np.percentile(magnitudes, _LARGE)), np.finfo(float).tiny)
    for number, forces in enumerate(_forces_of_places(moments, _SMALLEST * large)):
        _draw_arrow(
            meshcat, f"contact_forces/{number}", forces, animation_times, large, Rgba(*rgb(FORCE))
        )
    sums_of_moments = [_sums(inspector, moment) for moment in moments]
    pairs = sorted({pair for sums in sums_of_moments for pair in sums})
    for number, pair in enumerate(pairs):
        sums_of_pair = [sums.get(pair) for sums in sums_of_moments]
        _draw_arrow(
            meshcat, f"contact_forces/sum_{number}", sums_of_pair, animation_times, large, _SUM
        )


def _draw_contact_spheres(
    meshcat: Meshcat, inspector: SceneGraphInspector, contacts: Contacts
) -> None:
    """Draw the contact spheres that ever touch something, unless a visible sphere of their body covers them.

    Feet may have small spheres at their corners, for contact only. Without them the arrows would begin nowhere.

    Args:
        meshcat: the Meshcat.
        inspector: inspector of the scene, with the shapes.
        contacts: all contacts of the run.
    """
    touching_shapes = {shape for pair in contacts.pairs for shape in pair}
    for shape in touching_shapes:
        sphere = inspector.GetShape(shape)
        if not isinstance(sphere, Sphere):
            continue
        frame = inspector.GetFrameId(shape)
        visible_shapes = [
            inspector.GetShape(look) for look in inspector.GetGeometries(frame, Role.kIllustration)
        ]
        visible_radii = [look.radius() for look in visible_shapes if isinstance(look, Sphere)]
        # A visible ball, such as a foot, is at least as large. It is taken to be at the same place.
        if any(radius >= sphere.radius() for radius in visible_radii):
            continue
        body = inspector.GetName(frame).replace("::", "/")
        path = f"station/{body}/contact_sphere_{shape.get_value()}"
        meshcat.SetObject(path, sphere, _SPHERE)
        meshcat.SetTransform(path, inspector.GetPoseInFrame(shape))


def _forces_of_places(moments: Sequence[Contacts], least: float) -> Iterator[list[_Force | None]]:
    """Yield the force of each point or surface of contact, at all moments.

    A force is None at a moment at which there is no contact in this place, or less force than the least one.

    Args:
        moments: the contacts at each moment.
        least: magnitude of the least force [N].
    """
    places_of_moments = [_places_of(moment) for moment in moments]
    # One arrow for each place of the whole run, which is hidden while there is no contact: Meshcat cannot add
    # objects in the middle of an animation.
    all_places = dict.fromkeys(place for places in places_of_moments for place in places)
    for place in all_places:
        forces: list[_Force | None] = []
        for moment, places in zip(moments, places_of_moments, strict=True):
            force = None
            if place in places:
                row = places.index(place)  # index of the contact at this moment
                if np.linalg.norm(moment.forces[row]) >= least:
                    force = _Force(moment.points[row], moment.forces[row])
            forces.append(force)
        yield forces


def _places_of(contacts: Contacts) -> list[_Place]:
    """Places of contacts, in their order. Contacts of the same shapes are numbered from 0."""
    counts = Counter[_ShapePair]()
    places = []
    for first, second in contacts.pairs:
        pair = _ShapePair(first, second)
        places.append(_Place(pair, counts[pair]))
        counts[pair] += 1
    return places


def _sums(inspector: SceneGraphInspector, contacts: Contacts) -> dict[_BodyPair, _Force]:
    """Add up the forces between bodies that touch at several points. The sum acts at the centre of pressure.

    Bodies that touch at a single point are left out.

    Args:
        inspector: inspector of the scene, which has the names of the bodies.
        contacts: contacts at a moment.

    Returns:
        the sums by bodies, on the first body of each pair.
    """
    touches_of_pairs: dict[_BodyPair, list[_Touch]] = {}
    for row, (first_shape, second_shape) in enumerate(contacts.pairs):
        first = inspector.GetName(inspector.GetFrameId(first_shape))
        second = inspector.GetName(inspector.GetFrameId(second_shape))
        # The order of the shapes may change from moment to moment, that of the names does not.
        is_turned = _rank_of_body(inspector, first) > _rank_of_body(inspector, second)
        if is_turned:
            touches_of_pairs.setdefault(_BodyPair(second, first), []).append(_Touch(row, sign=-1.0))
        else:
            touches_of_pairs.setdefault(_BodyPair(first, second), []).append(_Touch(row, sign=1.0))

    sums = {}
    for pair, touches in touches_of_pairs.items():
        rows = [touch.row for touch in touches]
        signs = np.array([touch.sign for touch in touches])
        pressures = np.linalg.norm(contacts.normal_forces[rows], axis=1)
        # The sum of a single contact would cover its own arrow. Without normal forces there is no centre of
        # pressure.
        if len(rows) > 1 and pressures.any():
            # Centre of pressure: sum(p_i x_i) / sum(p_i), with the normal forces p_i at the points x_i.
            centre = pressures @ contacts.points[rows] / pressures.sum()
            sums[pair] = _Force(centre, signs @ contacts.forces[rows])
    return sums


class _BodyRank(NamedTuple):
    """Sort key of a body: the world is last, so that forces are shown on the bodies that touch it."""

    is_world: bool
    name: str


def _rank_of_body(inspector: SceneGraphInspector, name: str) -> _BodyRank:
    """Sort key of a body by its name."""
    world = inspector.GetName(inspector.world_frame_id())
    return _BodyRank(name == world, name)


def _draw_arrow(
    meshcat: Meshcat,
    path: str,
    forces: Sequence[_Force | None],
    animation_times: Sequence[float],
    large: float,
    colour: Rgba,
) -> None:
    """Draw the arrow of a force into a Meshcat that records.

    The arrow begins at the point where the force acts. Its shaft is as long as the force is large; a head follows.

    Args:
        meshcat: the Meshcat.
        path: path of the arrow in Meshcat's tree.
        forces: the force in each frame. The arrow is hidden in frames in which it is None or 0.
        animation_times: times of the frames in the animation [s].
        large: magnitude of the force whose arrow has the usual length [N].
        colour: colour of the arrow.
    """
    # The arrow points along z. Its shaft has the length 1 and is scaled; the tip of Meshcat's cone is at its origin, so
    # that the cone is turned over and moved by its length. The radius of the cone is half of its length.
    meshcat.SetObject(f"{path}/shaft", Cylinder(_RADIUS, 1.0), colour)
    meshcat.SetObject(f"{path}/head/cone", MeshcatCone(_HEAD, _HEAD / 2, _HEAD / 2), colour)
    meshcat.SetTransform(
        f"{path}/head/cone", RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, _HEAD])
    )
    for part in ("shaft", "head/cone"):
        # The arrow is visible through the body that it acts on.
        meshcat.SetProperty(f"{path}/{part}/<object>", "material.depthTest", False)
    for time, force in zip(animation_times, forces, strict=True):
        # Each property is set in every frame: the animation keeps the last value otherwise.
        # A force of 0 has no direction.
        is_shown = force is not None and bool(force.components.any())
        meshcat.SetProperty(path, "visible", is_shown, time)
        if force is None or not is_shown:
            continue
        length = float(np.linalg.norm(force.components)) / large * _ARROW
        rotation = RotationMatrix.MakeFromOneVector(force.components, 2)
        meshcat.SetTransform(path, RigidTransform(rotation, force.point), time)
        meshcat.SetProperty(f"{path}/shaft", "scale", [1.0, 1.0, length], time)
        meshcat.SetProperty(f"{path}/shaft", "position", [0.0, 0.0, length / 2], time)
        # The head keeps its size, so that the arrows of small forces are visible, too.
        meshcat.SetProperty(f"{path}/head", "position", [0.0, 0.0, length], time)
