"""Gaits: from a few figures to the joint angles of a legged robot over time, by kinematics and linear dynamics."""
