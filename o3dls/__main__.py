"""`python -m o3dls` is the command `o3dls`."""

import os
import sys

# `python -m` puts the working folder first in the path, and any file there could stand for a module; a clone
# that is not installed is found by it
if sys.path[0] == os.getcwd() != os.path.dirname(os.path.dirname(__file__)):
    del sys.path[0]

from .cli.main import main

main()
