"""Write gallery.md, its pictures and clips: what each station of the package does when it is run; robots' portraits.

``make pictures`` does so; ``python docs/gallery.py irb120_chess`` renews what shows one station alone.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from itertools import product
from operator import itemgetter
from pathlib import Path
from runpy import run_path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml
from PIL import Image

from simrob_drake import LeggedRobot, SimulationResult, load_station, simulate, station_names
from simrob_drake.base.files import models_root
from simrob_drake.programs.whole_program import run_whole
from simrob_drake.results.animation.camera import side, walked_displacement
from simrob_drake.results.animation.pictures import Studio, captions_of, side_by_side
from simrob_drake.results.result import join_runs
from simrob_drake.robots.catalog import robot_names

DOCS = Path(__file__).parent
WALKS = {
    "humanoid_dynamic": 10,
    "roid1_dynamic": 20,
    "yobotics_dynamic": 12,
    "zjudancer_dynamic": 12,
}
"""Steps of the legged robots: they are here to walk."""
PROGRAMS: dict[str, tuple[str, Callable[[Any], Sequence[SimulationResult]]]] = {
    "irb120_workcell": ("irb120_draw", itemgetter(1)),
    "three_humanoids": ("humanoids_same_program", itemgetter(slice(1))),
}
"""The examples of the stations that stand still as they are, and how to get the runs from what they return."""
SETTINGS: dict[str, Mapping[str, Any]] = {
    "box_on_floor": {"pieces.box.pose": [0, 0, 0.115, 0, 0.48, 0]},
    "irb120_kinematic": {"reference.target_deg": -30},
    "roid1_walking": {"controllers.walk.commands": [{"time": 0.5, "ahead": 0.1, "turn_deg": 15}]},
    "yobotics_walking": {"controllers.walk.commands": [{"time": 0.5, "ahead": 0.3, "turn_deg": 20}]},
    "zjudancer_walking": {"controllers.walk.commands": [{"time": 0.5, "sideways": 0.1}]},
}
"""What is set so that no two stations look alike."""
TURNED = {
    "acrobot": -60,
    "cart_pole": -60,
    "humanoid_fall_guard": -40,
    "humanoid_height": 30,
    "irb120_cobot": 40,
}
"""From where else these are seen [deg], for the same reason."""
NOTES = {
    "bouncing_ball": "The floor is soft: at each bounce the ball sinks 51 mm of its radius into it.",
    "box_on_floor": "Put down on one edge by 27.5°, beyond the 26.6° at which it falls over.",
}
"""What a picture does not say."""
CLIPS = (
    "irb120_chess",
    "two_arms",
    "belt_pick",
    "irb120_workcell",
    "humanoid_box",
    "humanoid_walking",
    "humanoid_balance",
    "humanoid_fall_forward",
    "roid1_walking",
    "yobotics_terrain",
    "zjudancer_dynamic",
    "bouncing_ball",
)
"""Those that are shown in motion, too."""
HEIGHT, WALK_HEIGHT, FRAMES, COLOURS = 150, 200, 6, 64
LARGE = {"roid1_dynamic": (DOCS / "roid1_walk.png", 320)}
"""Pictures of walks that pages show, too, and their height [pixels]."""
CLIP = (320, 220)  # pixels
FRAME_TIME, MOST_FRAMES = 0.08, 75
"""From one frame of a clip to the next [s], and how many there are at most: longer runs are shown faster."""
LARGEST = 300_000
"""Bytes of a clip."""
WIDEST = 5.8
"""The widest picture of a walk: width over height."""
PLACES, APART = 40, (0.8, 0.5)
"""How many places a picture of a walk chooses from; how far apart they are, across or up, in sizes of the robot."""
PALE = 24
"""By how much a colour differs from the floor's where a robot is, 0 to 255."""
SIDE = 160
"""Of a robot's portrait [pixels]."""
ALONE = "{{mode: kinematic, robot: {{model: {robot}}}, reference: {{kind: hold}}, duration: 0.1}}"
"""The station of a portrait."""
Images = npt.NDArray[np.uint8]


def command(station: str) -> str:
    """Return what a user types to see what the picture shows."""
    if station in WALKS:
        return f"simrob walk {station} --steps {WALKS[station]}"
    if station in PROGRAMS:
        return f"python examples/{PROGRAMS[station][0]}.py"
    flow = {key: yaml.safe_dump(value, default_flow_style=True, width=1000) for key, value in settings(station).items()}
    changes = [f"--set '{key}={text.splitlines()[0]}'" for key, text in flow.items()]
    return " ".join([f"simrob run {station}", *changes])


def settings(station: str) -> Mapping[str, Any]:
    """Return what is set in a station."""
    return SETTINGS.get(station, {})


def shown(station: str) -> Sequence[SimulationResult]:
    """Return the runs that the command makes."""
    if station in WALKS:
        return [LeggedRobot(load_station(station)).walk(WALKS[station])]
    if station in PROGRAMS:
        name, runs = PROGRAMS[station]
        return runs(run_path(str(DOCS.parent / "examples" / f"{name}.py"))["run"]())
    return [run_whole(load_station(station, dict(settings(station))))]


def save_pictures(station: str) -> list[Path]:
    """Write a small picture of a station's run, and a clip of some."""
    run = join_runs(shown(station))
    walks = station in WALKS or station.endswith(("_walking", "_terrain"))
    picture = walk_picture(run, height=WALK_HEIGHT) if walks else strip(run, azimuth=azimuth(station, run))
    files = [DOCS / "gallery" / f"{station}.png"]
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(files[0], optimize=True)
    if station in LARGE:
        file, height = LARGE[station]
        walk_picture(run, height=height).quantize(2 * COLOURS).save(file, optimize=True)
        files.append(file)
    if station in CLIPS:
        files.append(save_clip(run, DOCS / "gallery" / f"{station}.webp"))
    return files


def azimuth(station: str, run: SimulationResult) -> float:
    """Return from where a station is seen [rad]."""
    return side(run.plant) + float(np.deg2rad(TURNED.get(station, 0.0)))


def strip(run: SimulationResult, *, azimuth: float) -> Image.Image:
    """Return frames of a run side by side."""
    studio = Studio(run, height=HEIGHT, oversampling=2, azimuth=azimuth)
    times = np.linspace(0, run.stop_time, FRAMES)
    return side_by_side(list(studio.images(times)), captions_of(run, studio, times))


def walk_picture(run: SimulationResult, *, height: int) -> Image.Image:
    """Return one picture of a walk, in which the robot stands at several places of its way, the last ones in front.

    A camera that stands still sees it go from left to right.
    """
    way = walked_displacement(run)
    assert way is not None
    times = np.linspace(0.0, run.stop_time, 1000)
    gone = way(times)
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(gone, axis=0), axis=1)))
    azimuth = float(np.arctan2(gone[-1, 1], gone[-1, 0]) - np.deg2rad(75))
    studio = Studio(run, height=height, oversampling=2, follow=False, azimuth=azimuth, widest=WIDEST)
    # in length: while it stands it hides floor
    even = np.interp(np.linspace(0.0, lengths[-1], PLACES), lengths, times)
    images = list(studio.images(even))
    floor = np.median(images, axis=0)
    robots = [robot_in(image, floor) for image in images]
    chosen: list[int] = []
    for index, robot in enumerate(robots):
        if all(apart(robot, robots[other]) for other in chosen):
            chosen.append(index)
    picture = floor.astype(np.uint8)
    for index in chosen:
        picture[robots[index]] = images[index][robots[index]]
    return side_by_side([picture], [f"{run.stop_time:.1f} s, {lengths[-1]:.2f} m"])


def apart(one: npt.NDArray[np.bool_], other: npt.NDArray[np.bool_]) -> bool:
    """Tell whether two places of a robot in a picture, shape (height, width) each, hide little of each other."""
    for axis, least in enumerate(APART):
        first, second = (np.flatnonzero(place.any(axis=axis)) for place in (one, other))
        if abs(first.mean() - second.mean()) > least * (np.ptp(first) + np.ptp(second)) / 2:
            return True
    return False


def robot_in(image: Images, floor: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Return where an image differs from that of the floor alone, shape (height, width)."""
    return np.asarray(np.abs(image - floor).max(axis=2) > PALE)


def save_clip(run: SimulationResult, file: Path) -> Path:
    """Write a short film of a run that begins again and again, as large as may be."""
    times = np.linspace(0.0, run.stop_time, min(int(run.stop_time / FRAME_TIME) + 1, MOST_FRAMES))
    studio = Studio(run, height=CLIP[1], width=CLIP[0], oversampling=2)
    images = list(map(Image.fromarray, studio.images(times)))
    for every, quality in product((1, 2), (60, 45, 30)):  # of the images; then there are fewer of them
        first, *others = images[::every]
        # ms; the end is seen for longer
        pauses = [round(1000 * every * FRAME_TIME)] * len(others) + [1000]
        motion = {"save_all": True, "append_images": others, "duration": pauses, "loop": 0}
        first.save(content := BytesIO(), "webp", quality=quality, **motion)
        if content.tell() < LARGEST:
            break
    file.write_bytes(content.getvalue())
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
    """Return the gallery: a heading, what the station is, its command, its clip and its picture, station by station."""
    lines = "Lines on floors are 0.1 m apart, bold ones 0.5 m."
    parts = [
        "# Gallery",
        f"What the stations of the package do; `make pictures` writes this page. {lines}",
    ]
    for station in station_names():
        description = " ".join(filter(None, [f"{load_station(station).description}.", NOTES.get(station)]))
        parts += [f"## {station}", description, f"`{command(station)}`"]
        if station in CLIPS:
            parts.append(f"![{station} in motion](gallery/{station}.webp)")
        parts.append(f"![{station}](gallery/{station}.png)")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    for name in sys.argv[1:] or dict.fromkeys([*station_names(), *robot_names()]):
        files = save_pictures(name) if name in station_names() else []
        print(*files, *([save_portrait(name)] if name in robot_names() else []))
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")
