"""`python -m o3dls` is the command `o3dls`."""

from .cli.main import main

main()
