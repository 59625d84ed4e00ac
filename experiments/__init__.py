"""The papers' experiments, each a folder: a scenario, what varies in it, and what the paper printed beside it.

``sweep.yaml`` says what runs are made and is where to begin; ``published.csv`` holds the paper's numbers and claims,
``README.md`` what was chosen where the paper is silent, ``figures.py`` claims and pictures of its own. ``floors`` has
the maps that several share. ``pseudonet_coverage`` is the plainest.

Users have folders of this name too: theirs extend ours, so that ``experiments.mine`` is found beside these.
"""

from pkgutil import extend_path

__path__ = extend_path(__path__, __name__)
