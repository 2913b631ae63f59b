// STOP of every page. It imports nothing, and waits for nothing that the server must send first.
const TIMEOUT_MS = 1500;
const DONE_MS = 3000;

const byId = (id) => document.getElementById(id);
let pressedCount = 0;
let doneCount = 0; // newest press that has arrived
let isFailed = false;

function show(state) {
  for (const one of ["sent", "done", "failed"]) byId(`stop_${one}`).hidden = one !== state;
}

async function isDone() {
  try {
    const headers = { "Content-Type": "application/json" };
    const signal = AbortSignal.timeout(TIMEOUT_MS);
    const answer = await fetch("/stop", { method: "POST", headers, body: "{}", keepalive: true, signal });
    return (await answer.json()).outcome === "done";
  } catch {
    return false; // no answer, or none in time
  }
}

async function stop() {
  const number = ++pressedCount;
  if (!isFailed) show("sent");
  if (await isDone()) {
    doneCount = Math.max(doneCount, number);
    isFailed = false;
    show("done");
    setTimeout(() => { if (number === pressedCount && !isFailed) show(""); }, DONE_MS);
  } else if (number > doneCount) {
    isFailed = true; // told until a stop arrives
    show("failed");
  }
}

// The first touch counts. A keyboard's click has detail 0.
byId("stop").addEventListener("pointerdown", stop);
byId("stop").addEventListener("click", (event) => event.detail === 0 && stop());
