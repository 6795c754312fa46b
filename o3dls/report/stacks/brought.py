"""What is drawn on the image: the prior as it was segmented, and the run's surfaces and points brought back
to it.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...arrays import Array
from ...geometry.similarity import apply, inverse
from ...geometry.surface import Surface
from ...io.grey.image import GreyImage
from ...io.grey.of_case import LABELS, open_kept_image
from ...runs.export.placed import recorded
from ..mapping.views import Orientation, in_frame
from ..subject import Subject


@dataclass(frozen=True, eq=False)
class Layer:
    """A layer is a surface in the frame of the image: its key, by which it is coloured, and its name."""

    key: str
    name: str
    surface: Surface


@dataclass(frozen=True, eq=False)
class Brought:
    """This has the image of a case, the layers that are drawn on it, the mapping points (n, 3) where the
    motion brings them back to, and the patient's directions, all in the frame of the prior.
    """

    image: GreyImage
    labels: bool
    layers: tuple[Layer, ...]
    points: Array
    seen: Orientation

    @property
    def prior(self) -> Surface:
        return self.layers[0].surface

    @property
    def result(self) -> Surface:
        """The last surface, brought back by the similarity alone, so that what the motion did shows."""
        return next(layer.surface for layer in self.layers if layer.key == "similar")


def brought_back(subject: Subject) -> Brought:
    """Bring surfaces and points of a subject whose case has an image back to it. Raises InputError where the
    image is not there any more, or was changed.
    """
    case, last = subject.case, subject.last
    image = open_kept_image(case)
    back = inverse(last.estimate.T_map_prior)
    motion = recorded(case, last.estimate)
    layers = [Layer("prior", "prior as segmented", case.prior)]
    if subject.first is not None:
        name = f"{subject.first.name}, by the similarity of {last.name}"
        layers.append(Layer("baseline", name, subject.first.estimate.surface.transformed(back)))
    surface = last.estimate.surface
    layers.append(Layer("similar", f"{last.name}, by its similarity", surface.transformed(back)))
    points = last.run.points.of("eam").xyz
    if last.estimate.motion is None:
        return _on_image(image, subject, layers, apply(back, points))
    carried = surface.with_vertices(motion.inverse(surface.vertices))
    layers.append(Layer("moved", f"{last.name}, by its motion", carried))
    return _on_image(image, subject, layers, motion.inverse(points))


def _on_image(image: GreyImage, subject: Subject, layers: list[Layer], points: Array) -> Brought:
    known = image.frame != "unknown"
    seen = in_frame(image.frame if known else "LPS", f"frame of the image, {image.frame}", patient=known)
    return Brought(image, subject.case.image.get("shows") == LABELS, tuple(layers), points, seen)
