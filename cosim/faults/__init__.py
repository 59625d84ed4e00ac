"""Faults of a run: robots that die, crash, freeze or are carried, radios and cameras that fail, jammers and walls.

``settings`` is what a scenario can ask for, and where to begin; docs/faults.md describes it for users.
``course.Faults`` carries the faults of a run out, with batteries; ``air`` those that belong to no robot. ``instants``
draws when a fault begins and ends, and keeps the agenda. ``events`` has the rows that faults leave in the table of
events.
"""
