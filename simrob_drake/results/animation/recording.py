"""A run's motion as one HTML file that any browser plays."""

import gc
import json
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation

from simrob_drake.folders import replaced_at_once
from simrob_drake.frames import Vector
from simrob_drake.results.animation.camera import WINDOW_ASPECT, camera_on, frame_times, side, walked_way
from simrob_drake.results.animation.contact_arrows import draw_contact_forces
from simrob_drake.results.animation.drawn import draw_tool_paths, look, open_meshcat, path_colour
from simrob_drake.results.animation.scene import SPACING, ViewedStation, floor_lines, with_floor_under
from simrob_drake.results.colours import AXES, FORCE, SUM_OF_FORCES
from simrob_drake.results.record.run import RecordedRun

_SCRIPT = Path(__file__).with_suffix(".js")
_OVER_FLOOR = 0.002  # m
_LOOPS = 1_000_000  # "for ever", which Meshcat cannot say


def save_recording(result: RecordedRun, file: Path, *, frames_per_second: float = 32.0) -> Path:
    """Write the motion of a run, with the paths of the tools, as a self-contained page that plays and loops.

    Args:
        result: the run.
        file: where to, ``.html``.
        frames_per_second: of simulated time [1/s], positive.

    Returns:
        the file.

    Raises:
        InvalidParameter: the rate is not positive.
        OutputError: the file cannot be written.
    """
    page = _page(result, frame_times(result.stop_time, frames_per_second), frames_per_second)
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
    points = scene.extents_of_run(result, way)
    look(meshcat, camera_on(points, aspect=WINDOW_ASPECT, azimuth=side(scene.station)))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    tilt = scene.station.ground.tilt.rotation().matrix()
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
    if result.contacts_at is not None:
        found += [(FORCE, "contact forces"), (SUM_OF_FORCES, "their sum on a body")]
    return found


def _record(meshcat: Meshcat, scene: ViewedStation, run: RecordedRun, times: Vector, frames_per_second: float) -> None:
    visualizer = scene.visualizer
    assert visualizer is not None
    animation = visualizer.StartRecording(set_transforms_while_recording=False)
    shown = [(frame + 0.5) / frames_per_second for frame in range(len(times))]  # Meshcat rounds down to frames
    for time, positions in zip(shown, run.positions_at(times), strict=True):
        scene.draw(positions, time)
    draw_contact_forces(meshcat, run, times, shown)
    animation.set_autoplay(True)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(_LOOPS)
    visualizer.StopRecording()
    visualizer.PublishRecording()
