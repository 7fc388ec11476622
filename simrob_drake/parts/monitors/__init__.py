"""What may end a run: the kinds of monitor that a station file can name."""

from typing import Annotated

from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.monitors.monitor import MonitorSection

KINDS = Kinds(
    __name__,
    {
        "joint_limit": "sections.JointLimit",
        "torque_limit": "sections.TorqueLimit",
        "settled": "sections.Settled",
        "divergence": "sections.Divergence",
        "contact": "sections.Contact",
        "force_limit": "sections.ForceLimit",
        "power_limit": "sections.PowerLimit",
        "workspace": "sections.Workspace",
        "fall": "sections.Fall",
        "empty_grip": "sections.EmptyGrip",
    },
    base=MonitorSection,
    point="monitors",
)
MonitorConfig = Annotated[MonitorSection, KINDS]
Monitors = Annotated[dict[str, MonitorConfig], KINDS.names_are_kinds]
