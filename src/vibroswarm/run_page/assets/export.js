// Pictures, videos and data to keep: made in the browser, and saved like a download.

const STRIP = 30; // CSS pixels below floor and scale bar for the title and the time
const VIDEO_TYPES = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm"];

function save(blob, ending) {
  const link = make("a", ""), name = run.title.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "run";
  link.href = URL.createObjectURL(blob);
  link.download = `${name}.${ending}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// The floor as it is seen now, with title and time below it, onto a canvas of its own.
function composePicture(canvas, t) {
  const { width, height } = arena.view, below = height + SCALE_STRIP;
  const context = fitCanvas(canvas, width, below + STRIP);
  context.fillStyle = colours.paper;
  context.fillRect(0, 0, width, below + STRIP);
  for (const id of ["floor", "past", "actors"]) {
    const layer = byId(id);
    if (layer.style.visibility === "hidden") continue;
    context.globalAlpha = Number(getComputedStyle(layer).opacity);
    context.drawImage(layer, 0, 0, width, height);
  }
  context.globalAlpha = 1;
  context.drawImage(byId("scale"), 0, height, width, SCALE_STRIP);
  context.font = `13px ${FONT}`;
  context.textBaseline = "middle";
  context.fillStyle = colours.ink;
  context.textAlign = "right";
  context.fillText(bothTimes(t), width - 8, below + STRIP / 2);
  context.textAlign = "left";
  context.fillText(run.title, 8, below + STRIP / 2, width - 16 - 1.1 * context.measureText(bothTimes(t)).width);
}

function savePicture(t) {
  const canvas = document.createElement("canvas");
  composePicture(canvas, t);
  canvas.toBlob((blob) => save(blob, "png"), "image/png");
}

// All samples as CSV, one a line, sorted by robot and sample.
function samplesCsv() {
  const names = Object.keys(run.samples), columns = names.map((name) => run.samples[name]);
  const said = (name, value) => (Number.isNaN(value) || (name === "message" && value > 1) ? "" : String(value));
  const rows = Array.from({ length: columns[0].length }, (_, row) => (
    columns.map((column, i) => said(names[i], column[row])).join(",")));
  return `${[names.join(","), ...rows].join("\n")}\n`;
}

const video = { recorder: null, canvas: null };

// Records what is seen from now on, until it is pressed again; the bits come from the browser's own recorder.
function toggleVideo(t, onStop) {
  if (video.recorder) return video.recorder.stop();
  const type = VIDEO_TYPES.find((one) => MediaRecorder.isTypeSupported(one)), parts = [];
  video.canvas = document.createElement("canvas");
  composePicture(video.canvas, t);
  video.recorder = new MediaRecorder(video.canvas.captureStream(30), { mimeType: type });
  video.recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
  video.recorder.addEventListener("stop", () => {
    video.recorder = null;
    say(byId("video"), "Video");
    save(new Blob(parts, { type: "video/webm" }), "webm");
    onStop();
  });
  video.recorder.start();
  say(byId("video"), "Stop and save video");
}

function buildExport(timeNow, play, pause) {
  byId("picture").addEventListener("click", () => savePicture(timeNow()));
  byId("data").addEventListener("click", () => save(new Blob([samplesCsv()], { type: "text/csv" }), "csv"));
  const canRecord = typeof MediaRecorder === "function" && VIDEO_TYPES.some((one) => MediaRecorder.isTypeSupported(one));
  byId("video").hidden = !canRecord;
  byId("video").addEventListener("click", () => {
    toggleVideo(timeNow(), pause);
    if (video.recorder?.state === "recording") play();
  });
}

function recordFrame(t) {
  if (video.recorder) composePicture(video.canvas, t);
}
