// A card for each robot: its Beta density over the fill ratio, the boundary, the truth, alpha and beta.

const CARD_HEIGHT = 62, AXIS_HEIGHT = 15;
const cards = [];
const axes = new Map(); // pictures of the axis, by width and window

function buildCards(onChoose) {
  byId("posterior-title").parentElement.hidden = !hasPosterior;
  if (!hasPosterior) return;
  for (const robot of robots) {
    const canvas = make("canvas", "");
    canvas.setAttribute("aria-hidden", "true");
    const belief = make("span", "card-p"), alpha = make("span", "card-alpha"), beta = make("span", "card-beta");
    const pip = make("span", "pip", robot.name);
    const button = make("button", "card",
      make("span", "card-head", make("span", "unseen", "Robot "), pip,
        ...(hasBelief ? [make("span", "card-belief", "p ", belief)] : [])),
      canvas,
      make("span", "card-foot", make("span", "", "\u03b1 ", alpha), make("span", "", "\u03b2 ", beta)));
    button.type = "button";
    button.addEventListener("click", () => onChoose(robot));
    cards.push({ robot, button, canvas, belief, alpha, beta, pip, key: "" });
  }
  byId("cards").replaceChildren(...cards.map((card) => card.button));
}

// Columns as even as the width allows: ten cards stand in two rows of five, not in six and four.
function cardColumns() {
  const most = Math.max(Math.floor((byId("cards").clientWidth + 8) / 108), 1);
  const rows = Math.ceil(cards.length / most);
  return Math.ceil(cards.length / rows) || 1;
}

function layOutCards() {
  axes.clear();
  if (!cards.length) return;
  byId("cards").style.gridTemplateColumns = `repeat(${cardColumns()}, minmax(0, 1fr))`;
  for (const card of cards) {
    card.canvas.style.width = "100%";
    card.width = Math.max(card.canvas.clientWidth, 20);
  }
  for (const card of cards) {
    card.context = fitCanvas(card.canvas, card.width, CARD_HEIGHT + AXIS_HEIGHT);
    card.waves = wavePattern(card.context, colours.vibrating, 8, 4, 1);
    card.key = "";
  }
}

function drawCards(t, followed) {
  if (!cards.length) return;
  const minds = robots.map((robot) => mindAt(robot, t));
  const frame = shapeWindow(minds);
  cards.forEach((card, i) => {
    const mind = minds[i], key = `${mind.samples}/${frame.low}/${frame.high}`;
    if (key === card.key) return;
    card.key = key;
    drawDensity(card, mind, frame);
  });
  // Words after all pictures: each change between them would have the browser work out styles again.
  cards.forEach((card, i) => {
    const mind = minds[i];
    say(card.alpha, String(mind.alpha));
    say(card.beta, String(mind.beta));
    say(card.belief, probability(mind.belief));
    mark(card.pip, "data-decision", String(mind.decision));
    mark(card.button, "aria-pressed", String(card.robot === followed));
  });
}

function drawDensity(card, mind, frame) {
  const { context, width } = card;
  const x = (f) => 1 + (width - 2) * (f - frame.low) / (frame.high - frame.low);
  const floor = CARD_HEIGHT - 1, tall = CARD_HEIGHT - 9;
  context.clearRect(0, 0, width, CARD_HEIGHT + AXIS_HEIGHT);
  const steps = Math.max(Math.round(width / 1.5), 40);
  const heights = betaShape(mind.alpha, mind.beta, frame.low, frame.high, steps);
  const split = x(run.rule.tested);
  for (const [from, to, fills] of [
    [0, split, [colours["still-soft"]]], [split, width, [colours["vibrating-soft"], card.waves]],
  ]) {
    context.save();
    context.beginPath();
    context.rect(from, 0, to - from, CARD_HEIGHT);
    context.clip();
    densityPath(context, heights, width, floor, tall);
    for (const fill of fills) {
      context.fillStyle = fill;
      context.fill();
    }
    context.restore();
  }
  densityPath(context, heights, width, floor, tall);
  context.strokeStyle = colours.ink;
  context.lineWidth = 1.4;
  context.stroke();
  const key = `${width}/${frame.low}/${frame.high}`;
  if (!axes.has(key)) {
    const { canvas, context: brush } = hiddenCanvas(width, CARD_HEIGHT + AXIS_HEIGHT);
    drawDensityAxis(brush, width, floor, x, frame);
    axes.set(key, canvas);
  }
  context.drawImage(axes.get(key), 0, 0, width, CARD_HEIGHT + AXIS_HEIGHT);
}

function densityPath(context, heights, width, floor, tall) {
  const n = heights.length - 1;
  context.beginPath();
  context.moveTo(1, floor);
  heights.forEach((height, i) => context.lineTo(1 + (width - 2) * i / n, floor - tall * height));
  context.lineTo(width - 1, floor);
}

// The axis, the boundary (a line) and the truth (a triangle under the axis, dashes above it).
function drawDensityAxis(context, width, floor, x, frame) {
  context.lineWidth = 1;
  context.strokeStyle = colours["line-strong"];
  line(context, 0, crisp(floor), width, crisp(floor));
  context.strokeStyle = colours.ink;
  line(context, crisp(x(run.rule.tested)), 0, crisp(x(run.rule.tested)), floor + 3);
  const truth = x(run.truth.ones);
  context.setLineDash([2, 2]);
  line(context, crisp(truth), 4, crisp(truth), floor);
  context.setLineDash([]);
  context.fillStyle = colours.ink;
  context.beginPath();
  for (const [dx, dy] of [[0, 1], [4, 8], [-4, 8]]) context.lineTo(truth + dx, floor + dy);
  context.fill();
  context.font = `10.5px ${FONT}`;
  context.fillStyle = colours["ink-2"];
  context.textBaseline = "top";
  const ends = [[frame.low, 0, "left"], [frame.high, width, "right"]];
  for (const [value, end, align] of ends.filter(([, end]) => Math.abs(truth - end) > 26)) {
    context.textAlign = align;
    context.fillText(String(Number(value.toFixed(3))), end, floor + 4);
  }
}
