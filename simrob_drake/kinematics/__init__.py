"""Kinematics of a robot: its chain of joints, forward, and inverse by four solvers with one interface."""

from simrob_drake.base.frames import Targets as Targets
from simrob_drake.base.frames import pose_errors as pose_errors
from simrob_drake.base.frames import pose_matrices as pose_matrices
from simrob_drake.kinematics.analytic import AnalyticSolver as AnalyticSolver
from simrob_drake.kinematics.chain import Chain as Chain
from simrob_drake.kinematics.chain import UnsupportedChain as UnsupportedChain
from simrob_drake.kinematics.closed_form import NoClosedForm as NoClosedForm
from simrob_drake.kinematics.constrained import ConstrainedSolver as ConstrainedSolver
from simrob_drake.kinematics.every_branch import branches as branches
from simrob_drake.kinematics.goals import Aiming as Aiming
from simrob_drake.kinematics.goals import DistanceBounds as DistanceBounds
from simrob_drake.kinematics.goals import JointBounds as JointBounds
from simrob_drake.kinematics.goals import OrientationCone as OrientationCone
from simrob_drake.kinematics.goals import PositionBounds as PositionBounds
from simrob_drake.kinematics.incremental import IncrementalSolver as IncrementalSolver
from simrob_drake.kinematics.numeric import NumericSolver as NumericSolver
from simrob_drake.kinematics.registry import make_solver as make_solver
from simrob_drake.kinematics.solver import Solutions as Solutions
from simrob_drake.kinematics.solver import Solver as Solver
from simrob_drake.kinematics.solver import Unreachable as Unreachable
from simrob_drake.kinematics.solver import require as require
