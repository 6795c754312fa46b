"""Borders of classes in the viewer lead through the triangles of a wall, not along them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.evaluation.regions import REGIONS
from o3dls.geometry.surface import Surface
from o3dls.report.drawing import scene
from o3dls.report.drawing.painting import _mean_around as mean_around
from o3dls.report.drawing.painting import soften
from o3dls.report.page_parts import asset
from o3dls.report.subject import Subject
from o3dls.report.writer import write_report
from tests.borders import SLOPE, above_border, roughness
from tests.browser import Visit
from tests.tiny import sphere
from tests.viewer import FIXTURES, type_range

run, report, launch, browser, visit = FIXTURES
UPPER, LOWER = REGIONS.index("anterior"), REGIONS.index("lateral")  # orange and blue


def halved(_: Subject, surfaces: Mapping[str, Surface]) -> dict[str, Surface]:
    """Give every surface two regions, a column that has a value in one of them, and one that rises evenly."""
    found = {}
    for name, one in surfaces.items():
        above = above_border(one.vertices)
        fields = {
            "region": np.where(above, UPPER, LOWER).astype(float),
            "force": np.where(above, 1.0, np.nan),
            "height": one.vertices[:, 2] - SLOPE * one.vertices[:, 0],
        }
        found[name] = replace(one, fields={**one.fields, **fields})
    return found


@pytest.fixture(scope="module")
def page(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "with_regions", halved)
        return write_report([run], tmp_path_factory.mktemp("halved") / "report.html")


@pytest.fixture
def bare(browser: Any, page: Path) -> Iterator[Visit]:
    """A visit of pictures without points, names and hatching."""
    visit = Visit(browser, page)
    for box in [*visit.page.locator("#kinds input").all(), visit.page.locator("#labels")]:
        box.uncheck()
    visit.page.uncheck("#hatched")
    yield visit
    assert [text for text in visit.errors if "willReadFrequently" not in text] == []
    visit.page.close()


def edge(picture: Any) -> float:
    """Pixels of an edge of the ball of 14 rings: a fifteenth of half of its outline."""
    return float(np.ptp(np.flatnonzero((picture[..., 3] > 250).any(axis=0)))) * np.pi / 2 / 15


@pytest.mark.parametrize(
    ("field", "other"),
    [
        ("region of the wall", lambda colour: colour[..., 0] > colour[..., 2]),
        ("force", lambda colour: np.ptp(colour, axis=2) > 40),  # wall without a value is grey
    ],
    ids=["regions", "no value"],
)
def test_the_border_of_classes_is_a_line_across_triangles(
    bare: Visit, field: str, other: Callable[[Any], Any]
) -> None:
    """Along the triangles it would be rough by a fourth of an edge."""
    bare.page.select_option("#field", label=field)
    bare.settle()
    picture = bare.picture(0).astype(float)
    within = picture[..., 3] > 250
    within[-60:] = False
    assert roughness(other(picture[..., :3]), within) < 0.06 * edge(picture)


def test_the_region_under_the_pointer_is_named_as_the_picture_shows_it(bare: Visit) -> None:
    bare.page.select_option("#field", label="region of the wall")
    box = bare.page.locator("#panels canvas").first.bounding_box()
    for share, name in ((0.35, "anterior"), (0.65, "lateral")):
        bare.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + share * box["height"])
        bare.settle()
        assert bare.page.locator("#readout").inner_text() == f"icp: region of the wall {name}"


def test_the_end_of_the_colours_is_a_line_across_triangles(bare: Visit) -> None:
    bare.page.select_option("#field", label="height")
    type_range(bare, "-0.01", "0.01")
    picture = bare.picture(0).astype(float)
    within = picture[..., 3] > 250
    within[-60:] = False
    assert roughness(picture[..., 0] > 180, within) < 0.03 * edge(picture)


def test_shares_are_those_of_pictures_without_a_graphics_card(browser: Any) -> None:
    ball = sphere()
    share = above_border(ball.vertices).astype(float)
    page = browser.new_page()
    code = f"const MISSING = -1e30; {asset('borders.js')}; return softened(index, share);"
    found = page.evaluate(f"([index, share]) => {{ {code} }}", [ball.faces.ravel().tolist(), share.tolist()])
    page.close()
    wanted = soften(mean_around(ball.faces, len(share)), share)
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert 0.05 < wanted[share == 0].max() < 0.5


def test_the_shader_has_a_share_for_every_region() -> None:
    assert len(REGIONS) <= 4 * asset("materials.js").count("attribute vec4 shares")
