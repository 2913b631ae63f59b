import subprocess
import sys


def test_honesty_prints_what_it_measured_draws_it_and_is_content(tmp_path):
    ran = subprocess.run(
        [sys.executable, "-m", "gaitd", "honesty", "--runs", "30", "--output", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )

    assert ran.returncode == 0, ran.stdout + ran.stderr
    for word in ("NEES", "NIS", "whiteness", "3 sigma", "at rest", "gaps", "drift", "offset"):
        assert word in ran.stdout
    assert "OUTSIDE" not in ran.stdout
    assert (tmp_path / "honesty.png").exists()
