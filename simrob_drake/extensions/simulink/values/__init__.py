"""Values of MATLAB expressions, units and workspaces."""
