"""Paper 001's teams with one shared map, and with maps that are merged by messages over several channels.

``figures`` judges whether teams explore as the paper says, and draws what messages cost. The runs are made by
``experiments.exploration.exploring``. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
source is silent, and ``published.csv`` what it printed.
"""
