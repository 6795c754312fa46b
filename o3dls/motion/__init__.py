"""The motion T of the prior: a Gaussian process over its surface, fitted by its marginal likelihood.

May import noise, geometry and what is below them; it is read without the level set. Start with `fit`, then
`problem` for one iteration and `covariance` for what displacements are expected.
"""
