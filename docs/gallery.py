"""Write gallery.md and its pictures: what each station of the package does when it is run, and robots' portraits.

``make pictures`` does so; ``python docs/gallery.py irb120_chess`` renews one picture alone.
"""

import sys
from collections.abc import Callable, Sequence
from io import BytesIO
from operator import itemgetter
from pathlib import Path
from runpy import run_path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image

from simrob_drake import LeggedRobot, SimulationResult, load_station, simulate, station_names
from simrob_drake.files import models_root
from simrob_drake.programs.whole_program import run_whole
from simrob_drake.results.animation.pictures import Studio, film_strip
from simrob_drake.results.whole import joined
from simrob_drake.robots.catalog import robot_names

DOCS = Path(__file__).parent
WALKS = {
    "humanoid_dynamic": 4,
    "roid1_dynamic": 20,
    "yobotics_dynamic": 4,
    "zjudancer_dynamic": 4,
}
"""Steps of the legged robots: they are here to walk."""
PROGRAMS: dict[str, tuple[str, Callable[[Any], Sequence[SimulationResult]]]] = {
    "irb120_workcell": ("irb120_draw", itemgetter(1)),
    "three_humanoids": ("humanoids_same_program", itemgetter(slice(1))),
}
"""The examples of the stations that stand still as they are, and how to get the runs from what they return."""
HEIGHT, FRAMES, COLOURS = 150, 6, 64
SIDE = 160
"""Of a robot's portrait [pixels]."""
ALONE = "{{mode: kinematic, robot: {{model: {robot}}}, reference: {{kind: hold}}, duration: 0.1}}"
"""The station of a portrait."""


def command(station: str) -> str:
    """Return what a user types to see what the picture shows."""
    if station in WALKS:
        return f"simrob walk {station} --steps {WALKS[station]}"
    if station in PROGRAMS:
        return f"python examples/{PROGRAMS[station][0]}.py"
    return f"simrob run {station}"


def shown(station: str) -> Sequence[SimulationResult]:
    """Return the runs that the command makes."""
    if station in WALKS:
        return [LeggedRobot(load_station(station)).walk(WALKS[station])]
    if station in PROGRAMS:
        name, runs = PROGRAMS[station]
        return runs(run_path(str(DOCS.parent / "examples" / f"{name}.py"))["run"]())
    return [run_whole(load_station(station))]


def save_picture(station: str) -> Path:
    """Write a small film strip of a station's run."""
    strip = Image.open(BytesIO(film_strip(joined(shown(station)), frames=FRAMES, height=HEIGHT))).convert("RGB")
    file = DOCS / "gallery" / f"{station}.png"
    strip.quantize(COLOURS, dither=Image.Dither.NONE).save(file, optimize=True)
    return file


def save_portrait(robot: str) -> Path:
    """Write a small picture of a robot, by which it is chosen in the teach pendant, into its folder."""
    with TemporaryDirectory() as folder:
        alone = Path(folder) / f"{robot}.yaml"
        alone.write_text(ALONE.format(robot=robot), encoding="utf-8")
        run = simulate(load_station(alone), progress=False)
    studio = Studio(run, height=2 * SIDE, width=2 * SIDE, oversampling=2)
    image = Image.fromarray(next(studio.images(np.zeros(1)))).resize((SIDE, SIDE), Image.Resampling.LANCZOS)
    file = models_root() / robot / "picture.png"
    image.quantize(COLOURS // 2, dither=Image.Dither.NONE).save(file, optimize=True)
    return file


def page() -> str:
    """Return the gallery: a heading, what the station is, its command and its picture, station by station."""
    parts = ["# Gallery", "What the stations of the package do; `make pictures` writes this page."]
    for station in station_names():
        description = load_station(station).description
        parts += [f"## {station}", f"{description}.", f"`{command(station)}`", f"![{station}](gallery/{station}.png)"]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    for name in sys.argv[1:] or [*station_names(), *robot_names()]:
        print((save_portrait if name in robot_names() else save_picture)(name))
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")
