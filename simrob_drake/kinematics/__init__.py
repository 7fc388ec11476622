"""Kinematics of a robot: its chain of joints, forward, and inverse by four solvers with one interface."""

from simrob_drake.kinematics.analytic import AnalyticSolver
from simrob_drake.kinematics.chain import Chain
from simrob_drake.kinematics.constrained import ConstrainedSolver
from simrob_drake.kinematics.errors import NoClosedForm, Unreachable, UnsupportedChain
from simrob_drake.kinematics.goals import (
    Aiming,
    DistanceBounds,
    JointBounds,
    OrientationCone,
    PositionBounds,
)
from simrob_drake.kinematics.incremental import IncrementalSolver
from simrob_drake.kinematics.numeric import NumericSolver
from simrob_drake.kinematics.poses import Targets, pose_errors, pose_matrices
from simrob_drake.kinematics.registry import make_solver
from simrob_drake.kinematics.solutions import Solutions, require
from simrob_drake.kinematics.solver import Solver

__all__ = [
    "Aiming",
    "AnalyticSolver",
    "Chain",
    "ConstrainedSolver",
    "DistanceBounds",
    "IncrementalSolver",
    "JointBounds",
    "NoClosedForm",
    "NumericSolver",
    "OrientationCone",
    "PositionBounds",
    "Solutions",
    "Solver",
    "Targets",
    "Unreachable",
    "UnsupportedChain",
    "make_solver",
    "pose_errors",
    "pose_matrices",
    "require",
]
