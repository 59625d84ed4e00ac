"""The timeline: what robots and their radios did, as lanes of boxes on one axis of simulated time.

``lanes`` holds the boxes of one lane, sorted by their starts, and ``codes`` what their kinds and outcomes are called.
``levels`` sums boxes up by cells of time, for windows in which there are more boxes than pixels; ``window`` answers
what is in a window of time, ``search`` what comes next of a kind, and ``detail`` tells all about one box. ``index``
makes the lanes of a recorded run, once, in a folder beside its tables; ``growing`` those of a run that is under way.
"""
