"""An option that a sentence names is taken by the command that printed it, which succeeds then; one that it
says to leave out is left out, and it succeeds too.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from said import said_by

import o3dls
from o3dls.io.case_writer import write_case
from o3dls.io.markups import Markups, write_markups
from o3dls.io.meshes import dif
from o3dls.io.points import write_points
from o3dls.io.surfaces import read_surface_file, write_surface
from o3dls.io.transforms import write_transform
from o3dls.pipeline import supervision
from tests.cli.test_advised_commands import LANDMARKS, advised, ball, followed, refused
from tests.io.test_io_advice import study
from tests.io.test_io_study import DXL, carto_folder
from tests.tiny import ball_case, sphere

ICP = 'folds = 0\n[[stage]]\nuse = "icp"\n'
nibabel = pytest.importorskip("nibabel")
BALLS = np.indices((40, 40, 40)) - 19.5


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    (tmp_path / "plan.toml").write_text(LANDMARKS)
    return tmp_path / "plan.toml"


def option(said: str, name: str) -> list[str]:
    """The option of that name with its value, as a text has it for a shell."""
    found = re.search(rf"--{name} ('[^']*'|[^\s,;:)]+)", said)
    assert found, said
    return [f"--{name}", *shlex.split(found[1])]


def listed(said: str, name: str) -> list[str]:
    """What a text lists behind an option, in brackets or after a colon."""
    found = re.search(rf"--{name}(?: \((?:there are )?([^)]*)\)|[^:]*: (?:there are )?(.*))", said)
    assert found, said
    return (found[1] or found[2]).strip().split(", ")


def told_to_omit(said: str, name: str) -> None:
    assert re.search(rf"omit --{name}\b", said), said


def without(command: tuple[object, ...], name: str) -> tuple[object, ...]:
    """A command without an option and its value."""
    at = command.index(f"--{name}")
    return command[:at] + command[at + 2 :]


def saved(mask: np.ndarray, path: Path, code: int = 1) -> Path:
    image = nibabel.Nifti1Image(mask.astype(np.uint8), np.eye(4))
    image.header.set_xyzt_units("mm")
    image.set_qform(np.eye(4), code=code)
    image.set_sform(np.eye(4), code=code)
    nibabel.save(image, path)
    return path


def one_ball(radius: float = 15.0) -> np.ndarray:
    return (BALLS**2).sum(axis=0) < radius**2


def test_a_case_that_is_given_for_a_pipeline(tmp_path: Path) -> None:
    case = ball(tmp_path / "the ball")
    quick = ("--set", "folds=0", "--set", "level_set.spacing=4", "--out", tmp_path / "run")
    followed("run", *option(refused("run", case, *quick), "case"), *quick)


@pytest.mark.parametrize("command", ["run", "init", "import", "demo"])
def test_what_is_there_is_replaced_by_force_where_that_is_said(command: str, tmp_path: Path) -> None:
    """Of a folder that no such command made it is not said."""
    case, target = ball(tmp_path / "ball"), tmp_path / "target"
    (tmp_path / "plan.toml").write_text(LANDMARKS)
    study(tmp_path)
    files = ("--prior", case / "prior.ply", "--points", case / "points.csv")
    line: tuple[object, ...] = {
        "run": ("run", tmp_path / "plan.toml", "--case", case, "--out", target),
        "init": ("init", target, *files),
        "import": ("import", tmp_path / "study.mat", target),
        "demo": ("demo", "--out", target),
    }[command]
    if command == "demo":  # any run will do
        followed("run", tmp_path / "plan.toml", "--case", case, "--out", target)
        assert "name another folder or use --force" in refused(*line)
        return
    followed(*line)
    assert "name another folder or use --force" in refused(*line)
    followed(*line, "--force")
    (target / "mine.txt").write_text("mine")
    for force in ((), ("--force",)):
        said = refused(*line, *force)
        assert "mine.txt, which o3dls did not write" in said
        assert "--force" not in said
    followed(*(tmp_path / "another" if word == target else word for word in line))


def test_a_table_of_another_batch_is_replaced_by_force(plan: Path, tmp_path: Path) -> None:
    one, two = ball(tmp_path / "one"), ball(tmp_path / "two")
    batch = ("batch", "--pipeline", plan, "--out", tmp_path / "runs")
    followed(*batch, one)
    assert "name another folder or use --force" in refused(*batch, two)
    followed(*batch, two, "--force")


def test_columns_are_named_as_the_sentence_shows(tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    points = case / "points.csv"
    points.write_text(points.read_text().replace("x,y,z", "East,y,z"))
    make = ("init", tmp_path / "made", "--prior", case / "prior.ply", "--points", points, "--columns")
    said = refused(*make, "East")
    found = re.search(r"must be NAME=HEADING, with a name of (\w+)", said)
    assert found, said
    followed(*make, f"{found[1]}=East")


@pytest.mark.parametrize("heading", ["Voltage", "Voltages", "Amplitude", "Spannung"])
def test_a_doubtful_heading_is_taken_as_what_it_is_said_to_be(
    heading: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "o3dls")
    case = ball(tmp_path / "ball")
    rows = "".join(f"{x},{y},{z},0.5\n" for x, y, z in ball_case().points.of("eam").xyz)
    (tmp_path / "p.csv").write_text(f"# units=mm\nx,y,z,{heading}\n{rows}")
    files = ("--prior", case / "prior.ply", "--points", tmp_path / "p.csv")
    followed("init", tmp_path / "made", *files)
    found = re.search(r"if it is (\w+) or (\w+), say --columns NAME=(.*)", caplog.text)
    assert found, caplog.text
    for name in found.groups()[:2]:
        followed("init", tmp_path / name, *files, "--columns", f"{name}={found[3]}")
        assert o3dls.read_case(tmp_path / name).points.columns[name][0] == 0.5


def test_a_frame_that_the_points_state_is_not_said_again(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    write_points(case / "points.csv", ball_case().points, space="LPS", units="mm")
    (case / "case.toml").write_text('name = "ball"\n')
    run = ("run", plan, "--case", case, "--out", tmp_path / "run")
    said = refused(*run, "--frame", "RAS")
    assert "states frame LPS, and --frame or case.toml says RAS; omit that, or correct the file" in said
    followed(*run)
    (case / "case.toml").write_text('frame = "RAS"\n')
    assert "omit that" in refused(*run, "--force")
    (case / "case.toml").write_text('name = "ball"\n')
    followed(*run, "--force")


def test_units_that_case_toml_states_are_not_said_again(plan: Path, tmp_path: Path) -> None:
    run = ("run", plan, "--case", ball(tmp_path / "ball"), "--out", tmp_path / "run")
    told_to_omit(refused(*run, "--units", "cm"), "units")
    followed(*run)


@pytest.mark.parametrize("says", ["option", "case.toml"])
def test_pixels_are_no_units_of_a_file_in_millimetres(says: str, plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    run = ("run", plan, "--case", case, "--out", tmp_path / "run")
    toml = case / "case.toml"
    toml.write_text(toml.read_text().replace('"mm"', '"px"') if says == "case.toml" else 'name = "a"\n')
    pixels = ("--units", "px") if says == "option" else ()
    assert "correct the file, or the units in case.toml or --units" in refused(*run, *pixels)
    toml.write_text(toml.read_text().replace('"px"', '"mm"'))
    followed(*run)


def test_units_that_are_said_of_points_alone(tmp_path: Path) -> None:
    """`--units` is of all files that state none: a prior in mm is written so that it says so."""
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in ball_case().points.of("eam").xyz / 1000.0)
    (tmp_path / "p.csv").write_text(f"x,y,z\n{rows}")
    write_surface(tmp_path / "prior.obj", sphere())
    text = (tmp_path / "prior.obj").read_text()
    (tmp_path / "prior.obj").write_text("".join(row for row in text.splitlines(True) if row[0] != "#"))
    make = ("init", tmp_path / "made", "--points", tmp_path / "p.csv", "--prior")
    units = option(refused(*make, tmp_path / "prior.obj"), "units")
    said = refused(*make, tmp_path / "prior.obj", *units)
    assert "if the prior is in mm, write that into it" in said
    folder = tmp_path / "folder"  # as a case folder that says so
    folder.mkdir()
    for name in ("prior.obj", "p.csv"):
        (folder / ("points.csv" if name == "p.csv" else name)).write_bytes((tmp_path / name).read_bytes())
    (folder / "case.toml").write_text('units = "m"\n')
    (tmp_path / "plan.toml").write_text(ICP)
    run = ("run", tmp_path / "plan.toml", "--case", folder, "--out", tmp_path / "run")
    assert refused(*run).endswith("o3dls convert PRIOR OUT --units mm\n")
    followed("convert", folder / "prior.obj", folder / "prior.ply", "--units", "mm")
    (folder / "prior.obj").unlink()
    followed(*run)
    followed(*advised(said, "convert", PRIOR=tmp_path / "prior.obj", OUT=tmp_path / "prior.ply"))
    followed(*make, tmp_path / "prior.ply", *units)
    case = o3dls.read_case(tmp_path / "made")
    assert case.prior.diagonal == pytest.approx(sphere().diagonal)
    assert np.ptp(case.points.xyz, axis=0).max() < 50.0


def test_units_that_are_said_of_a_prior_alone(tmp_path: Path) -> None:
    """`--units` is of all files that state none: where the points are in mm, they are to say so."""
    prior = sphere()
    write_surface(tmp_path / "m.ply", prior.with_vertices(prior.vertices / 1000.0))
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in ball_case().points.of("eam").xyz)
    (tmp_path / "p.csv").write_text(f"x,y,z\n{rows}")
    make = ("init", tmp_path / "made", "--prior", tmp_path / "m.ply", "--points", tmp_path / "p.csv")
    make += tuple(option(refused(*make), "units"))
    said = refused(*make)
    found = re.search(r"if the points are in (\w+), add the line '(.*?)' above the header", said)
    assert found, said
    assert found[1] == "mm"
    (tmp_path / "p.csv").write_text(f"{found[2]}\nx,y,z\n{rows}")
    followed(*make)
    case = o3dls.read_case(tmp_path / "made")
    assert case.prior.diagonal == pytest.approx(prior.diagonal)
    assert np.ptp(case.points.xyz, axis=0).max() < 50.0


def test_labels_that_look_like_a_grey_image_are_read_by_the_one_that_is_said(tmp_path: Path) -> None:
    image = np.random.default_rng(3).integers(50, 250, BALLS.shape[1:])
    image[one_ball()] = 7
    path = saved(image, tmp_path / "la.nii")
    said = refused("convert", path, tmp_path / "la.ply")
    assert said.endswith("if these are labels, say --label\n")
    followed("convert", path, tmp_path / "la.ply", "--label", 7)
    assert o3dls.read_surface(tmp_path / "la.ply").volume == pytest.approx(one_ball().sum(), rel=0.02)


def test_blank_slices_that_are_noted_are_interpolated(tmp_path: Path) -> None:
    mask = one_ball()
    mask[:, :, 6] = False  # near the end, where little is lost
    convert = ("convert", saved(mask, tmp_path / "la.nii"), tmp_path / "la.ply")
    found = re.search(r"1 blank slices lie within it; (--[a-z-]+) interpolates them", followed(*convert))
    assert found
    assert "1 blank slices within it are interpolated" in followed(*convert, found[1])
    assert o3dls.read_surface(tmp_path / "la.ply").volume == pytest.approx(one_ball().sum(), rel=0.02)


def test_every_label_that_is_listed_is_one(tmp_path: Path) -> None:
    labels = np.where(one_ball(18.0), 2, 0)
    labels[one_ball(12.0)] = 5
    path = saved(labels, tmp_path / "la.nii")
    for label in listed(refused("convert", path, tmp_path / "la.ply"), "label"):
        followed("convert", path, tmp_path / f"{label}.ply", "--label", label)
    assert sorted(one.name for one in tmp_path.glob("*.ply")) == ["2.ply", "5.ply"]


def segments(layers: np.ndarray, path: Path, *names: str) -> Path:
    """A segmentation of 3D Slicer: a name for each of its layers (layers, x, y, z)."""
    sizes = " ".join(map(str, layers.shape))
    lines = [
        f"NRRD0004\ntype: uint8\ndimension: 4\nspace: left-posterior-superior\nsizes: {sizes}",
        "space directions: none (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)",
        "kinds: list domain domain domain\nencoding: raw",
    ]
    for k, name in enumerate(names):
        lines.append(f"Segment{k}_Name:={name}\nSegment{k}_LabelValue:=1\nSegment{k}_Layer:={k}")
    data = layers.astype(np.uint8).tobytes(order="F")
    path.write_bytes("\n".join(lines).encode() + b"\n\n" + data)
    return path


@pytest.mark.parametrize("named", [True, False])
def test_every_layer_and_part_that_is_listed_is_one(named: bool, tmp_path: Path) -> None:
    """The layer between is of another label."""
    layers = np.stack([one_ball(15.0), 2 * one_ball(15.0), one_ball(15.0)])
    names = ("LA", "wall", "LV") if named else ()
    path = segments(layers, tmp_path / "a.nrrd", *names)
    convert = ("convert", path, tmp_path / "la.ply")
    said = refused(*convert)
    labels = listed(said, "label")
    assert labels == ["1", "2"]
    for part in listed(said, "part") if named else []:
        code, text = said_by(*convert, "--part", part)
        assert code == (2 if part == "wall" else 0), text  # which states a label that it has not
    said = refused(*convert, "--label", 1)
    layers_of = listed(said, "layer")
    assert layers_of == ["0", "2"]
    for layer in layers_of:
        followed(*convert, "--label", 1, "--layer", layer)
    assert "--part" not in said  # which the next command would not take beside --label
    said = refused(*convert, "--label", 1, "--part", "LA") if named else ""
    if named:
        assert "label 1 and part 'LA' are both given; say the one that is meant" in said.replace('"', "'")
        followed(*convert, "--part", "LA")
        followed(*convert, "--label", 2)


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
def test_a_frame_is_said_for_a_volume_without_a_form(frame: str, tmp_path: Path) -> None:
    path = saved(one_ball(), tmp_path / "la.nii", code=0)
    convert = ("convert", path, tmp_path / "la.ply")
    assert f"--frame {frame} where" in refused(*convert)
    followed(*convert, "--frame", frame)
    assert read_surface_file(tmp_path / "la.ply").space == frame


def test_a_form_that_is_not_there_is_omitted(tmp_path: Path) -> None:
    path = saved(one_ball(), tmp_path / "la.nii")
    image = nibabel.load(path)
    image.set_qform(np.eye(4), code=0)
    nibabel.save(image, tmp_path / "one.nii")
    command = ("convert", tmp_path / "one.nii", tmp_path / "la.ply", "--form", "qform")
    told_to_omit(refused(*command), "form")
    followed(*without(command, "form"))


def test_a_sidecar_that_is_not_there_is_omitted(tmp_path: Path) -> None:
    command = ("convert", saved(one_ball(), tmp_path / "la.nii"), tmp_path / "la.ply", "--sidecar", "take")
    told_to_omit(refused(*command), "sidecar")
    followed(*without(command, "sidecar"))


def test_an_analyze_image_is_saved_as_nifti(tmp_path: Path) -> None:
    image = nibabel.AnalyzeImage(one_ball().astype(np.uint8), np.eye(4))
    nibabel.save(image, tmp_path / "la.hdr")
    said = refused("convert", tmp_path / "la.hdr", tmp_path / "la.ply")
    assert "is Analyze 7.5, which does not say left from right: save it as NIfTI" in said
    saved(np.asarray(nibabel.load(tmp_path / "la.hdr").dataobj), tmp_path / "la.nii")
    followed("convert", tmp_path / "la.nii", tmp_path / "la.ply")


def two_maps(folder: Path, name: str) -> Path:
    """A study of CARTO with two maps of three points, of which the second has that name."""
    xml = carto_folder(folder) / "Study 1.xml"
    text = xml.read_text(encoding="cp1252").replace("2 empty µ", name)
    text = text.replace('Name="1-Map"', f'Name="{name}"') if name == "LA" else text
    points = text[text.index("<CartoPoints") : text.index("</Map>")]
    xml.write_text(text.replace('<CartoPoints Count="0" />', points), encoding="cp1252")
    second = (folder / "1-Map_car.txt").read_bytes().replace(b"1-Map", b"2-Map")
    (folder / "2-Map_car.txt").write_bytes(second)
    return folder


def test_maps_of_one_name_are_imported_by_the_name_of_a_file(tmp_path: Path) -> None:
    take = ("import", two_maps(tmp_path / "carto", "LA"))
    said = refused(*take, tmp_path / "no", "--map", "LA")
    assert "say which with --map, by the name of its file" in said
    files = re.findall(r"\((\S+), 3 points\)", said)
    assert len(files) == 2, said
    for k, file in enumerate(files):
        followed(*take, tmp_path / f"case{k}", "--map", file)


def test_every_map_that_is_listed_is_imported_by_its_name(tmp_path: Path) -> None:
    """Of CARTO by the name of the map, of EnSite by that of its file, of OpenEP by that of the data set."""
    two_maps(tmp_path / "carto", "2-Map")
    (tmp_path / "ensite").mkdir()
    (tmp_path / "ensite/a.csv").write_text(DXL)
    (tmp_path / "ensite/b.csv").write_text(DXL.replace("9,1,0.5,1", "9,1,0.6,1"))
    (tmp_path / "openep").mkdir()
    whole = Path(study(tmp_path)).read_bytes()
    for name in ("one", "two"):
        (tmp_path / f"openep/{name}.mat").write_bytes(whole)
    for system in ("carto", "ensite", "openep"):
        said = refused("import", tmp_path / system, tmp_path / "no")
        names = [re.sub(r" \(.*", "", name) for name in listed(said, "map")]
        if "say which file" in said:
            names = re.findall(r"\((\S+), \d+ points\)", said)
        assert len(names) == 2, said
        for k, name in enumerate(names):
            followed("import", tmp_path / system, tmp_path / f"{system}{k}", "--map", name)


def test_an_import_takes_the_prior_and_landmarks_that_it_asks_for(tmp_path: Path) -> None:
    carto, prior = carto_folder(tmp_path / "carto"), tmp_path / "prior.ply"
    write_surface(prior, sphere(), space="LPS", units="mm")
    take = ("import", carto, tmp_path / "case", "--map", "1-Map", "--force")
    said = refused(*take, "--label", 1)
    assert "label: needs a prior; name one with --prior" in said
    nifti = saved(one_ball(), tmp_path / "la.nii")
    followed(*take, "--label", 1, "--prior", nifti)
    said = refused(*take, "--prior", prior, "--frame", "RAS")
    told_to_omit(said, "frame")
    said = followed(*take, "--prior", prior)
    assert "landmarks LSPV: have no partners" in said
    assert "name them with --landmarks" in said
    (tmp_path / "marks.csv").write_text("name,x,y,z\nLSPV,1,2,3\n")
    assert "no partners" not in followed(*take, "--prior", prior, "--landmarks", tmp_path / "marks.csv")
    assert o3dls.read_case(tmp_path / "case", fewest=0).landmark_pairs()[0] == ["LSPV"]


def test_every_part_of_a_dif_file_that_is_listed_is_one(tmp_path: Path) -> None:
    data = dif.encode(sphere(), name="LA")
    volume = data[data.index(b"<Volume ") : data.index(b"</Volumes>")]
    (tmp_path / "a.xml").write_bytes(data.replace(volume, volume + volume.replace(b'"LA"', b'"RA"')))
    names = listed(refused("convert", tmp_path / "a.xml", tmp_path / "no.ply"), "part")
    assert names == ["LA", "RA"]
    for name in names:
        followed("convert", tmp_path / "a.xml", tmp_path / f"{name}.ply", "--part", name)


def test_units_of_opencarp_are_said_to_convert_and_run(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    write_surface(tmp_path / "a.pts", o3dls.read_surface(case / "prior.ply"))
    for path in (tmp_path / "a.pts", tmp_path / "a.elem"):
        if path.suffix == ".pts":
            rows = path.read_text().splitlines()
            rows[1:] = [" ".join(str(float(n) / 1000) for n in row.split()) for row in rows[1:]]
            path.write_text("\n".join(rows) + "\n")
        path.rename(case / f"prior{path.suffix}")
    (case / "prior.ply").unlink()
    (case / "case.toml").write_text('prior = "prior.pts"\n')
    for command in (
        ("convert", case / "prior.pts", tmp_path / "a.ply"),
        ("run", plan, "--case", case, "--out", tmp_path / "run"),
    ):
        said = refused(*command)
        assert "say --units um or --units mm to convert or run" in said
        followed(*command, "--units", "mm")
    assert o3dls.read_surface(tmp_path / "a.ply").diagonal == pytest.approx(sphere().diagonal, rel=1e-4)


@pytest.mark.parametrize("kind", ["outline", "markups", "pose", "surface"])
def test_an_option_that_does_not_apply_is_omitted(kind: str, tmp_path: Path) -> None:
    name = {"outline": "to", "surface": "units"}.get(kind, "units")
    value = "LPS" if name == "to" else "cm"
    if kind == "outline":
        (tmp_path / "a.csv").write_text("# units=cm space=RAS\nx,y\n0,0\n6,0\n6,7\n")
        files = ("a.csv", "b.csv")
    elif kind == "markups":
        write_markups(tmp_path / "a.mrk.json", Markups(("a",), np.ones((1, 3)), "LPS"))
        files = ("a.mrk.json", "b.csv")
    elif kind == "pose":
        write_transform(tmp_path / "a.txt", np.eye(4), "LPS")
        files = ("a.txt", "b.txt")
    else:
        write_surface(tmp_path / "a.ply", sphere(), units="mm")
        files = ("a.ply", "b.ply")
    command = ("convert", *(tmp_path / file for file in files), f"--{name}", value)
    told_to_omit(refused(*command), name)
    followed(*without(command, name))


def test_units_that_nobody_knows_and_frames_are_stated(tmp_path: Path) -> None:
    write_surface(tmp_path / "a.ply", sphere(), units="millimeter")
    command: tuple[object, ...] = ("convert", tmp_path / "a.ply", tmp_path / "b.ply", "--to", "RAS")
    said = refused(*command)
    found = re.search(r"must be one of (\w+), .*say which with (--units)", said)
    assert found, said
    command += (found[2], found[1])
    said = refused(*command)
    found = re.search(r"state it with (--frame)\n", said)
    assert found, said
    followed(*command, found[1], "LPS")
    turned = read_surface_file(tmp_path / "b.ply")
    assert (turned.space, turned.units) == ("RAS", "mm")


def test_where_no_system_says_the_memory_the_limit_is_left_out(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervision, "resident", lambda _: 0)
    batch = ("batch", ball(tmp_path / "ball"), "--pipeline", plan, "--out", tmp_path / "runs")
    assert "what memory a process has; leave it out" in refused(*batch, "--memory", "4GB")
    followed(*batch)


def test_settings_are_said_as_the_sentence_shows(plan: Path, tmp_path: Path) -> None:
    case = ball(tmp_path / "the ball")
    plan.write_text(ICP)
    run = ("run", plan, "--case", case, "--force", "--out", tmp_path / "run")
    said = refused(*run, "--set", "icp")
    found = re.search(r"must be STAGE.PARAM=VALUE, such as (\S+)", said)
    assert found, said
    followed(*run, "--set", found[1])
    said = refused(*run, "--set", "icpp.keep=0.9")
    found = re.search(r"the pipeline has no 'icpp': did you mean '(\w+)'", said)
    assert found, said
    followed(*run, "--set", f"{found[1]}.keep=0.9")
    said = refused("run", plan, "--set", f"case={case}", "--out", tmp_path / "other")
    followed("run", plan, *option(said, "case"), "--out", tmp_path / "other")
    said = refused("run", plan, "--case", case, "--set", f"out={tmp_path / 'the third'}")
    followed("run", plan, "--case", case, *option(said, "out"))
    assert (tmp_path / "the third/run.json").is_file()
    plan.write_text(ICP + '[[write]]\nuse = "export"\nformat = "ply"\n[[write]]\nuse = "export"\n')
    said = refused(*run, "--set", "export.format=stl")
    assert "the pipeline has 2 named 'export'; set it in the pipeline file" in said
    plan.write_text(plan.read_text().replace('"ply"', '"stl"'))
    followed(*run)
    assert list((tmp_path / "run/export").glob("*.stl"))


def test_a_run_goes_where_it_replaces_no_case(tmp_path: Path) -> None:
    case = ball(tmp_path / "ball")
    made = tmp_path / "made"
    make = ("init", made, "--prior", case / "prior.ply", "--points", case / "points.csv", "--out")
    assert "name another folder" in refused(*make, made)
    followed(*make, tmp_path / "another")


def test_vmin_and_vmax_are_of_a_field_that_is_said(plan: Path, tmp_path: Path) -> None:
    points = ball_case().points
    values = {**points.columns, "bipolar": np.linspace(0.1, 3.0, len(points))}
    case = tmp_path / "ball"
    write_case(case, replace(ball_case(), points=replace(points, columns=values)))
    followed("run", plan, "--case", case, "--out", tmp_path / "run")
    export = ("export", tmp_path / "run", "--format", "carto_vtk", "--out", tmp_path / "a.vtk")
    limits = ("--vmin", 0.5, "--vmax", 1.5)
    assert "and none is named; say field" in refused(*export, *limits)
    followed(*export, *limits, "--field", "bipolar")
    assert "are in LPS by definition; omit frame" in refused(
        "export", tmp_path / "run", "--format", "dif", "--out", tmp_path / "a.xml", "--frame", "RAS"
    )
    followed("export", tmp_path / "run", "--format", "dif", "--out", tmp_path / "a.xml")


def test_files_are_given_where_there_is_no_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = ball(tmp_path / "ball")
    monkeypatch.setattr("sys.stdin", (tmp_path / "plan").open("w+"))
    said = refused("init", tmp_path / "made")
    found = re.search(r"give (--prior) FILE and (--points) FILE", said)
    assert found, said
    followed("init", tmp_path / "made", found[1], case / "prior.ply", found[2], case / "points.csv")
