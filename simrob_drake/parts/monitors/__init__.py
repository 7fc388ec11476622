"""What may end a run: the kinds of monitor that a station file can name."""

from typing import TYPE_CHECKING, Annotated, Any

from simrob_drake.parts.kinds import Kinds

KINDS = Kinds(
    __name__,
    {
        "joint_limit": "joint_limit.JointLimit",
        "torque_limit": "torque_limit.TorqueLimit",
        "settled": "settled.Settled",
        "divergence": "divergence.Divergence",
        "contact": "contact.Contact",
        "force_limit": "force_limit.ForceLimit",
        "power_limit": "power.PowerLimit",
        "workspace": "workspace.Workspace",
        "fall": "fall.Fall",
        "empty_grip": "empty_grip.EmptyGrip",
    },
)
if TYPE_CHECKING:
    from simrob_drake.parts.monitors.contact import Contact
    from simrob_drake.parts.monitors.divergence import Divergence
    from simrob_drake.parts.monitors.empty_grip import EmptyGrip
    from simrob_drake.parts.monitors.fall import Fall
    from simrob_drake.parts.monitors.force_limit import ForceLimit
    from simrob_drake.parts.monitors.joint_limit import JointLimit
    from simrob_drake.parts.monitors.power import PowerLimit
    from simrob_drake.parts.monitors.settled import Settled
    from simrob_drake.parts.monitors.torque_limit import TorqueLimit
    from simrob_drake.parts.monitors.workspace import Workspace

    MonitorConfig = (
        JointLimit
        | TorqueLimit
        | Settled
        | Divergence
        | Contact
        | ForceLimit
        | PowerLimit
        | Workspace
        | Fall
        | EmptyGrip
    )
else:
    MonitorConfig = Annotated[Any, KINDS]

Monitors = Annotated[dict[str, MonitorConfig], KINDS.names_are_kinds]
