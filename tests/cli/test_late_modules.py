"""Modules that nobody uses are not run; used, they are what they always are."""

import subprocess
import sys

DELAY = "from o3dls.cli.environment import delay_unused; delay_unused()"


def _run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_scipy_does_not_run_what_it_only_lists():
    code = (
        "import sys; {late}; import scipy.special;"
        "print('unittest' in sys.modules, 'numpy.f2py.crackfortran' in sys.modules)"
    )
    assert _run(code.format(late=DELAY)) == "False False"
    assert _run(code.format(late="pass")) == "True True"


def test_a_late_module_is_whole_when_it_is_used():
    said = _run(
        f"{DELAY}; import numpy;"
        "numpy.testing.assert_allclose(1.0, 1.0); from numpy.testing import assert_equal; assert_equal(1, 1);"
        "print(numpy.testing.__name__)"
    )
    assert said == "numpy.testing"


def test_a_module_that_has_run_stays():
    said = _run(f"import numpy.testing as before; {DELAY}; import numpy; print(numpy.testing is before)")
    assert said == "True"
