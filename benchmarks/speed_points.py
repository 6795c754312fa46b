"""Time over the number of points, on the phantom and on real atria, beside a thin-plate warp and Poisson."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

Row = dict[str, Any]
COUNTS = (250, 1000, 4000, 20_000)
LIMITS = {  # seconds of all stages, by number of points: on the phantom, on real surfaces
    250: (1.2, 3.0),
    1000: (2.0, 5.0),
    4000: (5.0, 10.0),
    20_000: (12.0, 20.0),
}
PEERS = ("thin-plate", "poisson")
PAIR = "cross_{points}_1_even_101"  # of the development pairs
RECONSTRUCTED = "cross_{points}_1_even_102"  # one whose wall is reconstructed


def limits() -> dict[str, tuple[float, str]]:
    """What is asked for, by the name of the row."""
    named = {
        f"{where} {count}": (seconds, "s")
        for count, both in LIMITS.items()
        for where, seconds in zip(("phantom", "cross"), both, strict=True)
    }
    kit = {f"kit {count}": (both[1], "s") for count, both in LIMITS.items()}
    return named | kit


def cases(seed: int, data: Path | None) -> Iterator[tuple[str, Any]]:
    """Cases with every number of points: name of the row, case. Those of real surfaces need the folder."""
    from data_synth.atrium import atrium

    for count in COUNTS:
        yield f"phantom {count}", atrium(seed, points=count)
    if data is None:
        return
    for count in COUNTS:
        yield f"cross {count}", pair(count, data)
        yield f"kit {count}", _kit(data, count, seed)


def pair(count: int, data: Path, name: str = PAIR) -> Any:
    """One atrium as prior of another, with so many points; `name` of a development pair."""
    from benchmarks.make_cases import crossed, made

    wanted = {one.name: one for one in crossed(judging=False)}
    return made(wanted[name.format(points=count)], data)


def _kit(data: Path, count: int, seed: int) -> Any:
    """The real map with as many points, even over its wall, with 1 mm of noise."""
    import numpy as np

    from o3dls.evaluation.distances import sample
    from o3dls.io.case_reader import read_case

    case = read_case(data / "real" / "kit_mri_to_eam")
    assert case.truth is not None
    assert case.truth.surface is not None
    rng = np.random.default_rng(seed)
    every = sample(case.truth.surface, 20_000)
    at = every[rng.permutation(len(every))[:count]]
    marks = case.points.of("landmark")
    fresh = replace(
        case.points, xyz=at + rng.normal(size=at.shape), type=np.full(count, "eam"), columns={}, order=None
    )
    return replace(case, points=_with_landmarks(fresh, marks))


def _with_landmarks(points: Any, marks: Any) -> Any:
    import numpy as np

    names = marks.columns.get("name", np.full(len(marks.xyz), ""))
    columns = {"name": np.concatenate([np.full(len(points.xyz), ""), names])}
    return replace(
        points,
        xyz=np.vstack([points.xyz, marks.xyz]),
        type=np.concatenate([points.type, marks.type]),
        columns=columns,
    )


def rows(
    seed: int, repeat: int, data: Path | None, timed: Callable[[Callable[[], Any], int], tuple[Any, Any]]
) -> Iterator[Row]:
    """Time and error of all stages, and of the two peers as tuned for so many points."""
    from benchmarks.peers import PEERS as RUN
    from benchmarks.peers import pose_of, tuned
    from o3dls.pipeline.file import read_pipeline
    from o3dls.pipeline.pipeline import Pipeline
    from o3dls.resources import pipeline_file

    for name, case in cases(seed, data):
        shown = case.visible()
        stages = read_pipeline(pipeline_file("default")).allowed_by(shown).stages
        pipeline = Pipeline(list(stages), folds=0)
        seconds, found = timed(lambda p=pipeline, c=shown: p.fit(c), repeat)  # type: ignore[misc]
        last = list(found.values())[-1]
        yield _row(name, seconds, case, last.surface, last.status)
        settings = tuned().get(f"cross_{name.split()[1]}", {})
        pose = pose_of(case)
        for peer in PEERS:
            if peer in settings:
                how = settings[peer]["parameters"]
                seconds, surface = timed(lambda q=peer, c=shown, o=pose, h=how: RUN[q](c, o, **h), 1)  # type: ignore[misc]
                yield _row(f"  {peer}", seconds, case, surface, "without the alignment it starts from")


def _row(what: str, seconds: Any, case: Any, surface: Any, status: str) -> Row:
    from benchmarks.peers import cost

    return {
        "what": what,
        "value": seconds.clock,
        "cpu": seconds.cpu,
        "unit": "s",
        "error_mm": cost(case, surface),
        "status": status,
    }
