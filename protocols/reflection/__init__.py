"""Local navigation by goal reflection (paper 000): robots that see each other promise each other ways to their goals.

Begin with ``machine``: at each tick a robot looks, chooses where to go and broadcasts, and between ticks it takes what
others send (``frames``) into its book of ``goals`` (rules 1 and 2) and its ``promises`` (rules 3 and 4).

- A robot with goals goes by ``seeking`` (rule 5): straight to what it sees or was promised (``straight``), else by the
  algorithm A (``guidance``), and out of ``trouble`` behind a helper (section 5).
- A robot without goals goes by ``patrolling``; both make way for others by ``yielding``.
- ``setup`` holds tasks and targets, ``spec`` what cosim must know and the referee, ``events`` what machines report.
"""
