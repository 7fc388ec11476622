"""Mesh files: found, checked, read in any format, mended, and written as OBJ."""
