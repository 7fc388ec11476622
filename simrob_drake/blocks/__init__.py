"""The blocks of a station, one concept a file: Drake's primitives wired together, and a few in Python."""
