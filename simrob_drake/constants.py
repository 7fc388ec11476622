"""Figures of nature that several modules need."""

STANDARD_GRAVITY = 9.80665
"""Of ISO 80000-3 [m/s²]; the value of the Simulink library."""
