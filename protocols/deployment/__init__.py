"""Deployments (paper 004): a person calls a play, and a team of different robots plans it and carries it out.

Begin with ``runner``, the machine of one robot, which joins the packages; ``spec`` names it to cosim. In order:

- ``tasks``: the vocabulary: plans, orders, facts and events;
- ``planning``: plays, and the planner that makes a plan of a call or refuses it;
- ``executing``: the executive that dispatches a plan's tasks, by the facts that are known;
- ``driving``: driving to a goal past other robots, and exploring;
- ``messages``: what robots send each other, as JSON or, the periodic status, as a short frame;
- ``team``: the log of the plan on every robot, and who leads; ``member``: how one robot carries out its orders;
- ``operator``: the console of the person, and the calls that a scenario makes in advance.

``parameters`` and ``setup`` hold what is known before the run, ``counters`` what a robot counts, ``referee`` the truth.
Where a robot takes itself to be is :mod:`protocols.localization`.
"""
