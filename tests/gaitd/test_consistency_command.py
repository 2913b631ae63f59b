from command_line import gaitd


def test_the_command_prints_and_draws_what_it_measured_and_ends_with_0(tmp_path):
    ran = gaitd("consistency", "--runs", 30, "--output", tmp_path)

    assert ran.code == 0, ran.out + ran.err
    for word in ("NEES", "NIS", "whiteness", "3 sigma", "at rest", "gaps", "drift", "offset"):
        assert word in ran.out
    assert "OUTSIDE" not in ran.out
    assert (tmp_path / "consistency.png").exists()
