// What lies under the pointer on the floor: a robot, else a sample, else the tile.

function robotNear(place, t, reach) {
  const { view } = arena;
  let best = null;
  for (const robot of robots) {
    const pose = poseAt(robot, t);
    if (!pose) continue;
    const far = Math.hypot(view.x(pose.x) - place.x, view.y(pose.y) - place.y);
    if (far < reach && (!best || far < best.far)) best = { robot, pose, far };
  }
  return best;
}

function sampleNear(place, t, reach) {
  const { view } = arena, count = lastAtMost(sampleTimes, t, 0, sampleTimes.length) + 1;
  let best = -1, nearest = reach;
  for (let i = count - 1; i >= 0; i--) {
    const row = samplesByTime[i];
    const far = Math.hypot(view.x(run.samples.x_m[row]) - place.x, view.y(run.samples.y_m[row]) - place.y);
    if (far < nearest) [best, nearest] = [row, far];
  }
  return best;
}

function robotNote({ robot, pose }, t) {
  const mind = mindAt(robot, t);
  return [`Robot ${robot.name}, ${doingWords(robot, pose, t)}`, [
    ["decision", DECISION_WORDS[mind.decision]], ["p", probability(mind.belief)],
    ...(hasPosterior ? [["\u03b1, \u03b2", `${mind.alpha}, ${mind.beta}`]] : []), ["own samples", String(mind.samples)],
    ...placeNote(robot, t),
    ["at", `${pose.x.toFixed(3)} m, ${pose.y.toFixed(3)} m`],
  ]];
}

function sampleNote(row) {
  const s = run.samples, tile = s.tile[row];
  const rows = [
    ["read as", kindWord(s.observation[row])],
    ["tile", tile < 0 ? "none" : kindWord(tileKind(tile, s.time_s[row]))],
    ...(isPatched(s.x_m[row], s.y_m[row]) ? [["on", "a patch"]] : []),
    ["bit sent", s.message[row] > 1 ? "not known" : String(s.message[row])], ["p after it", probability(s.belief_below[row])],
  ];
  if (!Number.isNaN(s.energy[row])) rows.splice(1, 0, ["RMS", s.energy[row].toFixed(2)]);
  const heading = `Sample ${s.sample[row] + 1} of robot ${s.robot[row]}, ${bothTimes(s.time_s[row])}`;
  return [isMisread(row) ? `${heading}: misread` : heading, rows];
}

function tileNote(tile, t, followed) {
  if (tile < 0) return ["No tile here", []];
  const read = Array(KIND_COUNT).fill(0);
  for (let i = lastAtMost(sampleTimes, t, 0, sampleTimes.length); i >= 0; i--) {
    const row = samplesByTime[i];
    if (run.samples.tile[row] !== tile) continue;
    read[run.samples.observation[row]]++;
  }
  const taken = read.reduce((sum, count) => sum + count, 0);
  const column = tile % run.floor.columns, row = (tile - column) / run.floor.columns;
  const rows = [["samples so far", String(taken)]];
  read.forEach((count, kind) => {
    if (taken && kind !== STILL) rows.push([`read as ${kindWord(kind)}`, `${count} (${percent(count / taken)})`]);
  });
  rows.push(...mapNote(tile, t, followed));
  const word = kindWord(tileKind(tile, arena.t));
  const name = KIND_COUNT > 2 ? `Tile of ${word}` : `${word[0].toUpperCase()}${word.slice(1)} tile`;
  return [`${name}, row ${row + 1}, column ${column + 1}`, rows];
}

function arenaNote(place, t, followed) {
  const near = robotNear(place, t, Math.max(bodyRadius(arena.view) * 1.3, 12));
  if (near) return robotNote(near, t);
  const row = sampleNear(place, t, 7);
  if (row >= 0) return sampleNote(row);
  const { view } = arena;
  return tileNote(tileAt(view.toX(place.x), view.toY(place.y)), t, followed);
}

function watchArena(timeNow, whoIsFollowed, onChoose) {
  const canvas = byId("actors");
  canvas.addEventListener("pointermove", (event) => {
    const place = placeIn(canvas, event);
    liveTooltip(event, () => arenaNote(place, timeNow(), whoIsFollowed()));
    canvas.style.cursor = robotNear(place, timeNow(), 16) ? "pointer" : "default";
  });
  canvas.addEventListener("pointerleave", hideTooltip);
  canvas.addEventListener("click", (event) => {
    const place = placeIn(canvas, event), near = robotNear(place, timeNow(), 16);
    if (near) onChoose(near.robot);
    else liveTooltip(event, () => arenaNote(place, timeNow(), whoIsFollowed()));
  });
}
