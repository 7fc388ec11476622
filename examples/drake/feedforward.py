"""A station in a diagram of your own: a LeafSystem adds the torques that hold the arm against gravity."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import Dynamics, add_station, simulate_diagram


class Gravity(LeafSystem):
    def __init__(self, arm: Dynamics) -> None:
        super().__init__()
        q = self.DeclareVectorInputPort("position", 6)
        self.DeclareVectorOutputPort("torque", 6, lambda context, out: out.SetFromVector(arm.gravity(q.Eval(context))))


builder = DiagramBuilder()
ports = add_station(builder, "irb120_dynamic", overrides={"inputs": ["feedforward"], "pieces": {}})
gravity = builder.AddSystem(Gravity(Dynamics.of_robot("irb120")))
target = builder.AddSystem(ConstantVectorSource(np.full(6, 0.2)))  # rad
builder.Connect(target.get_output_port(), ports.inputs["reference"])
builder.Connect(ports.outputs["position"], gravity.GetInputPort("position"))
builder.Connect(gravity.GetOutputPort("torque"), ports.inputs["feedforward"])
result = simulate_diagram(builder.Build(), ports, duration=2.0)
print("off by", np.abs(result.axes("q")[-1] - 0.2).max().round(6), "rad")
