"""What the experiments with goal reflection (paper 000) share; no experiment by itself.

``choices`` makes one run with several of its settings chosen under one name. ``tables`` has what the paper prints in
Tables 1 and 2 and the names that all figures use. The experiments are the folders ``reflection_*``; begin with
``reflection_tables``.
"""
