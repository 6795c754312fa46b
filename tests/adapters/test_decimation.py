"""A prior with more faces than a fit can use becomes one with fewer that is closed, near it and of its
topology; the run says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from o3dls import ICP, Pipeline
from o3dls.adapters import decimation
from o3dls.adapters.decimation import reduced, with_refit_prior, with_working_prior
from o3dls.evaluation.distances import distances
from o3dls.geometry.components import components_and_euler
from tests.finished import fine_sphere
from tests.shapes import torus
from tests.tiny import ball_case


def test_a_reduced_surface_is_closed_and_near_the_other() -> None:
    for surface in (fine_sphere(8000), torus()):
        small = reduced(surface, len(surface.faces) // 4)
        assert len(small.faces) <= len(surface.faces) // 4
        assert small.watertight
        kinds = {components_and_euler(one.vertices, one.faces) for one in (small, surface)}
        assert len(kinds) == 1
        extent = np.ptp(surface.vertices, axis=0).min()
        assert distances(surface.vertices, small).max() < 0.03 * extent


def test_where_the_topology_is_lost_another_method_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    surface = torus()
    asked = []
    same = decimation._have_one_topology

    def never(one: object, other: object) -> bool:
        asked.append(same(one, other))  # type: ignore[arg-type]
        return False

    monkeypatch.setattr(decimation, "_have_one_topology", never)
    small = reduced(surface, len(surface.faces) // 4)
    assert asked
    assert small.watertight
    assert components_and_euler(small.vertices, small.faces) == (1, 0)


def test_a_run_reduces_its_prior_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    case = ball_case()
    case = replace(case, prior=replace(case.prior, fields={"height": case.prior.vertices[:, 2]}))
    assert with_working_prior(case) == (case, ())
    monkeypatch.setattr(decimation, "MOST_FACES", 200)
    run = Pipeline([ICP()], folds=0).run(case)
    assert len(case.prior.faces) > 200
    for estimate in run.estimates.values():
        assert len(estimate.surface.faces) <= 200
        (said,) = [one for one in estimate.warnings if one.code == "prior-reduced"]
        assert f"has {len(case.prior.faces)} faces" in said.sentence
    height = run.case.prior.fields["height"]
    np.testing.assert_allclose(height, run.case.prior.vertices[:, 2], atol=1.0)  # read at the closest points


def test_a_refit_of_the_cross_validation_has_a_coarser_prior_that_gives_the_same_distances(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = replace(ball_case(), prior=fine_sphere(8000))
    whole = Pipeline([ICP()], folds=3).run(case)
    monkeypatch.setattr(decimation, "MOST_REFIT", 2000)
    assert len(with_refit_prior(case).prior.faces) <= 2000
    assert with_refit_prior(replace(case, prior_of="template")).prior is case.prior
    coarse = Pipeline([ICP()], folds=3).run(case)
    assert len(coarse.estimates[coarse.final].surface.faces) == len(
        case.prior.faces
    )  # the fit itself has them all
    names = [name for name in whole.points.columns if name.startswith("left_out")]
    assert names
    for name in names:
        own, other = whole.points.columns[name], coarse.points.columns[name]
        assert np.any(own != other)
        np.testing.assert_allclose(own, other, atol=0.05)  # the sagitta of its edges
