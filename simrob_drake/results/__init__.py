"""What a run leaves behind: recorded states, signals, pictures and files."""
