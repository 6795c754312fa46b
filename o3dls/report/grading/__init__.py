"""Parts of the strip that `report/checks.py` lists: what a check is, and the checks of the wall."""
