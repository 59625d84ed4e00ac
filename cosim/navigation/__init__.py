"""Navigation algorithms of one robot: pure functions of pose, velocity, goal, scan or map, and memory.

Local navigation: ``steering`` has the contract (``Navigator``) and the potential field and Avoid Past that fulfil it;
``bug2`` and ``visbug`` follow boundaries, ``vfh`` and ``dwa`` choose among free directions and velocities. ``schemas``
and ``frontier_fields`` are the motor schemas of paper 001, ``past`` the memory of Avoid Past, ``status`` what a step
may come to.

Position: ``localization`` is Monte Carlo localisation on a known map, ``slam`` makes the map as well, ``feature_slam``
one of the corners and walls that ``features`` finds in scans. Nothing here knows the simulator, so that a robot's body
and a protocol's machine can both use it. ``steering`` is where to begin.
"""
