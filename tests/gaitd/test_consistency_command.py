from command_line import gaitd

from analysis.consistency_text import PARTS


def test_the_command_prints_and_draws_what_it_measured_and_ends_with_0(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("".join(f"<!-- {one}: begin -->\n<!-- {one}: end -->\n" for one in PARTS))

    ran = gaitd("consistency", "--runs", 30, "--seeds", 1, "--output", tmp_path, "--page", page)

    assert ran.code == 0, ran.out + ran.err
    for word in ("NEES", "NIS", "one innovation", "3 sigma", "at rest", "gaps", "drift", "offset"):
        assert word in ran.out
    assert "OUTSIDE" not in ran.out
    assert (tmp_path / "consistency.png").exists()
    for part in PARTS:
        assert f"<!-- {part}: begin -->\n| " in page.read_text()
