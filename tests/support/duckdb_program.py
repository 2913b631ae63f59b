"""DuckDB in a process of its own: at its end it prints what it leaks, over pytest's summary."""

import json
import subprocess
import sys

_WORDS = "import sys, json, duckdb; print(json.dumps(duckdb.sql(sys.argv[1]).fetchall()))"


def rows_of(query, folder=None):
    """Return what DuckDB answers, rows of what JSON can say."""
    asked = [sys.executable, "-c", _WORDS, query]
    done = subprocess.run(asked, cwd=folder, capture_output=True, check=True, text=True)
    return json.loads(done.stdout)
