"""The executive: it dispatches a plan's tasks to robots and re-plans where robots are lost (paper 004, section 5).

Begin with ``executive``: it takes facts and gives orders. What it wants of the robots follows from ``progress``, which
runs the plan's task ``tree`` up to a given instant, and which can be computed again when a fact arrives late.

``timetable`` says what the temporal constraints allow under way, ``recovery`` reassigns the posts and roles of lost
robots, and ``making_room`` has deployed robots step aside for a robot that leaps past them.
"""
