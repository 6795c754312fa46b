"""The transforms of a run as 3D Slicer's libraries read them: to the world, which is the map, and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from o3dls.geometry.similarity import apply
from o3dls.runs.export.finished import export_run
from tests.oblique_motion import Smooth, chamber, oblique_run, turn_of
from tests.slicer import moved_by_slicer, slicer_python

WALL = 0.02  # mm: by how much a file may miss the motion on the wall, at the default spacing of 1 mm
INVERSE = 0.05  # mm, there and back


@pytest.mark.parametrize(("prior_frame", "frame"), [("RAS", "LPS"), ("LPS", "RAS")])
def test_slicer_moves_the_image_onto_the_map_and_back(prior_frame: str, frame: str, tmp_path: Path) -> None:
    slicer_python()
    folder = oblique_run(prior_frame, frame).write(tmp_path / "run")
    path = export_run(folder, tmp_path / "a.h5", format="itk")
    wall = chamber().vertices[::3]
    moved = apply(turn_of(frame), Smooth(prior_frame, frame)(apply(turn_of(prior_frame), wall)))
    onto_map, back = moved_by_slicer(path, wall)[0], moved_by_slicer(path, moved)[1]
    assert np.linalg.norm(onto_map - moved, axis=1).max() < INVERSE  # by Slicer's own inverse
    assert np.linalg.norm(back - wall, axis=1).max() < INVERSE
    # the other file leads straight from the image to the map
    straight = moved_by_slicer(tmp_path / "a_inverse.h5", wall)[1]
    assert np.linalg.norm(straight - moved, axis=1).max() < WALL


def test_a_field_alone_is_a_grid_transform(tmp_path: Path) -> None:
    slicer_python()
    folder = oblique_run().write(tmp_path / "run")
    export_run(folder, tmp_path / "a.tfm", format="itk", spacing=2.0)
    wall = chamber().vertices[::9]
    bent = moved_by_slicer(tmp_path / "a_inverse_field.nrrd", wall)[1]
    matrix = moved_by_slicer(tmp_path / "a_inverse.tfm", bent)[1]
    assert np.linalg.norm(matrix - Smooth("LPS", "LPS")(wall), axis=1).max() < 4 * WALL  # at 2 mm
