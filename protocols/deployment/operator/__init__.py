"""The person who calls plays, and what stands in for one in a run without a person (paper 004, sections 3 to 5).

Begin with ``console``: requests and answers at a robot's console, as JSON. ``page`` names the web page that speaks to
it, whose files are in ``static``. ``calls`` makes the calls that a scenario plans in advance.

Both make their plans by ``planning``, which asks the planner with what the host knows of the team.
"""
