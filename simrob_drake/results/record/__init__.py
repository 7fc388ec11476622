"""What a run recorded: states, signals, measures."""
