"""Linear models of stations about a posture: poles, Bode plots, and what a design of controllers starts from."""

from simrob_drake.extensions.linear.linearize import linearize as linearize
from simrob_drake.extensions.linear.model import LinearModel as LinearModel
from simrob_drake.extensions.linear.model import Mode as Mode
