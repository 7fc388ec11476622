"""Many runs of a station, on many processes: sweeps, and searches for figures that cost least."""
