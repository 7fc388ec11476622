"""Drake's scene files: model directives and scenarios become stations, and stations become such files."""
