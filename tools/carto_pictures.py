"""Draw the pictures of docs/tutorial_carto.md from the folder in which its commands were run, and print what
the page says of the wall.

    python tools/carto_pictures.py FOLDER docs

Needs vtk and playwright (the extras `formats-test` and `test`) and a Chromium.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import nibabel
import numpy as np
import vtk
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

sys.path.insert(0, str(Path(__file__).parents[1]))
from o3dls import Points, Surface, read_points, read_surface
from o3dls.evaluation.distances import distances, sample
from o3dls.io.table import read_table
from tests.browser import chromium
from tools.report_pictures import write

SIZE, SHARPER = 620, 2  # pixels of a view, and how many times as many it is drawn with
SCAR = LinearSegmentedColormap.from_list(  # red below the border of scar, as in the scene
    "scar", [(0.85, 0.1, 0.1), (0.95, 0.85, 0.2), (0.2, 0.7, 0.3), (0.2, 0.4, 0.9), (0.6, 0.25, 0.7)]
)
RATIO = LinearSegmentedColormap.from_list("ratio", ["#20406e", "#8fb3d9", "#f4f1e8", "#f0a04b", "#a3161b"])
VOLTS, RATIOS, GREYS = (0.5, 1.5), (0.9, 1.7), (60.0, 540.0)
GULLET, BURN, TAG = (0.75, 0.62, 0.45), (0.80, 0.05, 0.05), (1.0, 0.55, 0.1)
BORDER = 1.4  # of the image ratio: between healthy and enhanced wall
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
BACK, LEFT_BACK = np.array([0.1, 1.0, 0.12]), np.array([0.9, 0.4, 0.45])  # where a view is from, in LPS
WIDTH, HEIGHT = 1200, 900  # of the window of the browser


@dataclass(frozen=True)
class Colours:
    """Colours of a field between two values; grey where it has none."""

    field: str
    map: LinearSegmentedColormap
    limits: tuple[float, float]

    def of(self, values: np.ndarray) -> np.ndarray:
        low, high = self.limits
        found = self.map(np.clip((np.nan_to_num(values) - low) / (high - low), 0.0, 1.0))[:, :3]
        return np.where(np.isfinite(values)[:, None], found, 0.8)


BIPOLAR, ENHANCED = Colours("bipolar", SCAR, VOLTS), Colours("image_ratio", RATIO, RATIOS)


def bytes_of(colours: np.ndarray) -> Any:
    return numpy_to_vtk(np.round(255.0 * colours).astype(np.uint8), deep=True)


def actor_of(data: Any, colour: Sequence[float] = (0.8, 0.8, 0.8), opacity: float = 1.0) -> Any:
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(data)
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetColor(*colour)
    look.SetOpacity(opacity)
    look.SetAmbient(0.35)
    look.SetDiffuse(0.7)
    look.SetInterpolationToPhong()
    return actor


def wall(surface: Surface, colours: Colours | None = None, **look: Any) -> Any:
    """A surface, coloured by a field of its vertices."""
    data, places, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    places.SetData(numpy_to_vtk(surface.vertices, deep=True))
    corners = np.column_stack([np.full(len(surface.faces), 3), surface.faces]).ravel()
    cells.ImportLegacyFormat(numpy_to_vtkIdTypeArray(corners.astype(np.int64), deep=True))
    data.SetPoints(places)
    data.SetPolys(cells)
    if colours is not None:
        data.GetPointData().SetScalars(bytes_of(colours.of(surface.fields[colours.field])))
    smooth = vtk.vtkPolyDataNormals()
    smooth.SetInputData(data)
    smooth.SplittingOff()
    smooth.Update()
    return actor_of(smooth.GetOutput(), **look)


def balls(xyz: np.ndarray, radius: float, colours: np.ndarray | Sequence[float]) -> Any:
    """Places as balls, of one colour or of one each."""
    data, places = vtk.vtkPolyData(), vtk.vtkPoints()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(xyz), deep=True))
    data.SetPoints(places)
    data.GetPointData().SetScalars(bytes_of(np.broadcast_to(np.asarray(colours), (len(xyz), 3)).copy()))
    ball, each = vtk.vtkSphereSource(), vtk.vtkGlyph3D()
    ball.SetRadius(radius)
    ball.SetThetaResolution(16)
    ball.SetPhiResolution(16)
    each.SetInputData(data)
    each.SetSourceConnection(ball.GetOutputPort())
    each.ScalingOff()
    each.SetColorModeToColorByScalar()
    each.Update()
    return actor_of(each.GetOutput())


def slice_of(path: Path, middle: np.ndarray, axis: int, half: float) -> Any:
    """A slice of an image across an axis of the body, a square of 2 `half` mm, as a plane in LPS."""
    values, corner, sides = sampled(path, middle, axis, half)
    grey = np.clip((values - GREYS[0]) / (GREYS[1] - GREYS[0]), 0.0, 1.0)
    picture = vtk.vtkImageData()
    picture.SetDimensions(grey.shape[1], grey.shape[0], 1)
    picture.GetPointData().SetScalars(bytes_of(np.repeat(grey.reshape(-1, 1), 3, axis=1)))
    plane, texture = vtk.vtkPlaneSource(), vtk.vtkTexture()
    plane.SetOrigin(*corner)
    plane.SetPoint1(*(corner + 2.0 * half * sides[0]))
    plane.SetPoint2(*(corner + 2.0 * half * sides[1]))
    plane.Update()
    texture.SetInputData(picture)
    texture.InterpolateOn()
    actor = actor_of(plane.GetOutput(), colour=(1.0, 1.0, 1.0))
    actor.SetTexture(texture)
    actor.GetProperty().LightingOff()
    return actor


def sampled(
    path: Path, middle: np.ndarray, axis: int, half: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values (rows, columns) of a square across an axis, its first corner, and its sides' directions."""
    from scipy.ndimage import map_coordinates

    image = nibabel.load(path)
    sides = np.eye(3)[[k for k in range(3) if k != axis]]
    corner = middle - half * sides.sum(axis=0)
    steps = np.linspace(0.0, 2.0 * half, 360)
    places = corner + steps[None, :, None] * sides[0] + steps[:, None, None] * sides[1]
    inverse = np.linalg.inv(LPS @ image.affine)
    index = np.moveaxis(places @ inverse[:3, :3].T + inverse[:3, 3], -1, 0)
    return map_coordinates(image.get_fdata(), index, order=1, mode="nearest"), corner, sides


def view(actors: Sequence[Any], from_where: np.ndarray, middle: np.ndarray, size: float) -> np.ndarray:
    """What is seen of a scene: up is the head, and `size` mm from below to above."""
    window, renderer = vtk.vtkRenderWindow(), vtk.vtkRenderer()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)  # which peeling cannot have
    window.SetSize(SHARPER * SIZE, SHARPER * SIZE)
    window.AddRenderer(renderer)
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.SetUseDepthPeeling(1)
    window.SetAlphaBitPlanes(1)
    for actor in actors:
        renderer.AddActor(actor)
    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetParallelScale(size / 2.0)
    camera.SetFocalPoint(*middle)
    camera.SetPosition(*(middle + 300.0 * from_where / np.linalg.norm(from_where)))
    camera.SetViewUp(0.0, 0.0, 1.0)
    renderer.ResetCameraClippingRange()
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.Update()
    found = grab.GetOutput()
    columns, rows, _ = found.GetDimensions()
    return vtk_to_numpy(found.GetPointData().GetScalars()).reshape(rows, columns, 3)[::-1]


def titled(pictures: Sequence[tuple[str, np.ndarray, Colours | None, str]], out: Path) -> None:
    """Pictures beside each other with a title above, and below the colours of a field with its unit."""
    figure, axes = plt.subplots(1, len(pictures), figsize=(4.6 * len(pictures), 5.0))
    for axis, (title, picture, colours, unit) in zip(np.atleast_1d(axes), pictures, strict=True):
        axis.imshow(picture, interpolation="antialiased")
        axis.set_title(title, fontsize=11)
        axis.set_axis_off()
        if colours is not None:
            shown = matplotlib.cm.ScalarMappable(plt.Normalize(*colours.limits), colours.map)
            bar = figure.colorbar(shown, ax=axis, orientation="horizontal", shrink=0.62, pad=0.02, aspect=28)
            bar.set_label(unit, fontsize=9)
            bar.ax.tick_params(labelsize=9)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.93, bottom=0.03, wspace=0.03)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=130)
    plt.close(figure)
    write(Image.open(buffer).convert("RGB"), out)


def study(folder: Path, out: Path) -> None:
    """The map as it was exported, and the image with the segmentation."""
    shell = read_surface(folder / "case/map.ply")
    points: Points = read_points(folder / "case/points.csv")
    measured, tags = points.of("eam"), points.of("eam").columns["tags"]
    tagged = np.array([bool(tag) for tag in tags])
    actors = [
        wall(shell, opacity=0.25),
        balls(measured.xyz[~tagged], 0.9, BIPOLAR.of(measured.numbers("bipolar"))[~tagged]),
        balls(measured.xyz[tagged], 1.2, TAG),
    ]
    drawn = view(actors, BACK, shell.vertices.mean(axis=0), 90.0)
    prior = read_surface(folder / "case/prior.ply")
    middle = prior.vertices.mean(axis=0) + np.array([0.0, 12.0, 0.0])
    grey, _, _ = sampled(folder / "study/lge.nii.gz", middle, 2, 48.0)
    label, _, _ = sampled(folder / "study/la_labels.nii.gz", middle, 2, 48.0)
    shades = np.clip((grey - GREYS[0]) / (GREYS[1] - GREYS[0]), 0.0, 1.0)
    picture = np.repeat(shades[:, :, None], 3, axis=2)
    inside = label > 0.5
    edge = inside & ~(
        np.roll(inside, 1, 0) & np.roll(inside, -1, 0) & np.roll(inside, 1, 1) & np.roll(inside, -1, 1)
    )
    picture[edge] = (1.0, 0.87, 0.34)
    titled(
        [
            ("the map in CARTO's frame: tagged points are orange", drawn, BIPOLAR, "bipolar voltage, mV"),
            ("an axial slice of the image, and the label", picture, None, ""),
        ],
        out,
    )


def on_wall(folder: Path, out: Path) -> None:
    """Voltages and enhancement on the result, with the oesophagus that was carried there."""
    result = read_surface(folder / "run/wall/result.vtp")
    gullet = wall(read_surface(folder / "run/export/oesophagus_on_map.vtp"), colour=GULLET, opacity=0.55)
    middle = result.vertices.mean(axis=0)
    views = [view([wall(result, colours), gullet], BACK, middle, 82.0) for colours in (BIPOLAR, ENHANCED)]
    titled(
        [
            ("what the catheter measured", views[0], BIPOLAR, "bipolar voltage, mV"),
            ("what the image has there", views[1], ENHANCED, "image value over that of the blood"),
        ],
        out,
    )


def scene(folder: Path, out: Path) -> None:
    """What the scene for Slicer holds, on the image."""
    prior = read_surface(folder / "run/wall/prior.vtp")
    table = read_table(folder / "run/wall/points.csv", "xyz")
    xyz = np.column_stack([table.numbers(f"image_{axis}") for axis in "xyz"])
    middle = prior.vertices.mean(axis=0)
    image, half = folder / "study/lge.nii.gz", 46.0
    actors = [
        wall(prior, BIPOLAR),
        balls(xyz, 0.7, (1.0, 1.0, 1.0)),
        wall(read_surface(folder / "study/oesophagus.stl"), colour=GULLET),
        slice_of(image, middle - [0.0, 0.0, 14.0], 2, half),
        slice_of(image, middle - [30.0, 0.0, 0.0], 0, half),
    ]
    titled([("", view(actors, LEFT_BACK, middle, 122.0), BIPOLAR, "bipolar voltage, mV")], out)


def report(folder: Path, out: Path) -> None:
    """The part of the report on the image."""
    with chromium() as launch:
        page = launch().new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto((folder / "run/report.html").resolve().as_uri())
        page.locator("html[data-ready]").wait_for(state="attached", timeout=60_000)
        taken = page.locator("section#image").screenshot()
    write(Image.open(io.BytesIO(taken)).convert("RGB"), out)


def said(folder: Path) -> str:
    """How far the wall is from the true one, and how voltages go with enhancement."""
    truth = read_surface(folder / "study/true_wall.ply")
    lines = []
    for name in ("landmarks", "icp", "level_set"):
        found = read_surface(folder / f"run/estimates/{name}/surface.ply")
        both = (distances(sample(truth), found).mean() + distances(sample(found), truth).mean()) / 2.0
        lines.append(f"{name}: mean distance from the true wall {both:.2f} mm")
    table = read_table(folder / "run/wall/points.csv", "xyz")
    ratio, bipolar = (table.numbers(name, missing=True) for name in ("image_ratio", "bipolar"))
    for title, some in (("above", ratio > BORDER), ("at most", ratio <= BORDER)):
        lines.append(
            f"image ratio {title} {BORDER}: {some.sum()} points, median {np.nanmedian(bipolar[some]):.2f} mV"
        )
    return "".join(f"{line}\n" for line in lines)


def main(folder: Path, out: Path) -> None:
    sys.stdout.write(said(folder))
    for name, draw in (("study", study), ("wall", on_wall), ("scene", scene), ("report", report)):
        draw(folder, out / f"tutorial_carto_{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
