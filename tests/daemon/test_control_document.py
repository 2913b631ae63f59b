"""docs/control_by_others.md says what the code says."""

from pathlib import Path

from gaitd_client import SetpointRefusal
from gaitd_texts import Reader, catalogue

DOCUMENT = Path(__file__).parents[2] / "docs" / "control_by_others.md"


def part(name: str) -> str:
    text = DOCUMENT.read_text()
    return text.partition(f"<!-- {name}: begin -->\n")[2].partition(f"<!-- {name}: end -->")[0]


def test_the_table_of_refusals_is_that_of_the_code():
    text = catalogue(Reader.OPERATOR, "en").text
    rows = [
        f"| `{reason}` | {text(f'setpoint_refusal.{reason}')} | {text(f'remedy.{reason}')} |"
        for reason in SetpointRefusal
    ]

    head = ["| reason | what is wrong | what to do |", "|---|---|---|"]
    assert part("refusals").splitlines() == head + rows


def test_the_controller_in_the_document_is_python():
    code = part("controller").removeprefix("```python\n").rpartition("```")[0]

    compile(code, str(DOCUMENT), "exec")
