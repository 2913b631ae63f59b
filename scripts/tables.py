"""Write the pages and tables of docs/ that are drawn from tables in the code: `make tables`."""

import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(PROJECT)]

from daemon.config.limit_settings import Limits  # noqa: E402 - after the path
from daemon.config.strict import decoded, read_toml  # noqa: E402
from gaitd_lab.mode_page import page  # noqa: E402
from gaitd_lab.reference_pages import configuration_page, messages_page  # noqa: E402
from gaitd_lab.role_page import with_tables  # noqa: E402


def write(folder: Path) -> None:
    """Write the generated pages of this folder, and the tables in its security.md."""
    (folder / "messages.md").write_text(messages_page(), encoding="utf-8")
    (folder / "configuration.md").write_text(configuration_page(), encoding="utf-8")
    limits = decoded(read_toml(PROJECT / "configs/limits.toml"), Limits)
    (folder / "modes.md").write_text(page(limits.stop_category), encoding="utf-8")
    roles = folder / "security.md"
    roles.write_text(with_tables(roles.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    write(PROJECT / "docs")
