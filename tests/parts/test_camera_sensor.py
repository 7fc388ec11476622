"""Cameras: what they see against the geometry, after the run and in a loop."""

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


def seen(camera, **overrides):
    return simulate(
        load_station("box_on_floor", {"sensors": {"eye": camera}, **SHORT, **overrides}),
        progress=False,
    )


@pytest.fixture(scope="module")
def run():
    return seen(ASIDE)


def test_depth_is_that_of_the_floor_and_of_the_box(run):
    footage = run.images["eye"]
    box = next(label for label, name in footage.names.items() if name == "box")
    for image in footage:
        pose = transform_from_xyz_quaternion(
            [np.interp(image.time, run.times, column) for column in run.piece_pose("box").T]
        )
        corner = pose.inverse() @ image.points(image.labels == box).T
        assert corner.shape[1] > 500
        beyond = np.abs(corner) - np.array([[0.05], [0.05], [0.1]])
        np.testing.assert_allclose(beyond.max(axis=0), 0.0, atol=1e-3)  # on a face, and over none
        floor = image.points(image.labels == 0)
        np.testing.assert_allclose(floor[:, 2], 0.0, atol=1e-3)
        np.testing.assert_allclose(np.abs(floor[:, :2]).max(), 0.5, atol=0.01)


def test_the_images_come_evenly_and_the_last_at_the_end(run):
    footage = run.images["eye"]
    assert footage.times.tolist() == [0.0, 0.25, 0.5]
    assert footage.color.shape == (3, 120, 160, 3)
    assert footage.depth.shape == (3, 120, 160)
    with pytest.raises(IndexError):
        footage[3]


def test_one_on_a_link_moves_with_it():
    camera = {
        "kind": "camera",
        "frame": "link_6",
        "pose": [0.2, 0, 0, 0, 0.9, 0],
        "rate": 1.0,
        "far": 3.0,
    }
    result = simulate(
        load_station("irb120_kinematic", {"sensors": {"eye": camera}, "duration": 1.0}),
        progress=False,
    )
    plant, robot = result.plant.plant, next(iter(result.plant.robots.values()))
    for image in result.images["eye"]:
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, result.positions_at(np.array([image.time]))[0])
        link = plant.GetFrameByName("link_6", robot.instance).CalcPoseInWorld(context)
        assert image.pose.IsNearlyEqualTo(link @ transform_from_pose(camera["pose"]), 1e-9)
    assert not result.images["eye"][0].pose.IsNearlyEqualTo(result.images["eye"][-1].pose, 0.01)


class Finder(LeafSystem):
    """Tells where the middle of what is over the floor is."""

    def __init__(self):
        super().__init__()
        self.units = {"place": "m"}
        self.camera = self.DeclareAbstractInputPort("image.eye", Value[object]())
        self.DeclareVectorOutputPort("place", 3, self.look)

    def look(self, context, output):
        points = self.camera.Eval(context).points()
        output.SetFromVector(points[points[:, 2] > 0.15].mean(axis=0))


@pytest.mark.long
def test_a_loop_looks_through_it_and_it_changes_nothing():
    upright = {"pieces.box.pose": [0.03, -0.05, 0.1, 0, 0, 0], "duration": 0.2}
    plain = seen(ABOVE, **upright)
    config = load_station(
        "box_on_floor", {"sensors": {"eye": {**ABOVE, "in_loop": True}}, **SHORT, **upright}
    )
    looked = simulate(config, blocks=[Finder()], progress=False)
    place = np.column_stack([looked[f"finder.place.{axis}"] for axis in range(3)])
    np.testing.assert_allclose(place[-1], [0.03, -0.05, 0.2], atol=2e-3)
    for name in plain.names:
        np.testing.assert_array_equal(plain[name], looked[name])
    without = simulate(load_station("box_on_floor", {**SHORT, **upright}), progress=False)
    np.testing.assert_array_equal(plain.piece_pose("box"), without.piece_pose("box"))


def test_noise_of_depth_grows_with_the_square_of_the_distance_and_comes_again():
    first, again = (
        seen({**ABOVE, "depth_noise": 0.002, "rate": 2.0}, duration=0.5).images["eye"]
        for _ in range(2)
    )
    np.testing.assert_array_equal(first[0].depth, again[0].depth)
    floor = first[0].depth[first[0].labels == 0]
    assert floor.std() == pytest.approx(0.002 * 2.0**2, rel=0.03)
    assert floor.mean() == pytest.approx(2.0, abs=2e-4)
    assert (first[0].depth != first[1].depth).any()


def test_what_is_too_near_has_no_depth_and_what_is_too_far_none_either():
    image = seen({**ABOVE, "near": 1.85, "far": 1.95}, duration=0.01).images["eye"][0]
    box = image.labels == 1
    assert set(np.unique(image.depth[~box])) == {np.inf}
    assert (image.depth[box] == 0).any()
    assert set(image.points()[:, 2] < 0.151) == {True}
    assert len(image.points()) == (box & image.has_depth).sum()


@pytest.mark.long
def test_its_images_are_saved(tmp_path):
    result = seen({**ABOVE, "rate": 2.0})
    folder = result.save(tmp_path / "run") / "cameras"
    assert sorted(file.name for file in (folder / "eye").iterdir()) == [
        *(f"color_{k:04d}.png" for k in range(2)), *(f"depth_{k:04d}.png" for k in range(2))
    ]  # fmt: skip
    depth = np.asarray(Picture.open(folder / "eye" / "depth_0001.png"))
    expected = result.images["eye"][1]
    np.testing.assert_allclose(
        depth[expected.has_depth], 1e3 * expected.depth[expected.has_depth], atol=0.5
    )
    assert (depth[~expected.has_depth] == 65535).all()
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
def test_what_cannot_be_is_said(camera, message):
    upright = {"pieces.box.pose": [0, 0, 0.1, 0, 0, 0], "pieces.box.model": "box"}
    with pytest.raises(SimrobError, match=message):
        seen({**ABOVE, **camera}, **upright)


def test_a_block_that_looks_through_no_camera_is_told():
    config = load_station("box_on_floor", {"sensors": {"eye": ABOVE}})
    with pytest.raises(SimrobError, match=r"image\.eye.*in_loop"):
        simulate(config, blocks=[Finder()], progress=False)
