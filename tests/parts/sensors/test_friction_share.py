"""Friction of a force sensor under ``cenic``: that of its model, times the sensor's share of the normal load."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.geometry import Box, HalfSpace
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.blocks.contacts import Contacts
from simrob_drake.parts.sensors.shapes import MomentumBalance

MASS = 8.0  # kg
GRAVITY = 9.81  # m/s²
WEIGHT = MASS * GRAVITY  # N
FRICTION = 0.25  # coefficient
STEP = 0.01  # s
LEFT_SHARE = 0.75  # part of the weight on the left pad


class SlidingSledge:
    """A sledge on two pads that slides along x on the floor, and is braked by friction during one step.

    It has the attributes of a site and of a run that `MomentumBalance` reads: the plant, and its contacts and states.
    """

    def __init__(self, left_share: float):
        builder = DiagramBuilder()
        self.multibody, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        self.multibody.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
        sledge = self.multibody.AddRigidBody(
            "sledge", SpatialInertia.SolidBoxWithMass(MASS, 0.4, 0.4, 0.4)
        )
        material = CoulombFriction(FRICTION, FRICTION)
        pads = {"left": [0.0, 0.1, -0.2], "right": [0.0, -0.1, -0.2]}
        self.shapes = {
            name: self.multibody.RegisterCollisionGeometry(
                sledge, RigidTransform(place), Box(0.1, 0.05, 0.01), name, material
            )
            for name, place in pads.items()
        }
        world = self.multibody.world_body()
        floor = self.multibody.RegisterCollisionGeometry(
            world, RigidTransform(), HalfSpace(), "floor", material
        )
        self.multibody.Finalize()

        self.plant = SimpleNamespace(plant=self.multibody, scene_graph=scene_graph)
        self.state = self.multibody.get_state_output_port()
        self.step_times = np.array([0.0, STEP])
        self.memo = {}
        loads = np.array([left_share, 1.0 - left_share]) * WEIGHT
        self._contacts = Contacts(
            pairs=[(self.shapes["left"], floor), (self.shapes["right"], floor)],
            points=np.zeros((2, 3)),
            forces=np.column_stack([np.zeros((2, 2)), loads]),
            moments=np.zeros((2, 3)),
            normals=np.array([[0.0, 0.0, 1.0]] * 2),
        )

    def sample(self, ports, times):
        """Values of ports at times of the run: contacts, or states in which friction has braked the sledge."""
        (port,) = ports
        if port is not self.state:
            return [[self._contacts for _ in times]]
        states = np.zeros((len(times), self.multibody.num_multibody_states()))
        states[:, 0] = 1.0  # the unit quaternion
        states[:, self.multibody.num_positions() + 3] = 2.0 - FRICTION * GRAVITY * times
        return [states]

    def force_on(self, pad: str):
        """Force on a pad at the end of the step, shape (3,) [N], with the estimated friction."""
        frame = self.multibody.world_frame()
        balance = MomentumBalance(self, frame, body=[self.shapes[pad]], other=None)
        is_left = pad == "left"
        normal_force = self._contacts.forces[0 if is_left else 1]
        return balance.with_friction(self, np.array([STEP]), normal_force[np.newaxis])[0]


@pytest.mark.parametrize("left_share", [LEFT_SHARE, 0.5, 0.1])
def test_each_pad_gets_the_friction_in_proportion_to_its_load(left_share):
    """Coulomb's law holds at each pad: its friction is the coefficient times its own normal force."""
    sledge = SlidingSledge(left_share)

    left = sledge.force_on("left")
    right = sledge.force_on("right")

    friction = -FRICTION * WEIGHT
    assert left == pytest.approx([left_share * friction, 0.0, left_share * WEIGHT], abs=1e-9)
    assert right == pytest.approx(
        [(1 - left_share) * friction, 0.0, (1 - left_share) * WEIGHT], abs=1e-9
    )


def test_the_shares_of_all_pads_add_up_to_the_friction_of_the_model():
    """No friction is lost or counted twice: the sum is the force that brakes the sledge."""
    sledge = SlidingSledge(LEFT_SHARE)

    total = sledge.force_on("left") + sledge.force_on("right")

    assert total == pytest.approx([-FRICTION * WEIGHT, 0.0, WEIGHT], abs=1e-9)


def test_a_pad_without_load_gets_no_friction():
    """A sensor at a shape that touches nothing measures no force, however large the model's friction is."""
    sledge = SlidingSledge(left_share=1.0)

    force = sledge.force_on("right")

    assert force == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_normal_forces_that_cancel_have_no_normal():
    """Two fingers that clamp a part push on it with opposite forces. All other force on it counts as friction."""
    sledge = SlidingSledge(left_share=0.5)
    sledge._contacts.forces[:] = [[0.0, 0.0, 100.0], [0.0, 0.0, -100.0]]

    force = sledge.force_on("left")

    assert force == pytest.approx([-0.5 * FRICTION * WEIGHT, 0.0, 100.0 + 0.5 * WEIGHT], abs=1e-9)
