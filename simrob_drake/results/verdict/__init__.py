"""What was asked of a run against what became of it: figures, and which of them pass their bounds."""
