"""The pieces that a robot holds, and the choice of the tool in use."""

import pytest

from simrob_drake.stations.resolved_pieces import flange, tool_in_use

OWN = {"hand": "hand_frame", "camera": "camera_frame"}


@pytest.mark.parametrize(
    ("own", "carried", "tcp", "used"),
    [
        (OWN, [], None, "hand"),
        (OWN, [], "camera", "camera"),
        (OWN, ["gripper", "box"], None, "box"),
        (OWN, ["gripper", "box"], "gripper", "gripper"),
        ({}, ["box"], None, "box"),
        ({}, [], None, ""),
    ],
)
def test_the_tool_in_use_is_the_named_one_else_the_outermost_piece_else_the_first(
    own, carried, tcp, used
) -> None:
    assert tool_in_use(own, carried, tcp) == used


@pytest.mark.parametrize(
    ("own", "tool", "frame"),
    [
        (OWN, None, "hand_frame"),
        (OWN, "camera", "camera_frame"),
        ({}, None, "trunk"),
        (OWN, "shank", "shank"),
        ({"left_foot": "LF"}, None, "trunk"),
    ],
)
def test_pieces_hang_on_a_tool_of_the_robot_else_on_its_root(own, tool, frame) -> None:
    assert flange(own, "trunk", tool) == frame
