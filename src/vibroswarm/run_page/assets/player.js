// The bar at the foot: play, time, slider, speed. It shows the state that main.js holds, and asks it to change.

const SPEEDS = [1, 2, 5, 10, 20, 50, 100, 200];
const PLAY_SIGNS = {
  play: "M7 4.5v15l12-7.5z",
  pause: "M6.5 5h4v14h-4zM13.5 5h4v14h-4z",
  again: "M12 5a7 7 0 1 0 7 7h-2.2a4.8 4.8 0 1 1-4.8-4.8V11l5.5-5L12 1z",
};

function playSign(name) {
  const space = "http://www.w3.org/2000/svg";
  const sign = document.createElementNS(space, "svg"), path = document.createElementNS(space, "path");
  sign.setAttribute("viewBox", "0 0 24 24");
  sign.setAttribute("aria-hidden", "true");
  path.setAttribute("d", PLAY_SIGNS[name]);
  sign.append(path);
  return sign;
}

function buildPlayer(actions) {
  const scrub = byId("scrub"), speed = byId("speed");
  scrub.max = String(END_S);
  say(byId("clock-end"), ` / ${exactSeconds(END_S)}`);
  for (const value of SPEEDS) speed.append(new Option(`${value}\u00d7`, String(value)));
  byId("play").addEventListener("click", actions.toggle);
  scrub.addEventListener("input", () => actions.seek(Number(scrub.value)));
  speed.addEventListener("change", () => actions.setSpeed(Number(speed.value)));
  byId("slower").addEventListener("click", () => actions.changeSpeed(-1));
  byId("faster").addEventListener("click", () => actions.changeSpeed(1));
  byId("scrub-marks").replaceChildren(...decidedInOrder().map((robot) => {
    const mark = make("i", "");
    mark.dataset.decision = robot.final.decision;
    mark.style.left = `${100 * robot.final.decision_time_s / END_S}%`;
    return mark;
  }));
}

function drawPlayer(state) {
  const { t, playing, speed } = state, scrub = byId("scrub");
  say(byId("clock"), seconds(t));
  say(byId("clock-minutes"), `${clockMinutes(t)} / ${clockMinutes(END_S)} min`);
  scrub.value = String(t);
  scrub.style.setProperty("--done", `${100 * t / END_S}%`);
  scrub.setAttribute("aria-valuetext", bothTimes(t));
  if (Number(byId("speed").value) !== speed) byId("speed").value = String(speed);
  byId("slower").disabled = speed === SPEEDS[0];
  byId("faster").disabled = speed === SPEEDS[SPEEDS.length - 1];
  const sign = playing ? "pause" : t >= END_S ? "again" : "play", button = byId("play");
  if (button.dataset.sign === sign) return;
  button.dataset.sign = sign;
  button.replaceChildren(playSign(sign));
  button.setAttribute("aria-label", { pause: "Pause", play: "Play", again: "Play again from the start" }[sign]);
}
