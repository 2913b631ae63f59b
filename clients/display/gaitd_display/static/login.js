// The login page; STOP works on it, too.
import { Words, byId, load, post, setText } from "./common.js";

const session = await load("/session.json");
const words = await Words.load(session.language);
let told = "";
const tell = (key) => {
  told = key;
  setText(byId("answer"), key && words.of(key));
};

byId("language").addEventListener("click", () => {
  words.toggle();
  tell(told);
});
byId("login").addEventListener("submit", async (event) => {
  event.preventDefault();
  const answer = await post("/login", { password: byId("password").value });
  byId("password").value = "";
  if (answer.outcome === "done") location.reload();
  else tell(answer.outcome === "refused" && ["locked", "wrong_password"].includes(answer.reason) ? answer.reason : "no_answer");
});
document.body.dataset.page = "login"; // its script has run
