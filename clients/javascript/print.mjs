// node --experimental-websocket print.mjs [ADDRESS [COUNT]]: prints the patient's torque. Node 22
// needs no option.
import { follow } from "./gaitd.mjs";

const [address = "http://127.0.0.1:8090", count = "Infinity"] = process.argv.slice(2);
let left = Number(count);

const following = follow(
  {
    "right/activity": (activity, trouble) => {
      if (activity === null) return console.log(`no signal: ${trouble.text}`);
      const patient = activity.hip.patient;
      console.log(patient === null ? `unknown (${activity.hip.validity})` : `${patient.toFixed(1)} N·m`);
      left -= 1;
      if (left === 0) following.close();
    },
    events: (event) => event && console.log(`event: ${event.code} ${event.subject ?? ""}`),
  },
  { address },
);
