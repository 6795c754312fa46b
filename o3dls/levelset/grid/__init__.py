"""The discretisation of phi: a narrow band of grid nodes, signed distances on it, operators, the zero set.

May import geometry and what is below it. Start with `band` and `distance`.
"""
