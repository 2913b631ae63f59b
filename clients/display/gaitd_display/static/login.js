// The login page; STOP works on it, too.
import { Words, bindStop, byId, post, setText } from "./common.js";

const session = await (await fetch("/session.json")).json();
const words = await Words.load(session.language);
const tell = (key) => setText(byId("answer"), key === "" ? "" : words.of(key));

bindStop(byId("stop"), (state) => tell({ sent: "stop_sent", failed: "stop_failed", done: "done" }[state]));
byId("language").addEventListener("click", () => words.toggle());
byId("login").addEventListener("submit", async (event) => {
  event.preventDefault();
  const answer = await post("/login", { password: byId("password").value });
  byId("password").value = "";
  if (answer.outcome === "done") location.reload();
  else tell(answer.outcome === "refused" && ["locked", "wrong_password"].includes(answer.reason) ? answer.reason : "no_answer");
});
