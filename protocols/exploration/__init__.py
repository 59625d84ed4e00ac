"""Behavioural exploration (Lau, paper 001): robots with range scanners map a floor that they do not know.

Begin with ``explorer``: it marks the robot's map and shares it (both by ``protocols.mapping``), and goes where a leader
says. ``setup`` holds what robots know beforehand, and the common memory of a team that shares all at
once; ``spec`` says what cosim must know, ``referee`` what was covered in truth, ``events`` what is reported.

- The paper's leader is ``behaviour``: motor schemas over the map (``forces``, weighted by ``information``), and paths
  out of local minima (``escaping``, over the ``terrain``), which ``overlay`` adds to the frontiers. ``beacons`` keeps
  robots in each other's sight.
- The leaders that it is compared with are ``rivals``, which go to the ``targets`` that known algorithms choose.
- ``positioning`` says where a robot believes that it is, and ``steering`` turns headings into motion.
"""
