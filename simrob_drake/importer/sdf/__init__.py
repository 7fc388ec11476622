"""SDF, the format of Gazebo: read with the models that it includes, and written as a robot's element."""
