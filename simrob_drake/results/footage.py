"""The images of a run's cameras, rendered from its recorded motion when they are asked for."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image as Picture
from pydrake.multibody.tree import BodyIndex

from simrob_drake.parts.sensors.camera import CameraSensor, Image, let_render
from simrob_drake.results.animation.camera import frame_times
from simrob_drake.results.animation.pictures import captions, side_by_side, write_video
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.stations.posed import PosedStation

_STRIP = 7  # images
_FAR = np.iinfo(np.uint16).max  # mm, of what has no depth


class Footage:
    """The images of one camera, in order: ``footage[k]``, ``len(footage)``, or one after the other.

    Attributes:
        times: of the images, shape (k,) [s]; the last is the end of the run.
        rate: of them [Hz].
        names: of the bodies that labels stand for.
    """

    def __init__(self, result: RecordedRun, camera: CameraSensor) -> None:
        """Make ready to render; raises InvalidModel: a robot that cannot be built."""
        self._result, self._camera = result, camera
        config = result.config.model_copy(update={"contact": None, "sensors": {}})
        self._scene = PosedStation(config, lambda _, station: let_render(station.scene_graph))
        self._mount = camera.mount(self._scene.station)
        self.times, self.rate = frame_times(result.stop_time, camera.rate, begin=result.start_time), camera.rate
        plant, prefixes = self._scene.plant, {r.instance: r.prefix for r in self._scene.station.robots.values()}
        bodies = (plant.get_body(index) for index in map(BodyIndex, range(plant.num_bodies())))
        self.names = {int(b.index()): f"{prefixes.get(b.model_instance(), '')}{b.name()}" for b in bodies}
        self._rendered = lru_cache(maxsize=64)(self._render)

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, number: int) -> Image:
        """Return an image by its number; negative ones count from the end."""
        return self._rendered(range(len(self))[number])

    def __iter__(self) -> Iterator[Image]:
        return (self[number] for number in range(len(self)))

    @property
    def color(self) -> npt.NDArray[np.uint8]:
        """All colours, shape (k, h, w, 3)."""
        return np.array([image.color for image in self])

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        """All depths, shape (k, h, w) [m]."""
        return np.array([image.depth for image in self])

    def _render(self, number: int) -> Image:
        time = self.times[number : number + 1]
        self._scene.place(positions_in(self._scene.station, self._result, time)[0])
        return self._camera.lens.image(self._scene.query(), *self._mount, float(time[0]))


def footage_of(result: RecordedRun) -> dict[str, Footage]:
    """Return the images of a run's cameras, by name."""
    cameras = {name: sensor for name, sensor in result.config.sensors.items() if isinstance(sensor, CameraSensor)}
    return {name: Footage(result, camera) for name, camera in cameras.items()}


def save_footage(footage: dict[str, Footage], folder: Path, *, video: bool = False) -> None:
    """Write the images of cameras into folders of their own, beside a strip, and a video if asked.

    ``color_<k>.png`` has the colours, ``depth_<k>.png`` the depth in whole millimetres (16 bits; 65535 where there is
    none).
    """
    for name, images in footage.items():
        own = folder / name
        own.mkdir(parents=True)
        for number, image in enumerate(images):
            Picture.fromarray(image.color).save(own / f"color_{number:04d}.png")
            depth = np.where(image.seen, np.clip(1e3 * image.depth, 0, _FAR), _FAR)
            Picture.fromarray(np.round(depth).astype(np.uint16)).save(own / f"depth_{number:04d}.png")
        shown = np.unique(np.linspace(0, len(images) - 1, _STRIP).round().astype(int))
        strip = side_by_side([images[number].color for number in shown], captions(images.times[shown], None))
        strip.save(folder / f"{name}.png")
        if video:
            write_video((image.color for image in images), folder / f"{name}.mp4", images.rate)
