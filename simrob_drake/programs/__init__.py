"""Programs: moves given to a robot, and the kinematics under them."""
