"""Robots by name or URDF: their axes, signs, aliases and limits."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidConfig, InvalidModel, InvalidParameter, UnknownName
from simrob_drake.robots.catalog import RobotModel, load_robot, load_robot_from_urdf, robot_names

Write = Callable[[str], Path]

ROBOT_YAML = """
urdf: {urdf}
root: base
axes:
  shoulder_pitch: {{joint: shoulder, sign: {sign}, aliases: [HomD]}}
"""


def described(write_urdf: Write, text: str, *, sign: int = 1, urdf: str = "arm.urdf") -> RobotModel:
    path = write_urdf(text)
    path.with_name("robot.yaml").write_text(ROBOT_YAML.format(sign=sign, urdf=urdf))
    return load_robot_from_urdf(path)


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_of_the_package_loads_and_is_clean(name: str) -> None:
    robot = load_robot(name)

    lower, upper = robot.axis_limits
    assert (lower < upper).all()
    driven = [axis not in robot.passive_axes for axis in robot.axes]
    assert (robot.efforts[driven] > 0).all()
    assert robot.links_without_inertia == []
    assert robot.axis_vector(robot.home_deg, "home_deg").shape == lower.shape


def test_the_package_has_the_robots_of_its_stations() -> None:
    assert {"irb120", "double_pendulum"} <= set(robot_names())


def test_an_unknown_robot_brings_the_nearest_one() -> None:
    with pytest.raises(UnknownName, match="there is no robot 'irb210'; did you mean 'irb120'"):
        load_robot("irb210")


@pytest.mark.parametrize("name", ["../models/irb120", "pieces", "", "irb120/"])
def test_a_path_is_no_name(name: str) -> None:
    with pytest.raises(UnknownName):
        load_robot(name)


def test_a_number_is_for_all_axes() -> None:
    np.testing.assert_array_equal(load_robot("irb120").axis_vector(3.0, "kp"), np.full(6, 3.0))


def test_a_list_is_in_axis_order() -> None:
    np.testing.assert_array_equal(
        load_robot("irb120").axis_vector([1, 2, 3, 4, 5, 6], "kp"), [1, 2, 3, 4, 5, 6]
    )


def test_a_mapping_fills_up_with_the_default() -> None:
    vector = load_robot("irb120").axis_vector(
        {"joint_5": 90.0, "joint_1": 1.0}, "home_deg", default=7.0
    )
    np.testing.assert_array_equal(vector, [1, 7, 7, 7, 90, 7])


def test_a_mapping_fills_up_with_defaults_axis_by_axis() -> None:
    vector = load_robot("double_pendulum").axis_vector(
        {"joint_2": 9.0}, "kp", default=np.array([1.0, 2.0])
    )
    np.testing.assert_array_equal(vector, [1, 9])


@pytest.mark.parametrize("values", [[], [1.0], [1.0] * 7])
def test_a_list_of_the_wrong_length_is_an_error(values: list[float]) -> None:
    with pytest.raises(InvalidParameter, match="6 numbers, one for each axis of irb120"):
        load_robot("irb120").axis_vector(values, "kp")


def test_a_mapping_with_an_unknown_axis_brings_the_nearest_one_and_its_key() -> None:
    with pytest.raises(
        UnknownName, match=r"no axis of irb120 \(under servo\.kp\) 'joint5'; did you mean 'joint_5'"
    ):
        load_robot("irb120").axis_vector({"joint5": 1.0}, "servo.kp")


def test_an_axis_answers_to_its_aliases(write_urdf: Write, one_joint_urdf: str) -> None:
    robot = described(write_urdf, one_joint_urdf)

    assert robot.axis_index("HomD") == robot.axis_index("shoulder_pitch") == 0
    np.testing.assert_array_equal(robot.axis_vector({"HomD": 5.0}, "kp"), [5.0])
    with pytest.raises(UnknownName, match="did you mean 'HomD'"):
        robot.axis_index("HomDF")


@pytest.mark.parametrize(("sign", "lower", "upper"), [(1, -1.0, 2.0), (-1, -2.0, 1.0)])
def test_limits_follow_the_sign_of_the_axis(
    write_urdf: Write, one_joint_urdf: str, sign: int, lower: float, upper: float
) -> None:
    limits = described(write_urdf, one_joint_urdf, sign=sign).axis_limits
    np.testing.assert_array_equal(limits, [[lower], [upper]])


@pytest.mark.parametrize("sign", [1, -1])
def test_a_joint_without_limits_has_none_in_either_sense(
    write_urdf: Write, one_joint_urdf: str, sign: int
) -> None:
    endless = one_joint_urdf.replace("revolute", "continuous").replace('lower="-1" upper="2" ', "")
    robot = described(write_urdf, endless, sign=sign)
    np.testing.assert_array_equal(robot.axis_limits, [[-np.inf], [np.inf]])


@pytest.mark.parametrize("sign", [0, 2, -0.5])
def test_a_sign_is_one_or_minus_one(write_urdf: Write, one_joint_urdf: str, sign: float) -> None:
    with pytest.raises(InvalidConfig, match=r"robot\.yaml: axes\.shoulder_pitch\.sign"):
        described(write_urdf, one_joint_urdf, sign=sign)


def test_a_bare_urdf_has_its_joints_as_axes_and_its_last_link_as_tool(
    write_urdf: Write, one_joint_urdf: str
) -> None:
    robot = load_robot_from_urdf(write_urdf(one_joint_urdf))

    assert robot.name == "arm"
    assert list(robot.axes) == ["shoulder"]
    assert robot.root == "base"
    assert robot.tools == {"tip": "tip"}
    np.testing.assert_array_equal(robot.efforts, [10.0])


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "..", "", "n" * 201, r"a\b"])
def test_names_of_robots_are_no_paths(write_urdf: Write, one_joint_urdf: str, name: str) -> None:
    path = write_urdf(one_joint_urdf.replace('"arm"', f'"{name}"'))

    assert load_robot_from_urdf(path).name == "arm"  # as the file

    path.with_name("robot.yaml").write_text(
        f"name: {name!r}\n{ROBOT_YAML.format(sign=1, urdf='arm.urdf')}"
    )
    with pytest.raises(InvalidConfig, match=r"robot\.yaml: name: must be a valid folder name"):
        load_robot_from_urdf(path)


def test_a_description_of_another_urdf_does_not_count(
    write_urdf: Write, one_joint_urdf: str
) -> None:
    assert list(described(write_urdf, one_joint_urdf, urdf="other.urdf").axes) == ["shoulder"]


def test_a_urdf_in_which_nothing_moves_is_refused(write_urdf: Write, one_joint_urdf: str) -> None:
    with pytest.raises(InvalidParameter, match="at least one joint that moves"):
        load_robot_from_urdf(write_urdf(one_joint_urdf.replace("revolute", "fixed")))


def test_a_defect_of_a_urdf_is_found_at_the_border(write_urdf: Write, one_joint_urdf: str) -> None:
    with pytest.raises(InvalidModel, match="mass -1 kg is negative"):
        load_robot_from_urdf(
            write_urdf(one_joint_urdf.replace('<mass value="1"/>', '<mass value="-1"/>'))
        )


def test_an_axis_of_a_joint_that_does_not_exist_brings_the_nearest_one(
    write_urdf: Write, one_joint_urdf: str
) -> None:
    robot = described(write_urdf, one_joint_urdf.replace('"shoulder"', '"shoulder_1"'))
    with pytest.raises(
        UnknownName, match="there is no joint 'shoulder'; did you mean 'shoulder_1'"
    ):
        _ = robot.axis_limits


@pytest.mark.parametrize("axes", ["[]", "{}", "3", "[[1]]", "[1]", "null"])
def test_axes_are_names_or_a_mapping(write_urdf: Write, one_joint_urdf: str, axes: str) -> None:
    path = write_urdf(one_joint_urdf)
    path.with_name("robot.yaml").write_text(f"urdf: arm.urdf\nroot: base\naxes: {axes}\n")
    with pytest.raises(InvalidConfig, match=r"robot\.yaml: axes"):
        load_robot_from_urdf(path)
