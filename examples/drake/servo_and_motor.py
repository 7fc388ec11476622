"""Servos with motors on a plant of your own, without any station: an arm of seven joints, as large as an iiwa."""

from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from simrob_drake import Motor, add_joint_servos

builder = DiagramBuilder()
plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
end = plant.world_frame()
for number in range(1, 8):  # links of 0.18 m and 4 kg, whose joints turn about z and y alternately
    link = plant.AddRigidBody(str(number), SpatialInertia.SolidCylinderWithMassAboutEnd(4.0, 0.06, 0.18, [0, 0, 1]))
    joint = plant.AddJoint(RevoluteJoint(f"joint_{number}", end, link.body_frame(), [0, 1 - number % 2, number % 2]))
    plant.AddJointActuator(f"motor_{number}", joint, 300.0)  # N·m
    end = plant.AddFrame(FixedOffsetFrame(f"end_{number}", link, RigidTransform([0, 0, 0.18])))
plant.Finalize()
servos = add_joint_servos(builder, plant, kp=4e3, kd=2e2, motor=Motor(stall_torque=300.0, no_load_speed=1.5))
builder.ExportInput(servos.reference, "reference")
simulator = Simulator(builder.Build())
simulator.get_system().get_input_port().FixValue(simulator.get_mutable_context(), [0.5] * 7)
simulator.AdvanceTo(2.0)
print("joints [rad]:", plant.GetPositions(plant.GetMyContextFromRoot(simulator.get_context())).round(3))
