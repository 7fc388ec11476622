"""A model with its libraries put in: every block with its workspace, physical nodes and signal sources."""
