"""A discrete-event co-simulator: robots' motion and their radios' slots on one clock of integer nanoseconds.

Where to begin: ``cosim.scenario.load`` reads what a run is to be, ``cosim.simulation.simulate`` makes it, and
``cosim.cli`` is the command line. Below them, from the bottom up: ``units`` and ``randomness``; ``machine``, the
contract of what robots run, and ``protocol``, how such a thing introduces itself; ``kernel`` and ``trace``; the rooms
``world``, ``robots`` and ``channels``; ``node``, which joins one machine to its body and its radio. Above them:
``sweep``, ``results`` and ``report`` for thousands of runs, ``export`` for Wireshark, ``web`` for the browser, and
``testing``, the laws that every machine keeps. Nothing here knows a protocol or an experiment by name.
"""

__version__ = "0.2.0"
