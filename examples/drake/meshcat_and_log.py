"""A station with Drake's own tools: Meshcat shows and records it, and a VectorLogSink keeps a signal."""

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, MeshcatVisualizer
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from simrob_drake import add_station, apply_solver

meshcat = Meshcat(MeshcatParams(host="localhost"))
builder = DiagramBuilder()
ports = add_station(builder, "irb120_dynamic")
target = builder.AddSystem(ConstantVectorSource(np.full(6, 0.3)))  # rad
builder.Connect(target.get_output_port(), ports.inputs["reference"])
log = LogVectorOutput(ports.outputs["torque"], builder, publish_period=0.01)
visualizer = MeshcatVisualizer.AddToBuilder(builder, ports.plant.scene_graph, meshcat)
simulator = Simulator(builder.Build())
apply_solver(simulator, ports.config)
visualizer.StartRecording()
simulator.AdvanceTo(1.0)
visualizer.PublishRecording()
torques = log.FindLog(simulator.get_context()).data()
print("at most", np.abs(torques).max().round(1), "N·m; watch it at", meshcat.web_url())
