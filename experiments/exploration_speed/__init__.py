"""Paper 001, section 5.2: a constant speed against a greater one where no obstacle is near.

``figures`` judges what the greater speed saves and whether it disrupts. The runs are made by
``experiments.exploration.exploring``. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
