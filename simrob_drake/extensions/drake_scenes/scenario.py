"""The keys of a scenario file, as Drake's hardware simulation and the package ``manipulation`` read them.

Drake's own schemas describe most sections. The classes here describe the others.
"""

import dataclasses as dc
import typing

from pydrake.geometry import SceneGraphConfig
from pydrake.lcm import DrakeLcmParams
from pydrake.manipulation import IiwaDriver, SchunkWsgDriver, ZeroForceDriver
from pydrake.multibody.parsing import ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.sensors import CameraConfig
from pydrake.visualization import VisualizationConfig


@dc.dataclass
class JointPidControllerGains:
    """Gains of one joint of an :class:`InverseDynamicsDriver`.

    Attributes:
        kp: proportional gain [1/s²].
        ki: integral gain [1/s³].
        kd: derivative gain [1/s].
    """

    kp: float = 100.0
    ki: float = 1.0
    kd: float = 20.0


@dc.dataclass
class InverseDynamicsDriver:
    """Computed torque, with gains by the name of the actuator."""

    gains: typing.Mapping[str, JointPidControllerGains] = dc.field(default_factory=dict)


@dc.dataclass
class JointPdControllerGains:
    """Gains of one joint of a :class:`JointStiffnessDriver`.

    Attributes:
        kp: proportional gain [N·m/rad or N/m].
        kd: derivative gain [N·m·s/rad or N·s/m].
    """

    kp: float = 0.0
    kd: float = 0.0


@dc.dataclass
class JointStiffnessDriver:
    """Springs and dampers at the joints, with the torque against gravity.

    Attributes:
        gains: gains by the name of the actuator.
        hand_model_name: model of the hand.
    """

    gains: typing.Mapping[str, JointPdControllerGains] = dc.field(default_factory=dict)
    hand_model_name: str = ""


DRIVERS = (
    "IiwaDriver",
    "InverseDynamicsDriver",
    "JointStiffnessDriver",
    "SchunkWsgDriver",
    "ZeroForceDriver",
)
"""Names of the drivers, as tags of a scenario."""


def _default_simulator() -> SimulatorConfig:
    """Settings of the simulator that manipulation's scenarios have by default."""
    return SimulatorConfig(max_step_size=0.01, use_error_control=False, accuracy=1e-2)


@dc.dataclass
class Scenario:
    """The content of a scenario file.

    Attributes:
        directives: models, welds and frames.
        model_drivers: driver of each actuated model, by the name of the model.
        plant_config: time step and contact model.
        simulator_config: integrator, if the time step is 0.
        simulation_duration: length of a run [s].
        scenario_duration: the same under a former name.
        cameras: cameras by any name.
        initial_position: positions of joints by the names of model and joint.
        scene_graph_config: default properties of surfaces.
        visualization: settings of Drake's visualizers.
        lcm_buses: buses for messages between processes.
        camera_ids: serial numbers of real cameras.
        random_seed: seed of what is drawn.
    """

    directives: list[ModelDirective] = dc.field(default_factory=list)
    model_drivers: typing.Mapping[
        str,
        typing.Union[  # noqa: UP007  # Drake's loader reads no other form
            IiwaDriver,
            InverseDynamicsDriver,
            JointStiffnessDriver,
            SchunkWsgDriver,
            ZeroForceDriver,
        ],
    ] = dc.field(default_factory=dict)
    plant_config: MultibodyPlantConfig = dc.field(default_factory=MultibodyPlantConfig)
    simulator_config: SimulatorConfig = dc.field(default_factory=_default_simulator)
    simulation_duration: float = float("inf")
    scenario_duration: float = float("inf")
    cameras: typing.Mapping[str, CameraConfig] = dc.field(default_factory=dict)
    initial_position: typing.Mapping[str, typing.Mapping[str, list[float]]] = dc.field(
        default_factory=dict
    )
    scene_graph_config: SceneGraphConfig = dc.field(default_factory=SceneGraphConfig)
    visualization: VisualizationConfig = dc.field(default_factory=VisualizationConfig)
    lcm_buses: typing.Mapping[str, DrakeLcmParams] = dc.field(default_factory=dict)
    camera_ids: typing.Mapping[str, str] = dc.field(default_factory=dict)
    random_seed: int = 0


KEYS = tuple(field.name for field in dc.fields(Scenario))
"""Keys of a scenario."""

ROTATIONS = (
    "Rpy",
    "AngleAxis",
    "Identity",
    "Uniform",
    "UniformVector",
    "Gaussian",
    "GaussianVector",
)
"""Tags of rotations, and of numbers that are drawn."""

OTHER_TAGS = (
    "DeterministicVector",
    "Deterministic",
    "FocalLength",
    "FovDegrees",
    "RenderEngineVtkParams",
    "Meshcat",
)
"""Further tags that Drake's sections have."""
