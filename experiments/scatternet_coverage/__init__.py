"""Paper 003, section VI: teams of 8 in one piconet, and of 16 and 32 in scatternets of three shapes, cover a floor.

``sweep.yaml`` is where to begin; ``sensitivity.yaml`` varies what the paper leaves open, and ``README.md`` says what
was chosen there. The paper prints no numbers, so there is no published.csv.
"""
