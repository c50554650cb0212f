// Puts the page together: holds its state (time, playing, speed, followed robot) and draws it.

const state = { t: 0, playing: false, speed: 20, followed: null };
const LIVE_TEXT_MS = 120; // while playing, the words of cards and table change no more often than can be read
let lastText = 0, lastFrame = 0, waiting = false;

function draw(now = performance.now()) {
  drawArena(state.t, state.followed, state.speed);
  drawBelief(state.t, state.followed);
  drawMaps(state.t, state.followed);
  drawVerdict(state.t);
  drawPlayer(state);
  if (state.playing && now - lastText < LIVE_TEXT_MS) return;
  lastText = now;
  drawCards(state.t, state.followed); // with the table, so that both show one moment
  drawRoster(state.t, state.followed);
  refreshTooltip();
}

function askForFrame() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame((now) => {
    waiting = false;
    if (state.playing) {
      const passed = lastFrame ? Math.min(Math.max((now - lastFrame) / 1000, 0), 0.1) : 0;
      state.t = Math.min(state.t + passed * state.speed, END_S);
      if (state.t >= END_S) pause();
    }
    lastFrame = state.playing ? now : 0;
    draw(now);
    if (state.playing) askForFrame();
  });
}

function play() {
  if (state.t >= END_S) state.t = 0;
  state.playing = true;
  askForFrame();
}

function pause() {
  state.playing = false;
  writeAddress(state.t, state.followed);
  askForFrame();
}

function seek(t) {
  state.t = Math.min(Math.max(t, 0), END_S);
  if (!state.playing) writeAddress(state.t, state.followed);
  askForFrame();
}

function setSpeed(speed) {
  state.speed = speed;
  askForFrame();
}

function follow(robot) {
  state.followed = robot === state.followed ? null : robot;
  lastText = 0;
  if (!state.playing) writeAddress(state.t, state.followed);
  askForFrame();
}

const actions = {
  toggle: () => (state.playing ? pause() : play()),
  seek,
  move: (by) => seek(state.t + by),
  setSpeed,
  changeSpeed: (by) => setSpeed(SPEEDS[Math.min(Math.max(SPEEDS.indexOf(state.speed) + by, 0), SPEEDS.length - 1)]),
  follow,
  now: () => state.t,
};

function watchBelief() {
  const canvas = byId("belief");
  const scrub = (event) => seek(beliefChart.box.time(placeIn(canvas, event).x));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    hideTooltip();
    scrub(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) return scrub(event);
    const place = placeIn(canvas, event), near = beliefNear(place.x, place.y);
    const flag = flagNear(place.x, place.y);
    hover(flag ? null : near?.robot ?? null);
    if (flag) return showTooltip(event, ...flagNote(flag));
    if (!near) return hideTooltip();
    showTooltip(event, `Robot ${near.robot.name} at ${bothTimes(near.time)}`, [["p", probability(near.belief)]]);
  });
  canvas.addEventListener("pointerleave", () => {
    hover(null);
    hideTooltip();
  });
}

// The robot whose line is shown because the pointer is on it; needed only where lines are not shown anyway.
function hover(robot) {
  if (!isCrowd || robot === beliefChart.hovered) return;
  beliefChart.hovered = robot;
  askForFrame();
}

let shown = false; // false in a frame that is hidden

function layOut() {
  stamped.clear();
  shown = byId("belief-frame").clientWidth > 0;
  drawLegend();
  layOutArena();
  layOutBelief();
  layOutCards();
  layOutMaps();
  lastText = 0; // cards and table too, at once
  draw();
}

function watchSurroundings() {
  let size = "";
  addEventListener("resize", () => {
    const now = `${innerWidth}x${innerHeight}x${devicePixelRatio}`;
    if (now !== size) layOut();
    size = now;
  });
  // A frame that was hidden gets its size when it is shown, and not every browser calls that a resize.
  new ResizeObserver(() => {
    if ((byId("belief-frame").clientWidth > 0) !== shown) layOut();
  }).observe(byId("belief-frame"));
  addEventListener("hashchange", () => {
    const { t, robot } = readAddress();
    if (t === null) return;
    state.followed = robot ?? state.followed;
    state.playing = false;
    seek(t);
  });
  themeListeners.push(layOut);
}

// For tests and the curious: the state, and a way to change it at once.
function expose() {
  window.vibroswarm = {
    state: () => ({
      time_s: state.t, playing: state.playing, speed: state.speed, end_s: END_S, theme: themeName(),
      followed: state.followed ? state.followed.id : null,
      hovered: beliefChart.hovered ? beliefChart.hovered.id : null,
    }),
    seek: (t) => {
      state.t = Math.min(Math.max(t, 0), END_S);
      lastText = 0;
      draw();
    },
    play, pause, setSpeed, draw,
    pose: (id, t) => poseAt(robots.find((robot) => robot.id === id), t),
    mind: (id, t) => mindAt(robots.find((robot) => robot.id === id), t),
  };
}

function open() {
  buildVerdict();
  buildDetails();
  buildLeads();
  buildCards(follow);
  buildRoster(follow);
  buildLayers(layOut);
  buildPlayer(actions);
  byId("next-event").addEventListener("click", () => seek(nextEvent(state.t)));
  byId("previous-event").addEventListener("click", () => seek(previousEvent(state.t)));
  watchKeys(actions);
  watchArena(() => state.t, () => state.followed, follow);
  watchBelief();
  watchSurroundings();
  const address = readAddress();
  state.t = address.t ?? 0;
  state.followed = address.robot;
  applyTheme();
  // Words on a canvas do not load a font by themselves, and are not drawn again when it is there.
  Promise.all(["400 12px", "700 12px"].map((size) => document.fonts.load(`${size} "Roboto embedded"`))).then(layOut);
  expose();
  if (address.t === null && !calm.matches) play();
}

open();
