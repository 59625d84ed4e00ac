"""How one robot gets over a known floor past other robots. It knows neither plays nor messages.

Begin with ``floor``: the known map as value-iteration fields, one for each goal and radius. ``driver`` holds how the
robot moves, and chooses its next motion by DWA (:mod:`cosim.navigation.dwa`). ``traffic`` tracks the other robots.

``frames`` keeps corrections of a pose estimate apart from motion. ``progress`` tells whether a drive gets anywhere.
``parameters`` is what a scenario can say about driving.
"""
