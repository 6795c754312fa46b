"""The field of the motion as one Gaussian process: covariance, observations, posterior, marginal likelihood.

May import geometry, noise and what is below them, and the settings of the motion. Start with
`gaussian_process`.
"""
