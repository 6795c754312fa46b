"""Synthetic cases with known truth: `python -m data_synth atrium DIR --seed 7`.

Shapes are functions `f(points) -> signed distance`, motions are functions `f(points) -> points`; a generator
puts them together into a `Case` that `o3dls.write_case` writes. One seed gives one case; the anatomy, its
motion, the prior and the points have a random stream each, so that other noise or more points leave the
anatomy as it is.
"""

from .atrium import atrium
from .jar import jar
from .patient import Patient, patient
from .star import star

__all__ = ["Patient", "atrium", "jar", "patient", "star"]
