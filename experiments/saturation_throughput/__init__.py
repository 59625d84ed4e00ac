"""802.11 at saturation: what 2 to 50 stations that always have something to send get through.

``saturation`` makes a run and has Bianchi's model beside it. ``figures`` draws both with the values of ns-3.
``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the source is silent, and ``published.csv``
what it printed.
"""
