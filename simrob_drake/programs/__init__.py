"""What is done with robots and stations: moves and the kinematics under them, figures found from measurements."""
