"""Occupancy maps of robots, merged by messages over whatever channel there is.

- ``belief``: one map, an occupancy grid with its frontiers, and the frame that all maps of a run have in common.
- ``sharing``: one robot's part in the merging. It broadcasts what its own sensors have changed, in pieces, and
  summaries of the pieces that it has, by which others see what they lack.
- ``frames``: pieces and summaries on the wire, and the runs of cells in them.

Begin with ``sharing``. ``protocols.exploration`` explores with these maps, and robots of ``protocols.deployment`` that
explore share theirs by it, too.
"""
