"""How a team stays one: every robot has a replica of its log, one leads, and what was parted merges again.

Read in this order:

* ``ledger``: a plan and the facts about it, a set that only grows; what another robot lacks of it by its status.
* ``replica``: the log on one robot, and its part in electing the leader: terms, states, inputs and actions in one
  table. It takes statuses and messages and leaves messages and changes; it runs nothing.
* ``host``: what a robot does about the play that the log has: it runs the executive, orders, and says which robots are
  lost, if it leads or if the executive is distributed.
* ``reunion``: the plan by which a team goes on that was parted, or left a robot behind.

The model that checks the replica stands in tests/protocols/deployment/team/model.py.
"""
