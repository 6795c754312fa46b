"""A line of case.toml or of a pipeline file, a keyword, or a run that a sentence asks for mends what the
sentence is about.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from said import said_by

import o3dls
from o3dls.case import Case, Points
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import apply
from o3dls.geometry.surface import Surface
from o3dls.io.case_writer import write_case
from o3dls.io.points import write_points
from o3dls.io.surfaces import write_surface
from o3dls.motion.result import MotionFit
from o3dls.stages.deform_checks import another_heart
from tests.chamber import chamber, measured, pose, sampled
from tests.cli.followed import ROOT, strings
from tests.cli.test_advised_commands import LANDMARKS, ball, followed, refused
from tests.tiny import ball_case, disc_case, sphere

ICP = 'folds = 0\n[[stage]]\nuse = "icp"\n'


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    (tmp_path / "plan.toml").write_text(LANDMARKS)
    return tmp_path / "plan.toml"


def add_line(case: Path, line: str) -> None:
    """Put a line into case.toml in place of the one that it has for that key."""
    path, key = case / "case.toml", line.partition(" =")[0]
    text = path.read_text() if path.exists() else ""
    path.write_text(re.sub(rf"(?m)^{key} = .*\n", "", text) + line + "\n")


def line_in(said: str, key: str) -> str:
    """The line for a key that a text says."""
    found = re.search(rf'{key} = ("\w+"|[\w.]+)', said)
    assert found, said
    return found[0]


def test_which_of_two_files_is_the_prior(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    write_surface(case / "prior.stl", sphere(), units="mm")
    run = ("run", plan, "--case", case, "--out", tmp_path / "run")
    found = re.search(r"both (\S+) and (\S+); say in case.toml which is the (\w+)", refused(*run))
    assert found
    for name in found.groups()[:2]:
        add_line(case, f'{found[3]} = "{name}"')
        followed(*run, "--force")


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_dimension_is_said_in_case_toml(dimension: int, plan: Path, tmp_path: Path) -> None:
    write_case(tmp_path / "case", disc_case() if dimension == 2 else ball_case())
    add_line(tmp_path / "case", f"dimension = {5 - dimension}")
    plan.write_text(ICP)
    run = ("run", plan, "--case", tmp_path / "case", "--out", tmp_path / "run")
    line = line_in(refused(*run), "dimension")
    assert line == f"dimension = {dimension}"
    add_line(tmp_path / "case", line)
    followed(*run)


def test_an_open_prior_is_closed_by_a_line_or_a_keyword(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    prior = o3dls.read_surface(case / "prior.ply")
    hole = Surface(prior.vertices, prior.faces[1:])
    write_surface(case / "prior.ply", hole, units="mm")
    run = ("run", plan, "--case", case, "--out", tmp_path / "run")
    add_line(case, line_in(refused(*run), "cap"))
    followed(*run)
    points = ball_case().points.of("eam").xyz
    with pytest.raises(InputError, match="say cap=True to close it") as found:
        o3dls.case_of(hole, points)
    keyword = re.search(r"say (\w+)=(True)", str(found.value))
    assert keyword
    assert o3dls.case_of(hole, points, **{keyword[1]: keyword[2] == "True"}).prior.watertight  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "sentence"), [("touching", "two openings touch"), ("flat", "encloses nothing")]
)
def test_a_cap_is_not_advised_where_it_would_be_refused(kind: str, sentence: str, tmp_path: Path) -> None:
    prior = sphere()
    corners = np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]])
    opened = {
        "touching": Surface(prior.vertices, prior.faces[3:]),
        "flat": Surface(corners, np.array([[0, 1, 2], [0, 2, 3]])),
    }[kind]
    write_surface(tmp_path / "a.ply", opened, units="mm")
    case = ball(tmp_path / "ball")
    make = ("init", tmp_path / "made", "--points", case / "points.csv", "--prior", tmp_path / "a.ply")
    for said in (refused(*make), refused("convert", tmp_path / "a.ply", tmp_path / "b.ply", "--cap")):
        assert sentence in said
        assert "--cap" not in said


def test_headings_in_another_unit_are_scaled_or_said() -> None:
    prior, xyz = sphere(), ball_case().points.of("eam").xyz
    tenths = {f"{axis} (cm)": xyz[:, k] / 10.0 for k, axis in enumerate("xyz")}
    with pytest.raises(InputError, match="columns are in cm") as refusal:
        o3dls.case_of(prior, tenths)
    found = re.search(r"by (\d+) and name them x, y, z; or .* say units='(\w+)'", str(refusal.value))
    assert found
    plain = {name[0]: values for name, values in tenths.items()}
    case = o3dls.case_of(prior, {name: float(found[1]) * values for name, values in plain.items()})
    small = o3dls.case_of((prior.vertices / 10.0, prior.faces), plain, units=found[2])
    for one in (case, small):
        np.testing.assert_allclose(one.points.xyz, xyz)
        assert one.prior.diagonal == pytest.approx(prior.diagonal)


def test_units_of_objects_are_a_keyword() -> None:
    prior, xyz = sphere(), ball_case().points.of("eam").xyz / 1000.0
    small = (prior.vertices / 1000.0, prior.faces)
    with pytest.raises(InputError, match="if its units are m, say units='m'") as refusal:
        o3dls.case_of(small, xyz)
    found = re.search(r"say units='(\w+)'", str(refusal.value))
    assert found
    case = o3dls.case_of(small, xyz, units=found[1])
    assert case.prior.diagonal == pytest.approx(prior.diagonal)


def test_points_in_another_unit_get_a_line_above_their_header(plan: Path, tmp_path: Path) -> None:
    case, points = ball(tmp_path / "ball"), ball_case().points
    tenths = replace(points, xyz=points.xyz / 10.0)
    write_points(case / "points.csv", tenths)
    run = ("run", plan, "--case", case, "--out", tmp_path / "run")
    said = refused(*run)
    found = re.search(r"if the points are in cm, add the line '(.*?)' above the header", said)
    assert found, said
    header = re.sub(r"(?m)^#.*\n", "", (case / "points.csv").read_text())
    (case / "points.csv").write_text(f"{found[1]}\n{header}")
    followed(*run)


def test_units_of_headings_and_of_a_comment_are_corrected(tmp_path: Path) -> None:
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in ball_case().points.of("eam").xyz)
    target = ("convert", tmp_path / "p.csv", tmp_path / "out.csv")
    for heading, sentence in (
        ("x (mm),y (mm),z (mm)", "its columns are in mm; correct one"),
        ("Pos-X (mm),Pos-Y (mm),Pos-Z (mm)", "the headings of its coordinates say mm: correct one of them"),
    ):
        (tmp_path / "p.csv").write_text(f"# units=cm\n{heading}\n{rows}")
        assert sentence in refused(*target)
        (tmp_path / "p.csv").write_text(f"# units=mm\n{heading}\n{rows}")
        followed(*target)


STAGES = {
    "no stage": ("folds = 0\n", r'add a (\[\[stage\]\]) with (use = "icp")'),
    "no use": ("folds = 0\n[[stage]]\nscale = false\n", r'name the stage, such as ()(use = "icp")'),
}


@pytest.mark.parametrize("kind", STAGES)
def test_a_stage_is_written_as_the_sentence_shows(kind: str, plan: Path, tmp_path: Path) -> None:
    text, pattern = STAGES[kind]
    plan.write_text(text)
    found = re.search(pattern, refused("check", plan))
    assert found
    plan.write_text(text + "\n".join(found.groups()) + "\n")
    if kind == "no stage":
        followed("run", plan, "--case", ball(tmp_path / "ball"), "--out", tmp_path / "run")
    else:
        followed("check", plan)


def test_estimates_have_names_of_their_own_and_follow_earlier_ones(plan: Path, tmp_path: Path) -> None:
    run = ("run", plan, "--case", ball(tmp_path / "ball"), "--out", tmp_path / "run")
    plan.write_text(ICP + '[[stage]]\nuse = "icp"\n')
    said = refused(*run)
    found = re.search(r'give it another name with (as = ")\.\.\."', said)
    assert found, said
    plan.write_text(ICP + f'[[stage]]\nuse = "icp"\n{found[1]}again"\n')
    followed(*run)
    second = '[[stage]]\nuse = "landmarks"\n'
    plan.write_text(ICP + 'after = "landmarks"\n' + second)
    assert "is not made before icp; name an earlier estimate" in refused(*run, "--force")
    plan.write_text(ICP + 'after = "start"\n' + second)
    followed(*run, "--force")


def test_a_pipeline_and_its_run_name_their_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = ball(tmp_path / "ball")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r'give one to run\(\), or set case = "folder"') as refusal:
        o3dls.Pipeline([o3dls.ICP()], folds=0).run()
    assert line_in(str(refusal.value), "case") == 'case = "folder"'
    Path("plan.toml").write_text(ICP)
    run = o3dls.Pipeline([o3dls.ICP()], folds=0).run(o3dls.read_case(case))
    with pytest.raises(InputError, match="has no folder to go to: give one to write") as refusal:
        run.write()
    line = line_in(str(refusal.value), "out")
    assert run.write("given").is_dir()
    case.rename("folder")
    Path("plan.toml").write_text(f'case = "folder"\n{line}\n'.replace(line, 'out = "made"') + ICP)
    made = o3dls.read_pipeline("plan.toml").run().write()
    assert (made / "run.json").is_file()


def with_rectangle(seed: int, off: float, *, swapped: bool) -> Case:
    """A case whose landmarks are the corners of a rectangle, so far off the middle, which tell nobody left
    from right, and whose prior is 1.5 times too large.
    """
    prior, T = chamber(24), pose(20.0, 8.0)
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    corners = np.array([[1.0, 1], [1, -1], [-1, 1], [-1, -1]]) * rng.uniform(10.0, 25.0, 2)
    at = prior.vertices.mean(axis=0) + off * rng.normal(size=3) + corners @ axes
    names = np.array(["LSPV", "LIPV", "RSPV", "RIPV"])
    places = apply(T, np.vstack([sampled(prior, 60, seed), at]))
    kinds = np.array(["eam"] * 60 + ["landmark"] * 4)
    points = Points(places, kinds, {"name": np.concatenate([np.full(60, ""), names])})
    named = names[[2, 3, 0, 1]] if swapped else names
    marks = {str(name): 1.5 * place for name, place in zip(named, at, strict=True)}
    return Case("rectangle", prior.with_vertices(1.5 * prior.vertices), points, marks)


@pytest.mark.parametrize("where", ["option", "file"])
def test_a_factor_of_size_is_estimated_where_that_is_said(where: str, plan: Path, tmp_path: Path) -> None:
    """Of names that are swapped besides it is said next, and not the factor again."""
    write_case(tmp_path / "case", with_rectangle(5, 12.0, swapped=True))
    run: tuple[object, ...] = ("run", plan, "--case", tmp_path / "case", "--out", tmp_path / "run")
    line = line_in(refused(*run), "landmarks.scale")
    if where == "option":
        run += ("--set", line)
    else:
        stage, _, setting = line.partition(".")
        plan.write_text(LANDMARKS.replace(f'"{stage}"\n', f'"{stage}"\n{setting}\n'))
    said = refused(*run)
    assert "seem to be swapped" in said
    assert "correct the names in points.csv or prior_landmarks.csv" in said
    shutil.rmtree(tmp_path / "case")
    write_case(tmp_path / "case", with_rectangle(5, 12.0, swapped=False))
    followed(*run)
    found = o3dls.read_run(tmp_path / "run").estimates["landmarks"].surface
    assert found.area == pytest.approx(chamber(24).area, rel=1e-3)


def test_a_factor_of_size_alone_is_estimated_or_scaled_out() -> None:
    case = with_rectangle(3, 6.0, swapped=False)
    start = Estimate(case.prior, np.eye(4), "start")
    with pytest.raises(InputError, match=r"leave the names, or say landmarks\.scale = true$") as refusal:
        o3dls.Landmarks()(case, start)
    factor = re.search(r"the prior is ([\d.]+) times as large", str(refusal.value))
    assert factor
    smaller = replace(
        case,
        prior=case.prior.with_vertices(case.prior.vertices / float(factor[1])),
        prior_landmarks={name: at / float(factor[1]) for name, at in case.prior_landmarks.items()},
    )
    for found in (o3dls.Landmarks(scale=True)(case, start), o3dls.Landmarks()(smaller, start)):
        assert found.surface.area == pytest.approx(chamber(24).area, rel=1e-3)


def test_a_line_that_init_wrote_is_changed_as_it_says(tmp_path: Path) -> None:
    case, made = ball(tmp_path / "ball"), tmp_path / "made"
    followed("init", made, "--prior", case / "prior.ply", "--points", case / "points.csv")
    for file, line, changed in (
        ("case.toml", '# notes = ""', 'notes = "mine"'),
        ("pipeline.toml", "# folds = 5", "folds = 0"),
    ):
        text = (made / file).read_text()
        assert "to change it, remove the # and write another value." in text
        key = line.split(" = ")[0]
        there = re.search(rf"(?m)^{key} = .*$", text)
        assert there, text
        (made / file).write_text(text.replace(there[0], changed))
    followed("run", made / "pipeline.toml", "--set", "level_set.spacing=4")
    run = o3dls.read_run(made / "run")
    assert run.case.notes == "mine"
    assert run.provenance.pipeline["folds"] == 0


def test_a_prior_of_another_person_is_said_to_be_one(tmp_path: Path) -> None:
    """The motion of a run so far off is that of another heart; here only how much it bends is made up."""
    fit = cast(MotionFit, SimpleNamespace(gradient=0.25))
    case = ball(tmp_path / "ball")
    (said,) = another_heart(o3dls.read_case(case), fit)
    add_line(case, line_in(str(said), "prior_of"))
    assert another_heart(o3dls.read_case(case), fit) == []


def test_a_frame_is_said_in_case_toml_for_a_file_that_needs_one(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball", frame="unknown")
    run = ("run", plan, "--case", case, "--out", tmp_path / "run", "--force")
    followed(*run)
    export = ("export", tmp_path / "run", "--format", "mask_nifti", "--out", tmp_path / "a.nii.gz")
    said = refused(*export)
    found = re.search(r'say (frame = "LPS") or "RAS" in its case.toml', said)
    assert found, said
    add_line(tmp_path / "run/case", found[1])
    code = followed(*export)
    assert (tmp_path / "a.nii.gz").is_file(), code


DAMAGES: dict[str, Callable[[Path], Any]] = {
    "run.json": lambda run: (run / "run.json").write_text('{"schema": "o3dls/run/2"}'),
    "points.csv": lambda run: (run / "points.csv").write_text("x,y,z\n1,2,3\n"),
    "moved_prior.ply": lambda run: write_surface(
        next(run.glob("estimates/*/moved_prior.ply")), sphere(9.0, 5), units="mm"
    ),
    "posterior.npy": lambda run: next(run.glob("estimates/*/posterior.npy")).write_bytes(b"\x93NUMPY"),
    "posterior.npy, rows": lambda run: np.save(
        next(run.glob("estimates/*/posterior.npy")), np.full((4, 3), 1e9)
    ),
    "posterior_rows.npz": lambda run: next(run.glob("estimates/*/posterior_rows.npz")).write_bytes(b"PK"),
}


@pytest.fixture(scope="module")
def deformed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[object, ...]]:
    """A run with a motion, and the command that made it."""
    folder = tmp_path_factory.mktemp("again")
    (folder / "plan.toml").write_text('folds = 0\n[[stage]]\nuse = "deform"\n')
    run = ("run", folder / "plan.toml", "--case", ball(folder / "ball"), "--out", folder / "run")
    followed(*run)
    return folder / "run", (*run, "--force")


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_run_is_run_again(damage: str, deformed: tuple[Path, tuple[object, ...]]) -> None:
    folder, run = deformed
    DAMAGES[damage](folder)
    report = ("report", folder, "--out", folder.parent / "page.html")
    assert "run it again" in refused(*report)
    followed(*run)
    followed(*report)


def test_a_failure_that_does_not_say_why_is_run_again(plan: Path, tmp_path: Path) -> None:
    batch = ("batch", ball(tmp_path / "ball"), "--pipeline", plan, "--out", tmp_path / "runs")
    followed(*batch)
    (tmp_path / "runs/ball.failed.json").write_text("{}")
    assert "does not say why the case failed; run it again" in refused("cohort", tmp_path / "runs")
    followed(*batch)
    followed("cohort", tmp_path / "runs")


def test_next_places_are_those_of_a_run_with_a_motion(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    run = ("run", plan, "--case", case, "--out", tmp_path / "run", "--force")
    followed(*run)
    made = o3dls.read_run(tmp_path / "run")
    with pytest.raises(InputError, match="run a pipeline with the stage 'deform' again") as refusal:
        o3dls.suggest(made.case, made.estimates["landmarks"], k=1)
    found = re.search(r"stage '(\w+)'", str(refusal.value))
    assert found
    plan.write_text(f'folds = 0\n[[stage]]\nuse = "{found[1]}"\n')
    followed(*run)
    made = o3dls.read_run(tmp_path / "run")
    assert o3dls.suggest(made.case, made.estimates["deform"], k=1).places


def test_folds_that_are_set_test_the_expected_error(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text('folds = 0\n[[stage]]\nuse = "deform"\n')
    run = ("run", tmp_path / "plan.toml", "--case", ball(tmp_path / "ball"), "--out", tmp_path / "run")
    report = ("report", tmp_path / "run", "--out", tmp_path / "page.html")
    followed(*run)
    followed(*report)
    line = line_in((tmp_path / "page.html").read_text(), "folds")
    followed(*run, "--force", "--set", line)
    followed(*report)
    page = (tmp_path / "page.html").read_text()
    assert "not cross-validated" not in page
    assert "points that were left out lie" in page


def test_what_is_installed_holds_the_package_that_is_missing() -> None:
    """An extra that a sentence names is one of pyproject.toml and has the package that the sentence misses;
    a package that it names is one that an extra has.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = {
        name: {re.split(r"[\[><=;]", part)[0] for part in parts}
        for name, parts in project["optional-dependencies"].items()
    }
    every = set().union(*extras.values())
    named = [text for _, _, text in strings() if "pip install" in text and "constraints.txt" not in text]
    assert len(named) == 8
    for text in named:
        target = re.search(r"pip install '?([\w{}]+)(?:\[(\w+)\]')?", text)
        assert target, text
        if target[2]:
            assert any(package in text for package in extras[target[2]]), text
        elif target[1] != "{}":
            assert target[1] in every, text
    source = (ROOT / "o3dls/adapters/meshes.py").read_text(encoding="utf-8")
    libraries = set(re.findall(r'_import_library\("(\w+)"', source))
    assert libraries
    assert libraries <= every | {re.split(r"[><=;]", part)[0] for part in project["dependencies"]}
    assert (ROOT / "constraints.txt").is_file()


def test_points_far_off_the_prior_begin_with_the_stage_that_is_named(plan: Path, tmp_path: Path) -> None:
    case = measured(chamber(24), pose(20.0, 400.0), 200)
    far = Points(case.points.of("eam").xyz, np.full(200, "eam"))
    write_case(tmp_path / "case", replace(case, points=far, prior_landmarks={}, truth=None))
    run = ("run", plan, "--case", tmp_path / "case", "--out", tmp_path / "run")
    plan.write_text(ICP)
    found = re.search(r"begin the pipeline with the stage (\w+)", refused(*run))
    assert found
    plan.write_text(ICP.replace("[[stage]]", f'[[stage]]\nuse = "{found[1]}"\n[[stage]]', 1))
    followed(*run)


def test_icp_that_finds_no_pairs_begins_with_the_stage_that_is_named(plan: Path, tmp_path: Path) -> None:
    case = measured(chamber(24), pose(20.0, 25.0), 200)
    far = Points(case.points.of("eam").xyz, np.full(200, "eam"))
    write_case(tmp_path / "case", replace(case, points=far, prior_landmarks={}, truth=None))
    run = ("run", plan, "--case", tmp_path / "case", "--out", tmp_path / "run")
    plan.write_text(ICP + 'reject = ["threshold"]\nthreshold = 0.02\n')
    code, said = said_by(*run)
    assert code == 3, said
    found = re.search(r"loosen them, or begin nearer, such as with the stage (\w+)", said)
    assert found, said
    plan.write_text(plan.read_text().replace("[[stage]]", f'[[stage]]\nuse = "{found[1]}"\n[[stage]]', 1))
    followed(*run)
    plan.write_text(ICP + 'reject = ["threshold"]\n')
    followed(*run, "--force")


def test_icp_that_ends_turned_begins_with_the_stage_that_is_named(plan: Path, tmp_path: Path) -> None:
    case = measured(chamber(24), pose(120.0, 5.0), 400)
    turned = Points(case.points.of("eam").xyz, np.full(400, "eam"))
    write_case(tmp_path / "case", replace(case, points=turned, prior_landmarks={}, truth=None))
    run = ("run", plan, "--case", tmp_path / "case", "--out", tmp_path / "run")
    plan.write_text(ICP)
    said = followed(*run)
    found = re.search(r"begin with the stage (\w+), or give landmarks", said)
    assert found, said
    plan.write_text(ICP.replace("[[stage]]", f'[[stage]]\nuse = "{found[1]}"\n[[stage]]', 1))
    assert "ICP ended" not in followed(*run, "--force")


def test_an_outline_has_the_engine_and_the_door_that_are_named(plan: Path, tmp_path: Path) -> None:
    disc = disc_case()
    write_case(tmp_path / "case", disc)
    run = ("run", plan, "--case", tmp_path / "case", "--out", tmp_path / "run")
    kernel = 'kernel = "huber"\nscale = false\n'
    plan.write_text(ICP + kernel + 'engine = "open3d"\n')
    said = refused(*run)
    found = re.search(r"use engine '(\w+)'", said)
    assert found, said
    plan.write_text(ICP + kernel + f'engine = "{found[1]}"\n')
    followed(*run)
    outline = (disc.prior.vertices, disc.prior.faces)
    with pytest.raises(InputError, match="use case_of and a Pipeline"):
        o3dls.register(outline, disc.points.xyz, units="px")
    case = o3dls.case_of(outline, disc.points.xyz, units="px")
    assert list(o3dls.Pipeline([o3dls.ICP()], folds=0).run(case).estimates) == ["start", "icp"]
