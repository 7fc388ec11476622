"""What may end a run: the kinds of monitor that a station file can name."""

from typing import Annotated

from pydantic import Field

from simrob_drake.parts.kinds import named_by_kind
from simrob_drake.parts.monitors.contact import Contact
from simrob_drake.parts.monitors.divergence import Divergence
from simrob_drake.parts.monitors.fall import Fall
from simrob_drake.parts.monitors.force_limit import ForceLimit
from simrob_drake.parts.monitors.joint_limit import JointLimit
from simrob_drake.parts.monitors.power import PowerLimit
from simrob_drake.parts.monitors.settled import Settled
from simrob_drake.parts.monitors.torque_limit import TorqueLimit
from simrob_drake.parts.monitors.workspace import Workspace

MonitorConfig = Annotated[
    JointLimit | TorqueLimit | Settled | Divergence | Contact | ForceLimit | PowerLimit | Workspace | Fall,
    Field(discriminator="kind"),
]
Monitors = Annotated[dict[str, MonitorConfig], named_by_kind(MonitorConfig)]

__all__ = ["Fall", "MonitorConfig", "Monitors"]
