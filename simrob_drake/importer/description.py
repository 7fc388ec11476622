"""The first draft of an imported robot's ``robot.yaml``."""

from __future__ import annotations

from typing import Any

import yaml

from simrob_drake.importer.gains import first_gains
from simrob_drake.importer.report import ImportReport
from simrob_drake.robots.catalog import RobotModel

_HEADER = """\
# Draft of an import; edit it freely.
# axes: the joints in the order of every vector; rename an axis as `elbow: {joint: joint_3, sign: -1}`.
# tools: frames of the URDF whose pose a station can follow; the first is where pieces are attached.
"""


def draft(robot: RobotModel, report: ImportReport) -> str:
    """Return the text of a ``robot.yaml`` for an imported robot; its home posture and gains are added to the report."""
    content: dict[str, Any] = {
        "name": robot.name,
        "description": f"{robot.name}, imported",
        "source": report.source.name,
        "urdf": robot.urdf,
        "base": robot.base,
        "root": robot.root,
        "axes": list(robot.axes),
        "tools": robot.tools,
    }
    if isinstance(robot.home_deg, dict):
        content["home_deg"] = robot.home_deg
        midway = ", ".join(robot.home_deg)
        report.add("defaulted", "robot.yaml", f"zero is outside of the limits of {midway}: they start midway")
    if not robot.links_without_inertia:
        content["servo"] = _servo(robot)
        report.add("defaulted", "robot.yaml", "servo gains from the mass matrix")
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
    return _HEADER + text


def _servo(robot: RobotModel) -> dict[str, Any]:
    gains = first_gains(robot)
    per_axis = {"kp": gains.kp, "kd": gains.kd}
    return {key: dict(zip(robot.axes, values.tolist(), strict=True)) for key, values in per_axis.items()}
