from command_line import gaitd


def test_honesty_prints_what_it_measured_draws_it_and_is_content(tmp_path):
    ran = gaitd("honesty", "--runs", 30, "--output", tmp_path)

    assert ran.code == 0, ran.out + ran.err
    for word in ("NEES", "NIS", "whiteness", "3 sigma", "at rest", "gaps", "drift", "offset"):
        assert word in ran.out
    assert "OUTSIDE" not in ran.out
    assert (tmp_path / "honesty.png").exists()
