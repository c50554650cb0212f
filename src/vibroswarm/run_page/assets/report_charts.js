// What robots report over time: a chart for each value, with a line for each robot and the number that it estimates.

const REPORT_HEIGHT = 78, REPORT_LEFT = 44;
const reportCharts = [];

function buildReports() {
  byId("reports-section").hidden = !run.reports.length;
  const estimates = run.reports.some(({ truth }) => truth !== null) ? " Dashed: the true number." : "";
  const shown = run.reports.length, some = shown < run.reported ? ` The first ${shown} of ${run.reported} values.` : "";
  say(byId("reports-lead"), `After its samples, a line for each robot.${estimates}${some}`);
  for (const report of run.reports) {
    const canvas = make("canvas", ""), now = make("output", "");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${report.name} of each robot over time`);
    reportCharts.push({ report, canvas, now, key: "" });
  }
  byId("reports").replaceChildren(...reportCharts.map(({ report, canvas, now }) =>
    make("figure", "", make("figcaption", "", `${report.name} `, now), canvas)));
}

function reportLimits({ values, truth }) {
  let low = Infinity, high = -Infinity;
  for (const value of [...values, ...(truth ?? []).map(([, number]) => number)]) {
    if (Number.isNaN(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return low < high ? [low, high] : low === high ? [low - 0.5, high + 0.5] : [0, 1];
}

function layOutReports() {
  for (const chart of reportCharts) {
    chart.canvas.style.width = "100%";
    chart.width = Math.max(chart.canvas.clientWidth, 80);
    chart.context = fitCanvas(chart.canvas, chart.width, REPORT_HEIGHT);
    const [low, high] = reportLimits(chart.report), span = chart.width - REPORT_LEFT - 8;
    chart.x = (t) => REPORT_LEFT + span * t / END_S;
    chart.y = (value) => 7 + (REPORT_HEIGHT - 14) * (high - value) / (high - low);
    chart.ends = [high, low];
    chart.key = "";
  }
}

// All lines, the one of the followed robot last and strong.
function drawReportLines(chart, followed) {
  const { canvas, context } = hiddenCanvas(chart.width, REPORT_HEIGHT);
  context.strokeStyle = colours["line-strong"];
  context.fillStyle = colours["ink-2"];
  context.font = `11.5px ${FONT}`;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const end of chart.ends) {
    line(context, REPORT_LEFT, crisp(chart.y(end)), chart.width - 8, crisp(chart.y(end)));
    context.fillText(reportNumber(end), REPORT_LEFT - 5, chart.y(end));
  }
  context.strokeStyle = colours.ink;
  const spans = chart.report.truth ?? [];
  context.setLineDash([5, 3]);
  spans.forEach(([since, number], k) =>
    line(context, chart.x(since), chart.y(number), chart.x(spans[k + 1]?.[0] ?? END_S), chart.y(number)));
  context.setLineDash([]);
  for (const robot of robots) {
    if (robot === followed) continue;
    context.globalAlpha = followed ? 0.25 : 0.6;
    strokeReport(context, chart, robot, 1);
  }
  context.globalAlpha = 1;
  if (followed) strokeReport(context, chart, followed, 2.2);
  chart.lines = canvas;
}

function strokeReport(context, chart, robot, weight) {
  const { values } = chart.report, times = run.samples.time_s;
  context.lineWidth = weight;
  context.beginPath();
  let y = null;
  for (let row = robot.first; row < robot.end; row++) {
    if (Number.isNaN(values[row])) continue;
    const x = chart.x(times[row]);
    if (y === null) context.moveTo(x, chart.y(values[row]));
    else context.lineTo(x, y);
    y = chart.y(values[row]);
    context.lineTo(x, y);
  }
  if (y !== null) context.lineTo(chart.x(END_S), y);
  context.stroke();
}

const reportNumber = (value) => String(Number(value.toPrecision(3)));

// The last value that a robot had reported by a time; null before the first.
function reportAt(report, robot, t) {
  for (let row = latestSample(robot, t); row >= robot.first; row--)
    if (!Number.isNaN(report.values[row])) return report.values[row];
  return null;
}

function drawReports(t, followed) {
  for (const chart of reportCharts) {
    const key = `followed: ${followed ? followed.id : "none"}`;
    if (chart.key !== key) drawReportLines(chart, followed);
    chart.key = key;
    const { context, width, lines } = chart, x = chart.x(t);
    context.clearRect(0, 0, width, REPORT_HEIGHT);
    context.drawImage(lines, 0, 0, width, REPORT_HEIGHT);
    context.strokeStyle = colours.ink;
    context.lineWidth = 1.5;
    line(context, x, 3, x, REPORT_HEIGHT - 3);
    const told = (followed ? [followed] : robots).map((robot) => reportAt(chart.report, robot, t)).filter((v) => v !== null);
    const words = told.length ? reportNumber(meanOf(told)) : "none yet";
    say(chart.now, followed ? `robot ${followed.name}: ${words}` : `mean ${words}`);
  }
}
