"""Paper 004, section 7: the typical scenario of coordinated deployment, four different robots on a corridor floor.

``playbook.yaml`` and ``platforms.yaml`` are the play and the robots. ``figures`` judges time, way and order of the
robots. The runs are made by ``experiments.deployment.deploying``. ``sweep.yaml`` is where to begin; ``README.md`` says
what was chosen where the source is silent, and ``published.csv`` what it printed.
"""
