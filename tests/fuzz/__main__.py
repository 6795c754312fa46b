"""`python -m tests.fuzz [DOOR] [--seconds N]` gives bytes that grow out of the seeds to each door, so long.

With Atheris new bytes are kept where they reach new lines; where it has no wheel, hypothesis makes them. What
breaks a door stays in build/fuzz/DOOR, and its bytes belong among the seeds of doors.py.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))  # for what tests share, as pytest finds it
BUILD = Path(__file__).resolve().parents[2] / "build/fuzz"
MOST_SECONDS, MOST_MEMORY = 20, 4096  # for one input; MB
INSTRUMENTED = [
    "o3dls.io",
    "o3dls.live",
    "o3dls.report.mapping",
    "o3dls.runs",
    "o3dls.pipeline",
]  # what numba compiles must stay plain
NAMES = (
    "surface",
    "volume",
    "study",
    "table",
    "toml",
    "journal",
    "action",
    "posterior",
    "lesions",
    "run.json",
    "igtl",
)


def by_coverage(name: str, seconds: int) -> None:
    """Fuzz a door with Atheris; ends the process."""
    import atheris

    with atheris.instrument_imports(include=INSTRUMENTED):
        from tests.fuzz.doors import DOORS
    door, corpus = DOORS[name], BUILD / name / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for k, seed in enumerate(door.seeds()):
        (corpus / f"seed{k}").write_bytes(seed)
    limits = [f"-max_total_time={seconds}", f"-timeout={MOST_SECONDS}", f"-rss_limit_mb={MOST_MEMORY}"]
    atheris.Setup(
        [sys.argv[0], str(corpus), f"-artifact_prefix={BUILD / name}/", *limits, "-verbosity=0"], door
    )
    atheris.Fuzz()


def by_hypothesis(name: str, seconds: int) -> None:
    """Fuzz a door with changes of its seeds, which hypothesis chooses."""
    from hypothesis import HealthCheck, Phase, given, settings

    from tests.fuzz.changes import changed
    from tests.fuzz.doors import DOORS

    door, end = DOORS[name], time.monotonic() + seconds
    own = settings(
        max_examples=200,
        deadline=MOST_SECONDS * 1000,
        database=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )
    while time.monotonic() < end:
        own(given(changed(door.seeds()))(door.__call__))()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("door", nargs="?", choices=NAMES)
    parser.add_argument("--seconds", type=int, default=600)
    given = parser.parse_args()
    if given.door is None:
        command = [sys.executable, "-m", "tests.fuzz", "--seconds", str(given.seconds)]
        failed = [name for name in NAMES if subprocess.run([*command, name]).returncode]
        print(f"doors that broke: {', '.join(failed)}" if failed else "every door held")
        return bool(failed)
    try:
        import atheris  # noqa: F401
    except ImportError:
        by_hypothesis(given.door, given.seconds)
    else:
        by_coverage(given.door, given.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
