"""What may end a run: the kinds of monitor that a station file can name."""

from typing import Annotated

from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.monitors.monitor import MonitorSection

KINDS = Kinds(
    __name__,
    {
        "joint_limit": "axes.JointLimit",
        "torque_limit": "axes.TorqueLimit",
        "settled": "axes.Settled",
        "divergence": "axes.Divergence",
        "contact": "places.Contact",
        "force_limit": "places.ForceLimit",
        "power_limit": "axes.PowerLimit",
        "workspace": "places.Workspace",
        "fall": "places.Fall",
        "empty_grip": "axes.EmptyGrip",
    },
)
MonitorConfig = Annotated[MonitorSection, KINDS]
Monitors = Annotated[dict[str, MonitorConfig], KINDS.names_are_kinds]
