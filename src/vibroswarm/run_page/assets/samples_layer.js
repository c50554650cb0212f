// All samples taken by now: a canvas of its own, to which new marks are only added; redrawn on going back.

const FRESH_S = 12; // a sample stands out for so long

const STAGES = 8; // pictures kept of the layer at even steps, so that a jump back redraws little

const pastLayer = { context: null, view: null, sprites: null, drawn: 0, stages: [] };

function resetPast(context, view) {
  Object.assign(pastLayer, { context, view, sprites: sampleSprites(view), drawn: 0, stages: [] });
  const step = Math.ceil(sampleTimes.length / STAGES) || 1;
  const { canvas, context: brush } = hiddenCanvas(view.width, view.height);
  for (let count = step; count < sampleTimes.length; count += step) {
    stampSamples(brush, count - step, count);
    const stage = hiddenCanvas(view.width, view.height);
    stage.context.drawImage(canvas, 0, 0, view.width, view.height);
    pastLayer.stages.push({ count, canvas: stage.canvas });
  }
  context.clearRect(0, 0, view.width, view.height);
}

const sampleSize = (view) => Math.min(Math.max(view.scale * 0.0042, 1.6), 3.4);

// The marks of all kinds, and those of misread ones, drawn once each: they are put down thousands of times.
function sampleSprites(view) {
  const size = sampleSize(view), side = Math.ceil(size * 5);
  return Array.from({ length: 2 * KIND_COUNT }, (_, code) => {
    const { canvas, context } = hiddenCanvas(side, side);
    drawSampleMark(context, side / 2, side / 2, size, code % KIND_COUNT, code >= KIND_COUNT);
    return { canvas, side };
  });
}

// Puts down the marks from one place in the order of time to another, on whole device pixels.
function stampSamples(context, from, to) {
  const { view, sprites } = pastLayer, ratio = pixelRatio(), s = run.samples;
  const snap = (value) => Math.round(value * ratio) / ratio;
  for (let i = from; i < to; i++) {
    const row = samplesByTime[i];
    const { canvas, side } = sprites[s.observation[row] + (isMisread(row) ? KIND_COUNT : 0)];
    context.drawImage(canvas, snap(view.x(s.x_m[row]) - side / 2), snap(view.y(s.y_m[row]) - side / 2), side, side);
  }
}

function drawPast(t) {
  const { context, view, stages } = pastLayer;
  const count = lastAtMost(sampleTimes, t - FRESH_S, 0, sampleTimes.length) + 1;
  const stage = stages.filter((known) => known.count <= count).pop();
  if (count < pastLayer.drawn || (stage && stage.count > pastLayer.drawn)) {
    context.clearRect(0, 0, view.width, view.height);
    pastLayer.drawn = stage ? stage.count : 0;
    if (stage) context.drawImage(stage.canvas, 0, 0, view.width, view.height);
  }
  stampSamples(context, pastLayer.drawn, count);
  pastLayer.drawn = count;
}

// Samples of the last seconds: larger, and shrinking to their place among the others.
function drawFresh(context, view, t) {
  const size = sampleSize(view);
  const last = lastAtMost(sampleTimes, t, 0, sampleTimes.length);
  for (let i = last; i >= 0 && sampleTimes[i] > t - FRESH_S; i--) {
    const row = samplesByTime[i];
    const age = (t - sampleTimes[i]) / FRESH_S;
    const x = view.x(run.samples.x_m[row]), y = view.y(run.samples.y_m[row]);
    context.globalAlpha = 1;
    drawSampleMark(context, x, y, size * (1.75 - 0.75 * age), run.samples.observation[row], isMisread(row));
  }
}
