"""Driving of one robot of a deployment, on top of :mod:`protocols.motion` (paper 004, section 6).

Begin with ``mover``: to a goal, past other robots, with a right of way. ``yielding`` finds a place out of another's
way. ``twin`` computes what the robot would do without the others, for the measure of interference.

``exploring`` runs the exploration protocol within a deployment; ``exploring_mover`` is a mover that it can lead,
``exploring_parameters`` what a scenario can say about it, and ``learned`` the floor that robots have learned so.
"""
