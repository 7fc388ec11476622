"""What the pendant shows: a shell that all share, and a tab for each kind of use."""
