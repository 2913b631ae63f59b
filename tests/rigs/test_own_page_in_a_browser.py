"""The page of the example in headless Chromium: torque, what is not known, loss and recovery."""

import browser as rig
import display_bench as bench
import pytest
from documents import PROJECT
from gaitd_client import Mode
from gaitd_display.engineer import EngineerServer

pytestmark = pytest.mark.rig_browser

PAGES = PROJECT / "clients" / "javascript"
SHOWN = "document.querySelector('#torque').textContent"
STATE = "document.querySelector('#state').textContent"


def test_the_example_shows_the_torque_and_recovers(tmp_path):
    trainer = bench.MessageTrainer()
    site = rig.Site(
        lambda made: EngineerServer(made, trainer, lambda: bench.BEGAN_NS),
        bench.engineer_table(pages=str(PAGES)),
        tmp_path,
        rig.KINDS["engineer"],
    )
    with rig.chromium() as chromium, site, rig.Player(trainer) as player:
        player.play(mode=Mode.GAIT, power_w=4.0)
        tab = rig.Tab(chromium, site, rig.SHOTS, size=(700, 300))
        tab.page.goto(f"{site.address}/pages/torque.html")
        tab.until(f"{SHOWN} === '8.0 N·m' && {STATE} === 'gait, ok'")
        tab.shot("own_page")
        player.play(mode=Mode.READY, validity="split_unobservable")
        tab.until(f"{SHOWN} === '–' && {STATE} === 'ready, split_unobservable'")
        player.fall_silent()
        tab.until(f"{SHOWN} === '–' && {STATE}.startsWith('no message on')")
        player.play(mode=Mode.GAIT, power_w=4.0)
        player.speak()
        tab.until(f"{SHOWN} === '8.0 N·m'")
        site.end()
        tab.until(f"{SHOWN} === '–' && {STATE} === 'the server is away'")
        site.start()
        tab.until(f"{SHOWN} === '8.0 N·m'")
        assert tab.errors == []
        assert tab.foreign == []
