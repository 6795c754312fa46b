"""Synthetic cases with known truth: `python -m data_synth atrium DIR --seed 7`.

Shapes are functions `f(points) -> signed distance`, motions are functions `f(points) -> points`; a generator
puts them together into a `Case` that `o3dls.write_case` writes. One seed gives one case; the anatomy, its
motion, the prior and the points have a random stream each, so that other noise or more points leave the
anatomy as it is. `family` and `cross` take real atria from files instead; what a file holds is written into
cases and nowhere else.
"""

from .atrium import atrium, roughened
from .badly_segmented import badly_segmented
from .cross import cross
from .family import family
from .jar import jar
from .lengthening import lengthened
from .mapping import Mapping
from .patient import Patient, patient
from .star import star
from .study import Study, study, write_study
from .unvisited import unvisited
from .visits import Visits
from .wall import read_wall

__all__ = [
    "Mapping",
    "Patient",
    "Study",
    "Visits",
    "atrium",
    "badly_segmented",
    "cross",
    "family",
    "jar",
    "lengthened",
    "patient",
    "read_wall",
    "roughened",
    "star",
    "study",
    "unvisited",
    "write_study",
]
