"""A run in motion: recording, film strip, video, live view."""
