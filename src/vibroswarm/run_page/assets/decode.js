// Reading the numbers that were packed into the page.

const COLUMN_TYPES = {
  u1: Uint8Array, i1: Int8Array, u2: Uint16Array, u4: Uint32Array, i4: Int32Array,
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

// Variable-length integers, least significant seven bits first, zigzag for the sign.
function decodeIntegers(base64) {
  const bytes = bytesOf(base64);
  const values = [];
  for (let i = 0; i < bytes.length;) {
    let value = 0, scale = 1, byte;
    do {
      byte = bytes[i++];
      value += (byte & 127) * scale;
      scale *= 128;
    } while (byte & 128);
    values.push(value % 2 ? -(value + 1) / 2 : value / 2);
  }
  return values;
}

// One robot's knots: time, x, y, heading and kind, each a column.
function decodeTrack(packed, poses) {
  const n = packed.knots;
  const integers = decodeIntegers(packed.bytes);
  const quanta = [poses.time_quantum_s, poses.position_quantum_m, poses.position_quantum_m, poses.heading_quantum_rad];
  const columns = quanta.map(() => new Float64Array(n));
  const sums = [0, 0, 0, 0];
  const kind = new Uint8Array(n);
  for (let i = 0; i < n; i++) {
    for (let c = 0; c < 4; c++) {
      sums[c] += integers[5 * i + c];
      columns[c][i] = sums[c] * quanta[c];
    }
    kind[i] = integers[5 * i + 4];
  }
  const [time, x, y, heading] = columns;
  return { time, x, y, heading, kind };
}

function readRun() {
  const data = JSON.parse(document.getElementById("run-data").textContent);
  const samples = {};
  for (const [name, packed] of Object.entries(data.samples)) samples[name] = decodeColumn(packed);
  const reports = (data.reports ?? []).map((report) => ({ ...report, values: decodeColumn(report.values) }));
  const tracks = new Map(data.poses.robots.map((packed) => [packed.robot, decodeTrack(packed, data.poses)]));
  const places = data.places && Object.fromEntries(
    Object.entries(data.places).map(([name, packed]) => [name, decodeColumn(packed)]));
  const maps = data.maps && { ...data.maps, beliefs: decodeColumn(data.maps.beliefs) };
  return { ...data, samples, reports, tracks, places, maps };
}
