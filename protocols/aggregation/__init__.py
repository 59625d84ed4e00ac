"""Aggregation: hosts lead sub-teams of searchers to targets and aggregate what they find.

The system of paper 002 (Meng, Nickerson and Gan). ``spec`` names it to cosim and makes the machines. There are two:

- ``host``: sends heartbeats, leads a ``subteam`` and shares its findings with its ``neighbours``, the other hosts;
  ``strategies`` decides where it goes, ``itinerary`` keeps the way that it has announced (a ``course``);
- ``searcher``: a state table; it visits posts (``touring``), reports its ``findings``, and finds its host again or,
  when that has failed, another (``rendezvous``).

``roster`` holds who belongs to which sub-team. ``messages``, ``frames`` and ``radio`` are what they send, as values, as
bytes and by which radio. ``ground``, ``ground_posts`` and ``tours`` divide the floor; ``walking`` moves a body over it,
past others. ``setup`` is what all robots know before the run.
"""
