"""The step sequence of the humanoid in MuJoCo, stepped in C, with settings to choose from.

What the settings mean is told in MuJoCo's documentation, under "Model tuning" and "Numerical integration".
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import product

import mujoco
import numpy as np
from mujoco import rollout

from simrob_drake.base.frames import Vector
from simrob_drake.blocks.references import reference_values
from simrob_drake.extensions.mujoco.built import BuiltStation
from simrob_drake.stations.closed import station_references
from simrob_drake.stations.config import StationConfig
from tests.benchmarks.stepping import SAMPLES, Motion


@dataclass(frozen=True)
class Contact:
    """How hard a contact is: MuJoCo's ``solref`` and the two impedances of ``solimp``."""

    name: str
    solref: tuple[float, float] = (0.02, 1.0)
    impedance: tuple[float, float] = (0.9, 0.95)


DEFAULT = Contact("default")
CONTINUOUS = "implicitfast", "implicit", "Euler"
"""Integrators that find the forces of contacts first, and treat servos implicitly afterwards, or not at all."""


@dataclass(frozen=True)
class Settings:
    """What can be chosen of MuJoCo without changing the robot; those of the search come first."""

    step: float
    contact: Contact = DEFAULT
    friction_ratio: float = 1.0
    integrator: str = "discrete"
    solver: str = "Newton"
    cone: str = "elliptic"
    tolerance: float = 1e-8
    exact_diagonal: bool = False
    """Whether the softness of a contact is made with the inertia of the posture, or with that of the model's home."""

    def __str__(self) -> str:
        parts = [
            f"{self.integrator} {1e3 * self.step:g} ms",
            f"contact {self.contact.name}",
            f"impratio {self.friction_ratio:g}",
            f"tolerance {self.tolerance:g}",
            *(part for part in (self.solver, self.cone) if part not in ("Newton", "elliptic")),
            *(["diagexact"] if self.exact_diagonal else []),
        ]
        return ", ".join(parts)


class MujocoHumanoid:
    """The robot of a station in MuJoCo, with the station's reference."""

    def __init__(self, config: StationConfig) -> None:
        built = BuiltStation.of(config)
        (self.robot,) = built.ports.plant.robots.values()
        self._course = station_references(built.station)[self.robot.name]
        self.duration = config.duration
        self._spec = built.spec
        self._references: dict[float, Vector] = {}

    def contact_like_drake(self, impedance: float) -> Contact:
        """Return a critically damped contact as stiff as that of the plant's feet.

        ``solref`` asks for the acceleration x / timeconst² of a contact pressed in by x, and the impedance d makes of
        it the force x / timeconst² / (1 - d) / w, where w is the inverse weight that MuJoCo takes for a foot.
        """
        model = self._spec.compile()
        inverse_weight = model.body(self.robot.feet.links[0]).invweight0[0]
        timeconst = (self.robot.feet.stiffness * (1 - impedance) * inverse_weight) ** -0.5
        return Contact(
            f"k of ours, d {impedance:g}", (float(timeconst), 1.0), (impedance, impedance)
        )

    def run(self, settings: Settings, repeats: int = 1) -> Motion:
        """Step the sequence; its time is that spent in MuJoCo's own loop, the median of ``repeats``."""
        model = self._spec.compile()
        _apply(model, settings)
        data = mujoco.MjData(model)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, start, kind)
        controls = self._controls(settings.step)[np.newaxis]
        states = np.zeros((1, controls.shape[1], len(start)))
        seconds = []
        with rollout.Rollout(nthread=0) as loop:
            for _ in range(repeats):
                began = time.perf_counter()
                loop.rollout(model, data, start[np.newaxis], controls, state=states)
                seconds.append(time.perf_counter() - began)
        return self._motion(
            model, np.vstack([start, states[0]]), settings.step, float(np.median(seconds))
        )

    def _controls(self, step: float) -> Vector:
        """Return the references at the ends of the steps, where servos that are treated implicitly act."""
        if step not in self._references:
            ends = step * np.arange(1, round(self.duration / step) + 1)
            self._references[step] = reference_values(self._course, ends)
        return self._references[step]

    def _motion(self, model: mujoco.MjModel, states: Vector, step: float, seconds: float) -> Motion:
        times = step * np.arange(len(states))
        positions = states[:, 1 : 1 + model.nq]
        joints = [model.joint(joint.name()).qposadr[0] for joint in self.robot.joints]
        even = np.column_stack([np.interp(SAMPLES, times, column) for column in positions.T])
        return Motion(even[:, :7], even[:, joints] * self.robot.axis_map.signs, seconds, seconds)


def _apply(model: mujoco.MjModel, settings: Settings) -> None:
    option = model.opt
    option.timestep, option.tolerance, option.impratio = (
        settings.step,
        settings.tolerance,
        settings.friction_ratio,
    )
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{settings.integrator.upper()}")
    option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{settings.solver.upper()}")
    option.cone = getattr(mujoco.mjtCone, f"mjCONE_{settings.cone.upper()}")
    # the same figures as dense, a fifth quicker here
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    off = (
        mujoco.mjtDisableBit.mjDSBL_ISLAND,
        mujoco.mjtDisableBit.mjDSBL_SENSOR,
        mujoco.mjtDisableBit.mjDSBL_AUTORESET,
    )
    option.disableflags = sum(map(int, off))  # one robot is one island: a tenth quicker
    option.enableflags = settings.exact_diagonal * int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
    model.pair_solref[:], model.pair_solreffriction[:] = settings.contact.solref, 0.0
    model.pair_solimp[:, :2] = settings.contact.impedance


def candidates(ours: list[Contact]) -> list[Settings]:
    """Return the settings that the search tries.

    Args:
        ours: contacts as stiff as those of the plant; others are MuJoCo's default and what its guide recommends.
    """
    softer = [Contact(f"solref {constant:g}", (constant, 1.0)) for constant in (0.015, 0.01, 0.005)]
    tried = []
    for step, contact in product((5e-3, 6e-3, 7.5e-3, 8e-3, 1e-2), (DEFAULT, *softer, *ours)):
        for ratio in (1.0, 10.0, 100.0):
            usual = Settings(step, contact, ratio)
            exact = replace(usual, exact_diagonal=True)
            tried += [usual, exact, replace(exact, tolerance=1e-4)]
        tried.append(replace(exact, friction_ratio=10.0, solver="CG"))
        # the guide wants no other ratio with it
        tried.append(replace(exact, friction_ratio=1.0, cone="pyramidal"))
    for step, contact, integrator in product(
        (5e-3, 2e-3, 1e-3, 1e-4), (DEFAULT, ours[0]), CONTINUOUS
    ):
        tried.append(Settings(step, contact, 30.0, integrator=integrator))
    return [*tried, Settings(5e-5, ours[0], 30.0, integrator="implicitfast")]
