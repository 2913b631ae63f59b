"""Headless Chromium on the display's pages, and a player of messages behind them.

The pages and their servers are the real ones, over real sockets; the trainer is messages alone.
"""

import contextlib
import math
import re
import threading
from pathlib import Path

import display_bench as bench
from gaitd_client import Mode, Stage
from gaitd_display.settings import EngineerSettings, PatientSettings, TherapistSettings
from gaitd_display.web import Server

from gaitd_lab.processes import free_port

SHOTS = Path(__file__).parents[2] / "out" / "display"
CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
AXE = Path(__file__).parents[1] / "rigs" / "vendor" / "axe.min.js"
FEED = """
const paints = [];
const atNextFrame = requestAnimationFrame;
window.requestAnimationFrame = (paint) => (window.isFed ? paints.push(paint) : atNextFrame(paint));
window.WebSocket = class extends WebSocket {
  constructor(address) {
    super(address);
    window.live = this;
    this.frames = [];
    this.addEventListener("message", ({ data }) => this.frames.push(JSON.parse(data)));
  }
  send(text) { if (!window.isFed) super.send(text); }
};
window.feed = async ({ first, end, scenes, items }) => {
  window.isFed = true;
  for (let n = first; n < end; n++) {
    const frames = scenes[Math.floor(n / 9000) % scenes.length];
    const fresh = n % 150 === 0 ? items.map((item) => ({ ...item, number: n, id: `${n}` })) : [];
    const fed = { ...frames.at(-1 - ((end - 1 - n) % frames.length)), items: fresh };
    window.beforeFed?.(fed, n);
    live.onmessage({ data: JSON.stringify(fed) });
    if (n % 30 === 0) for (const paint of paints.splice(0)) paint(performance.now());
    if (n % 900 === 0) await new Promise((goOn) => setTimeout(goOn));
  }
};
"""
"""Comes before a page's own scripts: `feed` gives frames to the page's handler, instead of the
server: each scene for 2.5 minutes of 60 frames a second, new items every 2.5 s. It paints twice a
second, and ends with the newest frame of a scene: what is painted last then does not depend on how
many frames were recorded."""
MISPLACED = """() => {
    const isCut = (style) => style.overflow !== 'visible';
    const found = [];
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    const range = document.createRange();
    const pieces = [];
    while (texts.nextNode()) {
        const node = texts.currentNode;
        if (!node.data.trim() || !node.parentElement.checkVisibility()) continue;
        if (node.parentElement.closest('.sr')) continue; // for a screen reader alone
        range.selectNodeContents(node);
        for (const { left, right, top, bottom } of range.getClientRects()) {
            // A line's box has room above and below its letters.
            const room = (bottom - top) * 0.2;
            pieces.push({ node, left, right, top: top + room, bottom: bottom - room });
        }
    }
    for (const piece of pieces) {
        const boxes = [{ left: 0, top: 0, right: innerWidth, bottom: innerHeight }];
        for (let at = piece.node.parentElement; at !== document.body; at = at.parentElement) {
            if (isCut(getComputedStyle(at))) boxes.push(at.getBoundingClientRect());
        }
        const isOut = (box) => piece.left < box.left - 1 || piece.right > box.right + 1 ||
            piece.top < box.top - 1 || piece.bottom > box.bottom + 1;
        if (boxes.some(isOut)) found.push(`cut off: ${piece.node.data}`);
    }
    pieces.forEach((one, index) => {
        for (const other of pieces.slice(index + 1)) {
            if (Math.min(one.right, other.right) - Math.max(one.left, other.left) > 1 &&
                Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top) > 1) {
                found.push(`over each other: ${one.node.data} / ${other.node.data}`);
            }
        }
    });
    return found;
}"""
CONTRAST = """(pairs) => {
    const probe = document.body.appendChild(document.createElement("i"));
    const light = (name) => {
        probe.style.color = `var(${name})`;
        const parts = getComputedStyle(probe).color.match(/[0-9.]+/g).slice(0, 3).map((part) => {
            const value = part / 255;
            return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
        });
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2] + 0.05;
    };
    const ratios = pairs.map(([one, other]) => {
        const [low, high] = [light(one), light(other)].sort((a, b) => a - b);
        return high / low;
    });
    probe.remove();
    return ratios;
}"""
HOUR_FRAMES = 60 * 3600
BEGIN_FRAMES = 30
"""Frames of a scene that may still be of the one before it."""
IN_REACH = """(button) => {
    const { left, right, top, bottom, width, height } = button.getBoundingClientRect();
    const inset = 2 + parseFloat(getComputedStyle(button).borderTopLeftRadius) / 2;
    const across = [left + inset, (left + right) / 2, right - inset];
    const down = [top + inset, (top + bottom) / 2, bottom - inset];
    const isHit = (x, y) => button.contains(document.elementFromPoint(x, y));
    return left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight &&
        Math.min(width, height) >= 40 && across.every((x) => down.every((y) => isHit(x, y))) &&
        button.scrollWidth <= button.clientWidth + 1 &&
        button.scrollHeight <= button.clientHeight + 1;
}"""
"""Whole in the window, not covered at its corners, edges and centre, and no text is cut off."""
STRIDE = 60
PERIOD_S = 0.01


class Player:
    """Sends the messages of a scene, a cycle every 10 ms of the computer's clock."""

    def __init__(self, trainer):
        self.trainer = trainer
        self._scene = {"mode": Mode.READY}
        self._is_over = threading.Event()
        self._may_send = threading.Event()
        self._may_send.set()
        self._thread = threading.Thread(target=self._play)
        self._count = 0
        self._steps = []

    def play(self, **scene):
        if "top_w" in scene:
            self.walk(**scene)
        else:
            self._scene = scene

    def walk(self, top_w, shares=()):
        """Strides without end.

        Args:
            top_w: highest power of a stride.
            shares: of the steps that are sent at once, and the last one again with each stride;
                pairs are of both legs. Without them they rise and fall.
        """
        self._steps = [*shares]
        self._scene = {"top_w": top_w, "last": shares[-1:]}

    def fall_silent(self):
        self._may_send.clear()

    def speak(self):
        self._may_send.set()

    def _play(self):
        while not self._is_over.wait(PERIOD_S):
            if self._may_send.is_set():
                self.cycle()
            else:
                self.trainer.clock.ns += 10_000_000

    def cycle(self):
        scene = given = dict(self._scene)
        if "top_w" in scene:
            phase = self._count % STRIDE / STRIDE
            power_w = scene["top_w"] * math.sin(2 * math.pi * phase) ** 2
            scene = {"mode": Mode.GAIT, "stage": Stage.PLAYING, "phase": phase, "power_w": power_w}
            turn = math.cos(2 * math.pi * phase)
            near, far = (
                (0.25 - 0.3 * turn, 0.5 - 0.35 * turn),
                (0.25 + 0.3 * turn, 0.5 + 0.35 * turn),
            )
            scene["pose"] = (near, far)[: len(self.trainer.legs)]
        self._count += 1
        self.trainer.speak_of_health()
        self.trainer.cycles(scene.pop("mode"), **scene)
        if "phase" in scene:
            self._step(given, self._count // STRIDE, is_new=scene["phase"] == 0.0)

    def _step(self, given, number, *, is_new):
        rising = 0.5 + 0.3 * math.sin(number / 4)
        while self._steps:
            self._end_stride(number, self._steps.pop(0))
        if is_new:
            (share,) = given["last"] or (rising,)
            self._end_stride(number, share)

    def _end_stride(self, number, share):
        shares = share if isinstance(share, tuple) else (share,) * len(self.trainer.legs)
        for leg, one in zip(self.trainer.legs, shares, strict=True):
            self.trainer.step(number, one, 3.0 + number % 5, leg)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_error):
        self._is_over.set()
        self._thread.join()


class Site:
    """A server of the display on a port of its own; it can end and start again."""

    def __init__(self, make_app, table, folder, kind):
        self.port = free_port()
        table["web"]["port"] = self.port
        self._settings = bench.settings_of(folder, table, kind)
        self._make_app = make_app
        scheme = "https" if self._settings.web.is_tls else "http"
        self.address = f"{scheme}://127.0.0.1:{self.port}"
        self.server = None

    def start(self):
        made = self._make_app(self._settings)
        self._uvicorn = Server(made.app, self._settings.web)
        self._thread = threading.Thread(target=self._uvicorn.run)
        self._thread.start()
        while not self._uvicorn.started:
            assert self._thread.is_alive()
            self._thread.join(0.02)
        self.server = made
        return self

    def end(self):
        self._uvicorn.should_exit = True
        self._thread.join()

    __enter__ = start

    def __exit__(self, *_error):
        self.end()


@contextlib.contextmanager
def chromium():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


class Tab:
    """One page, with what went wrong in it."""

    def __init__(self, browser, site, shots: Path, size=(1280, 800)):
        width, height = size
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.site, self.errors, self.foreign = site, [], []
        self._shots = shots
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._console)
        self.page.on(
            "request",
            lambda request: site.address in request.url or self.foreign.append(request.url),
        )
        self.page.goto(site.address)

    def _console(self, message):
        is_expected = "WebSocket connection" in message.text or "status of " in message.text
        is_expected |= "ERR_CONNECTION_REFUSED" in message.text or "AudioContext" in message.text
        if message.type in {"error", "warning"} and not is_expected:
            self.errors.append(message.text)

    def until(self, expression, within_s=20):
        """Poll: `wait_for_function` needs eval, which our policy forbids.

        Returns:
            The first value that is true. What belongs to a condition is asked for with it: on a
            busy computer a page may lose the connection between two questions.
        """
        from playwright.sync_api import Error

        for _ in range(within_s * 50):
            with contextlib.suppress(Error):  # the page is being loaded
                if value := self.page.evaluate(expression):
                    return value
            self.page.wait_for_timeout(20)
        shown = self.page.evaluate("JSON.stringify(document.body.dataset)")
        raise AssertionError(f"not true in {within_s} s: {expression}; shown is {shown}")

    def word(self, word):
        self.until(f"document.body.dataset.word === '{word}'")

    def shot(self, name):
        self._shots.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=self._shots / f"{name}.png")

    def violations(self):
        """What axe-core finds; run in the page's isolated world, beside the policy."""
        self.page.evaluate(AXE.read_text(encoding="utf-8"))
        found = self.page.evaluate("axe.run(document, {resultTypes: ['violations']})")
        return [
            (one["id"], [node["target"] for node in one["nodes"]]) for one in found["violations"]
        ]

    def misplaced_texts(self):
        """Texts, also of pictures, that are cut off, beyond the page, or over another one."""
        return self.page.evaluate(MISPLACED)

    def contrasts(self, pairs):
        """Pairs of colours, by their names, with their contrast of WCAG 2.2."""
        return zip(pairs, self.page.evaluate(CONTRAST, pairs), strict=True)

    def unreachable(self, *names):
        """Buttons, by the begin of their name, that are not whole in view, covered, or cut off."""
        found = []
        for name in names:
            button = self.page.get_by_role("button", name=re.compile(f"^{name}"))
            if button.count() != 1 or not button.evaluate(IN_REACH):
                found.append(name)
        return found


def is_flat(tab, trainer, scenes, frame_count=HOUR_FRAMES, nodes_apart=0, most_mb=0.3):
    """Feed frames, by default of an hour; compare heap and nodes after a quarter and at the end.

    0.3 MB in an hour are 2 bytes a frame.
    """
    tab.page.add_init_script(FEED)
    tab.page.reload()
    recorded = []
    for scene in scenes:
        scene()
        for leg in trainer.legs:
            trainer.step(1, 0.5, 3.0, leg)
        tab.until(f"live.frames.length > {60 + BEGIN_FRAMES}")
        recorded.append(tab.page.evaluate("live.frames.splice(0)"))
    items = [item for frames in recorded for frame in frames for item in frame["items"]]
    recorded = [frames[BEGIN_FRAMES:] for frames in recorded]
    newest = {(item["kind"], item.get("leg")): item for item in items}
    wire = tab.page.context.new_cdp_session(tab.page)

    def fed(first, end):
        given = {"scenes": recorded, "items": [*newest.values()], "first": first, "end": end}
        tab.page.evaluate("feed", given)
        wire.send("HeapProfiler.collectGarbage")
        counts = wire.send("Memory.getDOMCounters")
        heap_mb = wire.send("Runtime.getHeapUsage")["usedSize"] / 1e6
        return heap_mb, counts["nodes"], counts["jsEventListeners"]

    before_mb, *before = fed(0, frame_count // 4)
    after_mb, *after = fed(frame_count // 4, frame_count)

    print(f"{before_mb:.2f} MB, {before} nodes and listeners; then {after_mb:.2f} MB, {after}")
    assert abs(after[0] - before[0]) <= nodes_apart
    assert after[1] == before[1]
    assert after_mb < before_mb + most_mb


STOP = ("STOP", "STOPP")
VIEWS = (
    *(((1280, 800), zoom) for zoom in (1, 1.5, 2, 4)),
    *(((1920, 1080), zoom) for zoom in (1, 2)),
    *(((1280, 1024), 4), ((1024, 768), 1), ((1440, 1000), 2)),
    *(((768, 1024), zoom) for zoom in (1, 2)),
    *(((390, 844), 1), ((844, 390), 1), ((360, 640), 1), ((320, 568), 1)),
)
"""Screens in px, and the zoom of the browser."""
PAINTED_TWICE = (
    "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
)


def are_in_reach(tab, *names):
    """In each view and both languages: `names` are pairs, English and German."""
    lacks = []
    for language, column in (("de", 1), ("en", 0)):
        tab.page.click("#language")
        tab.until(f"document.documentElement.lang === '{language}'")
        for (width, height), zoom in VIEWS:
            size = {"width": round(width / zoom), "height": round(height / zoom)}
            tab.page.set_viewport_size(size)
            # A busy computer may lose the connection for a moment, and then shows other buttons.
            for name in names:
                shown = re.compile(f"^{name[column]}")
                tab.page.get_by_role("button", name=shown).wait_for(timeout=20_000)
            tab.page.evaluate(PAINTED_TWICE)
            missed = tab.unreachable(*(name[column] for name in names))
            lacks += [(width, height, zoom, language, one) for one in missed]
        tab.page.set_viewport_size({"width": 1280, "height": 800})
    shown = tab.page.evaluate("JSON.stringify(document.body.dataset)")
    assert not lacks, (shown, lacks)


KINDS = {
    "patient": PatientSettings,
    "therapist": TherapistSettings,
    "engineer": EngineerSettings,
}
