"""A monitor in a diagram of your own: it ends the run when a pendulum has been too far for a fifth of a second."""

from pydrake.examples import PendulumPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from simrob_drake import add_monitor

builder = DiagramBuilder()
pendulum = builder.AddSystem(PendulumPlant())
torque = builder.AddSystem(ConstantVectorSource([3.0]))  # N·m
builder.Connect(torque.get_output_port(), pendulum.get_input_port())
add_monitor(
    builder,
    {"state": pendulum.get_state_output_port()},
    excess=lambda state: float(state[0]) - 0.8,  # the condition holds where this is not negative
    why=lambda state: f"the pendulum is at {state[0]:.2f} rad",
    hold=0.2,  # s
)
simulator = Simulator(builder.Build())
status = simulator.AdvanceTo(10.0)
print(status.reason().name, f"at {simulator.get_context().get_time():.2f} s:", status.message())
