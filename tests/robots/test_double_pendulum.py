"""The double pendulum against closed forms: plates with a hole and a peg, and the energy of two links."""

import runpy
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.base.files import models_root
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes

GRAVITY = 9.80665
WIDTH, THICKNESS, PEG = 0.02, 0.005, 0.005  # m; the peg's radius is also the hole's


@dataclass(frozen=True)
class Plate:
    """A stadium plate with a hole at one end and a peg, twice as long as the plate is thick, at the other."""

    length: float  # from hole to peg [m]
    density: float  # kg/m^3

    @property
    def parts(self) -> list[tuple[float, float, float]]:
        """Mass [kg], place along the plate from the hole [m] and own moment about the plate's normal [kg m^2]."""
        radius, sheet = WIDTH / 2, self.density * THICKNESS
        middle = sheet * self.length * WIDTH
        # a half disc and its centroid
        end, off = (
            sheet * np.pi * radius**2 / 2,
            4 * radius / (3 * np.pi),
        )
        about_centroid = end * radius**2 / 2 - end * off**2
        hole = -sheet * np.pi * PEG**2
        peg = self.density * np.pi * PEG**2 * 2 * THICKNESS
        return [
            (middle, self.length / 2, middle * (self.length**2 + WIDTH**2) / 12),
            (end, -off, about_centroid),
            (end, self.length + off, about_centroid),
            (hole, 0.0, hole * PEG**2 / 2),
            (peg, self.length, peg * PEG**2 / 2),
        ]

    @property
    def mass(self) -> float:
        return sum(mass for mass, _, _ in self.parts)

    @property
    def com(self) -> float:
        return sum(mass * place for mass, place, _ in self.parts) / self.mass

    @property
    def moment(self) -> float:
        return sum(own + mass * (place - self.com) ** 2 for mass, place, own in self.parts)


UPPER, LOWER = Plate(length=0.14, density=1000), Plate(length=0.20, density=1200)


def energy(q: np.ndarray, v: np.ndarray) -> tuple[float, float]:
    """Return kinetic and potential energy [J], the latter from the upper joint."""
    (a, b), (w, turn) = q, (v[0], v[0] + v[1])
    speed2 = (
        (UPPER.length * w) ** 2
        + (LOWER.com * turn) ** 2
        + 2 * UPPER.length * LOWER.com * w * turn * np.cos(b)
    )
    kinetic = (
        (UPPER.moment + UPPER.mass * UPPER.com**2) * w**2
        + LOWER.moment * turn**2
        + LOWER.mass * speed2
    )
    height = -UPPER.mass * UPPER.com * np.cos(a)
    height -= LOWER.mass * (UPPER.length * np.cos(a) + LOWER.com * np.cos(a + b))
    return kinetic / 2, GRAVITY * height


@pytest.fixture
def pendulum() -> MultibodyPlant:
    model = load_robot("double_pendulum")
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -GRAVITY]))
    robot = with_absolute_meshes(model.element, model.folder)
    add_urdf(plant, robot, name="robot", where="double_pendulum.urdf", collision=False)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(model.root))
    plant.Finalize()
    return plant


@pytest.mark.parametrize(("link", "plate"), [("upper_link", UPPER), ("lower_link", LOWER)])
def test_links_are_plates_with_a_hole_and_a_peg(
    pendulum: MultibodyPlant, link: str, plate: Plate
) -> None:
    inertia = pendulum.GetBodyByName(link).default_spatial_inertia()
    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()

    # the URDF has seven digits
    assert inertia.get_mass() == pytest.approx(plate.mass, rel=1e-6)
    assert inertia.get_com()[0] == pytest.approx(plate.com, rel=1e-6)
    assert about_com[2, 2] == pytest.approx(plate.moment, rel=1e-6)


def test_masses_are_those_of_the_original(pendulum: MultibodyPlant) -> None:
    assert pendulum.GetBodyByName("upper_link").default_mass() == pytest.approx(0.015963, abs=5e-7)
    assert pendulum.GetBodyByName("lower_link").default_mass() == pytest.approx(0.026356, abs=5e-7)


@pytest.mark.parametrize("seed", range(10))
def test_energy_is_that_of_two_links(pendulum: MultibodyPlant, seed: int) -> None:
    random = np.random.default_rng(seed)
    q, v = random.uniform(-np.pi, np.pi, 2), random.uniform(-5, 5, 2)
    context, hanging = pendulum.CreateDefaultContext(), pendulum.CreateDefaultContext()
    pendulum.SetPositions(context, q)
    pendulum.SetVelocities(context, v)
    kinetic, potential = energy(q, v)

    raised = pendulum.CalcPotentialEnergy(context) - pendulum.CalcPotentialEnergy(hanging)

    assert pendulum.CalcKineticEnergy(context) == pytest.approx(kinetic, rel=1e-5)
    assert raised == pytest.approx(potential - energy(np.zeros(2), np.zeros(2))[1], rel=1e-5)


def test_both_joints_turn_about_minus_y_and_the_links_hang_at_zero(
    pendulum: MultibodyPlant,
) -> None:
    context = pendulum.CreateDefaultContext()
    tip, hinge = pendulum.GetFrameByName("tip"), pendulum.GetFrameByName("upper_link")

    below = (
        tip.CalcPoseInWorld(context).translation() - hinge.CalcPoseInWorld(context).translation()
    )

    np.testing.assert_allclose(below[[0, 2]], [0, -0.34], atol=1e-12)

    pendulum.SetPositions(context, [np.pi / 2, 0])
    beside = (
        tip.CalcPoseInWorld(context).translation() - hinge.CalcPoseInWorld(context).translation()
    )

    np.testing.assert_allclose(beside[[0, 2]], [0.34, 0], atol=1e-12)


def test_the_mesh_is_what_the_script_makes(tmp_path: Path) -> None:
    folder = models_root() / "double_pendulum"
    script = shutil.copy(folder / "make_meshes.py", tmp_path)

    runpy.run_path(str(script), run_name="__main__")

    assert (tmp_path / "base.obj").read_bytes() == (folder / "base.obj").read_bytes()
