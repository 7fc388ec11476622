"""A walk that is made while it goes: footsteps, pendulum and legs, from a command and from what the robot does.

Places on the ground are complex numbers, x + iy [m]: ahead and to the left, seen from the foot that stands.
"""
