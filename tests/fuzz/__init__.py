"""Hostile input, made from a seed and given to the command line: each case ends with an exit code and one line."""
