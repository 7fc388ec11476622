"""The gallery of the pendant: pictures of robots, and nothing else below their path."""

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from simrob_drake.base.files import models_root
from simrob_drake.extensions.pendant.pages import gallery
from simrob_drake.extensions.pendant.pages.gallery import PICTURES, picture_file
from simrob_drake.extensions.pendant.server import _picture_of
from simrob_drake.robots.catalog import robot_names


@pytest.fixture(scope="module")
def client():
    app = FastAPI()
    app.get(f"/{PICTURES}/{{robot}}")(_picture_of)
    return TestClient(app)


@pytest.mark.parametrize("robot", robot_names())
def test_every_robot_of_the_package_has_a_picture(client, robot):
    answer = client.get(f"/{PICTURES}/{robot}")
    assert answer.headers["content-type"] == "image/png"
    assert answer.content == (models_root() / robot / "picture.png").read_bytes()


@pytest.mark.parametrize(
    "robot", ["irb121", "..", "..%2Firb120", "irb120%2Frobot.yaml", "irb120/robot.yaml"]
)
def test_nothing_else_is_served(client, robot):
    assert client.get(f"/{PICTURES}/{robot}").status_code == 404


def test_a_robot_of_no_name_has_no_picture():
    assert picture_file("") is None


def test_a_robot_of_an_extension_may_have_no_picture(client, monkeypatch, tmp_path):
    monkeypatch.setattr(
        gallery, "robot_files", lambda: {"plain": tmp_path / "plain" / "robot.yaml"}
    )
    assert picture_file("plain") is None
    assert client.get(f"/{PICTURES}/plain").status_code == 404
