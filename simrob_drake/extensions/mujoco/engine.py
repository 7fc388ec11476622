"""The engine ``mujoco``: MuJoCo stands in for Drake's plant in a station, its servos and contacts included."""

from typing import ClassVar, Literal

from simrob_drake.base.extras import importing_extra
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Positive
from simrob_drake.parts.engine import Engine, PlantBlock
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.stations.other_engine import OtherEngine
from simrob_drake.stations.resolve import ResolvedStation


class MujocoEngine(OtherEngine):
    """MuJoCo in the place of Drake's plant, its servos and contacts in one implicit step (extra `mujoco`)."""

    answers: ClassVar[Engine] = Engine(
        name="mujoco",
        holds_joint_limits=True,
        constrains_gears=True,
        puts_friction_in_actuators=False,
        has_friction_of_joints=True,
        allows_dampers_of_motors=False,
        reports_forces_of_joints=False,
        takes_any_contact_stiffness=True,
        has_static_friction=False,
        has_surface_contact=False,
        has_prescribed_joints=False,
        has_forces_of_couplings=False,
        touches_at_several_points=True,
        reports_torques_of_last_step=True,
    )
    kind: Literal["mujoco"]
    time_step: Positive = 2e-3
    """Length of a step [s]."""

    def plant_block(self, station: ResolvedStation, plant: StationPlant) -> PlantBlock:
        """Make the block in which MuJoCo simulates the station's plant.

        Args:
            station: the station.
            plant: its plant in Drake, which is finalized.

        Raises:
            SimrobError: MuJoCo is not installed, or a part of the station has no equivalent in MuJoCo.
        """
        with importing_extra(message("mujoco.solver_kind", "solver.kind mujoco"), "mujoco"):
            from simrob_drake.extensions.mujoco.plant import MujocoPlant
        return MujocoPlant(station, plant)
