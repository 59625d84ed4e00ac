"""The pose of one robot in the frame of the map (paper 004, section 6: "Markov localization"; paper 002, VII.B).

Begin with ``positioning``: the pose is given, or estimated by a Monte Carlo filter
(:mod:`cosim.navigation.localization`). ``scan`` turns range readings from the robot's frame to that of the map.
What a scenario can say about all this, and the known floor as cells, stand there, too. ``aiming`` sends the robot to
places of the map by the estimate of the moment.
"""
