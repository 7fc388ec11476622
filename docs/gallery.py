"""Write gallery.md and its pictures: what each station of the package does when it is run.

``make pictures`` does so; ``python docs/gallery.py irb120_chess`` renews one picture alone.
"""

import sys
from io import BytesIO
from pathlib import Path

from PIL import Image

from simrob_drake import LeggedRobot, SimulationResult, load_station, simulate, station_names
from simrob_drake.results.animation.pictures import film_strip

DOCS = Path(__file__).parent
WALKS = {"humanoid_dynamic": 4, "roid1_dynamic": 20, "yobotics_dynamic": 4, "zjudancer_dynamic": 4}
"""Steps of the legged robots: they are here to walk."""
HEIGHT, FRAMES, COLOURS = 150, 6, 64


def command(station: str) -> str:
    """Return what a user types to see what the picture shows."""
    return f"simrob walk {station} --steps {WALKS[station]}" if station in WALKS else f"simrob run {station}"


def shown(station: str) -> SimulationResult:
    """Return the run that the command makes."""
    if station in WALKS:
        return LeggedRobot(load_station(station)).walk(WALKS[station])
    return simulate(load_station(station), progress=False)


def save_picture(station: str) -> Path:
    """Write a small film strip of a station's run."""
    strip = Image.open(BytesIO(film_strip(shown(station), frames=FRAMES, height=HEIGHT))).convert("RGB")
    file = DOCS / "gallery" / f"{station}.png"
    strip.quantize(COLOURS, dither=Image.Dither.NONE).save(file, optimize=True)
    return file


def page() -> str:
    """Return the gallery: a heading, what the station is, its command and its picture, station by station."""
    parts = ["# Gallery", "What the stations of the package do; `make pictures` writes this page."]
    for station in station_names():
        description = load_station(station).description
        parts += [f"## {station}", f"{description}.", f"`{command(station)}`", f"![{station}](gallery/{station}.png)"]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    for name in sys.argv[1:] or station_names():
        print(save_picture(name))
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")
