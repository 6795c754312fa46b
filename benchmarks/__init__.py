"""Accuracy and speed of o3dls, side by side with other methods: `python -m benchmarks.accuracy --help`,
`python -m benchmarks.speed`.
"""
