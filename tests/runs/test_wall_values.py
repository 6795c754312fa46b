"""Values of an image on the wall: those of a known map come back, on the prior and, by a known motion, on the
result and at the points; the blood inside is what they are divided by.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from data_synth import atrium
from data_synth.grey import Tissue, late_enhancement, oblique_grid
from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.cli.main import answer
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.evaluation.projection import project
from o3dls.evaluation.wall_image import DEPTH, Layer, blood_of, wall_values
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface
from o3dls.io.grey.image import Part
from o3dls.io.images.volumes import write_volume
from o3dls.io.surfaces import read_surface
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.runs.folder import read_run
from o3dls.runs.image.values import image_values
from tests.finished import bulged_case, finished
from tests.oblique import ball_image, write
from tests.tiny import sphere

SEEDS = (40_211, 71_530, 93_084)
VOXEL = np.array([0.8, 0.8, 1.2])  # mm
WALL = Tissue(thickness=3.0)
INSIDE = Layer(1.0, 2.0)  # a voxel from blood and from what lies around
CLOSE = 0.02  # of the truth
BEND = 4.0  # mm


def known_map(at: Array) -> Array:
    """What the wall shows at places (n, 3): between 0.65 and 1.35 times 380."""
    return np.asarray(380.0 * (1.0 + 0.35 * np.sin(at[:, 0] / 14.0) * np.cos(at[:, 2] / 17.0)))


def enhanced(surface: Surface, seed: int) -> tuple[Array, Array]:
    """An image (ni, nj, nk) whose wall shows the known map of the nearest place, and its affine."""
    values = known_map(surface.vertices)

    def wall(at: Array) -> Array:
        found = project(at, surface)
        return np.asarray((values[surface.faces[found.face]] * found.weights).sum(axis=1))

    grid = oblique_grid(np.random.default_rng(seed), surface, VOXEL, margin=9.0)
    return late_enhancement(surface, grid, wall, WALL), grid.affine


class Bend:
    """A known motion: turned, shifted and bent; its deviation is 0.4 mm along x and 0.8 mm across."""

    T = similarity(
        np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([30.0, -5.0, 8.0]), 1.03
    )

    def __call__(self, points: Array) -> Array:
        moved = points + BEND * np.column_stack([np.sin(points[:, (1, 2, 0)[k]] / 25.0) for k in range(3)])
        return apply(self.T, moved)

    def sd(self, points: Array, normals: Array) -> Array:
        return np.asarray(np.sqrt((np.square(normals) * np.square([0.4, 0.8, 0.8])).sum(axis=1)))


class Known(Stage):
    """Brings a finer mesh of the prior where the known motion brings it."""

    name: ClassVar[str] = "deform"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        import trimesh

        fine = trimesh.remesh.subdivide(case.prior.vertices, case.prior.faces)
        surface = Surface(Bend()(np.asarray(fine[0])), np.asarray(fine[1]))
        return Estimate(surface, Bend.T, "as it is known", motion=Bend())


def mapped(case: Case) -> Case:
    """The case with points where the known motion brought its prior, each with a voltage."""
    rows = np.random.default_rng(SEEDS[0]).choice(len(case.prior.vertices), 60, replace=False)
    places = case.prior.vertices[rows]
    points = Points(Bend()(places), np.full(60, "eam"), {"bipolar": 0.1 + np.abs(places[:, 2]) / 20.0})
    return replace(case, points=points, prior_landmarks={}, truth=None, init=None, prior_frame="LPS")


def before_motion(case: Case) -> Array:
    """Where the vertices of the result were before the known motion: those of the finer mesh."""
    import trimesh

    return np.asarray(trimesh.remesh.subdivide(case.prior.vertices, case.prior.faces)[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_known_map_comes_back_on_prior_and_result(seed: int, tmp_path: Path) -> None:
    case = mapped(atrium(seed=seed))
    image, affine = enhanced(case.prior, seed)
    write_volume(tmp_path / "lge.nrrd", image.astype(np.float32), affine, space="LPS")
    case = replace(case, image={"path": str(tmp_path / "lge.nrrd")})
    Pipeline([Known()], folds=0).run(case).write(tmp_path / "run")
    run = read_run(tmp_path / "run")
    found = image_values(run, INSIDE)
    truth = known_map(case.prior.vertices)
    assert np.abs(found.prior.fields["image_value"] / truth - 1.0).max() < CLOSE
    assert np.abs(found.prior.fields["image_ratio"] / (truth / WALL.blood) - 1.0).max() < CLOSE
    on_result = known_map(before_motion(case))
    assert np.abs(found.result.fields["image_value"] / on_result - 1.0).max() < CLOSE
    assert found.result.fields["bipolar"].shape == found.result.fields["image_value"].shape
    voltage = found.prior.fields["bipolar"]
    known = np.isfinite(voltage)
    assert known.mean() > 0.5
    places = np.column_stack([found.points[f"image_{axis}"] for axis in "xyz"])
    assert np.abs(found.points["image_value"] / known_map(places) - 1.0).max() < CLOSE
    back = Bend()(places)
    assert back == pytest.approx(run.points.xyz, abs=0.02)  # the points lie on the moved prior


def test_layers_are_the_mean_or_the_largest_of_what_lies_along_the_normal() -> None:
    ball = sphere(20.0, 24)

    class Rings:
        """Its value is the distance from the middle."""

        def sample(self, points: Array) -> Array:
            return np.asarray(np.linalg.norm(points, axis=-1))

    rim = np.linalg.norm(ball.vertices, axis=1)
    assert wall_values(Rings(), ball, Layer(-1.0, 3.0)) == pytest.approx(rim + 1.0, abs=0.02)
    assert wall_values(Rings(), ball, Layer(0.0, 2.0, "max")) == pytest.approx(rim + 2.0 - 0.125, abs=0.02)
    with pytest.raises(InputError, match="layer 3 to 1 mm: must be two distances"):
        Layer(3.0, 1.0)


def part_of(values: Array) -> Part:
    """Values (n, n, n) in voxels of 1 mm about the origin."""
    affine = np.eye(4)
    affine[:3, 3] = -(values.shape[0] - 1) / 2.0
    return Part(np.ascontiguousarray(values.T, dtype=np.float32), affine)


def test_the_blood_is_what_lies_deep_inside() -> None:
    ball, rng = sphere(20.0, 24), np.random.default_rng(SEEDS[1])
    radius = np.linalg.norm(np.indices((61, 61, 61)) - 30.0, axis=0)
    values = np.where(radius < 20.0 - DEPTH + 1.0, 250.0, 900.0)
    blood = blood_of(part_of(values + 10.0 * rng.normal(size=values.shape)), ball)
    assert blood.mean == pytest.approx(250.0, rel=0.005)
    assert blood.sd < 10.0
    volume = 4.0 / 3.0 * np.pi * (20.0 - DEPTH) ** 3
    assert blood.places == pytest.approx(volume / 1.5**3, rel=0.1)


@pytest.mark.parametrize(
    ("value", "radius", "words"),
    [
        (0.0, 20.0, "clearly above 0"),
        (-700.0, 20.0, "clearly above 0"),
        (300.0, 7.0, "at least 100 are needed"),
    ],
)
def test_no_ratio_is_made_of_what_is_no_blood(value: float, radius: float, words: str) -> None:
    noise = np.random.default_rng(SEEDS[2]).normal(size=(61, 61, 61))
    with pytest.raises(InputError, match=words):
        blood_of(part_of(value + noise), sphere(radius, 24))


def test_where_the_image_ends_the_wall_has_no_value() -> None:
    ball = sphere(20.0, 24)
    values = wall_values(part_of(np.full((41, 41, 41), 5.0)), ball, Layer(0.5, 2.0))
    outside = np.abs(ball.vertices).max(axis=1) > 19.5
    assert np.isnan(values[outside]).all()
    assert values[np.abs(ball.vertices).max(axis=1) < 17.0] == pytest.approx(5.0)


def run_with_image(folder: Path) -> Path:
    image = write(folder, "mri.nrrd", 400.0 - ball_image() / 100.0)
    case = replace(bulged_case(), prior_frame="LPS", image={"path": str(image)})
    return finished(folder / "run", case)


def test_the_command_writes_surfaces_points_and_how_they_were_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_with_image(tmp_path)
    assert answer(["wall", str(run), "--layer", "0", "1", "--take", "max"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[1] == str(run / "wall")
    facts = json.loads((run / "wall" / "wall.json").read_text())
    assert said[0].startswith(f"blood {facts['blood']['mean']:.4g}, sd ")
    assert (facts["layer_mm"], facts["take"], facts["estimate"]) == ([0.0, 1.0], "max", "level_set")
    prior, result = (read_surface(run / "wall" / f"{name}.vtp") for name in ("prior", "result"))
    first = 400.0 - 10.0 * 0.125  # 10 less for each mm outward, and the first sample is an eighth outside
    assert prior.fields["image_value"] == pytest.approx(first, abs=0.5)
    assert {"image_ratio", "bipolar", "sd_mm"} <= prior.fields.keys() & result.fields.keys()
    with (run / "wall" / "points.csv").open() as file:
        assert file.readline() == "# space=LPS units=mm\n"
        rows = list(csv.DictReader(file))
    measured = read_run(run).points.of("eam")
    assert [float(row["bipolar"]) for row in rows] == pytest.approx(measured.columns["bipolar"])
    assert [float(row["distance_mm"]) for row in rows] == pytest.approx(
        measured.columns["distance_level_set_mm"]
    )
    names = [
        "image_x",
        "image_y",
        "image_z",
        "image_value",
        "image_ratio",
        "sd_mm",
        "sd_in_wall_mm",
        "prior_only",
    ]
    assert set(names) <= rows[0].keys()
    assert "wall/points.csv" in (run / "manifest.txt").read_text()


def test_the_deviation_in_the_wall_is_kept_where_there_is_an_image(tmp_path: Path) -> None:
    case = mapped(replace(bulged_case(), prior_frame="LPS"))
    image = write(tmp_path, "mri.nrrd", 400.0 - ball_image() / 100.0)
    with_image = replace(case, image={"path": str(image)})
    for name, one in (("with", with_image), ("without", case)):
        Pipeline([Known()], folds=0).run(one).write(tmp_path / name)
    path = Path("estimates", "deform", "moved_prior.ply")
    moved = [read_surface(tmp_path / name / path) for name in ("with", "without")]
    assert "sd_in_wall_mm" not in moved[1].fields
    total = moved[0].fields["sd_mm"] ** 2 + 2.0 * moved[0].fields["sd_in_wall_mm"] ** 2
    assert total == pytest.approx(0.4**2 + 2 * 0.8**2, rel=1e-4)  # the trace, whatever the normal
    read_run(tmp_path / "with").write(tmp_path / "again")
    again = read_surface(tmp_path / "again" / path)
    assert again.fields["sd_in_wall_mm"] == pytest.approx(moved[0].fields["sd_in_wall_mm"])


def test_surfaces_of_a_run_have_the_image_beside_the_voltage_and_so_have_exports(tmp_path: Path) -> None:
    run = run_with_image(tmp_path)
    for name in ("start", "icp", "level_set"):
        fields = read_surface(run / "estimates" / name / "surface.vtp").fields
        assert {"image_value", "image_ratio", "bipolar"} <= fields.keys()
        blood = np.median(fields["image_value"] / fields["image_ratio"])
        mean_depth = 20.0 - 0.75 * (20.0 - DEPTH)  # of what is DEPTH or more from the wall
        assert blood == pytest.approx(400.0 + 10.0 * mean_depth, rel=0.01)
    out = tmp_path / "lge.vtk"
    export = ["export", str(run), "--format", "carto_vtk", "--field", "image_ratio", "--out", str(out)]
    assert answer(export) == 0
    assert out.is_file()


def test_a_run_whose_image_has_no_blood_is_not_lost(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    image = write(tmp_path, "mri.nrrd", 0.0 * ball_image())
    case = replace(bulged_case(), prior_frame="LPS", image={"path": str(image)})
    run = finished(tmp_path / "run", case)
    assert "image_ratio" not in read_surface(run / "estimates" / "icp" / "surface.vtp").fields
    said = [one for one in caplog.messages if "no values of the image on the wall" in one]
    assert len(said) == 1
    assert "clearly above 0" in said[0]


def test_labels_are_no_values_of_the_wall(tmp_path: Path) -> None:
    image = write(tmp_path, "labels.nrrd", (ball_image() < 0).astype(np.uint8))
    case = replace(bulged_case(), prior_frame="LPS", image={"path": str(image), "shows": "labels"})
    run = finished(tmp_path / "run", case)
    assert "image_value" not in read_surface(run / "estimates" / "icp" / "surface.vtp").fields
