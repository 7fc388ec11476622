"""Hold a posture by a linear quadratic regulator, designed on the station's linear model, and push the arm."""

from __future__ import annotations

import numpy as np
from pydrake.systems.controllers import LinearQuadraticRegulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, MatrixGain, Multiplexer

from simrob_drake import (
    SimulationResult,
    add_station,
    linearize,
    load_station,
    simulate,
    simulate_diagram,
)
from simrob_drake.stations.config import StationConfig

POSTURE = np.deg2rad([0.0, 30.0, 10.0, 0.0, 50.0, 0.0])
PUSH = {"kind": "push", "start": 0.1, "duration": 0.1, "force": [0, 0, -150]}
COST_OF_ANGLE, COST_OF_SPEED, COST_OF_TORQUE = 1e4, 10.0, 1e-2
"""What a rad², a (rad/s)² and a (N·m)² cost a second."""


def station(**servo: object) -> StationConfig:
    """Return the arm at the posture, its tool pushed down for a moment."""
    changes = {
        "robot.initial_deg": np.rad2deg(POSTURE).tolist(),
        "reference": {"kind": "hold"},
        "servo": {"realization": "vector", **servo},
        "forces": {"hand": PUSH},
        "solver.accuracy": 1e-4,
        "duration": 1.5,
    }
    return load_station("irb120_dynamic", changes)


def run_servos() -> SimulationResult:
    """Let the station's own servos hold it."""
    return simulate(station(kp=1000, kd=10), progress=False)


def run() -> SimulationResult:
    """Let the regulator hold it: torque = what holds the posture - K (state - posture)."""
    config = station(kp=0, kd=0).model_copy(update={"inputs": ("feedforward",)})
    model = linearize(config, POSTURE)
    motors = model.part(inputs=["feedforward"])
    states = np.diag([COST_OF_ANGLE] * 6 + [COST_OF_SPEED] * 6)
    gain, _ = LinearQuadraticRegulator(model.A, motors.B, states, COST_OF_TORQUE * np.eye(6))

    builder = DiagramBuilder()
    ports = add_station(builder, config)
    state = builder.AddNamedSystem("regulator.state", Multiplexer([6, 6]))
    regulator = builder.AddNamedSystem("regulator", MatrixGain(-gain))
    holding = builder.AddNamedSystem(
        "regulator.holding", ConstantVectorSource(motors.u0 + gain @ model.x0)
    )
    torque = builder.AddNamedSystem("regulator.torque", Adder(2, 6))
    reference = builder.AddNamedSystem("regulator.reference", ConstantVectorSource(POSTURE))
    builder.Connect(ports.outputs["position"], state.get_input_port(0))
    builder.Connect(ports.outputs["velocity"], state.get_input_port(1))
    builder.Connect(state.get_output_port(), regulator.get_input_port())
    builder.Connect(regulator.get_output_port(), torque.get_input_port(0))
    builder.Connect(holding.get_output_port(), torque.get_input_port(1))
    builder.Connect(torque.get_output_port(), ports.inputs["feedforward"])
    builder.Connect(reference.get_output_port(), ports.inputs["reference"])
    return simulate_diagram(builder.Build(), ports, duration=config.duration, progress=False)


def strays(result: SimulationResult) -> tuple[float, float]:
    """Return how far joint 2 is from the posture at most, and at most in the last half second [deg]."""
    away = np.rad2deg(np.abs(result["q.joint_2"] - POSTURE[1]))
    return float(away.max()), float(away[result.times > 1.0].max())


def main() -> None:
    """Print how both take the push."""
    for name, result in (("servos", run_servos()), ("regulator", run())):
        most, late = strays(result)
        print(
            f"{name}: joint 2 strays by {most:.2f} deg, and still by {late:.3f} deg after a second"
        )


if __name__ == "__main__":
    main()
