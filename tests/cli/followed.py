"""Find every sentence of the program that advises a user to do something, by the syntax of its source."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from o3dls.cli.commands import cli

ROOT = Path(__file__).resolve().parents[2]
OPTION = re.compile(r"(?<![\w-])--(?:\{\}|[a-z][a-z-]+)")
COMMAND = re.compile(r"o3dls (\w+)")
SAID = re.compile(
    r"\b[Ss]ay\b|\bomit\b|\brun (?:it|them|again|there|the case|a pipeline)\b|\bpip install\b"
    r"|\bthe stage global_pose\b|\bengine '|\buse case_of\b"
)
# a line of a file, or a keyword: `cap = true`, `units='mm'`
LINE = re.compile(r"\b[a-z_]+ ?= ?(?:[\"'{\[]|true|false|True|mm\b|\d)|case\.toml")
VERB = re.compile(r"\b(?:add|correct|give|leave|name|omit|put|raise|remove|set|state|take|use|write)\b")


def strings() -> Iterator[tuple[str, int, str]]:
    """The strings of the program with module and line, and what is filled in as {}; no docstrings."""
    for path in sorted((ROOT / "o3dls").rglob("*.py")):
        name = path.relative_to(ROOT / "o3dls").with_suffix("").as_posix()
        tree = ast.parse(path.read_text(encoding="utf-8"))
        nodes = list(ast.walk(tree))
        skipped = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
        skipped |= {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        for node in nodes:
            text = None if id(node) in skipped else string_of(node)
            if text is not None:
                yield name, node.lineno, text  # type: ignore[attr-defined]  # strings have a line


def string_of(node: ast.AST) -> str | None:
    if isinstance(node, ast.JoinedStr):
        return "".join(str(p.value) if isinstance(p, ast.Constant) else "{}" for p in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def advises(text: str) -> bool:
    """Whether a text names an option or a command, says what to say or to run, or what to do with a line of a
    file or a keyword.
    """
    return " " in text and bool(
        OPTION.search(text)
        or set(COMMAND.findall(text)) & set(cli.commands)
        or SAID.search(text)
        or (LINE.search(text) and VERB.search(text))
    )


STACKS, IMAGE = "report/test_stacks.py::", "io/test_io_image.py::"
COMMANDS, OPTIONS, LINES = ("cli/test_advised_" + name + ".py::" for name in ("commands", "options", "lines"))
ADVICE, IO_ADVICE = "cli/test_advice.py::", "io/test_io_advice.py::"
CHOICE, SIDECAR, LIVE = (
    "io/test_io_label_choice.py::",
    "io/test_io_sidecar.py::",
    "live/test_live_advice.py::",
)
FEWEST_LETTERS = 14  # of words that may stand anywhere in a sentence
# words of a sentence: the test that provokes it, does what it says, and sees that the command then succeeds
FOLLOWED = {
    "o3dls measure has regions, distances and lesions": "report/test_measure_command.py::"
    "test_lesions_have_gaps_and_distances_to_scars",
    "--on and --out go with --mean": "report/test_mean_command.py::"
    "test_it_is_laid_on_the_atrium_that_is_named",
    "give its cycle length, --cycle": (
        "report/test_activation_command.py::test_early_beside_late_is_said_and_taken_in_with_a_cycle"
    ),
    # commands
    "parts of the cases, and then `o3dls cohort`": "cli/test_cli.py::"
    "test_a_batch_goes_on_and_its_parts_give_the_table_of_the_whole",
    "to run it: o3dls run": COMMANDS + "test_what_init_says_is_run",
    "this folder; another: o3dls run --case DIR": COMMANDS + "test_what_init_says_is_run",
    "o3dls stages NAME. After a change: o3dls check": COMMANDS + "test_what_init_says_is_run",
    "no report yet: o3dls report": COMMANDS + "test_a_run_without_a_report_gets_one",
    "o3dls run pipeline.toml --case case --out again": COMMANDS + "test_a_run_without_a_report_gets_one",
    "in the run folder as pipeline.toml and run there": COMMANDS + "test_a_run_without_a_report_gets_one",
    "is a table and no study: use o3dls init": COMMANDS + "test_a_table_is_no_study",
    "if it is the export of a study, use o3dls import": COMMANDS + "test_a_study_is_no_table",
    "put the MRI or CT surface there before o3dls run": COMMANDS + "test_a_study_is_no_table",
    "state it with o3dls convert --frame": COMMANDS + "test_landmarks_without_a_frame_get_one",
    "say um (for this file alone: o3dls convert)": COMMANDS + "test_micrometres_for_one_file_alone",
    "close it with `o3dls convert --cap`": IO_ADVICE + "test_what_is_advised_for_an_open_prior_closes_it",
    "or say cap = true in case.toml": LINES + "test_an_open_prior_is_closed_by_a_line_or_a_keyword",
    "mend it with `o3dls convert --repair`": "adapters/test_mending.py::"
    "test_the_sentence_that_refuses_names_the_mend",
    "or run the case by o3dls run": COMMANDS + "test_what_is_too_much_for_a_session_is_run",
    "name the folder that `o3dls batch`": COMMANDS + "test_a_cohort_is_that_of_a_batch",
    "name the one that `o3dls batch`": COMMANDS + "test_a_cohort_is_that_of_a_batch",
    "write it in mm: o3dls convert PRIOR OUT": COMMANDS + "test_a_prior_in_metres_is_written_in_millimetres",
    "write that into it: o3dls convert PRIOR OUT": OPTIONS + "test_units_that_are_said_of_points_alone",
    "for several there is o3dls compare": COMMANDS + "test_runs_of_two_cases_are_compared",
    "its pictures are in the report: o3dls report": COMMANDS
    + "test_a_run_in_2d_has_its_pictures_in_the_report",
    "look at the page in a browser: o3dls view": COMMANDS + "test_where_no_window_opens_a_page_does",
    "o3dls convert PRIOR prior.ply": COMMANDS + "test_a_prior_without_a_frame_gets_one",
    "With o3dls slices RUN --image": STACKS + "test_an_image_that_is_gone_is_said_and_another_is_named",
    "the image is no longer at {}; name where it is": STACKS
    + "test_an_image_that_is_gone_is_said_and_another_is_named",
    "has no image of its prior; name one": STACKS + "test_a_run_without_an_image_asks_for_one",
    "an image belongs to a prior; name one": IMAGE + "test_an_import_refers_to_the_image_of_its_prior",
    "lie in the body: orient it first": IMAGE + "test_an_image_that_does_not_say_how_it_lies_is_oriented",
    "folder of DICOM files install pydicom": IMAGE + "test_a_series_is_read_once_pydicom_is_there",
    "as `o3dls settings": COMMANDS + "test_settings_that_others_print",
    "`o3dls paper --out": "paper/test_paper.py::"
    "test_a_quick_page_has_every_section_and_says_what_is_left_out",
    # options of files, as `convert`, `init` and `import` have them
    "if its units are {}, say --units {}, else --units {}": IO_ADVICE
    + "test_units_of_a_header_that_cannot_be_meant_are_asked_about_at_every_door",
    "if its units are {}, say --units {}, else --units mm": OPTIONS
    + "test_units_that_are_said_of_points_alone",
    "say --units um or --units mm to convert or run": OPTIONS
    + "test_units_of_opencarp_are_said_to_convert_and_run",
    "say which with --units": OPTIONS + "test_units_that_nobody_knows_and_frames_are_stated",
    "state it with --frame": OPTIONS + "test_units_that_nobody_knows_and_frames_are_stated",
    "say --frame RAS where i, j and k": OPTIONS + "test_a_frame_is_said_for_a_volume_without_a_form",
    "--label (there are {})": OPTIONS + "test_every_label_that_is_listed_is_one",
    "--layer ({})": OPTIONS + "test_every_layer_and_part_that_is_listed_is_one",
    "--part ({})": OPTIONS + "test_every_layer_and_part_that_is_listed_is_one",
    "; say ": OPTIONS + "test_every_layer_and_part_that_is_listed_is_one",  # before the three
    "are both given; say the one that is meant": OPTIONS + "test_every_layer_and_part_that_is_listed_is_one",
    "say the label of the chamber with --label": CHOICE
    + "test_an_inverted_mask_is_refused_and_read_by_the_label_that_is_named",
    "if these are labels, say --label": OPTIONS
    + "test_labels_that_look_like_a_grey_image_are_read_by_the_one_that_is_said",
    "--fill-slices interpolates them": OPTIONS + "test_blank_slices_that_are_noted_are_interpolated",
    "say --fill-slices, which interpolates": CHOICE
    + "test_blank_slices_are_named_and_interpolated_where_that_is_said",
    "cut to it with --box": CHOICE + "test_of_several_pieces_the_largest_is_taken_by_the_box_that_is_named",
    "its header has no {}: omit --form": OPTIONS + "test_a_form_that_is_not_there_is_omitted",
    "say --form sform or --form qform": IO_ADVICE + "test_two_forms_that_contradict_are_asked_about",
    "say --sidecar ignore where the volume is right, else": SIDECAR
    + "test_an_orientation_that_contradicts_is_not_taken",
    "say --sidecar ignore where the volume is right, --sidecar take": SIDECAR
    + "test_a_sidecar_that_contradicts_is_asked_about_at_every_door",
    "is beside it: omit --sidecar": OPTIONS + "test_a_sidecar_that_is_not_there_is_omitted",
    "does not say left from right: save it as NIfTI": OPTIONS + "test_an_analyze_image_is_saved_as_nifti",
    "save it without compression": "io/test_io_dicom.py::test_a_packing_that_nothing_here_unpacks_is_named",
    "say which with --map": OPTIONS + "test_maps_of_one_name_are_imported_by_the_name_of_a_file",
    "say which file with --map": OPTIONS + "test_every_map_that_is_listed_is_imported_by_its_name",
    "say which data set with --map": OPTIONS + "test_every_map_that_is_listed_is_imported_by_its_name",
    "needs a prior; name one with --prior": OPTIONS
    + "test_an_import_takes_the_prior_and_landmarks_that_it_asks_for",
    "given; omit --frame": OPTIONS + "test_an_import_takes_the_prior_and_landmarks_that_it_asks_for",
    "name them with --landmarks": OPTIONS + "test_an_import_takes_the_prior_and_landmarks_that_it_asks_for",
    "say which with --part": OPTIONS + "test_every_part_of_a_dif_file_that_is_listed_is_one",
    "frames in 3D; omit --to": OPTIONS + "test_an_option_that_does_not_apply_is_omitted",
    "state their units; omit --units": OPTIONS + "test_an_option_that_does_not_apply_is_omitted",
    "a pose moves by mm; omit --units": OPTIONS + "test_an_option_that_does_not_apply_is_omitted",
    "omit --{} if the file is right": OPTIONS + "test_an_option_that_does_not_apply_is_omitted",
    "if it is a lat, say --columns lat=": "io/test_io_columns.py::"
    "test_a_time_is_said_to_be_the_order_and_may_be_a_lat_on_demand",
    "say --columns NAME=": OPTIONS + "test_a_doubtful_heading_is_taken_as_what_it_is_said_to_be",
    "must be NAME=HEADING": OPTIONS + "test_columns_are_named_as_the_sentence_shows",
    "=HEADING with the one that is right": ADVICE
    + "test_columns_that_a_table_asks_for_are_said_to_convert_too",
    # options of a case and its run
    "says {}; omit that, or correct the file": OPTIONS
    + "test_a_frame_that_the_points_state_is_not_said_again",
    "omit --{}, or correct the file": OPTIONS + "test_units_that_case_toml_states_are_not_said_again",
    "or the units in case.toml or --units": OPTIONS + "test_pixels_are_no_units_of_a_file_in_millimetres",
    "exists already; name another folder or use --force": OPTIONS
    + "test_what_is_there_is_replaced_by_force_where_that_is_said",
    "name another folder or use --force": OPTIONS + "test_a_table_of_another_batch_is_replaced_by_force",
    "if it is a case, say --case": OPTIONS + "test_a_case_that_is_given_for_a_pipeline",
    "--{} FILE": OPTIONS + "test_files_are_given_where_there_is_no_terminal",
    "--out {}: is or holds the case": OPTIONS + "test_a_run_goes_where_it_replaces_no_case",
    "the pipeline has no '{}'": OPTIONS + "test_settings_are_said_as_the_sentence_shows",
    "set it in the pipeline file": OPTIONS + "test_settings_are_said_as_the_sentence_shows",
    "must be STAGE.PARAM=VALUE, such as": OPTIONS + "test_settings_are_said_as_the_sentence_shows",
    "names a folder, not a parameter: use": OPTIONS + "test_settings_are_said_as_the_sentence_shows",
    "and none is named; say field": OPTIONS + "test_vmin_and_vmax_are_of_a_field_that_is_said",
    "in LPS by definition; omit frame": OPTIONS + "test_vmin_and_vmax_are_of_a_field_that_is_said",
    # options of a batch and of a session
    "leave --jobs out": "pipeline/test_scheduler.py::test_a_scheduler_is_begun_and_has_its_own_workers",
    "such as tcp://host:8786": "pipeline/test_scheduler.py::"
    "test_a_scheduler_is_begun_and_has_its_own_workers",
    "begin one with `dask scheduler`": "pipeline/test_scheduler.py::"
    "test_a_scheduler_is_begun_and_has_its_own_workers",
    "what memory a process has; leave it out": OPTIONS
    + "test_where_no_system_says_the_memory_the_limit_is_left_out",
    "no CASE given, and no --record folder": LIVE
    + "test_a_session_begins_with_the_case_and_the_rate_that_are_asked_for",
    "--rate: is of --replay": LIVE + "test_a_session_begins_with_the_case_and_the_rate_that_are_asked_for",
    "say --rate, in points a second": LIVE
    + "test_a_session_begins_with_the_case_and_the_rate_that_are_asked_for",
    "must be HOST:PORT, such as": LIVE
    + "test_the_address_of_a_navigation_system_is_said_as_the_sentence_shows",
    "or another --record folder": LIVE + "test_a_session_goes_on_with_its_own_case_or_in_another_folder",
    "must say where it comes from (Origin)": LIVE + "test_a_request_that_says_what_is_asked_for_is_answered",
    "a body must say its length": LIVE + "test_a_request_that_says_what_is_asked_for_is_answered",
    # lines of files, and keywords
    "say in case.toml which is the": LINES + "test_which_of_two_files_is_the_prior",
    "say dimension = {} in case.toml": LINES + "test_a_dimension_is_said_in_case_toml",
    "say cap=True to close it": LINES + "test_an_open_prior_is_closed_by_a_line_or_a_keyword",
    "and say units='{}' where the prior": LINES + "test_headings_in_another_unit_are_scaled_or_said",
    "add the line '# units={0}' above": LINES + "test_points_in_another_unit_get_a_line_above_their_header",
    "add the line '# units=mm' above": OPTIONS + "test_units_that_are_said_of_a_prior_alone",
    "say {}: correct one of them": LINES + "test_units_of_headings_and_of_a_comment_are_corrected",
    "its columns are in {}; correct one": LINES + "test_units_of_headings_and_of_a_comment_are_corrected",
    'say frame = "LPS" or "RAS" in its case.toml': LINES
    + "test_a_frame_is_said_in_case_toml_for_a_file_that_needs_one",
    'Then say prior_of = "template" in case.toml': LINES + "test_a_prior_of_another_person_is_said_to_be_one",
    "or say landmarks.scale = true": LINES + "test_a_factor_of_size_is_estimated_where_that_is_said",
    "set folds = 5 to test it": LINES + "test_folds_that_are_set_test_the_expected_error",
    "add a [[stage]] with use": LINES + "test_a_stage_is_written_as_the_sentence_shows",
    "name the {}, such as use = ": LINES + "test_a_stage_is_written_as_the_sentence_shows",
    "give it another name with as = ": LINES
    + "test_estimates_have_names_of_their_own_and_follow_earlier_ones",
    "name an earlier estimate": LINES + "test_estimates_have_names_of_their_own_and_follow_earlier_ones",
    'or set case = "folder"': LINES + "test_a_pipeline_and_its_run_name_their_folders",
    'or say out = "folder" in the pipeline': LINES + "test_a_pipeline_and_its_run_name_their_folders",
    "or begin the pipeline with the stage global_pose": LINES
    + "test_points_far_off_the_prior_begin_with_the_stage_that_is_named",
    "begin nearer, such as with the stage global_pose": LINES
    + "test_icp_that_finds_no_pairs_begins_with_the_stage_that_is_named",
    "begin with the stage global_pose, or give": LINES
    + "test_icp_that_ends_turned_begins_with_the_stage_that_is_named",
    "use engine 'o3dls'": LINES + "test_an_outline_has_the_engine_and_the_door_that_are_named",
    "use case_of and a Pipeline": LINES + "test_an_outline_has_the_engine_and_the_door_that_are_named",
    "to change it, remove the # and write another value.": LINES
    + "test_a_line_that_init_wrote_is_changed_as_it_says",
    "Scale the prior and its landmarks": LINES + "test_a_factor_of_size_alone_is_estimated_or_scaled_out",
    # runs
    "must have a vertex of the prior and numbers in each row; run it again": LINES
    + "test_a_damaged_run_is_run_again",
    "has other faces than the prior of the run's case; run it again": LINES
    + "test_a_damaged_run_is_run_again",
    "is damaged ({}); run it again": LINES + "test_a_damaged_run_is_run_again",
    "is not as the run wrote it; run it again": LINES + "test_a_damaged_run_is_run_again",
    "so it is not a finished run; run it again": LINES + "test_a_damaged_run_is_run_again",
    "does not say why the case failed; run it again": LINES
    + "test_a_failure_that_does_not_say_why_is_run_again",
    "run a pipeline with the stage 'deform' again": LINES
    + "test_next_places_are_those_of_a_run_with_a_motion",
    # the motion as a file
    **dict.fromkeys(
        (
            "nodes: must be at most {}; say {}",
            "has no motion but its pose; name one behind deform",
            "holds both map and prior, in LPS; omit on and frame",
        ),
        "runs/test_motion_files.py::test_what_cannot_be_written_names_what_can",
    ),
    **dict.fromkeys(
        ("volumes are in mm; omit --units", "resample an image by the transform"),
        "runs/test_carry.py::test_an_image_is_resampled_by_the_transform_that_its_refusal_names",
    ),
    # packages: a test does not install them, and sees that what is named brings what is missing
    "install highdicom, pip install": LINES + "test_what_is_installed_holds_the_package_that_is_missing",
    "needs h5py: pip install": LINES + "test_what_is_installed_holds_the_package_that_is_missing",
    "is written with h5py: pip install": LINES + "test_what_is_installed_holds_the_package_that_is_missing",
    "pip install lz4, or save it with zlib": LINES
    + "test_what_is_installed_holds_the_package_that_is_missing",
    "pip install openpyxl": LINES + "test_what_is_installed_holds_the_package_that_is_missing",
    "which is not installed: pip install": LINES + "test_what_is_installed_holds_the_package_that_is_missing",
    "{} is not installed: pip install {}": LINES + "test_what_is_installed_holds_the_package_that_is_missing",
    "pip install -c constraints.txt .": LINES + "test_what_is_installed_holds_the_package_that_is_missing",
}
# texts that look like advice and ask for nothing: whole, or the beginning before "..."
NO_ADVICE = {
    # what a table or a picture shows
    "Of {}, by the patient's axes and the named places...",
    # what commands and parameters do: help
    "run the cases on the workers of a dask scheduler...",
    "points a second of --replay",
    "units of the case where its files do not say...",
    "which columns of the points these are, where headings do not say...",
    "distance over which a point has a say in the amplitude...",
    # what is at fault, or was done
    "{}: {}, so it does not say how its axes lie in the body",
    "--{} {}: no such file",
    "--{} {}",
    "--set {}",
    "--set {}: '{}' is not a table",
    "use = {}: must be the name of one {}",
    "with engine 'open3d' and metric '{}' must be one of {}",
    "{}: its line '# columns =' must name x, y, z and label",
    "packed data do not end after the {} bytes that they say",
    "took more than {} s and was stopped (--timeout)",
    "took more than {} MB of memory and was stopped (--memory)",
    "{}; the sidecar is taken, as --sidecar says",
    "{}; it is ignored, as --sidecar says",
    "states units {}, {}; --units {} overrules that",
    # titles, lines of files, patterns, and parts of sentences
    "o3dls live",
    "o3dls app",
    "{}: o3dls app",
    "say ",
    "o3dls paper --out DIR{}",
    " --quick",
    "[[{}]] use = {} {}",
    'use = "{}"\n',
    "        <!--{}-->\n",
    '    <Volumes number="1">...',
    "engine 'open3d'",
    "--form (sform|qform)...",
    "say --(units|frame) ({})\\b",
}


def followed_by(text: str) -> list[str]:
    """The tests that follow a text; a few letters must be all of it."""
    return [
        test
        for words, test in FOLLOWED.items()
        if words == text or (len(words) >= FEWEST_LETTERS and words in text)
    ]


def asks_for_nothing(text: str) -> bool:
    return any(text.startswith(words[:-3]) if words.endswith("...") else text == words for words in NO_ADVICE)
