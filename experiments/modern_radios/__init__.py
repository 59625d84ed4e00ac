"""The tasks of five papers over seven radios, each alone and with pairs of the other technologies on the air.

``comparing`` makes the runs, from a scenario file for each task beside it; ``figures`` judges what messages cost, and
draws what each radio costs each task. ``sweep.yaml`` is where to begin; ``README.md`` says what was chosen where the
sources are silent, and ``published.csv`` what the papers assume.
"""
