"""Constants that several modules need."""

STANDARD_GRAVITY = 9.80665
"""Of ISO 80000-3 [m/s²]; the value of the Simulink library."""

LARGEST_GAIN = 1e9
"""Largest gain that a servo accepts, in its own units. Ten times the stiffness of a hydraulic cylinder; with larger
values the solvers take very small steps."""
