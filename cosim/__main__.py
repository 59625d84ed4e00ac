"""``python -m cosim``: the command line, where the command itself is not on the path."""

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    # Python has put the working directory first; as for the command, it comes last, unless cosim itself stands there
    if sys.path[0] == os.getcwd() != str(Path(__file__).parents[1]):
        del sys.path[0]
    from cosim.cli import main

    main()
