"""Programs: what robots are told to do, planned before they move."""
