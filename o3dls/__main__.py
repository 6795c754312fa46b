"""`python -m o3dls` is the command `o3dls`."""

from .cli import main

main()
