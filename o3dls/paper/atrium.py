"""The patient-like left atrium (figures 5 and 6, table 1): angiogram, segmentation, landmarks, ICP, level
set.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_synth import patient as synthetic_patient

from ..case import Case
from ..evaluation.distances import distances
from ..pipeline.pipeline import Pipeline
from ..report.drawing.fields import Field
from ..report.drawing.figures import plain_figure, png
from ..report.mapping.views import in_frame
from ..stages.deform import Deform
from ..stages.icp import ICP
from ..stages.landmarks import Landmarks
from ..stages.level_set import LevelSet
from ..stages.topology import Topology
from .blocks import Block, Figure, Heading, Table, Text
from .drawing import COLOURS, MARKERS, NAMES, rendered
from .experiment import Outcome, Row, Scope, Task, mean_sd, score, truth_of, with_truth_distance
from .results import Results, column
from .segment import segmented

MARKS = ("LIPV", "LSPV", "RSPV")  # the paper's LA-LIPV, LA-LSPV, LA-RSPV
SHOWN = ("icp", "similarity", "level_set")


def pipeline() -> Pipeline:
    """Make the pipeline of the paper's way (landmarks, then rigid ICP), the best similarity, and ours."""
    robust = ICP(as_="similarity", after="landmarks")
    return Pipeline([Landmarks(), ICP(preset="standard"), robust, Deform(), Topology(), LevelSet()], folds=0)


def tasks(scope: Scope) -> list[Task]:
    seeds = scope.seeds(20)
    return [
        Task("atrium", f"patient-like atrium, seed {seed}", fit, (seed, seed == seeds[0])) for seed in seeds
    ]


def fit(seed: int, drawn: bool) -> Outcome:
    """Fit one patient, from grey values to the table's numbers."""
    patient = synthetic_patient(seed)
    prior, mask = segmented(patient.scan, patient.affine, patient.inside)
    case = with_marks(replace(patient.case, prior=prior), MARKS)
    plan = pipeline()
    truth = truth_of(case)
    estimates = plan.fit(case)
    floor = float(distances(case.points.of("eam").xyz, truth).mean())
    known = {
        "seed": seed,
        "noise": 1.5,
        "floor": floor,
        "size_ml": truth.volume / 1e3,
        "prior_ml": prior.volume / 1e3,
    }
    rows = [known | score(case, plan, estimates, name) for name in SHOWN]
    if not drawn:
        return Outcome(rows)
    shapes = {name: with_truth_distance(estimates[name].surface, truth) for name in ("landmarks", *SHOWN)}
    middle = patient.scan.shape[0] // 3  # the slice in which the ventricle touches the atrium
    views = {
        "slice": patient.scan[middle],
        "mask": mask[middle].astype(float),
        "points": case.points.of("eam", "ablation").xyz,
    }
    return Outcome(rows, {**shapes, **views, "truth": truth, "prior": prior})


def with_marks(case: Case, names: tuple[str, ...]) -> Case:
    """Return the case with these landmarks only."""
    keep = (case.points.type != "landmark") | np.isin(case.points.columns["name"], names)
    return replace(case, points=case.points.select(keep))


def left_out(scope: Scope) -> dict[str, str]:
    return {}


def blocks(results: Results) -> list[Block]:
    rows = results.of("atrium")
    return [
        Heading("Patient-like left atrium (figures 5 and 6, table 1)"),
        Text(
            "An MR angiogram (45 slices, 0.78125 x 0.78125 x 1.5 mm; contrast, partial volume, noise, a "
            "ventricle and an aorta beside the "
            "atrium) is segmented, unwanted parts are removed, and the label map gives the prior. 250 "
            "EAM points and 120 ablation points, "
            "both with noise of 1.5 mm per axis; a fifth of the wall has no points; landmarks LA-LIPV, "
            "LA-LSPV, LA-RSPV. Ablation points "
            f"are not fitted. {len({row['seed'] for row in rows})} seeds, on which nothing was chosen. "
            "The motion between imaging and "
            "mapping is made as large as the paper's baseline says: the best rigid pose misses the true "
            "wall by as much on every seed. "
            "The wall also ripples by 0.6 mm per axis over 6 mm, which no smooth motion expresses."
        ),
        Figure(
            "atrium_scan",
            "A slice of the angiogram, and what the segmentation makes the prior of.",
            _draw_scan(results),
        ),
        Figure(
            "atrium",
            "Distance to the true surface, one colour scale; EAM and ablation points in black.",
            _draw_surfaces(results),
        ),
        paper_table(rows, "Table 1 in the paper's form: mean distance, mm"),
        full_table(rows, "What the paper did not give: mean ± standard deviation over seeds, mm"),
        Figure("atrium_size", "Size of the atrium against the error of its registration.", _draw_sizes(rows)),
    ]


def paper_table(rows: list[Row], caption: str) -> Table:
    """Tabulate the mean distance of EAM and ablation points, by method."""
    lines = [
        [NAMES[m], *(mean_sd(column(_rows_of(rows, m), key)) for key in ("fitted", "ablation"))]
        for m in SHOWN
    ]
    return Table(caption, ["method", "EAM points", "ablation points (not fitted)"], lines)


def full_table(rows: list[Row], caption: str) -> Table:
    """Tabulate errors against truth, on what was seen and what was not, validity, seconds."""
    keys = {
        "held_out": "held out",
        "held_out_p95": "its 95 %",
        "held_out_unseen": "unseen areas",
        "truth_to_surface": "truth to surface",
        "assd": "both ways",
        "components": "pieces",
        "self_intersections": "self-cuts",
        "seconds": "s",
    }
    used = {key: name for key, name in keys.items() if any(key in row for row in rows)}
    lines = [[NAMES[m], *(mean_sd(column(_rows_of(rows, m), key)) for key in used)] for m in SHOWN]
    return Table(caption, ["method", *used.values()], lines)


def _rows_of(rows: list[Row], method: str) -> list[Row]:
    return [row for row in rows if row["method"] == method]


def _draw_scan(results: Results) -> bytes:
    grey, mask = results.array("atrium/slice"), results.array("atrium/mask")
    with plain_figure(7.0, 3.6) as figure:
        for ax, shown in zip(figure.subplots(1, 2), (False, True), strict=True):
            ax.imshow(grey, cmap="gray")
            if shown:
                ax.contour(mask, [0.5], colors=[COLOURS["similarity"]], linewidths=1.5)
            ax.set_title("label map" if shown else "angiogram, one slice")
            ax.set_axis_off()
        figure.subplots_adjust(left=0.01, right=0.99, bottom=0.01, top=0.92, wspace=0.02)
        return png(figure)


def _draw_surfaces(results: Results) -> bytes:
    scale = Field("distance_to_truth", "distance to the true surface", "mm", "sequential", 0.0, 8.0)
    points = results.array("atrium/points")
    panels = [
        [(NAMES[m] + side, results.shape(f"atrium/{m}"), points) for m in ("landmarks", *SHOWN)]
        for side in (", front", ", back")
    ]
    front, back = (
        rendered([panel], in_frame("LPS").looking(behind=behind), scale)
        for panel, behind in zip(panels, (False, True), strict=True)
    )
    return _stack_pictures(front, back)


def _stack_pictures(*pictures: bytes) -> bytes:
    """Stack pictures of one width, one under the other."""
    import io

    from matplotlib.image import imread

    parts = [imread(io.BytesIO(picture)) for picture in pictures]
    height = sum(len(part) for part in parts)
    width = parts[0].shape[1]
    with plain_figure(width / 130, height / 130) as figure:
        figure.figimage(np.vstack(parts), origin="upper")
        return png(figure)


def _draw_sizes(rows: list[Row]) -> bytes:
    with plain_figure(6.2, 3.2) as figure:
        ax = figure.subplots()
        for method in SHOWN:
            own = _rows_of(rows, method)
            x, y = column(own, "size_ml"), column(own, "truth_to_surface")
            ax.plot(x, y, MARKERS[method], color=COLOURS[method], label=NAMES[method], markersize=5)
        ax.set(xlabel="true volume of the atrium, ml", ylabel="truth to surface, mm", ylim=(0.0, None))
        ax.grid(alpha=0.25)
        ax.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0))
        figure.tight_layout()
        return png(figure)
