// The beliefs of many robots as one band: the middle 80 % of them, and their mean.

const BAND_SHARE = 0.8, BAND_STEP = 2; // px between the points of the band

// Low end, high end and mean of the band at even steps of the chart.
function beliefBand(box) {
  const count = Math.max(Math.ceil(box.width / BAND_STEP), 1), cut = (1 - BAND_SHARE) / 2;
  return Array.from({ length: count + 1 }, (_, i) => {
    const t = END_S * i / count;
    const beliefs = robots.map((robot) => mindAt(robot, t).belief).sort((a, b) => a - b);
    const skipped = Math.floor(cut * beliefs.length + 1e-9);
    return { t, low: beliefs[skipped], high: beliefs[beliefs.length - 1 - skipped], mean: meanOf(beliefs) };
  });
}

function drawBand(context, box, band, strength) {
  context.globalAlpha = 0.3 * strength;
  context.fillStyle = colours["ink-2"];
  context.beginPath();
  for (const { t, high } of band) context.lineTo(box.x(t), box.y(high));
  for (const { t, low } of [...band].reverse()) context.lineTo(box.x(t), box.y(low));
  context.fill();
  context.globalAlpha = strength;
  context.strokeStyle = colours.ink;
  context.lineWidth = 2;
  context.lineJoin = "round";
  context.beginPath();
  for (const { t, mean } of band) context.lineTo(box.x(t), box.y(mean));
  context.stroke();
  context.globalAlpha = 1;
}

const bandSentence = () => (isCrowd ? ` Band: the middle ${percent(BAND_SHARE)} of the robots; line: their mean. `
  + "Point at the chart for one robot's line." : "");
