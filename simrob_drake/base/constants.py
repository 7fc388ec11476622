"""Constants that several modules need."""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²], ISO 80000-3. The Simulink library of the thesis has the same value."""

LARGEST_GAIN = 1e9
"""Largest gain that a servo accepts, in its own units. Ten times the stiffness of a hydraulic cylinder; with larger
values the solvers take very small steps."""
