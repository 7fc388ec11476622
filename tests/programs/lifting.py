"""A gripper on a column that lifts a box from the floor, as a station that several tests run."""

from pathlib import Path
from typing import Any

import yaml

from simrob_drake import load_station
from simrob_drake.stations.config import StationConfig

_LINK = """<link name="{name}">
  <inertial><origin xyz="{com}"/><mass value="{mass}"/>
    <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision></link>"""
_FINGER_JOINT = """<joint name="finger_{side}_joint" type="prismatic">
  <parent link="carriage"/><child link="finger_{side}"/><origin xyz="0 {sign}0.005 -0.02"/><axis xyz="0 {sign}1 0"/>
  <limit lower="0" upper="0.045" effort="40" velocity="0.15"/>{dynamics}{mimic}</joint>"""


def gripper_urdf(*, friction: float = 0.0, right_has_inertia: bool = True) -> str:
    """Write a robot with a lift along z and two fingers along y, of which the right one mimics the left one.

    Args:
        friction: friction of the lift in the file [N]. The import leaves it out.
        right_has_inertia: whether the right finger has an inertia.
    """
    finger = {"com": "0 0 -0.05", "mass": 0.1, "inertia": 7e-5, "size": "0.03 0.01 0.09"}
    right = _LINK.format(name="finger_right", at="0 -0.005 -0.05", **finger)
    if not right_has_inertia:
        begin, end = right.index("<inertial>"), right.index("</inertial>") + len("</inertial>")
        right = right[:begin] + right[end:]
    lift_friction = f'<dynamics friction="{friction}"/>' if friction else ""
    parts = [
        _LINK.format(
            name="column",
            com="0 0 0.3",
            mass=8,
            inertia=0.25,
            at="-0.12 0 0.3",
            size="0.08 0.08 0.6",
        ),
        _LINK.format(
            name="carriage",
            com="0 0 0",
            mass=1.2,
            inertia=0.003,
            at="-0.02 0 0",
            size="0.12 0.16 0.04",
        ),
        '<joint name="lift" type="prismatic"><parent link="column"/><child link="carriage"/>'
        '<origin xyz="0 0 0.12"/><axis xyz="0 0 1"/>'
        f'<limit lower="0" upper="0.35" effort="120" velocity="0.5"/>{lift_friction}</joint>',
        _LINK.format(name="finger_left", at="0 0.005 -0.05", **finger),
        _FINGER_JOINT.format(side="left", sign="", dynamics="", mimic=""),
        right,
        _FINGER_JOINT.format(
            side="right", sign="-", dynamics="", mimic='<mimic joint="finger_left_joint"/>'
        ),
    ]
    return f'<robot name="lift_gripper">{"".join(parts)}</robot>'


def lifting_station(folder: Path, moves: list[dict[str, Any]], **urdf: Any) -> StationConfig:
    """Load the station with a box of 0.2 kg between its open fingers, 40 mm high on the floor.

    Args:
        folder: folder for the robot's file and the station's file.
        moves: moves of the station's program.
        urdf: arguments of :func:`gripper_urdf`.
    """
    return load_station(lifting_file(folder, moves, **urdf))


def lifting_file(folder: Path, moves: list[dict[str, Any]], **urdf: Any) -> Path:
    """Write what :func:`lifting_station` loads. Returns the path of the station's file."""
    (folder / "lift_gripper.urdf").write_text(gripper_urdf(**urdf))
    servo = {
        "realization": "implicit",
        "kp": {"lift": 14000, "finger_left_joint": 8900, "finger_right_joint": 8900},
        "kd": {"lift": 280, "finger_left_joint": 60, "finger_right_joint": 60},
        "torque_limit": {"lift": 120, "finger_left_joint": 40, "finger_right_joint": 40},
        "feedforward": "inverse_dynamics",
    }
    content = {
        "mode": "dynamic",
        "robot": {
            "urdf": "lift_gripper.urdf",
            "initial_deg": {"lift": 0.1, "finger_left_joint": 0.045},
        },
        "pieces": {
            "box": {
                "box": [0.05, 0.04, 0.04],
                "mass": 0.2,
                "free": True,
                "pose": [0, 0, 0.02, 0, 0, 0],
            }
        },
        "couplings": {
            "gear": {
                "kind": "gear",
                "ratios": {"finger_right_joint": 1, "finger_left_joint": -1},
                "total": 0,
            }
        },
        "servo": servo,
        "floor": {"size": 3},
        "contact": {"model": "hydroelastic", "friction": {"static": 0.5, "dynamic": 0.5}},
        "solver": {"kind": "discrete", "scheme": "lagged", "time_step": 0.005},
        "program": {"moves": moves},
        "reference": {"kind": "hold"},
    }
    path = folder / "lift_box.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path
