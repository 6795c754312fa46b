"""The app: pages on this machine that lead from two files to a judged surface, by the functions that the
commands call. Start at `desk`, which holds what goes on; `routes` says what a page may ask.
"""
