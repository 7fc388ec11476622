"""Images of the cameras of a station, rendered from the recorded motion of a run when they are asked for."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image as Picture
from pydrake.multibody.tree import BodyIndex

from simrob_drake.parts.sensors.camera import CameraSensor, Image, add_renderer
from simrob_drake.results.animation.camera import frame_times
from simrob_drake.results.animation.pictures import captions, side_by_side, write_video
from simrob_drake.results.record.other_plant import positions_in
from simrob_drake.results.record.run import RecordedRun
from simrob_drake.stations.posed import PosedStation

_STRIP_COUNT = 7
"""Most images of a strip."""

_NO_DEPTH = np.iinfo(np.uint16).max
"""Value of a pixel without depth in a file, and largest depth of a file [mm]."""

_MILLIMETRES = 1e3
"""Millimetres of a metre."""


class Footage:
    """The images of one camera in a run, in order: ``footage[k]``, ``len(footage)``, or one after the other.

    Attributes:
        times: times of the images, shape (k,) [s]. The last is the end of the run.
        rate: rate of the images [Hz].
        names: names of the bodies by the labels that their pixels have.
    """

    def __init__(self, result: RecordedRun, camera: CameraSensor) -> None:
        """Prepare the scene. Images are rendered later.

        Args:
            result: the run.
            camera: a camera of its station.

        Raises:
            SimrobError: the station cannot be built, such as a robot without its files.
        """
        self._result = result
        self._camera = camera
        # Contact and sensors have no part in a picture.
        config = result.config.model_copy(update={"contact": None, "sensors": {}})
        self._scene = PosedStation(config, lambda _, station: add_renderer(station.scene_graph))
        self._mount = camera.mount(self._scene.station)
        self.times = frame_times(result.stop_time, camera.rate, begin=result.start_time)
        self.rate = camera.rate
        self.names = _names_of_labels(self._scene)
        # A page may ask for the same image several times. More images would take too much memory.
        self._rendered = lru_cache(maxsize=64)(self._render)

    def __len__(self) -> int:
        """Count of the images."""
        return len(self.times)

    def __getitem__(self, number: int) -> Image:
        """Render an image, or return one of the last 64 that were rendered.

        Args:
            number: index of the image, from 0. Negative numbers count from the end.

        Raises:
            IndexError: there is no image of this index.
        """
        # A range checks the number as a list would, and counts negative ones from the end.
        return self._rendered(range(len(self))[number])

    def __iter__(self) -> Iterator[Image]:
        """Iterate over the images, each rendered when it is reached."""
        return (self[number] for number in range(len(self)))

    @property
    def color(self) -> npt.NDArray[np.uint8]:
        """Colours of all images, shape (k, h, w, 3)."""
        return np.array([image.color for image in self])

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        """Depths of all images, shape (k, h, w) [m]."""
        return np.array([image.depth for image in self])

    def _render(self, number: int) -> Image:
        """Render the image at a time of `times`, given by its index from 0."""
        time = float(self.times[number])
        positions = positions_in(self._scene.station, self._result, np.array([time]))[0]
        self._scene.place(positions)
        return self._camera.lens.image(self._scene.query(), *self._mount, time)


def _names_of_labels(scene: PosedStation) -> dict[int, str]:
    """Names of the bodies of a scene, by the label that their pixels have: a body's index in the plant.

    The names of links begin with the prefix of their robot, which is empty in stations with one robot.
    """
    prefixes = {robot.instance: robot.prefix for robot in scene.station.robots.values()}
    names = {}
    for index in range(scene.plant.num_bodies()):
        body = scene.plant.get_body(BodyIndex(index))
        prefix = prefixes.get(body.model_instance(), "")  # pieces have none
        names[index] = f"{prefix}{body.name()}"
    return names


def footage_of(result: RecordedRun) -> dict[str, Footage]:
    """Images of a run's cameras, by the name of the camera; empty if the station has no camera."""
    cameras = {
        name: sensor
        for name, sensor in result.config.sensors.items()
        if isinstance(sensor, CameraSensor)
    }
    return {name: Footage(result, camera) for name, camera in cameras.items()}


def save_footage(footage: dict[str, Footage], folder: Path, *, video: bool = False) -> None:
    """Write the images of cameras: a folder and a strip ``<camera>.png`` for each camera.

    In the folder, ``color_<k>.png`` has the colours, and ``depth_<k>.png`` the depth in whole millimetres (16 bits;
    65535 for a pixel without depth).

    Args:
        footage: images by camera.
        folder: folder in which the cameras' folders are made. They must not exist.
        video: whether there is a ``<camera>.mp4``, too.
    """
    for name, images in footage.items():
        own_folder = folder / name
        own_folder.mkdir(parents=True)
        for number, image in enumerate(images):
            Picture.fromarray(image.color).save(own_folder / f"color_{number:04d}.png")
            # PNG has no pixels of floating point numbers: depths are whole millimetres.
            Picture.fromarray(_depth_pixels(image)).save(own_folder / f"depth_{number:04d}.png")
        # Indices of the images in the strip, evenly spaced. If there are fewer than seven images, indices occur several
        # times: np.unique keeps each once.
        shown = np.unique(np.linspace(0, len(images) - 1, _STRIP_COUNT).round().astype(int))
        colours = [images[number].color for number in shown]
        strip = side_by_side(colours, captions(images.times[shown], None))
        strip.save(folder / f"{name}.png")
        if video:
            write_video((image.color for image in images), folder / f"{name}.mp4", images.rate)


def _depth_pixels(image: Image) -> npt.NDArray[np.uint16]:
    """Depth of an image in whole millimetres, as a file has it, shape (h, w). 65535 marks pixels without depth."""
    millimetres = np.clip(_MILLIMETRES * image.depth, 0, _NO_DEPTH)
    depth = np.where(image.has_depth, millimetres, _NO_DEPTH)
    return np.round(depth).astype(np.uint16)
