"""What Drake's Meshcat draws, as commands to its page; and robots drawn translucent at other postures beside it.

Meshcat's own server is open for moments and to no browser.
"""

import logging
import re
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.geometry import (
    FrameId,
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    QueryObject,
    Rgba,
    Role,
)
from pydrake.multibody.tree import ModelInstanceIndex

from simrob_drake.base.frames import Vector
from simrob_drake.results import colours
from simrob_drake.results.animation.camera import FIELD_OF_VIEW, Camera
from simrob_drake.results.animation.scene import ViewedStation
from simrob_drake.results.colours import PATHS, rgb
from simrob_drake.results.record.run import RecordedRun

Command = str | dict[str, Any]  # to Meshcat's page: a dictionary, or one in MessagePack and base64
Prefixes = Mapping[str, Role]  # where in Meshcat's tree the geometry of a role hangs

_TOP, _BOTTOM = [1.0, 1.0, 1.0], [0.86, 0.88, 0.91]  # background
_AMBIENT = 1.1  # intensity; Meshcat's own leaves steep faces dark
_IN_PAGE = re.compile(r'fetch\("data:application/octet-binary;base64,([^"]*)"\)')
_ASSET = re.compile(r'casAssets\["([^"]*)"\] = "([^"]*)";')


def open_meshcat() -> Meshcat:
    """Return a Meshcat for a moment's work; it listens on this computer, where no browser will guess.

    It asks nobody who they are, and a malformed message ends the process: on Linux its address is one of sixteen
    million loopback addresses.
    """
    hidden = f"127.{'.'.join(str(1 + secrets.randbelow(254)) for _ in range(3))}"
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # where Meshcat listens, or could not, is nobody's business
    try:
        try:
            meshcat = Meshcat(MeshcatParams(host=hidden, show_stats_plot=False))
        except RuntimeError:  # macOS has one loopback address
            meshcat = Meshcat(MeshcatParams(host="127.0.0.1", show_stats_plot=False))
    finally:
        logger.setLevel(level)
    meshcat.SetProperty("/Background", "top_color", _TOP)
    meshcat.SetProperty("/Background", "bottom_color", _BOTTOM)
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", _AMBIENT)
    return meshcat


def empty_page() -> str:
    """Return Meshcat's page with nothing in it, self-contained."""
    page: str = open_meshcat().StaticHtml()
    return page


def commands(draw: Callable[[Meshcat], None]) -> list[Command]:
    """Return what makes Meshcat's page show what a function draws."""
    meshcat = open_meshcat()
    draw(meshcat)
    page = meshcat.StaticHtml()
    assets: list[Command] = [{"type": "asset", "name": name, "url": url} for name, url in _ASSET.findall(page)]
    return [*assets, *_IN_PAGE.findall(page)]


def draw_geometry(meshcat: Meshcat, query: QueryObject, prefixes: Prefixes, *, hidden: str = "") -> None:
    """Draw a scene's geometry in its present configuration; what hangs under ``hidden`` waits for a switch."""
    for prefix, role in prefixes.items():
        shown = MeshcatVisualizerParams(
            role=role, prefix=prefix, enable_alpha_slider=False, visible_by_default=prefix != hidden
        )
        visualizer = MeshcatVisualizer(meshcat, shown)
        context = visualizer.CreateDefaultContext()
        visualizer.query_object_input_port().FixValue(context, query)
        visualizer.ForcedPublish(context)


def pose_commands(query: QueryObject, prefixes: Prefixes) -> list[Command]:
    """Return what moves the bodies in Meshcat's page to where they are now."""
    inspector = query.inspector()
    frames, found = inspector.GetAllFrameIds(), list[Command]()
    for frame, (path, matrix) in zip(frames, placed(query, frames), strict=True):
        for prefix, role in prefixes.items():
            if inspector.NumGeometriesForFrameWithRole(frame, role) and frame != inspector.world_frame_id():
                found.append({"type": "set_transform", "path": f"/drake/{prefix}/{path}", "matrix": matrix})
    return found


def placed(query: QueryObject, frames: Sequence[FrameId]) -> Iterator[tuple[str, list[float]]]:
    """Yield the path of each frame in Meshcat's tree, under a prefix, and the matrix of its pose, column by column."""
    for frame in frames:
        matrix = np.round(query.GetPoseInWorld(frame).GetAsMatrix4(), 7)
        yield query.inspector().GetName(frame).replace("::", "/"), matrix.ravel(order="F").tolist()


def draw_tool_paths(meshcat: Meshcat, result: RecordedRun, number: int = 0) -> None:
    """Draw the ways of the tools in a run as lines; ``number`` keeps those of other runs."""
    for robot in result.plant.robots.values():
        if robot.tcp:
            path: Vector = result.pose("tcp", robot.name)[:, :3].T
            colour = Rgba(*rgb(path_colour(result, robot.name)))
            meshcat.SetLine(f"tool_path/{robot.name}/{number}", np.asfortranarray(path), rgba=colour)


def draw_searches(meshcat: Meshcat, result: RecordedRun, number: int = 0) -> None:
    """Draw the ways of tools that searches for the moves of a run tried, where that was asked for, as thin lines."""
    for move in result.moves:
        if len(move.search):
            begin, end = (np.asfortranarray(points.T) for points in (move.search[:, 0], move.search[:, 1]))
            meshcat.SetLineSegments(f"search/{move.robot}/{number}", begin, end, 1.0, Rgba(*rgb(colours.SEARCH)))


def path_colour(result: RecordedRun, robot: str) -> str:
    """Return the colour of the way of a robot's tool."""
    return PATHS[list(result.plant.robots).index(robot) % len(PATHS)]


def look(meshcat: Meshcat, camera: Camera) -> None:
    """Put the camera of a Meshcat window in its place."""
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=float(np.rad2deg(FIELD_OF_VIEW))))
    meshcat.SetCameraPose(camera.eye, camera.target)


GHOSTS, COMPARED = "/drake/ghosts", "/drake/compared"  # where in Meshcat's tree they hang, and those of another run
SHOWN = "/drake/station"  # where what they are copies of does
_OTHER = {"color": colours.COLOURS[0], "opacity": 0.35}
GOOD, BAD = (colours.GOOD, 0.3), (colours.BAD, 0.12)
"""Colour and opacity of a posture that the robot can take, and of one that it cannot."""

_PLAIN = 0.6  # opacity of a marked one


def ghosts(
    scene: ViewedStation, robot: str, postures: Sequence[Vector], good: Sequence[bool], marked: int | None = None
) -> list[Command]:
    """Return what makes the view of a station show a robot, and what it carries, at postures (n,); none: gone.

    In place of the ghosts that were there. The window copies what it shows already, so that nothing is sent twice.
    ``good`` tells whether the robot can take each, ``marked`` is the number of one that is drawn less faint.
    """
    found: list[Command] = [{"type": "delete", "path": GHOSTS}]
    for number, (posture, can) in enumerate(zip(postures, good, strict=True)):
        scene.place_robots({robot: posture})
        colour, opacity = GOOD if can else BAD
        looks = {"color": colour, "opacity": _PLAIN if number == marked else opacity}
        found += _copies(scene, f"{GHOSTS}/{number}", looks, scene.station.robots[robot].instance)
    return found


def compared_ghost(scene: ViewedStation, positions: Vector | None) -> list[Command]:
    """Return what makes the view show all that moves once more, as it was at positions (nq,); None: gone."""
    if positions is None:
        return [{"type": "delete", "path": COMPARED}]
    scene.place(positions)
    return list(_copies(scene, COMPARED, _OTHER))


def _copies(
    scene: ViewedStation, path: str, looks: Mapping[str, Any], own: ModelInstanceIndex | None = None
) -> Iterator[Command]:
    """Yield what copies what is seen of all moving bodies, or those of one instance, to where they are now."""
    plant, inspector = scene.plant, scene.station.scene_graph.model_inspector()
    moving = [
        frame
        for frame in inspector.GetAllFrameIds()
        if (body := plant.GetBodyFromFrameId(frame)) is not None
        and own in (None, body.model_instance())
        and not plant.IsAnchored(body)
        and inspector.NumGeometriesForFrameWithRole(frame, Role.kIllustration)
    ]
    for body, matrix in placed(scene.query(), moving):
        yield {"type": "copy", "path": f"{path}/{body}", "source": f"{SHOWN}/{body}", **looks}
        yield {"type": "set_transform", "path": f"{path}/{body}", "matrix": matrix}
