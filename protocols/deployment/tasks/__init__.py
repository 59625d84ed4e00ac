"""The vocabulary of a deployment, which planner, executive and robots share. It depends on no other package of it.

Begin with ``plan``: a net of tasks with temporal constraints, as the planner sends it. An executive turns its tasks
into ``orders``, and robots answer with reports. What has happened to a plan is a set of ``facts``.

``constraints`` are temporal constraints as people write them; ``stn`` is the network that they and the tasks make, and
says what is possible in it, both before a plan begins and under way. ``crew`` has the team's bodies, and what plans ask
of a map; ``events`` the rows of the trace.
"""
