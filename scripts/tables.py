"""Write what docs/ has from the code (pages, tables, the drawing of the machine): `make tables`.

Another folder than docs/ is the argument; `scripts/pages.py` compares what is written there.
"""

import math
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(PROJECT)]

from gaitd_session.store import EXPORTED  # noqa: E402

from analysis.machine_figure import draw  # noqa: E402 - after the path
from daemon.config.limit_settings import Limits  # noqa: E402
from daemon.config.robot import leg_parameters  # noqa: E402
from daemon.config.settings import Robot  # noqa: E402
from daemon.config.strict import decoded, load_toml, read_toml  # noqa: E402
from gaitd_lab import csv_page  # noqa: E402
from gaitd_lab.mode_page import page  # noqa: E402
from gaitd_lab.reference_pages import configuration_page, messages_page  # noqa: E402
from gaitd_lab.role_page import with_tables  # noqa: E402


def write(folder: Path) -> None:
    """Write the generated pages of this folder, the tables in its security.md, and the drawing."""
    (folder / "messages.md").write_text(messages_page(), encoding="utf-8")
    (folder / "configuration.md").write_text(configuration_page(), encoding="utf-8")
    (folder / "csv_columns.md").write_text(csv_page.page(EXPORTED), encoding="utf-8")
    limits = decoded(read_toml(PROJECT / "configs/limits.toml"), Limits)
    (folder / "modes.md").write_text(page(limits.stop_category), encoding="utf-8")
    roles = folder / "security.md"
    roles.write_text(with_tables(roles.read_text(encoding="utf-8")), encoding="utf-8")
    robot = load_toml(PROJECT / "configs/robot.toml", Robot)
    recline_rad = math.radians(robot.geometry.recline_deg)
    draw(leg_parameters(robot), recline_rad, folder / "machine.png")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else PROJECT / "docs")
