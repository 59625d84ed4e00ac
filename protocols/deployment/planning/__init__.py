"""From a play that is called to a plan, or to a refusal with its reasons (paper 004, section 4).

Begin with ``planner``, which does this in steps:

- ``play`` models a play in YAML, ``playbook`` holds the tree of plays, ``binding`` the values of a play's parameters;
- ``casting`` makes tasks of a play; ``roles`` assigns robots to its roles, at the least cost by ``routes``;
- ``timing`` estimates how long tasks take, and makes the temporal network of a plan (``tasks.stn``);
- ``mending`` tries changes of a call that is infeasible.

``methods`` and ``staging`` make the stages of a deployment (Fig. 3), at its start and under way; ``augmenting`` keeps
its robots out of each other's way. The executive uses these three too.
"""
