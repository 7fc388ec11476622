"""From the files that MATLAB writes to a graph of blocks; nothing in them is executed."""
