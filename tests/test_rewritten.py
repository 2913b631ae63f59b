"""What the workers of pytest-xdist load instead of rewriting it themselves."""

import importlib.util

import pytest
import rewritten
from _pytest.assertion import rewrite

SOURCE = "def test_a():\n    assert [1] == [2]\n"


def test_a_worker_loads_the_rewritten_asserts_and_rewrites_none(
    pytestconfig, tmp_path, monkeypatch
):
    file = tmp_path / "test_it.py"
    file.write_text(SOURCE)
    rewritten.rewrite(pytestconfig, [file])

    monkeypatch.setattr(rewrite, "_rewrite_test", None)
    hook = rewrite.AssertionRewritingHook(pytestconfig)
    spec = importlib.util.spec_from_file_location("test_it", file, loader=hook)
    module = importlib.util.module_from_spec(spec)
    hook.exec_module(module)

    with pytest.raises(AssertionError, match=r"\[1\] == \[2\]"):
        module.test_a()


def test_a_file_that_has_changed_is_rewritten_again(pytestconfig, tmp_path):
    file = tmp_path / "test_it.py"
    for source in (SOURCE, "def test_b():\n    pass\n"):
        file.write_text(source)
        rewritten.rewrite(pytestconfig, [file])

        code = rewrite._read_pyc(file, rewrite.get_cache_dir(file) / f"test_it{rewrite.PYC_TAIL}")
        assert code.co_names[-1] == source[4:10]
