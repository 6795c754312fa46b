"""The numbers: mean distances in the form of the paper's table 1, every set in full, closeness to truth,
validity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...evaluation.validity import handles
from ..markup import Child, Html, join, millimetres, signed, table, tag
from ..section import Section
from ..shape_words import FLAT, ShapeWords, words_of
from ..subject import SETS, Result, Subject
from ..surfaces.given import before_stages

SEEN = ("landmarks", "fitted")  # these sets were fitted, so a small distance proves nothing: they stand last
DIGITS = 2
CAPTION = (
    "Mean distance of each set of points from each estimate. Bold: the smallest of a column, as far as the "
    "digits show; sets used in the fit have none."
)
NOTE = (
    "A surface that overfits the noise is closest to the points used in the fit, landmarks included. Judge "
    "by the sets that were not used in the fit."
)


def score_section(subject: Subject) -> Section:
    """Tabulate mean distances, one row per estimate: sets that were not fitted first, those that were last
    and marked.
    """
    results = list(subject.results.values())
    sets = _known_sets(results)
    heads: list[Child] = [_set_heading(group) for group in sets]
    rows: list[list[Child]] = [
        [labelled(result), *_mean_cells(result, sets, results, subject.unit)] for result in results
    ]
    main = table([f"mean distance, {subject.unit}", *heads], rows, CAPTION)
    full = tag("details", tag("summary", "Every set in full"), _full_table(results, sets, subject.unit))
    return Section(
        "scores",
        "Distances",
        join(main, tag("p", NOTE, class_="soft"), *_truth_tables(results, subject.unit), full),
    )


def labelled(result: Result) -> str:
    """Name an estimate, and say what it stands for where it is no stage."""
    meaning = before_stages(result.run).get(result.key)
    return f"{result.name} ({meaning})" if meaning else result.name


def mean_table(subject: Subject) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Return the sets, and for each estimate its name and mean distances, as plain text."""
    results = list(subject.results.values())
    sets = _known_sets(results)
    return sets, [
        (result.name, [millimetres(_read_mean(result, group, subject.unit)) for group in sets])
        for result in results
    ]


def _known_sets(results: Sequence[Result]) -> list[str]:
    return [group for group in SETS if any(group in result.scores for result in results)]


def _set_heading(group: str) -> Html:
    return (
        join(SETS[group], tag("br"), tag("small", "used in the fit")) if group in SEEN else join(SETS[group])
    )


def _mean_cells(result: Result, sets: Sequence[str], results: Sequence[Result], unit: str) -> list[Child]:
    cells: list[Child] = []
    for group in sets:
        shown = _rounded_mean(result, group, unit)
        known = {one for other in results if (one := _rounded_mean(other, group, unit)) is not None}
        best = group not in SEEN and len(known) > 1 and shown == min(known)
        text = "–" if shown is None else f"{shown:.{DIGITS}f}"
        cells.append(tag("span", text, class_="best" if best else None))
    return cells


def _rounded_mean(result: Result, group: str, unit: str) -> float | None:
    """Return the mean as it is written: digits that nobody sees pick no winner."""
    value = _read_mean(result, group, unit)
    return None if value is None else round(value, DIGITS)


def _read_mean(result: Result, group: str, unit: str) -> float | None:
    value = result.scores.get(group, {}).get(f"mean_{unit}")
    return None if value is None else float(value)


def _truth_tables(results: Sequence[Result], unit: str) -> list[Html]:
    """Tabulate how close the whole surfaces are, where the truth is known."""
    words = {
        f"assd_{unit}": (f"mean of both directions, {unit}", "{:.2f}"),
        f"hd95_{unit}": (f"95 % Hausdorff, {unit}", "{:.2f}"),
        "dice": ("Dice", "{:.3f}"),
        **{f"within_{k}{unit}": (f"truth within {k} {unit}", "{:.1%}") for k in (1, 2, 3)},
    }
    known = [(result, result.scores["truth"]) for result in results if "truth" in result.scores]
    if not known:
        return []
    rows: list[list[Child]] = [
        [result.name, *(_format_number(found.get(key), form) for key, (_, form) in words.items())]
        for result, found in known
    ]
    return [table(["against the true surface", *(label for label, _ in words.values())], rows)]


def _full_table(results: Sequence[Result], sets: Sequence[str], unit: str) -> Html:
    keys = ["n", *(f"{name}_{unit}" for name in ("mean", "median", "rms", "p95", "max"))]
    rows: list[list[Child]] = [
        [
            result.name,
            SETS[group],
            *(
                _format_number(result.scores[group].get(key), "{:.3f}" if key != "n" else "{:d}")
                for key in keys
            ),
        ]
        for group in sets
        for result in results
        if group in result.scores
    ]
    return table(["estimate", "set", *(key.replace("_", ", ").replace("p95", "95 %") for key in keys)], rows)


def validity_section(subject: Subject) -> Section:
    """Say whether each surface can be used: closed, one piece, without folds, and its volume."""
    results = list(subject.results.values())
    words = words_of(subject)
    keys = dict.fromkeys(key for result in results for key in result.validity)
    if words is FLAT:
        keys.pop("euler", None)  # an outline has no handles
    rows: list[list[Child]] = [
        [labelled(result), *(_write_measure(key, result.validity) for key in keys), _list_faults(result)]
        for result in results
    ]
    return Section(
        "validity",
        f"Validity of the {words.shape}s",
        table(["estimate", *(_name_measure(key, words) for key in keys), "verdict"], rows),
    )


def _list_faults(result: Result) -> str:
    return "; ".join(result.run.faults_of(result.key)) or "valid"


def _name_measure(key: str, words: ShapeWords) -> str:
    units = {
        "volume_ml": "volume, ml",
        "area_mm2": "area, mm²",
        "area_px2": "area, px²",
        "volume_change": f"change of {words.amount}",
        "euler": "handles (0 = none)",
        "flipped_faces": f"flipped {words.pieces}",
        **({"watertight": "closed", "self_intersections": "crossings"} if words is FLAT else {}),
    }
    return units.get(key, key.replace("_", " "))


def _write_measure(key: str, found: Mapping[str, Any]) -> str:
    value = found.get(key)
    if key == "euler":  # handles cannot be counted on an open surface or an outline
        value = handles(dict(found)) if found.get("watertight") and "volume_ml" in found else None
    if isinstance(value, bool):
        return "yes" if value else "no"
    if key == "volume_change" and value is not None:
        return f"{signed(100 * value, 1)}%"
    return _format_number(value, "{:.1f}" if isinstance(value, float) else "{}")


def _format_number(value: Any, form: str) -> str:
    return "–" if value is None else form.format(value)
