"""From what was read of a model to robots, pieces and a station on disk."""
