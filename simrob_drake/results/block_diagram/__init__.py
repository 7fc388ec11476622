"""The block picture of a station."""
