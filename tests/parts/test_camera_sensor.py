"""Cameras: images against the geometry, taken after the run and in a loop."""

import numpy as np
import pytest
from PIL import Image as Picture
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import transform_from_pose, transform_from_xyz_quaternion

ABOVE = {"kind": "camera", "pose": [0, 0, 2.0, 0, 0, np.pi]}
ASIDE = {
    "kind": "camera",
    "pose": [-0.9, 0.1, 0.5, 0, 1.9, np.pi / 2 * 0],
    "width": 160,
    "height": 120,
    "rate": 4.0,
}
SHORT = {"duration": 0.5, "pieces.box.pose": [0, 0, 0.112, 0.2, 0.4363, 0]}


def simulate_box(camera, **overrides):
    """Run a box that falls over, with a camera ``eye``."""
    config = load_station("box_on_floor", {"sensors": {"eye": camera}, **SHORT, **overrides})
    return simulate(config, progress=False)


@pytest.fixture(scope="module")
def run():
    return simulate_box(ASIDE)


def test_depth_is_that_of_the_floor_and_of_the_box(run):
    footage = run.images["eye"]

    box = next(label for label, name in footage.names.items() if name == "box")
    for image in footage:
        values = [np.interp(image.time, run.times, column) for column in run.piece_pose("box").T]
        pose = transform_from_xyz_quaternion(values)
        in_box = pose.inverse() @ image.points(image.labels == box).T
        assert in_box.shape[1] > 500
        # Each point is on a face of the box, and beyond none.
        beyond = np.abs(in_box) - np.array([[0.05], [0.05], [0.1]])
        np.testing.assert_allclose(beyond.max(axis=0), 0.0, atol=1e-3)
        floor = image.points(image.labels == 0)
        np.testing.assert_allclose(floor[:, 2], 0.0, atol=1e-3)
        np.testing.assert_allclose(np.abs(floor[:, :2]).max(), 0.5, atol=0.01)


def test_images_are_taken_at_equal_intervals_up_to_the_end(run):
    footage = run.images["eye"]

    assert footage.times.tolist() == [0.0, 0.25, 0.5]
    assert footage.color.shape == (3, 120, 160, 3)
    assert footage.depth.shape == (3, 120, 160)
    with pytest.raises(IndexError):
        footage[3]


def test_a_camera_on_a_link_moves_with_the_link():
    camera = {
        "kind": "camera",
        "frame": "link_6",
        "pose": [0.2, 0, 0, 0, 0.9, 0],
        "rate": 1.0,
        "far": 3.0,
    }
    config = load_station("irb120_kinematic", {"sensors": {"eye": camera}, "duration": 1.0})

    result = simulate(config, progress=False)

    plant = result.plant.plant
    robot = next(iter(result.plant.robots.values()))
    footage = result.images["eye"]
    for image in footage:
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, result.positions_at(np.array([image.time]))[0])
        link = plant.GetFrameByName("link_6", robot.instance).CalcPoseInWorld(context)
        assert image.pose.IsNearlyEqualTo(link @ transform_from_pose(camera["pose"]), 1e-9)
    assert not footage[0].pose.IsNearlyEqualTo(footage[-1].pose, 0.01)


class Finder(LeafSystem):
    """Computes the mean of the points that a camera sees above the floor."""

    def __init__(self):
        super().__init__()
        self.units = {"place": "m"}
        self.camera = self.DeclareAbstractInputPort("image.eye", Value[object]())
        self.DeclareVectorOutputPort("place", 3, self.find)

    def find(self, context, output):
        points = self.camera.Eval(context).points()
        output.SetFromVector(points[points[:, 2] > 0.15].mean(axis=0))


@pytest.mark.long
def test_a_block_can_read_its_images_and_the_motion_does_not_change():
    upright = {"pieces.box.pose": [0.03, -0.05, 0.1, 0, 0, 0], "duration": 0.2}
    in_loop = {"sensors": {"eye": {**ABOVE, "in_loop": True}}, **SHORT, **upright}

    with_camera = simulate_box(ABOVE, **upright)
    with_block = simulate(load_station("box_on_floor", in_loop), blocks=[Finder()], progress=False)
    without = simulate(load_station("box_on_floor", {**SHORT, **upright}), progress=False)

    places = np.column_stack([with_block[f"finder.place.{axis}"] for axis in range(3)])
    np.testing.assert_allclose(places[-1], [0.03, -0.05, 0.2], atol=2e-3)
    for name in with_camera.names:
        np.testing.assert_array_equal(with_camera[name], with_block[name])
    np.testing.assert_array_equal(with_camera.piece_pose("box"), without.piece_pose("box"))


def test_the_noise_of_the_depth_grows_with_the_square_of_the_distance_and_is_repeatable():
    camera = {**ABOVE, "depth_noise": 0.002, "rate": 2.0}

    first = simulate_box(camera, duration=0.5).images["eye"]
    again = simulate_box(camera, duration=0.5).images["eye"]

    np.testing.assert_array_equal(first[0].depth, again[0].depth)
    floor = first[0].depth[first[0].labels == 0]
    assert floor.std() == pytest.approx(0.002 * 2.0**2, rel=0.03)
    assert floor.mean() == pytest.approx(2.0, abs=2e-4)
    assert (first[0].depth != first[1].depth).any()


def test_pixels_of_things_too_near_or_too_far_have_no_depth():
    camera = {**ABOVE, "near": 1.85, "far": 1.95}

    image = simulate_box(camera, duration=0.01).images["eye"][0]

    box = image.labels == 1
    assert set(np.unique(image.depth[~box])) == {np.inf}
    assert (image.depth[box] == 0).any()
    assert set(image.points()[:, 2] < 0.151) == {True}
    assert len(image.points()) == (box & image.has_depth).sum()


@pytest.mark.long
def test_its_images_are_saved(tmp_path):
    """Depths are saved in millimetres, and 65535 for pixels without a depth."""
    result = simulate_box({**ABOVE, "rate": 2.0})

    folder = result.save(tmp_path / "run") / "cameras"

    names = sorted(file.name for file in (folder / "eye").iterdir())
    assert names == ["color_0000.png", "color_0001.png", "depth_0000.png", "depth_0001.png"]
    saved = np.asarray(Picture.open(folder / "eye" / "depth_0001.png"))
    image = result.images["eye"][1]
    has_depth = image.has_depth
    np.testing.assert_allclose(saved[has_depth], 1e3 * image.depth[has_depth], atol=0.5)
    assert (saved[~has_depth] == 65535).all()
    assert Picture.open(folder / "eye.png").width > 2 * 320


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (
            {"pose": [0, 0, 0.1, 0, 0, 0]},
            r"sensors\.eye\.pose: the camera is at \(0, 0, 0\.1\) m, inside box; move it outside",
        ),
        ({"near": 2.0, "far": 1.0}, "far is 1 m; it must be larger than near"),
        ({"frame": "bax"}, "did you mean 'box'"),
        ({"width": 321}, "multiple of 2"),
        ({"seed": -1}, "sensors.eye.seed: "),
        ({"opening_deg": 180}, "less than 180"),
    ],
)
def test_an_invalid_camera_is_refused_with_its_cause(camera, message):
    upright = {"pieces.box.pose": [0, 0, 0.1, 0, 0, 0], "pieces.box.model": "box"}

    with pytest.raises(SimrobError, match=message):
        simulate_box({**ABOVE, **camera}, **upright)


def test_a_block_that_reads_a_camera_outside_of_the_loop_is_refused():
    config = load_station("box_on_floor", {"sensors": {"eye": ABOVE}})
    with pytest.raises(SimrobError, match=r"image\.eye.*in_loop"):
        simulate(config, blocks=[Finder()], progress=False)
