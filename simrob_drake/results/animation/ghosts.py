"""Robots of a station drawn translucent at other postures than where they are, in a view that shows the station."""

from collections.abc import Sequence

from pydrake.geometry import Role

from simrob_drake.frames import Vector
from simrob_drake.results import colours
from simrob_drake.results.animation.drawn import Command, placed
from simrob_drake.results.animation.scene import ViewedStation

GHOSTS = "/drake/ghosts"
"""Where in Meshcat's tree they hang."""
SHOWN = "/drake/station"
"""Where what they are copies of does."""
GOOD, BAD = (colours.GOOD, 0.3), (colours.BAD, 0.12)
"""Colour and opacity of a posture that the robot can take, and of one that it cannot."""

_PLAIN = 0.6  # opacity of a marked one


def ghosts(
    scene: ViewedStation, robot: str, postures: Sequence[Vector], good: Sequence[bool], marked: int | None = None
) -> list[Command]:
    """Return what makes the view of a station show a robot, and what it carries, at postures (n,) [rad or m].

    In place of the ghosts that were there. The window copies what it shows already, so that nothing is sent twice.

    Args:
        scene: the station as it is shown.
        robot: its name.
        postures: of the ghosts, each (n,); none takes all away.
        good: whether the robot can take each.
        marked: the number of one that is drawn less faint.
    """
    own, plant = scene.station.robots[robot].instance, scene.plant
    inspector = scene.station.scene_graph.model_inspector()
    moving = [
        frame
        for frame in inspector.GetAllFrameIds()
        if (body := plant.GetBodyFromFrameId(frame)) is not None
        and body.model_instance() == own
        and not plant.IsAnchored(body)
        and inspector.NumGeometriesForFrameWithRole(frame, Role.kIllustration)
    ]
    found: list[Command] = [{"type": "delete", "path": GHOSTS}]
    for number, (posture, can) in enumerate(zip(postures, good, strict=True)):
        scene.place_robots({robot: posture})
        colour, opacity = GOOD if can else BAD
        looks = {"color": colour, "opacity": _PLAIN if number == marked else opacity}
        for path, matrix in placed(scene.query(), moving):
            ghost = f"{GHOSTS}/{number}/{path}"
            found.append({"type": "copy", "path": ghost, "source": f"{SHOWN}/{path}", **looks})
            found.append({"type": "set_transform", "path": ghost, "matrix": matrix})
    return found
