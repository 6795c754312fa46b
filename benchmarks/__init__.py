"""Benchmarks of o3dls: each module prints one table of the documentation, `python -m benchmarks.NAME --help`
says how. `cases` makes and finds the cases, `peers` runs other methods on them, `scores` judges results.
"""
