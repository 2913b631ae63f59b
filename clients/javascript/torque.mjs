import { follow } from "/static/gaitd.mjs";

const [torque, bar, state] = ["torque", "bar", "state"].map((id) => document.getElementById(id));

follow({
  "right/activity": (activity, trouble) => {
    const patient = activity?.hip.patient ?? null; // null: not known, for example at rest
    torque.textContent = patient === null ? "–" : `${patient.toFixed(1)} N·m`;
    bar.value = patient ?? 0;
    bar.hidden = patient === null;
    state.textContent = trouble === null ? `${activity.mode}, ${activity.hip.validity}` : trouble.text;
  },
});
