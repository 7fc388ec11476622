"""The blocks of ``irb120_dynamic`` in the shortest Drake program: what a station is measured against."""

from __future__ import annotations

import time

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from simrob_drake import apply_solver, load_station
from simrob_drake.blocks.passive_joints import add_joint_stops
from simrob_drake.blocks.references import add_reference
from simrob_drake.blocks.servo import ServoSignals, add_actuator_servos, add_servos
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


def stepping_time(realization: str) -> float:
    """Step the move for 3 s without recorder, inputs, sensors, signals or monitors; return the wall time [s]."""
    config = load_station("irb120_dynamic", {"servo.realization": realization})
    builder = DiagramBuilder()
    station = add_plant(builder, resolve(config))
    plant, (robot,) = station.plant, station.robots.values()
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.outer(np.ones(6), [0.0, np.pi / 6]))
    source = add_reference(builder, ramp)
    signals = ServoSignals(source.position, plant.get_state_output_port(robot.instance))
    if realization == "implicit":
        add_actuator_servos(
            builder, plant, robot.instance, signals, robot.gains, actuation_map=np.eye(6)
        )
    else:
        per_joint = realization == "per_joint"
        torque = add_servos(builder, signals, robot.gains, names=robot.axes, per_joint=per_joint)
        builder.Connect(torque, plant.get_actuation_input_port(robot.instance))
    stops = add_joint_stops(
        builder, plant, stiffness=config.joint_stops.stiffness, damping=config.joint_stops.damping
    )
    if stops is not None:
        builder.Connect(stops, plant.get_applied_generalized_force_input_port())
    simulator = Simulator(builder.Build())
    apply_solver(simulator, config)
    began = time.perf_counter()
    simulator.AdvanceTo(1.0)  # a step must end at the corner of the ramp
    simulator.AdvanceTo(config.duration)
    return time.perf_counter() - began
