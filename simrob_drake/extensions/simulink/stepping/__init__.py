"""Stations that are stepped from outside: their numbers by name, their parameters, and a server."""
