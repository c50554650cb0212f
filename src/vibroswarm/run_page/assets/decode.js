// Reading the numbers that were packed into the page.

const COLUMN_TYPES = {
  u1: Uint8Array, i1: Int8Array, u2: Uint16Array, i2: Int16Array, u4: Uint32Array, i4: Int32Array,
  f4: Float32Array, f8: Float64Array,
};

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

function decodeColumn(packed) {
  return new COLUMN_TYPES[packed.type](bytesOf(packed.bytes).buffer);
}

// One robot's poses: time, x, y, heading and kind, each a column.
function decodeTrack(packed, poses) {
  const scaled = (column, unit) => Float64Array.from(decodeColumn(column), (value) => value * unit);
  return {
    time: decodeColumn(packed.time), x: scaled(packed.x, poses.position_m), y: scaled(packed.y, poses.position_m),
    heading: scaled(packed.heading, poses.heading_rad), kind: decodeColumn(packed.kind),
  };
}

function readRun() {
  const data = JSON.parse(document.getElementById("run-data").textContent);
  const samples = {};
  for (const [name, packed] of Object.entries(data.samples)) samples[name] = decodeColumn(packed);
  const tracks = new Map(data.poses.robots.map((packed) => [packed.robot, decodeTrack(packed, data.poses)]));
  const places = data.places && Object.fromEntries(
    Object.entries(data.places).map(([name, packed]) => [name, decodeColumn(packed)]));
  const maps = data.maps && { ...data.maps, beliefs: decodeColumn(data.maps.beliefs) };
  return { ...data, samples, tracks, places, maps };
}
