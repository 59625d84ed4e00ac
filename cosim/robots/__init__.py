"""The bodies of a run: where they start, how they move, what they touch and what they sense.

``motion.Fleet`` is where to begin: all bodies in one array (``table`` names its rows), one kernel call a world tick,
which brakes under the limits of the drives and is cut at walls and bodies (``contact``). ``body`` has the settings of
a body, ``placement`` checks places before anything moves. ``senses`` makes each robot's observation, in its own frame
and with its sensors' errors, by ``sense_kernels``.
"""
