"""What robots of a station are told to do: moves, gaits and programs, and the kinematics under them."""
