"""What a robot is: its model files, axes and tools, and the pieces that it carries."""
