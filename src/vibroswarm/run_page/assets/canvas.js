// Canvases in CSS pixels, crisp on every screen.

const FONT = '"Roboto embedded", system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif';

const pixelRatio = () => Math.min(Math.max(window.devicePixelRatio || 1, 1), 3);

// Gives a canvas a size in CSS pixels; returns its context, whose unit is then one CSS pixel.
function fitCanvas(canvas, width, height) {
  const ratio = pixelRatio();
  canvas.width = Math.max(Math.round(width * ratio), 1);
  canvas.height = Math.max(Math.round(height * ratio), 1);
  if (canvas.style) {
    canvas.style.width = `${width}px`;
    canvas.style.height = `${height}px`;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}

function hiddenCanvas(width, height) {
  const canvas = document.createElement("canvas");
  return { canvas, context: fitCanvas(canvas, width, height) };
}

const stamped = new Map();

// Words drawn once and put down as a picture, centred, on whole device pixels: to name a font on a canvas that is
// shown makes the browser work out all styles anew. With a halo, a line of that colour runs round the letters.
function stampWords(context, text, x, y, size, colour, halo = null) {
  const ratio = pixelRatio(), key = [text, size, colour, halo, ratio].join("|");
  if (!stamped.has(key)) stamped.set(key, wordsPicture(text, size, colour, halo));
  const { canvas, width, height } = stamped.get(key), snap = (value) => Math.round(value * ratio) / ratio;
  context.drawImage(canvas, snap(x - width / 2), snap(y - height / 2), width, height);
}

function wordsPicture(text, size, colour, halo) {
  const font = `700 ${size}px ${FONT}`, ruler = hiddenCanvas(1, 1).context, ratio = pixelRatio();
  ruler.font = font;
  const width = Math.ceil((ruler.measureText(text).width + 8) * ratio) / ratio;
  const height = Math.ceil((size * 1.4 + 6) * ratio) / ratio;
  const { canvas, context } = hiddenCanvas(width, height);
  Object.assign(context, { font, textAlign: "center", textBaseline: "middle", lineJoin: "round", lineWidth: 3 });
  if (halo) {
    context.strokeStyle = halo;
    context.strokeText(text, width / 2, height / 2);
  }
  context.fillStyle = colour;
  context.fillText(text, width / 2, height / 2);
  return { canvas, width, height };
}

// Half a device pixel off, so that a thin line fills whole pixels.
function crisp(value) {
  const ratio = pixelRatio();
  return (Math.round(value * ratio) + 0.5) / ratio;
}

function line(context, x0, y0, x1, y1) {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}

// Waves that fill what vibrates, on the floor and in charts: a pattern in CSS pixels.
function wavePattern(context, colour, length, gap, weight) {
  const ratio = pixelRatio();
  const { canvas, context: brush } = hiddenCanvas(length, gap);
  brush.strokeStyle = colour;
  brush.lineWidth = weight;
  brush.beginPath();
  for (let x = -2; x <= length + 2; x += 0.5) {
    brush.lineTo(x, gap / 2 + gap * 0.22 * Math.sin(2 * Math.PI * x / length));
  }
  brush.stroke();
  const pattern = context.createPattern(canvas, "repeat");
  pattern.setTransform(new DOMMatrix([length / canvas.width, 0, 0, gap / canvas.height, 0, 0]));
  return pattern;
}

// Straight lines at an angle, in degrees.
function linePattern(context, colour, gap, angle) {
  const { canvas, context: brush } = hiddenCanvas(gap, gap);
  brush.strokeStyle = colour;
  brush.globalAlpha = 0.5;
  line(brush, 0, gap / 2, gap, gap / 2);
  const pattern = context.createPattern(canvas, "repeat");
  pattern.setTransform(new DOMMatrix().rotate(angle).scale(gap / canvas.width, gap / canvas.height));
  return pattern;
}
