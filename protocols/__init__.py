"""What robots run: machines that take bytes and time and give bytes and commands, and know no simulator.

Each folder is one system: ``pseudonet``, ``reflection``, ``aggregation``, ``exploration`` and ``deployment`` of the
papers, and the smaller ``gathering`` and ``monitoring``. Its ``spec.py`` introduces it to cosim and is where to begin;
``monitoring`` is the shortest to read. ``wire.py`` has what all frames are written with.

Users have folders of this name too: theirs extend ours, so that ``protocols.mine`` is found beside these.
"""

from pkgutil import extend_path

__path__ = extend_path(__path__, __name__)
