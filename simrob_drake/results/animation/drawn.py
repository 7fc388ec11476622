"""Commands to Meshcat's page in a browser, which draw a station, and translucent copies of its robots.

Drake's Meshcat is used to make the commands: it draws, and its page with all drawings is read. Its own server is open
only for these moments, and no browser connects to it. A *ghost* is a translucent copy of a robot in another posture.
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

Command = str | dict[str, Any]
"""Command to Meshcat's page: a dictionary, or a dictionary in MessagePack, written in base64."""

Prefixes = Mapping[str, Role]
"""Paths in Meshcat's tree, and the role of the shapes that are drawn under each."""

_TOP = [1.0, 1.0, 1.0]
_BOTTOM = [0.86, 0.88, 0.91]
"""Colours of the background at the top and at the bottom: red, green and blue, from 0 to 1."""

_AMBIENT = 1.1
"""Intensity of the light from all sides. Meshcat's own leaves steep faces dark."""

# The page that Meshcat writes has each command as data that it fetches, and each mesh as an asset.
_IN_PAGE = re.compile(r'fetch\("data:application/octet-binary;base64,([^"]*)"\)')
_ASSET = re.compile(r'casAssets\["([^"]*)"\] = "([^"]*)";')


def open_meshcat() -> Meshcat:
    """Open a Meshcat for a short time. It listens on this computer only, at an address that is hard to guess.

    Meshcat accepts any connection, and a malformed message ends the process. On Linux its address is one of sixteen
    million loopback addresses.
    """
    # All addresses 127.x.x.x are those of this computer, on Linux. Numbers 0 and 255 are left out: they may be
    # addresses of a network or a broadcast.
    hidden = f"127.{'.'.join(str(1 + secrets.randbelow(254)) for _ in range(3))}"
    logger = logging.getLogger("drake")
    level = logger.level
    # Meshcat would write its address to the terminal, or that it could not open it.
    logger.setLevel(logging.CRITICAL)
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
    """HTML of Meshcat's page, in which nothing is drawn. It needs no other file."""
    page: str = open_meshcat().StaticHtml()
    return page


def commands(draw: Callable[[Meshcat], None]) -> list[Command]:
    """Commands that draw into Meshcat's page the same as a function draws into a Meshcat.

    Args:
        draw: the function. It is called once, with a new Meshcat.

    Returns:
        the commands: the meshes first, then the messages that use them.
    """
    meshcat = open_meshcat()
    draw(meshcat)
    # Meshcat has no function for its messages, but its page as a single file contains all of them.
    page = meshcat.StaticHtml()
    assets: list[Command] = [
        {"type": "asset", "name": name, "url": url} for name, url in _ASSET.findall(page)
    ]
    return [*assets, *_IN_PAGE.findall(page)]


def draw_geometry(
    meshcat: Meshcat, query: QueryObject, prefixes: Prefixes, *, hidden: str = ""
) -> None:
    """Draw the shapes of a scene in its present configuration.

    Args:
        meshcat: the Meshcat into which the shapes are drawn.
        query: the scene.
        prefixes: paths in Meshcat's tree, and the role of the shapes under each.
        hidden: prefix whose shapes are invisible until the user switches them on; empty for none.
    """
    for prefix, role in prefixes.items():
        shown = MeshcatVisualizerParams(
            role=role, prefix=prefix, enable_alpha_slider=False, visible_by_default=prefix != hidden
        )
        # A visualizer outside of any diagram: its input gets the scene as a fixed value, and it draws once.
        visualizer = MeshcatVisualizer(meshcat, shown)
        context = visualizer.CreateDefaultContext()
        visualizer.query_object_input_port().FixValue(context, query)
        visualizer.ForcedPublish(context)


def pose_commands(query: QueryObject, prefixes: Prefixes) -> list[Command]:
    """Commands that move the bodies in Meshcat's page to their present poses.

    Args:
        query: the scene in its present configuration.
        prefixes: paths in Meshcat's tree, and the role of the shapes under each.
    """
    inspector = query.inspector()
    frames = inspector.GetAllFrameIds()
    found: list[Command] = []
    for frame, (path, matrix) in zip(frames, frame_poses(query, frames), strict=True):
        for prefix, role in prefixes.items():
            # Bodies without a shape of this role have no object in the tree, and the world never moves.
            if (
                inspector.NumGeometriesForFrameWithRole(frame, role)
                and frame != inspector.world_frame_id()
            ):
                found.append(
                    {"type": "set_transform", "path": f"/drake/{prefix}/{path}", "matrix": matrix}
                )
    return found


def frame_poses(query: QueryObject, frames: Sequence[FrameId]) -> Iterator[tuple[str, list[float]]]:
    """Yield the path of each frame below its scene in Meshcat's tree, and its pose in the world.

    The path is ``<model instance>/<body>``. The pose is a homogeneous matrix, 16 numbers column by column, as Meshcat
    expects it.

    Args:
        query: the scene in its present configuration.
        frames: frames of bodies.
    """
    for frame in frames:
        # Fewer digits make messages shorter: seven decimals are exact to less than a micrometre.
        matrix = np.round(query.GetPoseInWorld(frame).GetAsMatrix4(), 7)
        yield query.inspector().GetName(frame).replace("::", "/"), matrix.ravel(order="F").tolist()


def draw_tool_paths(meshcat: Meshcat, result: RecordedRun, number: int = 0) -> None:
    """Draw the paths of the tools in a run as lines. Robots without a tool have none.

    Args:
        meshcat: the Meshcat.
        result: the run.
        number: number of the run. Lines of another number remain, so that several runs are shown.
    """
    for robot in result.plant.robots.values():
        if robot.tcp:
            path: Vector = result.pose("tcp", robot.name)[:, :3].T
            colour = Rgba(*rgb(path_colour(result, robot.name)))
            meshcat.SetLine(
                f"tool_path/{robot.name}/{number}", np.asfortranarray(path), rgba=colour
            )


def draw_searches(meshcat: Meshcat, result: RecordedRun, number: int = 0) -> None:
    """Draw the paths that the searches for the moves of a run have tried, as thin lines, if they were recorded.

    Args:
        meshcat: the Meshcat.
        result: the run.
        number: number of the run. Lines of another number remain, so that several runs are shown.
    """
    for move in result.moves:
        if len(move.search):
            # Meshcat takes points as columns.
            begins = np.asfortranarray(move.search[:, 0].T)
            ends = np.asfortranarray(move.search[:, 1].T)
            meshcat.SetLineSegments(
                f"search/{move.robot}/{number}", begins, ends, 1.0, Rgba(*rgb(colours.SEARCH))
            )


def path_colour(result: RecordedRun, robot: str) -> str:
    """Colour of the path of a robot's tool. The colours repeat after the third robot.

    Args:
        result: a run of the robot's station.
        robot: name of the robot.
    """
    return PATHS[list(result.plant.robots).index(robot) % len(PATHS)]


def look(meshcat: Meshcat, camera: Camera) -> None:
    """Set the camera of a Meshcat window."""
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=float(np.rad2deg(FIELD_OF_VIEW))))
    meshcat.SetCameraPose(camera.eye, camera.target)


GHOSTS = "/drake/ghosts"
COMPARED = "/drake/compared"
"""Paths in Meshcat's tree of ghosts, and of the ghost of another run with which a run is compared."""

SHOWN = "/drake/station"
"""Path of the bodies of which ghosts are copies."""

_OTHER = {"color": colours.COLOURS[0], "opacity": 0.35}
"""Look of the ghost of another run."""

GOOD = (colours.GOOD, 0.3)
BAD = (colours.BAD, 0.12)
"""Colour and opacity of a posture that the robot can take, and of one that it cannot take."""

_MARKED_OPACITY = 0.6
"""Opacity of a marked ghost."""


def ghosts(
    scene: ViewedStation,
    robot: str,
    postures: Sequence[Vector],
    good: Sequence[bool],
    marked: int | None = None,
) -> list[Command]:
    """Commands that show ghosts of a robot, and of the pieces that it carries, in place of all earlier ghosts.

    The page copies the bodies that it shows already, so that no mesh is sent twice.

    Args:
        scene: the scene that the page shows. It keeps the last posture.
        robot: name of the robot.
        postures: positions of the robot's axes, shape (n,) each. Without any, the earlier ghosts are only deleted.
        good: whether the robot can take each posture.
        marked: index of a posture that is drawn less faint; None for none.
    """
    found: list[Command] = [{"type": "delete", "path": GHOSTS}]
    for number, (posture, can) in enumerate(zip(postures, good, strict=True)):
        scene.place_robots({robot: posture})
        colour, opacity = GOOD if can else BAD
        looks = {"color": colour, "opacity": _MARKED_OPACITY if number == marked else opacity}
        found += _copies(scene, f"{GHOSTS}/{number}", looks, scene.station.robots[robot].instance)
    return found


def compared_ghost(scene: ViewedStation, positions: Vector | None) -> list[Command]:
    """Commands that show a ghost of all moving bodies, or delete it.

    Args:
        scene: the scene that the page shows. It keeps the positions.
        positions: positions of the plant, shape (nq,). If they are None, the ghost is deleted.
    """
    if positions is None:
        return [{"type": "delete", "path": COMPARED}]
    scene.place(positions)
    return list(_copies(scene, COMPARED, _OTHER))


def _copies(
    scene: ViewedStation, path: str, looks: Mapping[str, Any], own: ModelInstanceIndex | None = None
) -> Iterator[Command]:
    """Yield the commands that copy the visible shapes of moving bodies to their present poses in the world.

    Each copy gets its pose as 16 numbers, as :func:`frame_poses` gives them.

    Args:
        scene: the scene in its present configuration.
        path: path of the copies in Meshcat's tree.
        looks: colour and opacity of the copies.
        own: model instance of the bodies; None for the bodies of all instances.
    """
    plant = scene.plant
    inspector = scene.station.scene_graph.model_inspector()
    moving = []
    for frame in inspector.GetAllFrameIds():
        body_of_frame = plant.GetBodyFromFrameId(frame)
        # Anchored bodies are at the same place in all postures, so a copy would only cover them.
        if body_of_frame is None or plant.IsAnchored(body_of_frame):
            continue
        is_chosen = own is None or body_of_frame.model_instance() == own
        if is_chosen and inspector.NumGeometriesForFrameWithRole(frame, Role.kIllustration):
            moving.append(frame)
    for body_path, matrix in frame_poses(scene.query(), moving):
        source = f"{SHOWN}/{body_path}"
        yield {"type": "copy", "path": f"{path}/{body_path}", "source": source, **looks}
        yield {"type": "set_transform", "path": f"{path}/{body_path}", "matrix": matrix}
