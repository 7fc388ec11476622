"""What is done with robots and stations: moves, and figures found from measurements."""
