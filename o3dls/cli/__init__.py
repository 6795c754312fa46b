"""The command line: arguments in, one result on stdout, progress and errors on stderr.

May import everything. Start with `main`.
"""
