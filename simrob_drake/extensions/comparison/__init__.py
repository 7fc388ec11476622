"""One run of a station told by several engines, with how sure each of them is."""
