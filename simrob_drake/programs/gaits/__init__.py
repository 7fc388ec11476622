"""Gaits: from a few parameters to the joint angles of a legged robot over time, by kinematics and linear dynamics."""
