"""The floor of a run: walls and obstacles as they are, which no robot knows.

``floorplan`` is where to begin: it loads what a scenario names and gives it to all others, as shapely geometry and as
arrays for kernels. ``maps`` reads ROS and MovingAI maps and turns occupied cells into walls, ``offices`` generates
floors. ``sight`` looks for lines of sight and for the walls that a signal crosses.
"""
