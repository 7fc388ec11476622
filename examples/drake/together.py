"""Two stations in one builder, each with a world of its own, and two in one plant, where the arms hit each other."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import add_station, add_world, load_station, place_station, simulate_diagram

arm = load_station("irb120_dynamic", {"contact": {}, "servo.realization": "implicit", "solver": {"kind": "discrete"}})
builder = DiagramBuilder()
plant, scene_graph = add_world(builder, arm)
turning = place_station(plant, arm, scene_graph=scene_graph, name="turning")
hit = place_station(plant, arm, scene_graph=scene_graph, name="hit", overrides={"robot.base": [0, 0.5, 0, 0, 0, 0]})
plant.Finalize()
stations = {placed.name: placed.wire(builder) for placed in (turning, hit)}
stations |= {name: add_station(builder, arm, name=name) for name in ("alone", "beside")}
for name, ports in stations.items():
    angle = 1.5 if name in ("turning", "alone") else 0.0  # of joint 1 [rad]
    source = builder.AddSystem(ConstantVectorSource(angle * np.eye(6)[0]))
    builder.Connect(source.get_output_port(), ports.inputs["reference"])
diagram = builder.Build()
for name, ports in stations.items():
    print(name, "ends at", simulate_diagram(diagram, ports, duration=0.5)["q.joint_1"][-1].round(2), "rad")
